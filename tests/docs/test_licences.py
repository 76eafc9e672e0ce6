"""What users install is under permissive licences; what is not stands in extras of developers, by name."""

from __future__ import annotations

import tomllib

from test_site import ROOT, tool

licences = tool("licences")

# For benchmarks, tests and documentation alone; docutils gives a choice.
COPYLEFT = {"casadi", "dijkstra3d", "docutils", "evo", "pymavlink"}


def test_what_users_install_is_permissive() -> None:
    users = [one for one in licences.found() if one.users]
    assert {"jax", "mujoco", "numpy", "pyproj", "scipy", "tyro"} <= {one.name for one in users}
    for one in users:
        assert licences.PERMISSIVE.search(one.licence), one
        assert not licences.COPYLEFT.search(one.licence), one


def test_copyleft_stands_in_no_extra_of_users() -> None:
    found = licences.found()
    assert {one.name for one in found if licences.COPYLEFT.search(one.licence)} <= COPYLEFT
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    asked = [project["dependencies"], *(project["optional-dependencies"][extra] for extra in licences.USERS)]
    assert not [text for texts in asked for text in texts for name in COPYLEFT if text.startswith(name)]


def test_the_table_has_a_row_for_each() -> None:
    assert len(licences.table().splitlines()) == 2 + len(licences.found())
