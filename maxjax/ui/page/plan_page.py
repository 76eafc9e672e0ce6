"""The page to plan on: ends and waypoints dragged by hand, a new plan at once.

controls and handles → Request → worker → Answer → scene, status in words
"""

from __future__ import annotations

import dataclasses
import itertools
import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from maxjax.core.grid import Point3
from maxjax.io.geo.earth import Earth
from maxjax.planning.waypoint import Waypoint
from maxjax.ui.page.air import air_lines, air_scene
from maxjax.ui.page.answer import Answer, answer, describe_answer
from maxjax.ui.page.building_inspector import BuildingInspector
from maxjax.ui.page.camera import hiding
from maxjax.ui.page.charge_chart import charge_chart
from maxjax.ui.page.controls import add_controls, legend, place_text, reach, text_place
from maxjax.ui.page.download import downloading, file_of, inspection_files
from maxjax.ui.page.draw import THROUGH, answer_scene, city_scene, end_name, end_scene, root_of
from maxjax.ui.page.nodes import Scene, point3
from maxjax.ui.page.page_map import City, building_at, hit
from maxjax.ui.page.server import look_at, set_theme
from maxjax.ui.page.slices import Field, Slice, field_of, picture
from maxjax.ui.page.stage import Stage
from maxjax.ui.page.waypoint_editor import Ground, WaypointEditor
from maxjax.ui.page.worker import Worker
from maxjax.ui.request import Request

if TYPE_CHECKING:
    from viser import GuiApi, ViserServer

_SLOW = 0.5  # after so long the status says that a plan is being made [s]
_REST = 0.3  # after so long without a move the camera is at rest [s]
_HANDLE, _REACH = 12.0, 0.15  # length of a handle's arrows: at least [m], and in extents of the waypoints
_PLAIN = str.maketrans("", "", "<>[]()!`*_#|\\\n")  # what Markdown would not show as it is
_NAME = 1.15  # height of a name above its waypoint, in lengths of an arrow


class PlanPage:
    """A page to plan on; it answers as long as its server runs.

    Args:
        server: with an empty scene.
        city: the map.
        request: the first one.
        earth: where the map lies; None: unknown.
        dark: whether the page is dark.
    """

    def __init__(
        self,
        server: ViserServer,
        city: City,
        request: Request,
        earth: Earth | None = None,
        *,
        dark: bool = False,
    ) -> None:
        self._server, self._city, self._earth = server, city, earth
        self._stage = Stage(server.scene)
        self._stage.show("/map", city_scene(city, dark=dark))
        look_at(server, city, _surroundings(city, request))
        self._eye: Point3 = point3(np.asarray(server.initial_camera.position))
        self._hiding = np.zeros(city.grid.shape[:2], bool)
        self._drawn = city  # without the voxels of a building that is drawn as it was inspected
        self._resting = threading.Timer(_REST, self.ask)
        self._stops = list(request.stops)
        self._arrow = max(_HANDLE, _REACH * float(np.ptp(np.array(request.places), axis=0).max()))
        self._handles: dict[str, Any] = {}
        self._field: tuple[tuple[Any, ...], Field | None] = (), None
        self._lock = threading.RLock()
        self.answer: Answer | None = None
        """The last one; None before the first."""
        self.controls = add_controls(server.gui, city, request, self._listed, on_earth=earth is not None, dark=dark)
        self.worker: Worker[tuple[Request, Slice | None]] = Worker(self._work)
        self.inspector = BuildingInspector(city, self.controls.inspection, self._show_inspection)
        self._listen()
        self._place_handles()
        self.ask()

    def close(self) -> None:
        """End its threads."""
        self.worker.close()
        self.inspector.worker.close()

    @property
    def waypoints(self) -> tuple[Point3, ...]:
        """Start, places to visit and goal [m]."""
        return tuple(stop.position for stop in self._stops)

    def ask(self) -> None:
        """Ask what handles and controls say."""
        with self._lock:
            request = self.controls.request(tuple(self._stops))
            self.worker.ask((request, self.controls.wanted(self._city)))
            self.inspector.ask(request)

    def change(self, stops: Sequence[Waypoint]) -> None:
        """Visit these waypoints, the start first, and plan anew."""
        with self._lock:
            self._stops = list(stops)
            self._place_handles()
            for k, place in enumerate(self.waypoints):
                self._handles[self._name(k)].position = point3(self._city.frame.page(place))
            self._write_ends()
        self.ask()

    def move(self, k: int, place: Point3) -> None:
        """Put the waypoint k elsewhere [m] and plan anew."""
        moved = list(self._stops)
        moved[k] = dataclasses.replace(moved[k], position=place)
        self.change(moved)

    def add(self, place: Point3) -> None:
        """Visit a place [m] before the goal."""
        self.change((*self._stops[:-1], Waypoint(place), self._stops[-1]))

    def _listed(self, gui: GuiApi) -> WaypointEditor:
        """The fields of the waypoints."""

        def refuse(why: str) -> None:
            self._say(f"### Not a waypoint yet\n{why[:200].translate(_PLAIN)}")

        return WaypointEditor(gui, tuple(self._stops), Ground(self._earth, self._city.terrain), self.change, refuse)

    def _place_handles(self) -> None:
        """A handle to drag for each waypoint, with its ball and name; those that are there stay."""
        names = [self._name(k) for k in range(len(self._stops))]
        with self._server.atomic():
            for name in [name for name in self._handles if name not in names]:
                self._stage.show(root_of(name), {})
                self._handles.pop(name).remove()
            for name, place in zip(names, self.waypoints, strict=True):
                if name not in self._handles:
                    self._handles[name] = self._handle(name, place)
                    self._stage.show(root_of(name), end_scene(root_of(name), name, high=_NAME * self._arrow))

    def _handle(self, name: str, place: Point3) -> Any:
        at = point3(self._city.frame.page(place))
        handle = self._server.scene.add_transform_controls(
            root_of(name), scale=self._arrow, line_width=6.0, disable_rotations=True, depth_test=False, position=at
        )

        # Coroutines keep the order of a drag's events; none of them waits.
        @handle.on_update
        async def _(event: Any) -> None:
            with self._lock:
                names = [self._name(k) for k in range(len(self._stops))]
                if name not in names:
                    return  # removed while it is dragged
                k = names.index(name)
                place = point3(np.round(self._city.frame.map(np.asarray(event.target.position)), 3))
                self._stops[k] = dataclasses.replace(self._stops[k], position=place)
            self.ask()
            if event.phase == "end":
                self._write_ends()

        return handle

    def _name(self, k: int) -> str:
        return end_name(k, len(self._stops))

    def _write_ends(self) -> None:
        """Say in the panel where the waypoints are."""
        self.controls.start.value, self.controls.goal.value = (place_text(self.waypoints[k]) for k in (0, -1))
        self.controls.list.show(tuple(self._stops))

    def _listen(self) -> None:
        """Ask anew whenever a control changes."""
        controls = self.controls
        for control in (
            controls.method,
            controls.radius,
            controls.margin,
            controls.beside,
            controls.keep,
            controls.band,
            controls.landing,
            controls.autopilot,
        ):
            control.on_update(lambda _: self.ask())
        controls.band.on_update(lambda _: controls.say_band())
        for control in controls.inspection.asking:
            control.on_update(lambda _: self.ask())
        for control in (controls.slice, controls.place):
            control.on_update(lambda _: self.ask())
        for k, control in ((0, controls.start), (-1, controls.goal)):
            control.on_update(lambda event, k=k: self._typed(k, event))

        controls.axis.on_update(lambda _: self._turned())
        controls.through.on_update(lambda _: self._show_map())
        controls.dark.on_update(lambda _: self._darken())
        self._server.on_client_connect(self._watch)
        self._server.scene.on_click()(self._clicked)
        controls.export.on_click(lambda event: self._download(event, event.target.value))
        controls.share.on_click(lambda event: self._download(event, ".html"))
        controls.inspection.export.on_click(self._download_inspection)

    def _turned(self) -> None:
        reach(self._city, self.controls)
        self.ask()

    async def _watch(self, client: Any) -> None:
        """Ask anew when a camera has come to rest: other buildings may hide the way from there."""

        async def moved(camera: Any) -> None:
            self._eye = point3(np.asarray(camera.position))
            self._resting.cancel()
            self._resting = threading.Timer(_REST, self.ask)
            self._resting.daemon = True
            self._resting.start()

        client.camera.on_update(moved)

    def _darken(self) -> None:
        set_theme(self._server, dark=self.controls.dark.value)
        self._show_map()

    def _show_map(self) -> None:
        opacity = THROUGH if self.controls.through.value else 1.0
        self._stage.show("/map", city_scene(self._drawn, opacity, self._hiding, dark=self.controls.dark.value))

    def _see_through(self) -> None:
        """Draw the buildings see-through that hide the path, or viewpoints, from where the camera is."""
        between = np.zeros_like(self._hiding)
        path = self.answer.dense if self.answer is not None and self.answer.ok else np.zeros((0, 3))
        for points in (path, self.inspector.points):
            if len(points):
                between |= hiding(self._drawn, self._eye, self._city.frame.page(points))
        if (between != self._hiding).any():
            self._hiding = between
            self._show_map()

    def _clicked(self, event: Any) -> None:
        """A building to inspect, or a place to visit or the goal above what is clicked, where clicks say so."""
        origin = point3(self._city.frame.map(np.asarray(event.ray_origin)))
        if self.controls.inspects:
            place = building_at(self._city, origin, event.ray_direction)
            if place is not None:
                self.inspector.choose(place, self.controls.request(tuple(self._stops)))
            return
        if not (self.controls.adds or self.controls.moves_goal):
            return
        met = hit(self._city, origin, event.ray_direction)
        if met is not None:
            above = met[0], met[1], met[2] + float(self.controls.above.value)
            self.add(above) if self.controls.adds else self.move(len(self._stops) - 1, above)

    def _typed(self, k: int, event: Any) -> None:
        place = text_place(event.target.value)
        if event.client is None:
            return  # the panel was told, not the page
        if place is None:
            what = "Start" if k == 0 else "Goal"
            typed = event.target.value[:60].translate(_PLAIN)
            self._say(f"### Not a place yet\n{what} [m]: expected three numbers, as 10, 20, 30, given “{typed}”.")
        elif place != self.waypoints[k]:
            self.move(k % len(self._stops), place)
        elif self.answer is not None:
            self._say(describe_answer(self.answer))

    def _download(self, event: Any, ending: str) -> None:
        with downloading(event.client) as send:
            if self.answer is None or not self.answer.ok:
                raise ValueError("there is no path to take away; move an end, or lower the radius")
            send(*file_of(self._city, self._earth, ending, self.answer))

    def _download_inspection(self, event: Any) -> None:
        with downloading(event.client) as send:
            request = self.controls.request(tuple(self._stops))
            files, said = inspection_files(self._city, self._earth, event.target.value, self.inspector.answer, request)
            for name, content in files:
                send(name, content)
            event.client.add_notification("Inspection", said, auto_close_seconds=8.0)

    def _show_inspection(self, scene: Scene, drawn: City) -> None:
        with self._server.atomic():
            self._stage.show("/inspection", scene)
            self._drawn = drawn
            self._show_map()
        self.ask()

    def _work(self, asked: tuple[Request, Slice | None]) -> None:
        request, wanted = asked
        if self.answer is None or request != self.answer.request:
            slow = threading.Timer(_SLOW, self._say, ["### Planning …\nThe first plan of a size is compiled, once."])
            slow.start()
            found = answer(self._city, request)
            slow.cancel()
            self._show(found, wanted)
        else:
            self._say_legend(self.answer, wanted)
        if not self.worker.stale:
            self._see_through()
            self._slice(request, wanted)

    def _show(self, found: Answer, wanted: Slice | None) -> None:
        with self._server.atomic():
            self._stage.show("/plan", answer_scene(found, self._city.frame))
            self._stage.show("/air", {} if found.mission is None else air_scene(self._city, found.request))
            self._say(describe_answer(found))
            self._say_legend(found, wanted)
        self.answer = found

    def _say(self, text: str) -> None:
        self.controls.status.content = text

    def _say_legend(self, found: Answer, wanted: Slice | None) -> None:
        request = found.request
        text = legend(request, wanted, air_lines(self._city, request), path=found.ok)
        text += charge_chart([found.flight], request.supply)
        if self.controls.legend.content != text:
            self.controls.legend.content = text

    def _slice(self, request: Request, wanted: Slice | None) -> None:
        """Show the slice, of a field that is solved where the request's last leg is another one."""
        if wanted is None:
            self._stage.show("/slice", {})
            return
        highest = self._city.highest(request.places[0])
        key = (*request.stops[-2:], request.radius, request.margin, request.altitudes, highest)
        if self._field[0] != key:
            try:
                self._field = key, field_of(self._city, request)
            except ValueError as error:
                self._say(f"### No slice\n{error}")
                self._field = key, None
        field = self._field[1]
        nodes = {} if field is None else {"/slice/plane": picture(field, wanted, self._city.grid, self._city.frame)}
        self._stage.show("/slice", nodes)


def _surroundings(city: City, request: Request) -> np.ndarray:
    """The straight legs with some of the map around them, in the page's frame [m]."""
    ends = city.frame.page(np.array(request.places))
    room = 0.15 * max(float(np.ptp(ends, axis=0).max()), 40.0)
    along = np.linspace(0.0, 1.0, 12)[:, None]
    legs = [start + along * (stop - start) for start, stop in itertools.pairwise(ends)]
    return np.concatenate([ends.min(axis=0, keepdims=True) - room, *legs, ends.max(axis=0, keepdims=True) + room])
