"""Provenance of a result: the sources of maxjax, versions of everything that computes, and the device it ran on."""

from __future__ import annotations

import functools
import hashlib
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import jax

_PACKAGES = ("maxjax", "jax", "jaxlib", "numpy", "scipy", "mujoco", "mujoco-mjx")
_SOURCES = Path(__file__).parents[1]


def versions() -> dict[str, str]:
    """Version by name: Python, maxjax and the packages that it computes with, as installed."""
    return {"python": platform.python_version()} | {name: _version(name) for name in _PACKAGES}


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:  # a source tree on the path
        return "not installed"


@functools.cache
def sources() -> str:
    """A digest of the sources of maxjax, installed or not: what a commit and its uncommitted changes come to."""
    digest = hashlib.sha256()
    for path in sorted(_SOURCES.rglob("*.py")):
        digest.update(f"{path.relative_to(_SOURCES)}\n".encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def device() -> str:
    """Kind and number of the devices that this process computes on, e.g. `1 x NVIDIA H200` or `1 x cpu`."""
    devices = jax.local_devices()
    return f"{len(devices)} x {devices[0].device_kind}"
