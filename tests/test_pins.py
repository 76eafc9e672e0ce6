"""CI installs by hash what the package asks for: one file each, within the limits of pyproject.toml."""

from __future__ import annotations

import re
import runpy
import tomllib
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
PIN = runpy.run_path(str(ROOT / ".ci" / "pin"))


def pins() -> dict[str, str]:
    """Versions by name."""
    lines = PIN["PINS"].read_text(encoding="utf-8").splitlines()[1:]
    found = [re.fullmatch(r"([\w.-]+)==(\S+) --hash=sha256:[0-9a-f]{64}", line) for line in lines]
    assert all(found)
    return {canonicalize_name(one[1]): one[2] for one in found if one}


def test_every_package_that_setup_asks_for_is_pinned_within_its_limits() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = PIN["EXTRAS"].split(",")
    asked = project["dependencies"] + [one for extra in extras for one in project["optional-dependencies"][extra]]
    found = pins()
    wrong = []
    for one in map(Requirement, asked):
        version = found.get(canonicalize_name(one.name))
        if one.name != project["name"] and (version is None or version not in one.specifier):
            wrong.append(f"{one}: {version}")
    assert wrong == [], "run: .venv/bin/python .ci/pin"


def test_the_extras_are_those_of_setup() -> None:
    told = re.findall(r"--editable '\.\[([\w,]+)\]'", (ROOT / "Makefile").read_text(encoding="utf-8"))
    assert sorted(",".join(told).split(",")) == sorted(PIN["EXTRAS"].split(","))
