"""C++ sources of the package as libraries: built where there is a compiler, kept, and needed by nothing.

    source → SHA-256 of source, compiler and flags → a file of that name in the cache folder (`compile.cache`)

A library is put there by a rename, so that processes may build it at the same time. Without a compiler or a cache
folder `library` raises a `NotCompiledError`; each source has a Python counterpart that gives the same answers.

Products and sums are rounded one by one, as in Python (no fused multiply-add), which makes the answers the same.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import hashlib
import os
import shutil
import subprocess
import tempfile
import threading
from pathlib import Path

from maxjax.compile.cache import VARIABLE, cache_folder

COMPILERS = ("c++", "g++", "clang++")
# `-march=native` gains nothing here.
FLAGS = ("-std=c++17", "-O3", "-ffp-contract=off", "-shared", "-fPIC")
_SECONDS = 60  # that a compiler may take; a process that ends waits for it


class NotCompiledError(RuntimeError):
    """There is no library of a source; the message says why."""


def library(source: Path) -> ctypes.CDLL:
    """The library of a source, built unless it is there.

    Raises:
        NotCompiledError: without a compiler, where the build fails, or where its result cannot be kept or loaded.
    """
    found = _outcome(source)
    if isinstance(found, NotCompiledError):
        raise found
    return found


def available(source: Path) -> bool:
    """Whether there is a library; the first call may build it, which takes up to a few seconds."""
    return not isinstance(_outcome(source), NotCompiledError)


def at_hand(source: Path) -> ctypes.CDLL | None:
    """The library, if that takes no waiting; the first call begins to build one that is not there, in a thread.

    A process that ends before waits for the thread, so that the next one finds the library.
    """
    ahead = _AHEAD.get(source)
    if ahead is None:
        ahead = _AHEAD[source] = threading.Thread(target=_outcome, args=(source,))
        ahead.start()
        with contextlib.suppress(NotCompiledError, OSError):
            if _place(source)[1].is_file():
                ahead.join()
    if ahead.is_alive():
        return None
    found = _outcome(source)
    return None if isinstance(found, NotCompiledError) else found


_AHEAD: dict[Path, threading.Thread] = {}


@functools.cache
def _outcome(source: Path) -> ctypes.CDLL | NotCompiledError:
    """The result of the one attempt of this process."""
    try:
        return ctypes.CDLL(str(_built(source)))
    except NotCompiledError as error:
        return error
    except (OSError, subprocess.SubprocessError) as error:
        return NotCompiledError(f"{source.name}: cannot be built or loaded: {error}")


def _built(source: Path) -> Path:
    """The library's file, compiled unless it is there."""
    compiler, path = _place(source)
    if path.is_file():
        return path
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".build-") as scratch:
        new = Path(scratch, path.name)
        command = [compiler, *FLAGS, "-o", str(new), str(source)]
        built = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=_SECONDS)
        if built.returncode:
            raise NotCompiledError(
                f"{source.name}: {Path(compiler).name} could not compile it: {built.stderr.strip()[:500]}"
            )
        os.replace(new, path)
    return path


def _place(source: Path) -> tuple[str, Path]:
    """The compiler, and where the library that it makes of a source is kept."""
    folder = cache_folder()
    if folder is None:
        raise NotCompiledError(f"{source.name}: there is no folder to keep its library in; set {VARIABLE} to one")
    compiler = next(filter(None, map(shutil.which, COMPILERS)), None)
    if compiler is None:
        raise NotCompiledError(
            f"{source.name}: expected a C++ compiler ({', '.join(COMPILERS)}) on the PATH, found none; install one, "
            "or go on with what is written in Python"
        )
    binary = Path(compiler).resolve()
    told = (str(binary), binary.stat().st_size, binary.stat().st_mtime_ns, *FLAGS)
    key = hashlib.sha256(source.read_bytes() + repr(told).encode()).hexdigest()[:24]
    return compiler, folder / f"{source.stem}-{key}.so"
