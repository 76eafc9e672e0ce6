"""The public names: all there, and imported only when they are used."""

from __future__ import annotations

import subprocess
import sys

import pytest

import maxjax


def test_each_public_name_has_one_module_and_can_be_imported() -> None:
    named = sorted(name for names in maxjax._MODULES.values() for name in names)
    assert named == sorted(maxjax.__all__)
    for module, names in maxjax._MODULES.items():
        for name in names:
            assert getattr(maxjax, name) is getattr(sys.modules[module], name)
    assert set(maxjax.__all__) <= set(dir(maxjax))


def test_other_names_are_attribute_errors() -> None:
    with pytest.raises(AttributeError, match="module 'maxjax' has no attribute 'plann'"):
        maxjax.plann  # noqa: B018
    with pytest.raises(ImportError, match="plann"):
        from maxjax import plann  # noqa: F401


def test_importing_the_package_loads_no_jax() -> None:
    script = "import sys, maxjax; print('jax' in sys.modules); maxjax.Grid; print('jax' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True"]
