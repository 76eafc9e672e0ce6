"""Files: how all of them are written, and how a user's are read.

A file is written to a temporary name in its folder, flushed to the disk and renamed: a reader sees the old file or the
new one, and never a part. A file of a user is a regular one, and is read whole, once, within a bound, or refused with
a sentence (`FileError`): a pipe would hang, a device never end, and a mapped file may shrink while it is read.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import secrets
import stat
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

from maxjax.core.interruption import finishing

MAX_FILE_BYTES = 2**31
MAX_TEXT_BYTES = 2**28  # of JSON, XML and other text, which takes ten times as much memory while it is read

_LONGEST_LINE = 2**20
_LONGEST_SENTENCE = 500  # characters: files may hold texts of any length


class FileError(ValueError):
    """A user's file cannot be used; the message names the file, what was found and what was expected."""


def brief(said: object) -> str:
    """The text of an error or of a file in one line of bounded length."""
    sentence = " ".join(str(said).split())
    return sentence if len(sentence) <= _LONGEST_SENTENCE else sentence[:_LONGEST_SENTENCE] + " …"


def atomic_write(path: str | os.PathLike[str], content: str | bytes) -> None:
    """Write a whole file or nothing: an existing file stays until the new one is safely on the disk.

    Args:
        path: file to create or to replace; its folder must exist.
        content: bytes, or text that is stored as UTF-8.

    Raises:
        OSError: if the file cannot be written (no such folder, no permission, disk full); nothing is left
            behind.
    """
    path = Path(path)
    # In the same folder, since only a rename within one file system is atomic.
    temporary = path.parent / f".{secrets.token_hex(8)}.tmp"
    with finishing(temporary):
        try:
            with open(temporary, "xb") as file:
                file.write(content.encode() if isinstance(content, str) else content)
                file.flush()
                # Without this, a power cut after the rename may leave an empty file under the final name.
                os.fsync(file.fileno())
            os.replace(temporary, path)
        except BaseException:
            with contextlib.suppress(OSError):
                temporary.unlink(missing_ok=True)
            raise


def parse_json(content: bytes, path: Path) -> Any:
    """Read a JSON text in UTF-8.

    Raises:
        FileError: if it is none, nests too deep, or holds numbers that JSON or a computer has not (NaN, 1e999).
    """

    def refused(name: str) -> float:
        raise ValueError(f"{name} is no JSON number")

    def finite(digits: str) -> float:
        number = float(digits)
        return number if math.isfinite(number) else refused(brief(digits))

    try:
        return json.loads(content, parse_constant=refused, parse_float=finite)
    except (RecursionError, ValueError) as error:
        raise FileError(f"{path}: expected JSON: {brief(error)}") from error


def text_lines(readline: Callable[[int], bytes], count: int, fail: Callable[[str], FileError]) -> Iterator[bytes]:
    """The next lines of a file, at most so many, of bounded length: a whole file may be one line.

    Args:
        readline: of the file, which is open at the first of them.
        count: how many.
        fail: makes the error of a sentence.

    Raises:
        FileError: for a line of 1 MiB or more.
    """
    for _ in range(count):
        line = readline(_LONGEST_LINE)
        if len(line) == _LONGEST_LINE:
            raise fail(f"expected lines of less than {_LONGEST_LINE} bytes, found a longer one; damaged")
        if not line:
            return
        yield line


def read_text(path: Path) -> bytes:
    """A text file whole; raises as `read_bytes`, from fewer bytes on."""
    return read_bytes(path, MAX_TEXT_BYTES)


def read_bytes(path: Path, most: int = MAX_FILE_BYTES) -> bytes:
    """A file whole.

    Raises:
        FileError: as `open_regular`, and if it grows beyond `most` bytes while it is read.
    """
    with open_regular(path, most) as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise FileError(f"{path}: more than {most} bytes, expected at most so many; crop it")
    return content


@contextlib.contextmanager
def open_regular(path: str | os.PathLike[str], most: int = MAX_FILE_BYTES) -> Iterator[BinaryIO]:
    """A user's file, open for reading; every file that a user names is opened here.

    Args:
        path: of the file, or of a link to it.
        most: bytes that it may have.

    Raises:
        FileError: if it is missing, cannot be read, is no regular file (a folder, pipe, socket or device) or has more
            bytes than `most`; also for what the system says while it is read.
    """
    try:
        # Looked at before it is opened, since opening alone may act on a device; and after, since a name may change.
        _check_regular(path, os.stat(path), most)
        file = os.fdopen(os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)), "rb")
    except (OSError, ValueError) as error:  # ValueError: a name that no file can have
        if isinstance(error, FileError):
            raise
        raise FileError(f"{brief(path)}: cannot be read: {getattr(error, 'strerror', None) or error}") from error
    with file:
        _check_regular(path, os.fstat(file.fileno()), most)
        try:
            yield file
        except OSError as error:
            raise FileError(f"{path}: cannot be read: {error.strerror or error}") from error


def check_regular(path: Path) -> None:
    """Refuse what a library that opens a file by its name would wait for; raises as `open_regular`."""
    with open_regular(path):
        pass


@contextlib.contextmanager
def open_to_append(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """A file open for appending, unbuffered; made if it is missing.

    Raises:
        FileError: if it is no regular file: writing to a pipe that nobody reads would wait for ever.
        OSError: if it cannot be written.
    """
    with contextlib.suppress(FileNotFoundError):
        _check_regular(path, os.stat(path))
    flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    with os.fdopen(os.open(path, flags, 0o666), "ab", buffering=0) as file:
        _check_regular(path, os.fstat(file.fileno()))
        yield file


def _check_regular(path: str | os.PathLike[str], found: os.stat_result, most: int | None = None) -> None:
    if not stat.S_ISREG(found.st_mode):
        kinds = {stat.S_IFDIR: "a folder", stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket"}
        kind = kinds.get(stat.S_IFMT(found.st_mode), "a device")
        deed = "written" if most is None else "read"
        raise FileError(f"{path}: cannot be {deed}: expected a regular file, found {kind}")
    if most is not None and found.st_size > most:
        raise FileError(f"{path}: {found.st_size} bytes, expected at most {most}; crop it")
