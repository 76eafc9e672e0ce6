"""Importing MJX says nothing about packages that nothing here needs, and all else on stderr."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import mujoco
import pytest

from maxjax.sim.worlds.geoms import BOX, CAPSULE, ELLIPSOID, PLANE, SPHERE

_STAND_IN = """
print("Failed to import warp: No module named 'warp'")
print("Failed to import mujoco_warp: No module named 'warp'")
print("Failed to find a file")
"""


def test_the_geom_types_are_mujocos() -> None:
    kinds = mujoco.mjtGeom
    expected = (kinds.mjGEOM_PLANE, kinds.mjGEOM_SPHERE, kinds.mjGEOM_CAPSULE, kinds.mjGEOM_ELLIPSOID, kinds.mjGEOM_BOX)
    assert tuple(map(int, expected)) == (PLANE, SPHERE, CAPSULE, ELLIPSOID, BOX)


@pytest.mark.parametrize("real", [True, False])
def test_only_the_missing_warp_is_not_told(real: bool, tmp_path: Path) -> None:
    lines = "from maxjax.sim.worlds.mjx_import import import_mjx; print(import_mjx().__name__)"
    if not real:  # a package that prints what MJX prints, and more
        (tmp_path / "mujoco").mkdir()
        (tmp_path / "mujoco" / "__init__.py").touch()
        (tmp_path / "mujoco" / "mjx.py").write_text(_STAND_IN)
        lines = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); {lines}"
    done = subprocess.run([sys.executable, "-c", lines], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["mujoco.mjx"]
    assert "warp" not in done.stderr
    assert ("Failed to find a file" in done.stderr) == (not real)
