"""What the wheel and the sdist hold; `.ci/packages` installs and uses them."""

from __future__ import annotations

import os
import tarfile
import zipfile
from collections.abc import Callable
from email.parser import Parser
from pathlib import Path

import pytest

from maxjax.nn.architecture import CONFIGS

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Builds a "wheel" or an "sdist", as pip would."""
    hatchling = pytest.importorskip("hatchling.build", reason="no hatchling: pip install hatchling")
    folder = tmp_path_factory.mktemp("dist")

    def build(kind: str) -> Path:
        before = Path.cwd()
        os.chdir(ROOT)
        try:
            return folder / str(getattr(hatchling, f"build_{kind}")(str(folder)))
        finally:
            os.chdir(before)

    return build


def test_the_wheel_holds_the_package_and_its_licence(built: Callable[[str], Path]) -> None:
    with zipfile.ZipFile(built("wheel")) as archive:
        names = archive.namelist()
        (metadata,) = (name for name in names if name.endswith(".dist-info/METADATA"))
        told = Parser().parsestr(archive.read(metadata).decode())
    assert {Path(name).parts[0] for name in names} == {"maxjax", Path(metadata).parts[0]}
    sources = {str(path.relative_to(ROOT)) for path in (ROOT / "maxjax").rglob("*.py")}
    assert {name for name in names if name.endswith(".py")} == sources
    others = [name for name in names if name.startswith("maxjax/") and not name.endswith(".py")]
    assert {Path(name).suffix for name in others} == {".cpp", ".npz", ".typed"}
    assert "maxjax/py.typed" in others
    assert {Path(name).stem for name in others if name.endswith(".npz")} <= {*CONFIGS, "completion"}
    assert any(name.endswith(".dist-info/licenses/LICENSE") for name in names)
    assert told["License-Expression"] == "Apache-2.0"
    classifiers = told.get_all("Classifier")
    for minor in (11, 12, 13):
        assert f"Programming Language :: Python :: 3.{minor}" in classifiers


def test_the_sdist_holds_what_is_needed_to_test_it(built: Callable[[str], Path]) -> None:
    with tarfile.open(built("sdist")) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {"LICENSE", "SECURITY.md", "README.md", "pyproject.toml", ".ci/run", ".ci/packages"} <= names
    assert {str(path.relative_to(ROOT)) for path in (ROOT / "tests").rglob("*.py")} <= names
    assert "docs/samples/quarter.geojson" in names
    left = [name for name in names if "__pycache__" in name or name.endswith((".pyc", ".partial"))]
    assert left == []
