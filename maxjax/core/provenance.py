"""What produced a result: versions of everything that computes, and the device it ran on."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

import jax

_PACKAGES = ("maxjax", "jax", "jaxlib", "numpy", "scipy", "mujoco", "mujoco-mjx")


def versions() -> dict[str, str]:
    """Version by name: Python, maxjax and the packages that it computes with, as installed."""
    return {"python": platform.python_version()} | {name: _version(name) for name in _PACKAGES}


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:  # a source tree on the path
        return "not installed"


def device() -> str:
    """Kind and number of the devices that JAX computes on, e.g. `1 x NVIDIA H200` or `1 x cpu`."""
    devices = jax.devices()
    return f"{len(devices)} x {devices[0].device_kind}"
