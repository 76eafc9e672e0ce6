"""Versions and device are what the interpreter itself says."""

from __future__ import annotations

import importlib
import sys

import jax

from maxjax.core.provenance import device, versions


def test_versions_are_those_of_the_imported_packages() -> None:
    found = versions()
    assert found["python"] == ".".join(map(str, sys.version_info[:3]))
    for name in ("jax", "jaxlib", "numpy", "scipy", "mujoco"):
        assert found[name] == importlib.import_module(name).__version__
    assert {"maxjax", "mujoco-mjx"} < set(found)


def test_device_states_number_and_kind() -> None:
    assert device() == f"{jax.device_count()} x {jax.devices()[0].device_kind}"
