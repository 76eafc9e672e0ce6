"""One list of methods: what it says of each is true, and the command line knows no others."""

from __future__ import annotations

import sys
from typing import get_args, get_type_hints

import pytest

from maxjax.cli.options import FlyOptions, PlanOptions
from maxjax.methods import METHODS, method_named
from maxjax.planning.field_planner import Climb


def test_what_it_says_of_each_is_true() -> None:
    for name, method in METHODS.items():
        assert method.name == name
        assert method.label
        if method.needs is None:
            method.check()
            assert isinstance(method.finder(), Climb) == method.climbs
            assert method.finder() == method.finder()  # so that nothing is compiled twice
        if method.flies:
            assert method.flying() == method.flying()
        else:
            with pytest.raises(ValueError, match=f"expected one that can fly, given '{name}'"):
                method.flying()


def test_the_command_line_offers_the_same() -> None:
    assert get_args(get_type_hints(PlanOptions)["method"]) == tuple(METHODS)
    assert get_args(get_type_hints(FlyOptions)["method"]) == tuple(name for name, one in METHODS.items() if one.flies)


@pytest.mark.parametrize("name", ["dijkstra", None, 3, ["solver"]])
def test_an_unknown_name_is_told(name: object) -> None:
    with pytest.raises(ValueError, match="method: expected one of solver, network, astar, rrtstar, apf, given "):
        method_named(name)


def test_a_missing_package_is_told_before_anything_is_planned(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ompl", None)
    with pytest.raises(ImportError, match=r"'rrtstar' needs ompl, from the extra bench: pip install 'maxjax\[bench\]'"):
        method_named("rrtstar")
