"""One table of planners: what it says of each is true, and the command line knows no others."""

from __future__ import annotations

import sys
from typing import get_args, get_type_hints

import pytest

from maxjax.planning.planner import Planner, check_planner, pure_route
from maxjax.planning.run.field_planner import FieldPlanner
from maxjax.ui.cli.options import FlyOptions, PlanOptions
from maxjax.ui.methods import ALIASES, METHODS, climbs, label_of, method_named, planner_named


@pytest.mark.parametrize("name", list(METHODS))
def test_what_it_says_of_each_is_true(name: str) -> None:
    if name == "rrtstar":
        pytest.importorskip("ompl", reason="RRT* is OMPL's: pip install 'maxjax[bench]'")
    planner = planner_named(name)
    assert isinstance(planner, Planner)
    assert check_planner(planner) is planner
    assert planner.name == METHODS[name].name == name
    assert label_of(name)
    assert isinstance(planner, FieldPlanner) == climbs(name) == planner.batched
    # Equal values, so that nothing is compiled twice.
    assert planner == planner_named(name)
    assert hash(planner) == hash(planner_named(name))
    assert pure_route(planner) == pure_route(planner_named(name))


def test_the_command_line_offers_the_same_and_other_words_for_them() -> None:
    for options in (PlanOptions, FlyOptions):
        assert get_args(get_type_hints(options)["method"]) == (*METHODS, *ALIASES)
    for word, name in ALIASES.items():
        assert method_named(word) is METHODS[name]
        assert label_of(word) == label_of(name)


def test_the_name_of_a_strangers_planner_is_its_label() -> None:
    assert label_of("prm") == "prm"
    assert not climbs("prm")


@pytest.mark.parametrize("name", ["dijkstra", None, 3, ["field"]])
def test_an_unknown_name_is_told(name: object) -> None:
    with pytest.raises(ValueError, match="method: expected one of field, network, astar, rrtstar, apf, given "):
        method_named(name)


def test_a_missing_package_is_told_before_anything_is_planned(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ompl", None)
    with pytest.raises(ImportError, match=r"needs ompl, from the extra bench: pip install 'maxjax\[bench\]'"):
        planner_named("rrtstar")
