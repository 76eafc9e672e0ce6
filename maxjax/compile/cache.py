"""The folder in which compiled programs are kept from one process to the next.

    MAXJAX_CACHE    not set: `maxjax` in the user's cache folder (XDG_CACHE_HOME, else ~/.cache; macOS ~/Library/Caches)
                    off:     nothing is kept
                    else:    this folder

Executables are machine code, so each kind of machine has a folder of its own in it, and the folder is the user's alone:
who can write there can run code as the user. A folder that cannot be made or written to is as good as none. Above
`LIMIT`, what was not used for the longest time is removed.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import platform
import sys
import tempfile
from pathlib import Path

import jax

VARIABLE = "MAXJAX_CACHE"
LIMIT = 2**29
"""All files of one machine together [B]: a hundred times what one plan needs."""

_OFF = "off"


def cache_folder() -> Path | None:
    """The folder of this machine's executables, made if missing; None: nothing is kept."""
    return _usable(os.environ.get(VARIABLE) or None)


@functools.cache
def _usable(wanted: str | None) -> Path | None:
    if wanted == _OFF:
        return None
    try:
        folder = (_of_user() / "maxjax" if wanted is None else Path(wanted).expanduser()).absolute() / _machine()
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        # Asks the file system itself: permission bits do not tell of read-only disks.
        with tempfile.TemporaryFile(dir=folder):
            pass
    except (OSError, RuntimeError):  # RuntimeError: a user without a home
        return None
    return folder


def _of_user() -> Path:
    """The user's cache folder."""
    given = os.environ.get("XDG_CACHE_HOME", "")
    if os.path.isabs(given):  # others are to be ignored, as its specification says
        return Path(given)
    return Path.home() / ("Library/Caches" if sys.platform == "darwin" else ".cache")


@functools.cache
def _machine() -> str:
    """Properties of a CPU that executables depend on: kind, instructions, and the number of cores of a process.

    A home folder may be shared by machines of many kinds.
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    facts = [platform.system(), platform.machine(), platform.processor(), str(cores)]
    with contextlib.suppress(OSError):
        told = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        kinds = ("model name", "flags", "Features", "CPU part")
        facts += sorted({line for line in told if line.startswith(kinds)})
    return f"{platform.machine()}-{hashlib.sha256(chr(10).join(facts).encode()).hexdigest()[:16]}"


def trim(folder: Path, limit: int = LIMIT) -> None:
    """Remove the files that were not used for the longest time, until those left hold `limit` bytes at most."""
    found = []
    for path in folder.rglob("*"):
        with contextlib.suppress(OSError):  # another process may have removed it
            if path.is_file():
                status = path.stat()
                # Some file systems do not write down when a file is read.
                found.append((max(status.st_atime, status.st_mtime), status.st_size, path))
    total = sum(size for _, size, _ in found)
    for _, size, path in sorted(found):
        if total <= limit:
            return
        with contextlib.suppress(OSError):
            path.unlink()
            total -= size


def let_jax_keep() -> None:
    """Switch JAX's own cache on, in this folder, unless the user has given it another one or switched it off."""
    folder, settings = cache_folder(), jax.config.values
    if folder is None or settings["jax_compilation_cache_dir"] or not settings["jax_enable_compilation_cache"]:
        return
    jax.config.update("jax_compilation_cache_dir", str(folder / "jax"))
    trim(folder)
