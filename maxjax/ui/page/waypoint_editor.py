"""The list of a page's waypoints: one is chosen, its fields are typed, and it is moved, put in or left out.

    fields of the chosen waypoint → typed → Waypoint → list → page

An empty field leaves the value to the mission. Places are typed in any frame that the map has (`io.places`).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from maxjax.core.grid import Point3
from maxjax.core.terrain import Terrain
from maxjax.io.geo.earth import Earth
from maxjax.io.places import Frame, numbers_of_point, point_at, points_at
from maxjax.planning.waypoint import Waypoint
from maxjax.ui.page.draw import end_name
from maxjax.ui.page.nodes import point3

if TYPE_CHECKING:
    from viser import GuiApi

Stops = tuple[Waypoint, ...]

_NUMBERS = {"hover": "Hover [s]", "speed": "Speed [m/s]", "heading": "Heading [°]"}
_OPEN = "as the mission"
_EARLIER, _LATER, _ADD, _REMOVE = "Earlier", "Later", "Add", "Remove"
_ON_EARTH: tuple[Frame, ...] = ("agl", "home", "amsl")


@dataclasses.dataclass(frozen=True, eq=False)
class Ground:
    """What places count from.

    Attributes:
        earth: where the map lies; None: unknown.
        terrain: how high its ground is.
    """

    earth: Earth | None
    terrain: Terrain

    @property
    def frames(self) -> tuple[Frame, ...]:
        """That places can be typed in."""
        return "map", "local-agl", *(() if self.earth is None else _ON_EARTH)


def exchange(stops: Stops, k: int, other: int) -> Stops:
    """The waypoints with two of them exchanged; the same where one of them is none."""
    if not (0 <= k < len(stops) and 0 <= other < len(stops)):
        return stops
    order = list(stops)
    order[k], order[other] = order[other], order[k]
    return begin(order)


def insert(stops: Stops, k: int) -> Stops:
    """The waypoints with one more, halfway to the next one; before the last one where that is chosen."""
    k = min(k, len(stops) - 2)
    between = point3(np.round(0.5 * (np.array(stops[k].position) + stops[k + 1].position), 3))
    return (*stops[: k + 1], Waypoint(between), *stops[k + 1 :])


def remove(stops: Stops, k: int) -> Stops:
    """The waypoints without one; the same where only two are left."""
    return begin((*stops[:k], *stops[k + 1 :])) if len(stops) > 2 else stops


def begin(stops: Sequence[Waypoint]) -> Stops:
    """The waypoints, of which the first one has no leg."""
    return (dataclasses.replace(stops[0], speed=None, radius=None, margin=None), *stops[1:])


class WaypointEditor:
    """The fields of a page's waypoints.

    Args:
        gui: of the page.
        stops: that it begins with.
        ground: what places count from.
        change: called with the waypoints after an edit.
        say: called with a sentence on what was typed and is none.
    """

    def __init__(
        self,
        gui: GuiApi,
        stops: Stops,
        ground: Ground,
        change: Callable[[Stops], None],
        say: Callable[[str], None],
    ) -> None:
        self._stops, self._ground, self._change, self._say = stops, ground, change, say
        self.chosen: Any = gui.add_dropdown("Waypoint", self._names, initial_value=self._names[-1])
        self.edit = gui.add_button_group("In the list", (_EARLIER, _LATER, _ADD, _REMOVE))
        self.frame: Any = gui.add_dropdown("Places in", ground.frames, initial_value=ground.frames[0])
        self.place = gui.add_text("Place", "", hint="three numbers, as the frame says")
        self.numbers: dict[str, Any] = {name: gui.add_text(label, "", hint=_OPEN) for name, label in _NUMBERS.items()}
        self.look_at = gui.add_text("Look at", "", hint="a point of interest; empty: along the course")
        for control in (self.chosen, self.frame):
            control.on_update(lambda _: self._fill())
        self.edit.on_click(lambda event: self._edit(event.target.value))
        self.place.on_update(lambda event: self._typed(event, "position", self._place_typed))
        self.look_at.on_update(lambda event: self._typed(event, "look_at", self._place_typed))
        for name, control in self.numbers.items():
            control.on_update(lambda event, name=name: self._typed(event, name, _number_typed))
        self._fill()

    def show(self, stops: Stops) -> None:
        """Show waypoints that were changed elsewhere."""
        chosen, self._stops = self._k, stops
        if tuple(self.chosen.options) != self._names:
            self.chosen.options = self._names
            self.chosen.value = self._names[min(chosen, len(stops) - 1)]
        self._fill()

    @property
    def _names(self) -> tuple[str, ...]:
        return tuple(end_name(k, len(self._stops)) for k in range(len(self._stops)))

    @property
    def _k(self) -> int:
        """Number of the chosen one."""
        names = tuple(self.chosen.options)
        return names.index(self.chosen.value) if self.chosen.value in names else len(names) - 1

    def _fill(self) -> None:
        """Write the chosen waypoint into the fields."""
        waypoint = self._stops[min(self._k, len(self._stops) - 1)]
        _write(self.place, self._numbers_of(waypoint.position))
        _write(self.look_at, "" if waypoint.look_at is None else self._numbers_of(waypoint.look_at))
        for name, control in self.numbers.items():
            given = getattr(waypoint, name)
            _write(control, "" if given is None else f"{given:g}")

    def _numbers_of(self, place: Point3) -> str:
        frame, start = self.frame.value, self._stops[0].position
        try:
            numbers = numbers_of_point(place, frame, self._ground.earth, self._ground.terrain, start)
        except ValueError as error:
            self._say(str(error))
            return ""
        digits = (8, 8, 3) if frame in _ON_EARTH else (3, 3, 3)
        return ", ".join(f"{round(x, digit):.12g}" for x, digit in zip(numbers, digits, strict=True))

    def _place_typed(self, text: str) -> Point3 | None:
        if not text:
            return None
        x, y, z = map(float, text.replace(",", " ").split())
        if not math.isfinite(x + y + z):
            raise ValueError(f"expected three finite numbers, given {text}")
        earth, terrain = self._ground.earth, self._ground.terrain
        if self.frame.value != "home":
            return point_at((x, y, z), self.frame.value, earth, terrain)
        start = numbers_of_point(self._stops[0].position, "agl", earth, terrain)
        return points_at([start, (x, y, z)], "home", earth, terrain)[1]

    def _typed(self, event: Any, name: str, read: Callable[[str], Any]) -> None:
        """Take what was typed, or say why it is no value."""
        if event.client is None:
            return  # the panel was told, not the page
        k, text = self._k, event.target.value.strip()
        try:
            if name == "position" and not text:
                raise ValueError("expected three numbers, given none")
            changed = dataclasses.replace(self._stops[k], **{name: read(text), **_aim_alone(name, text)})
            if k == 0 and changed.speed is not None:
                raise ValueError("Speed: expected none of the start, to which no leg leads")
        except ValueError as error:
            self._say(str(error))
            return
        if changed != self._stops[k]:
            self._change((*self._stops[:k], changed, *self._stops[k + 1 :]))

    def _edit(self, what: str) -> None:
        k = self._k
        edits: dict[str, tuple[Callable[[], Stops], int]] = {
            _EARLIER: (lambda: exchange(self._stops, k, k - 1), k - 1),
            _LATER: (lambda: exchange(self._stops, k, k + 1), k + 1),
            _ADD: (lambda: insert(self._stops, k), min(k + 1, len(self._stops) - 1)),
            _REMOVE: (lambda: remove(self._stops, k), k),
        }
        edit, following = edits[what]
        stops = edit()
        if stops == self._stops:
            return
        self._stops = stops
        self.chosen.options = self._names
        self.chosen.value = self._names[min(max(following, 0), len(stops) - 1)]
        self._fill()
        self._change(stops)


def _aim_alone(name: str, text: str) -> dict[str, None]:
    """A heading takes the place of a point of interest, and the other way round."""
    other = {"heading": "look_at", "look_at": "heading"}.get(name)
    return {other: None} if other is not None and text else {}


def _number_typed(text: str) -> float | None:
    return float(text) if text else None


def _write(control: Any, text: str) -> None:
    if control.value != text:
        control.value = text
