"""Files: how all of them are written, and how a user's are read.

A file is written to a temporary name in its folder, flushed to the disk and renamed: a reader sees the old file or the
new one, and never a part. A file of a user is read whole, within a bound, or refused with a sentence (`FileError`).
"""

from __future__ import annotations

import contextlib
import json
import os
import secrets
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from maxjax.core.interruption import finishing

MAX_FILE_BYTES = 2**31
MAX_TEXT_BYTES = 2**28  # of JSON, XML and other text, which takes ten times as much memory while it is read

_LONGEST_LINE = 2**20


class FileError(ValueError):
    """A user's file cannot be used; the message names the file, what was found and what was expected."""


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
    """What a JSON text holds, in UTF-8.

    Raises:
        FileError: if it is none, nests too deep, or holds numbers that JSON has not (NaN, Infinity).
    """

    def refused(name: str) -> float:
        raise ValueError(f"{name} is no JSON number")

    try:
        return json.loads(content, parse_constant=refused)
    except (RecursionError, ValueError) as error:
        raise FileError(f"{path}: expected JSON: {error}") from error


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
        FileError: if it cannot be read or is too large.
    """
    try:
        if (size := path.stat().st_size) > most:
            raise FileError(f"{path}: {size} bytes, expected at most {most}; crop it")
        return path.read_bytes()
    except (OSError, ValueError) as error:
        if isinstance(error, FileError):
            raise
        raise FileError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from error
