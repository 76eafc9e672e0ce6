"""A mission's own speed and its near waypoints on the page."""

from __future__ import annotations

import functools
import itertools
import types

import numpy as np
import pytest

import maxjax
from maxjax.planning.mission import Mission
from maxjax.planning.waypoint import Waypoint
from maxjax.ui.page.answer import Answer, answer, describe_answer
from maxjax.ui.page.incoming import fault_of, refusal_of
from maxjax.ui.request import Request
from tests.planners import bare_plan

PLACES = ((0.0, 0.0, 20.0), (60.0, 0.0, 20.0), (120.0, 0.0, 20.0))
PLAIN = tuple(map(Waypoint, PLACES))


def answered(stops: tuple[Waypoint, ...], clear: float = np.inf) -> Answer:
    """The answer to a request of two straight legs in the open."""
    request = Request(map="open", waypoints=stops, radius=1.5, speed=4.0)
    path, where = (
        np.array(PLACES),
        maxjax.VoxelMap.of(np.zeros((70, 5, 20), bool), spacing=2.0, origin=(0.0, -4.0, 1.0)),
    )
    legs = tuple(
        bare_plan(
            where,
            path[k : k + 2],
            maxjax.Distances(1.5, 1.5),
            clearance_at=np.array([np.inf, clear] if k == 0 else [clear, np.inf]),
            exemptions=(3.0 * (k == 1 and clear < 1.5), 3.0 * (k == 0 and clear < 1.5)),
            timings={"total": 0.1},
        )
        for k in range(2)
    )
    mission = Mission(
        maxjax.Status.OK, request.flown, legs, path, np.array([0, 1, 2]), 120.0, clear, {"total": 0.1}, where
    )
    return Answer(request, mission, None, path, np.full(3, clear), "", 0.1)


def speeds(stops: tuple[Waypoint, ...]) -> list[float]:
    """Greatest speed on each leg [m/s]."""
    found = answered(stops)
    flight = maxjax.trajectory(found.verified, found.request.limits)
    motion = flight.sampled(0.05)
    fast = np.linalg.norm(motion.velocity, axis=1)
    legs = itertools.pairwise(flight.passes)
    return [float(fast[(motion.time > a) & (motion.time < b)].max()) for a, b in legs]


def test_the_speed_of_the_mission_rules_where_a_leg_has_none() -> None:
    """A waypoint that was added by click has no speed; another leg may do 12 m/s."""
    start, click, fast = Waypoint(PLACES[0], speed=4.0), Waypoint(PLACES[1]), Waypoint(PLACES[2], speed=12.0)
    added, own = speeds((start, click, fast))
    assert added == pytest.approx(4.0, abs=0.1)
    assert own > 8.0
    assert speeds(PLAIN) == pytest.approx([4.0, 4.0], abs=0.1)
    assert speeds((start, Waypoint(PLACES[1], speed=3.0), fast))[0] == pytest.approx(3.0, abs=0.1)
    assert "1. 60.0 m, at most 4 m/s" in describe_answer(answered((start, click, fast))).replace("nan m", "60.0 m")


def test_a_waypoint_nearer_than_the_radius_is_told() -> None:
    assert "Radius not kept" not in describe_answer(answered(PLAIN))
    text = describe_answer(answered(PLAIN, clear=1.36))
    assert "**Radius not kept:** waypoint 1 (60, 0, 20) stands 1.36 m from an obstacle" in text


class Control:
    """A control as viser has them."""

    def __init__(self, value: object, **props: object) -> None:
        self._impl = types.SimpleNamespace(value=value, props=types.SimpleNamespace(**props))


@pytest.mark.parametrize(
    ("typed", "sentence"),
    [
        (1e13, "Radius [m]: expected a number from 0 to 30, given 10000000000000.0; 1.5 stays"),
        ("thirty", "Radius [m]: expected a number from 0 to 30, given 'thirty'; 1.5 stays"),
        (float("nan"), "Radius [m]: expected a number from 0 to 30, given nan; 1.5 stays"),
        (2.5, ""),
    ],
)
def test_a_value_that_is_not_taken_is_told(typed: object, sentence: str) -> None:
    msgspec = pytest.importorskip("msgspec", reason="needs viser (extra view)")
    panel = {"a": Control(1.5, min=0.0, max=30.0, step=0.25, label="Radius [m]")}
    content = msgspec.msgpack.encode({"type": "GuiUpdateMessage", "uuid": "a", "updates": {"value": typed}})
    assert refusal_of(content, panel) == sentence
    assert bool(fault_of(content, panel)) == bool(sentence)
    for strange in (b"", b"\x93", msgspec.msgpack.encode({"type": "GuiUpdateMessage", "uuid": 5, "updates": 1})):
        assert refusal_of(strange, panel) == ""


def test_an_end_in_something_is_told_as_on_the_command_line() -> None:
    from maxjax.ui.page.page_map import City

    ground = np.zeros((40, 30, 30), bool)
    ground[:, :, :5] = True
    walls = ground.copy()
    walls[20:30, 10:20, :20] = True
    where = maxjax.VoxelMap.of(walls, spacing=2.0, origin=(0.0, 0.0, 0.0), ground=ground)
    city = City("town", where)
    ask = functools.partial(Request.between, "town", method="astar", radius=1.0, margin=2.0)
    text = describe_answer(answer(city, ask((50.0, 30.0, 31.0), (10.0, 20.0, 20.0))))
    assert "START_OCCUPIED" in text
    assert "(50, 30, 31) lies in an obstacle, 8.0 m below its top at z = 39.0; free from z = " in text
    closed = ask((10.0, 20.0, 12.0), (10.0, 50.0, 30.0), floor=10.0, ceiling=40.0)
    text = describe_answer(answer(city, closed))
    assert "START_OUTSIDE_BAND" in text
    assert ". There z = 20.0 to z = 46.0 is open" in text
