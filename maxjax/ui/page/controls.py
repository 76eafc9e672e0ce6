"""The panel of a page to plan on: its controls, and what they say."""

from __future__ import annotations

import dataclasses
import html
import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Literal

from maxjax.core.grid import Point3
from maxjax.io.export.endings import IN_TIME, ON_EARTH
from maxjax.planning.waypoint import Waypoint
from maxjax.ui.methods import METHODS
from maxjax.ui.page.colors import CLEARANCES, FIELD, PRICE
from maxjax.ui.page.inspection_controls import InspectionControls, add_answer, add_inspection
from maxjax.ui.page.page_map import Band, City
from maxjax.ui.page.slices import Axis, Slice
from maxjax.ui.page.waypoint_editor import WaypointEditor
from maxjax.ui.request import Request

if TYPE_CHECKING:
    from viser import GuiApi

_SLICES = {"none": None, "cost to the goal, −ℓ log φ": "cost", "price of a metre": "price"}
_AXES: dict[str, Axis] = {"horizontal": "z", "along y": "x", "along x": "y"}
_TYPED = "x, y, z"
_CLICKS = ("only turns the view", "adds a waypoint", "moves the goal", "inspects a building")
_AUTOPILOTS: dict[str, Literal["px4", "arducopter"] | None] = {"any": None, "PX4": "px4", "ArduCopter": "arducopter"}
_MOST = 30.0  # of radius and margin [m]
_HIGHEST = 150.0  # of the altitude band [m]


@dataclasses.dataclass(frozen=True, eq=False)
class Controls:
    """Handles of the panel, by what they are for; each is viser's. `first` is the request that it begins with."""

    first: Request
    status: Any
    legend: Any
    start: Any
    goal: Any
    click: Any
    above: Any
    list: WaypointEditor
    method: Any
    radius: Any
    margin: Any
    beside: Any
    keep: Any
    band: Any
    slice: Any
    axis: Any
    place: Any
    through: Any
    dark: Any
    export: Any
    landing: Any
    autopilot: Any
    share: Any
    inspection: InspectionControls

    def request(self, stops: tuple[Waypoint, ...]) -> Request:
        """The request of the controls, through these waypoints; the margin is the radius at least."""
        radius = float(self.radius.value)
        floor, ceiling = self._band() if self.keep.value else (None, None)
        return dataclasses.replace(
            self.first,
            waypoints=stops,
            method=self.method.value,
            radius=radius,
            margin=max(radius, float(self.margin.value)),
            beside=bool(self.beside.value),
            floor=floor,
            ceiling=ceiling,
            takeoff_and_landing=bool(self.landing.value),
            autopilot=_AUTOPILOTS[self.autopilot.value],
        )

    @property
    def adds(self) -> bool:
        """Whether a click adds a waypoint."""
        return bool(self.click.value == _CLICKS[1])

    @property
    def moves_goal(self) -> bool:
        """Whether a click moves the goal."""
        return bool(self.click.value == _CLICKS[2])

    @property
    def inspects(self) -> bool:
        """Whether a click inspects a building."""
        return bool(self.click.value == _CLICKS[3])

    def _band(self) -> Band:
        """The first request's own until the slider is moved; an end of the slider is no limit."""
        low, high = map(float, self.band.value)
        if self.first.altitudes != (None, None) and (low, high) == _on_slider(self.first.altitudes):
            return self.first.altitudes
        return None if low <= 0.0 else low, None if high >= self.band.max else max(high, low + 1.0)

    def say_band(self) -> None:
        """Write the numbers of the altitude band beside its slider."""
        low, high = map(float, self.band.value)
        self.band.label = _band_label(low, high, self.band.max)

    def wanted(self, city: City) -> Slice | None:
        """The slice to show; None: none."""
        of = _SLICES[self.slice.value]
        axis = _AXES[self.axis.value]
        number = "xyz".index(axis)
        place = round((float(self.place.value) - city.grid.origin[number]) / city.grid.spacing)
        inside = min(max(place, 0), city.grid.shape[number] - 1)
        return None if of is None else Slice(of, axis, inside)  # type: ignore[arg-type]  # one of the two names


def add_controls(
    gui: GuiApi,
    city: City,
    request: Request,
    listed: Callable[[GuiApi], WaypointEditor],
    *,
    on_earth: bool,
    dark: bool,
) -> Controls:
    """Fill the panel; `listed` adds the fields of its waypoints."""
    step = 0.25
    parts: dict[str, Any] = {"first": request}
    parts |= {"status": gui.add_markdown("### Planning …"), "legend": gui.add_html("")}
    inspected = add_answer(gui)
    formats = tuple(ending for ending in (*(ON_EARTH if on_earth else ()), *IN_TIME) if ending != ".rosbag")
    with gui.add_folder("Where"):
        # As text: three boxes are too narrow for national coordinates.
        parts["start"] = gui.add_text("Start [m]", place_text(request.places[0]), hint=_TYPED)
        parts["goal"] = gui.add_text("Goal [m]", place_text(request.places[-1]), hint=_TYPED)
        parts["click"] = gui.add_dropdown("A click", _CLICKS, initial_value=_CLICKS[0])
        parts["above"] = gui.add_slider("Above what is clicked [m]", 2.0, 60.0, 1.0, 10.0)
    with gui.add_folder("Waypoints", expand_by_default=False):
        parts["list"] = listed(gui)
    with gui.add_folder("How"):
        parts["method"] = gui.add_dropdown(
            "Method", tuple(dict.fromkeys((*METHODS, request.method))), initial_value=request.method
        )
        for name, given in (("radius", request.radius), ("margin", request.margin)):
            parts[name] = gui.add_slider(f"{name.capitalize()} [m]", 0.0, max(_MOST, given), step, given)
        parts["keep"] = gui.add_checkbox("Keep an altitude band", request.altitudes != (None, None))
        band = _on_slider(request.altitudes)
        low, high = min(0.0, band[0]), max(_HIGHEST, band[1])
        parts["band"] = gui.add_multi_slider(_band_label(*band, high), min=low, max=high, step=1.0, initial_value=band)
        parts["beside"] = gui.add_checkbox("A* beside it", request.beside)
    parts["inspection"] = add_inspection(gui, inspected, formats)
    with gui.add_folder("Look inside", expand_by_default=False):
        parts["slice"] = gui.add_dropdown("Slice of", tuple(_SLICES), initial_value="none")
        parts["axis"] = gui.add_dropdown("Plane", tuple(_AXES), initial_value="horizontal")
        low, high = _reach(city, "z")
        height = min(max(request.places[-1][2], low), high)
        parts["place"] = gui.add_slider("At [m]", low, high, city.grid.spacing, height)
        parts["through"] = gui.add_checkbox("See-through buildings", False)
        parts["dark"] = gui.add_checkbox("Dark page", dark)
    with gui.add_folder("Take away", expand_by_default=False):
        own = next((name for name, one in _AUTOPILOTS.items() if one == request.autopilot), "any")
        parts["autopilot"] = gui.add_dropdown("For the autopilot", tuple(_AUTOPILOTS), initial_value=own)
        parts["landing"] = gui.add_checkbox("Take-off and landing", request.takeoff_and_landing)
        parts["export"] = gui.add_button_group("Download the plan", (".toml", *formats))
        parts["share"] = gui.add_button("Download this page")
    return Controls(**parts)


def _band_label(low: float, high: float, most: float) -> str:
    return f"Above ground, {low:g} to {high:g} m" if high < most else f"Above ground, from {low:g} m"


def place_text(place: Point3) -> str:
    """A place [m] as it is shown and typed: whole numbers whole, all others to the millimetre."""
    return ", ".join(f"{round(x, 3):.12g}" for x in place)


def text_place(text: str) -> Point3 | None:
    """The place [m] that is typed as three numbers, with commas or without; None where it is not."""
    try:
        x, y, z = map(float, text.replace(",", " ").split())
    except ValueError:
        return None
    return (x, y, z) if math.isfinite(x + y + z) else None


def _on_slider(band: Band) -> tuple[float, float]:
    """Where the slider stands for a band; for none where it is tried first."""
    low, high = (5.0, 60.0) if band == (None, None) else band
    return 0.0 if low is None else low, max(_HIGHEST, low or 0.0) if high is None else high


def reach(city: City, controls: Controls) -> None:
    """Let the slider run over the axis of the slice."""
    low, high = _reach(city, _AXES[controls.axis.value])
    controls.place.min, controls.place.max = low, high
    controls.place.value = min(max(controls.place.value, low), high)


def _reach(city: City, axis: Axis) -> tuple[float, float]:
    number = "xyz".index(axis)
    low = city.grid.origin[number]
    return low, low + city.grid.spacing * (city.grid.shape[number] - 1)


def legend(request: Request, wanted: Slice | None, rules: Sequence[str] = (), *, path: bool = True) -> str:
    """The legend of colours, of a path where there is one, and the rules of the air that hold, as HTML."""
    rows = [color_bar(CLEARANCES, "path: clearance 0 m", f"{request.margin:g} m and more")] if path else []
    if wanted is not None and wanted.of == "cost":
        rows.append(color_bar(FIELD, "cost to the goal 0 m, a line every 10 m", "far"))
    if wanted is not None and wanted.of == "price":
        rows.append(color_bar(PRICE, "price of a metre 1", "dear"))
    if request.beside:
        rows.append('<div style="margin-top:4px"><b style="color:#0072B2">━━</b> A*</div>')
    rows += [f'<div style="margin-top:4px">{html.escape(rule)}</div>' for rule in rules]
    return legend_box(rows)


def legend_box(rows: Sequence[str]) -> str:
    """Rows of a legend as a panel holds them, as HTML."""
    return f'<div style="font-size:0.8em;padding:0 0.9em 0.4em">{"".join(rows)}</div>'


def color_bar(colors: tuple[str, ...], low: str, high: str) -> str:
    """A ramp of colours with what its ends mean, as HTML."""
    return (
        f'<div style="height:8px;border-radius:4px;margin-top:6px;background:linear-gradient(90deg,{",".join(colors)})"'
        f'></div><div style="display:flex;justify-content:space-between"><span>{low}</span><span>{high}</span></div>'
    )
