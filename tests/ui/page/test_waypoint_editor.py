"""Waypoints of a page edited in its list, without a browser: what is typed, where it lies, and what stays."""

from __future__ import annotations

import types
from collections.abc import Iterator
from typing import Any

import pytest

import maxjax
from maxjax import Waypoint
from maxjax.core.terrain import Terrain
from maxjax.io.geo.earth import TangentPlane
from maxjax.ui.page.waypoint_editor import Ground, Stops, WaypointEditor, begin, exchange, insert, remove

STOPS = (
    Waypoint((0.0, 0.0, 30.0)),
    Waypoint((40.0, 0.0, 25.0), hover=3.0, speed=4.0, radius=2.0),
    Waypoint((40.0, 60.0, 35.0), heading=90.0),
)
GROUND = Ground(TangentPlane(52.0, 4.3, 7.0), Terrain.flat(12.0, maxjax.Grid((1, 1, 1), 4e3)))


class Shown:
    """A list, what it changed and what it said."""

    def __init__(self, gui: Any) -> None:
        self.stops: Stops = STOPS
        self.said: list[str] = []
        self.list = WaypointEditor(gui, STOPS, GROUND, self.changed, self.said.append)

    def changed(self, stops: Stops) -> None:
        self.stops = stops
        self.list.show(stops)

    def type(self, name: str, text: str) -> None:
        """As a browser does."""
        control = self.list.numbers.get(name) or getattr(self.list, name)
        control.value = text
        for function in control._impl.update_cb:
            function(types.SimpleNamespace(client=object(), target=control))

    def click(self, name: str) -> None:
        self.list._edit(name)


@pytest.fixture
def shown() -> Iterator[Shown]:
    viser = pytest.importorskip("viser", reason="the page needs the extra view: pip install 'maxjax[view]'")
    server = viser.ViserServer(port=0, verbose=False)
    yield Shown(server.gui)
    server.stop()


def test_fields_are_those_of_the_chosen_waypoint(shown: Shown) -> None:
    assert tuple(shown.list.chosen.options) == ("start", "waypoint 1", "goal")
    assert (shown.list.place.value, shown.list.numbers["heading"].value) == ("40, 60, 35", "90")
    shown.list.chosen.value = "waypoint 1"
    fields = shown.list.numbers
    assert [fields[name].value for name in ("hover", "speed", "heading")] == ["3", "4", ""]
    shown.list.frame.value = "local-agl"
    assert shown.list.place.value == "40, 0, 13"
    assert shown.stops == STOPS


def test_what_is_typed_is_the_waypoint_and_the_rest_stays(shown: Shown) -> None:
    shown.list.chosen.value = "waypoint 1"
    shown.type("hover", "")
    shown.type("speed", "6.5")
    shown.type("look_at", "10 20 5")
    shown.type("place", "41, 1, 26")
    assert shown.stops[1] == Waypoint((41.0, 1.0, 26.0), speed=6.5, radius=2.0, look_at=(10.0, 20.0, 5.0))
    shown.type("heading", "-45")
    assert (shown.stops[1].heading, shown.stops[1].look_at) == (-45.0, None)
    assert (shown.stops[0], shown.stops[2]) == (STOPS[0], STOPS[2])
    assert shown.said == []


@pytest.mark.parametrize("frame", ["local-agl", "agl", "home", "amsl"])
def test_a_place_shown_in_a_frame_and_typed_again_is_the_place(shown: Shown, frame: str) -> None:
    shown.list.frame.value = frame
    text = shown.list.place.value
    shown.type("place", "40, 60, 3" if frame == "local-agl" else "52.0001, 4.3001, 40")
    moved = shown.stops[2].position
    assert moved != STOPS[2].position
    shown.type("place", text)
    assert shown.stops[2].position == pytest.approx(STOPS[2].position, abs=2e-3)
    assert shown.said == []


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("place", "", "expected three numbers, given none"),
        ("place", "1, 2", "not enough values"),
        ("place", "1, 2, inf", "expected three finite numbers"),
        ("hover", "-1", "Waypoint.hover: expected seconds from 0 to 3600"),
        ("speed", "fast", "could not convert"),
        ("heading", "400", "Waypoint.heading: expected degrees"),
    ],
)
def test_what_is_no_value_is_said_and_changes_nothing(shown: Shown, name: str, text: str, said: str) -> None:
    shown.type(name, text)
    assert shown.stops == STOPS
    assert shown.said[0].startswith(said)


def test_no_leg_leads_to_the_start(shown: Shown) -> None:
    shown.list.chosen.value = "start"
    shown.type("speed", "3")
    assert shown.said == ["Speed: expected none of the start, to which no leg leads"]
    shown.list.chosen.value = "waypoint 1"
    shown.click("Earlier")
    assert shown.stops == (Waypoint(STOPS[1].position, hover=3.0), STOPS[0], STOPS[2])
    assert shown.list.chosen.value == "start"


def test_waypoints_are_exchanged_put_in_and_left_out(shown: Shown) -> None:
    assert exchange(STOPS, 1, 2) == (STOPS[0], STOPS[2], STOPS[1])
    assert exchange(STOPS, 0, -1) == exchange(STOPS, 2, 3) == STOPS
    assert insert(STOPS, 0)[1] == Waypoint((20.0, 0.0, 27.5))
    assert insert(STOPS, 2)[2] == insert(STOPS, 1)[2] == Waypoint((40.0, 30.0, 30.0))
    assert remove(STOPS, 0) == begin(STOPS[1:]) == (Waypoint(STOPS[1].position, hover=3.0), STOPS[2])
    assert remove(STOPS[:2], 1) == STOPS[:2]
    shown.list.chosen.value = "start"
    for click in ("Add", "Add", "Remove", "Later"):
        shown.click(click)
    added, goal = Waypoint((20.0, 0.0, 27.5)), STOPS[2]
    assert shown.stops == (STOPS[0], added, goal, STOPS[1])
    assert shown.list.chosen.value == "goal"
