"""The panel of a page to plan on: its controls, and what they say."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

from maxjax.methods import METHODS
from maxjax.missions.export import IN_TIME, ON_EARTH
from maxjax.view.asking import Question
from maxjax.view.city import City
from maxjax.view.colors import CLEARANCES, FIELD, PRICE
from maxjax.view.slices import Axis, Slice

if TYPE_CHECKING:
    from viser import GuiApi

_SLICES = {"none": None, "cost to the goal, −ℓ log φ": "cost", "price of a metre": "price"}
_AXES: dict[str, Axis] = {"horizontal": "z", "along y": "x", "along x": "y"}
_MOST = 30.0  # of radius and margin [m]
_HIGHEST = 150.0  # of the altitude band [m]


@dataclasses.dataclass(frozen=True, eq=False)
class Controls:
    """Handles of the panel, by what they are for; each is viser's."""

    status: Any
    legend: Any
    start: Any
    goal: Any
    click: Any
    above: Any
    undo: Any
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
    format: Any
    export: Any
    share: Any

    def question(self, waypoints: tuple[Any, ...]) -> Question:
        """What the controls ask, through these places; the margin is the radius at least."""
        radius = float(self.radius.value)
        low, high = map(float, self.band.value)
        return Question(
            waypoints,
            self.method.value,
            radius,
            max(radius, float(self.margin.value)),
            bool(self.beside.value),
            (low, max(high, low + 1.0)) if self.keep.value else None,
        )

    def wanted(self, city: City) -> Slice | None:
        """The slice to show; None: none."""
        of = _SLICES[self.slice.value]
        axis = _AXES[self.axis.value]
        number = "xyz".index(axis)
        place = round((float(self.place.value) - city.grid.origin[number]) / city.grid.spacing)
        inside = min(max(place, 0), city.grid.shape[number] - 1)
        return None if of is None else Slice(of, axis, inside)  # type: ignore[arg-type]  # one of the two names


def add_controls(gui: GuiApi, city: City, question: Question, *, on_earth: bool, dark: bool) -> Controls:
    """Fill the panel."""
    step = 0.25
    parts: dict[str, Any] = {"status": gui.add_markdown("### Planning …"), "legend": gui.add_html("")}
    with gui.add_folder("Where"):
        parts["start"] = gui.add_vector3("Start [m]", question.waypoints[0], step=0.5)
        parts["goal"] = gui.add_vector3("Goal [m]", question.waypoints[-1], step=0.5)
        parts["click"] = gui.add_checkbox("Add waypoints by click", False)
        parts["above"] = gui.add_slider("Above what is clicked [m]", 2.0, 60.0, 1.0, 10.0)
        parts["undo"] = gui.add_button("Remove the last waypoint", disabled=len(question.waypoints) < 3)
    with gui.add_folder("How"):
        parts["method"] = gui.add_dropdown("Method", tuple(METHODS), initial_value=question.method)
        parts["radius"] = gui.add_slider("Radius [m]", 0.0, _MOST, step, min(question.radius, _MOST))
        parts["margin"] = gui.add_slider("Margin [m]", 0.0, _MOST, step, min(question.margin, _MOST))
        parts["keep"] = gui.add_checkbox("Keep an altitude band", question.band is not None)
        band = (5.0, 60.0) if question.band is None else question.band
        parts["band"] = gui.add_multi_slider("Above ground [m]", min=0.0, max=_HIGHEST, step=1.0, initial_value=band)
        parts["beside"] = gui.add_checkbox("A* beside it", question.beside)
    with gui.add_folder("Look inside", expand_by_default=False):
        parts["slice"] = gui.add_dropdown("Slice of", tuple(_SLICES), initial_value="none")
        parts["axis"] = gui.add_dropdown("Plane", tuple(_AXES), initial_value="horizontal")
        parts["place"] = gui.add_slider("At [m]", *_reach(city, "z"), city.grid.spacing, question.waypoints[-1][2])
        parts["through"] = gui.add_checkbox("See-through buildings", False)
        parts["dark"] = gui.add_checkbox("Dark page", dark)
    with gui.add_folder("Take away", expand_by_default=False):
        formats = tuple(ending for ending in (*(ON_EARTH if on_earth else ()), *IN_TIME) if ending != ".rosbag")
        parts["format"] = gui.add_dropdown("Format", formats)
        parts["export"] = gui.add_button("Download the plan")
        parts["share"] = gui.add_button("Download this page")
    return Controls(**parts)


def reach(city: City, controls: Controls) -> None:
    """Let the slider run over the axis of the slice."""
    low, high = _reach(city, _AXES[controls.axis.value])
    controls.place.min, controls.place.max = low, high
    controls.place.value = min(max(controls.place.value, low), high)


def _reach(city: City, axis: Axis) -> tuple[float, float]:
    number = "xyz".index(axis)
    low = city.grid.origin[number]
    return low, low + city.grid.spacing * (city.grid.shape[number] - 1)


def legend(question: Question, wanted: Slice | None) -> str:
    """What the colours mean, as HTML."""
    rows = [_bar(CLEARANCES, "path: clearance 0 m", f"{question.margin:g} m and more")]
    if wanted is not None and wanted.of == "cost":
        rows.append(_bar(FIELD, "cost to the goal 0 m, a line every 10 m", "far"))
    if wanted is not None and wanted.of == "price":
        rows.append(_bar(PRICE, "price of a metre 1", "dear"))
    if question.beside:
        rows.append('<div style="margin-top:4px"><b style="color:#0072B2">━━</b> A*</div>')
    return f'<div style="font-size:0.8em;padding:0 0.9em 0.4em">{"".join(rows)}</div>'


def _bar(colors: tuple[str, ...], low: str, high: str) -> str:
    return (
        f'<div style="height:8px;border-radius:4px;margin-top:6px;background:linear-gradient(90deg,{",".join(colors)})"'
        f'></div><div style="display:flex;justify-content:space-between"><span>{low}</span><span>{high}</span></div>'
    )
