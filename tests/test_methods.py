"""One table of planners: what it says of each is true, and the command line knows no others."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
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
        hint = get_type_hints(options, include_extras=True)["method"]
        (how,) = (one for one in get_args(hint) if hasattr(one, "metavar"))
        assert how.metavar == "{" + ",".join((*METHODS, *ALIASES)) + "}|MODULE:CLASS"
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


OWN = """
import dataclasses
import jax.numpy as jnp
from maxjax import Route

@dataclasses.dataclass(frozen=True)
class Straight:
    level: float = 0.0
    name: str = "straight"
    batched: bool = True

    def route(self, problem):
        return Route(jnp.stack([problem.start, problem.goal]), problem.status, jnp.array(False))

class Rooms:
    inner = Straight(level=2.0)

class Needy(Straight):
    def __init__(self, level):
        pass

class Nameless:
    batched = True
    def route(self, problem): ...

class Wordless:
    name, batched = "wordless", True

class Wavering:
    name, batched = "wavering", "yes"
    def route(self, problem): ...

class Fluid(Straight):
    __hash__ = None
high = Straight(level=5.0)
usurper = Straight(name="field")
"""


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A module in the working directory, which Python's path does not hold."""
    name = "planners_of_my_own"
    (tmp_path / f"{name}.py").write_text(OWN)
    (tmp_path / "planner_that_breaks.py").write_text("1 / 0")
    (tmp_path / "planner_that_needs.py").write_text("import a_package_that_nobody_has")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [place for place in sys.path if place])
    yield name
    for module in (name, "planner_that_breaks", "planner_that_needs"):
        sys.modules.pop(module, None)


def test_a_planner_of_ones_own_is_found_by_its_import_path(own: str) -> None:
    planner = planner_named(f"{own}:Straight")
    assert check_planner(planner) is planner
    assert planner == planner_named(f"{own}:Straight")
    assert (planner.name, climbs(f"{own}:Straight")) == ("straight", False)
    for place, level in (("high", 5.0), ("Rooms.inner", 2.0)):
        assert planner_named(f"{own}:{place}").level == level  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("nowhere_at_all:Straight", "expected a module nowhere_at_all, found none in "),
        ("planners_of_my_own.deeper:Straight", "expected a module planners_of_my_own.deeper, found none"),
        ("planner_that_breaks:Any", "planner_that_breaks does not load: ZeroDivisionError: division by zero"),
        ("planner_that_needs:Any", "needs a_package_that_nobody_has, which is not installed"),
        ("planners_of_my_own:Curved", "expected Curved in planners_of_my_own, found Straight, "),
        ("planners_of_my_own:Needy", "expected a class that takes no arguments, or the name of a value: "),
        ("planners_of_my_own:Nameless", "expected a planner with name, batched, route, given a Nameless without name;"),
        ("planners_of_my_own:Wordless", "given a Wordless without route;"),
        ("planners_of_my_own:OWN", "expected OWN in planners_of_my_own"),
        ("planners_of_my_own:jnp", "given a module without name, batched, route;"),
        ("planners_of_my_own:Wavering", "batched as True or False and route(problem) as a function, given batched ="),
        ("planners_of_my_own:usurper", "expected a name of its own, given 'field', which is a planner of maxjax"),
        ("planners_of_my_own:Fluid", "expected a planner with a hash"),
    ],
)
def test_what_is_no_planner_is_told_with_what_it_lacks(own: str, name: str, sentence: str) -> None:
    with pytest.raises(ValueError, match=f"^method {name}: ") as caught:
        planner_named(name)
    assert sentence in str(caught.value)


@pytest.mark.parametrize(
    "name", [":Straight", "own:", "own:Straight:more", "own straight:Straight", "./own.py:A", "a:b."]
)
def test_what_is_no_import_path_is_an_unknown_name(name: str) -> None:
    with pytest.raises(ValueError, match=r"given .*a planner of your own is MODULE:CLASS"):
        method_named(name)


def test_a_missing_package_is_told_before_anything_is_planned(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ompl", None)
    with pytest.raises(ImportError, match=r"needs ompl, from the extra bench: pip install 'maxjax\[bench\]'"):
        planner_named("rrtstar")
