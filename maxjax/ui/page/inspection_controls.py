"""The part of a page's panel that inspects buildings: camera, distance, overlap, what came of it, and its files."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from maxjax.core.grid import Point3
from maxjax.inspection.camera_table import CAMERAS
from maxjax.inspection.capture import Capture
from maxjax.ui.page.inspection_answer import InspectionRequest
from maxjax.ui.request import Request

if TYPE_CHECKING:
    from viser import GuiApi

_FIRST = Capture()
_NEAR, _FAR = 2.0, 60.0  # of the distance [m]
_MOST = 90.0  # of the overlap [%]
# What says nothing of an inspection: where files go, and how the path from start to goal is planned.
_OTHERS: dict[str, Any] = {
    "waypoints": (),
    "method": Request.method,
    "beside": False,
    "takeoff_and_landing": False,
    "return_to_start": False,
}


@dataclasses.dataclass(frozen=True, eq=False)
class InspectionControls:
    """Handles of the panel, by what they are for; each is viser's."""

    status: Any
    legend: Any
    camera: Any
    distance: Any
    forward: Any
    sideways: Any
    from_start: Any
    export: Any

    @property
    def asking(self) -> tuple[Any, ...]:
        """Those whose change asks anew."""
        return self.camera, self.distance, self.forward, self.sideways, self.from_start

    def request(self, place: tuple[float, float], rules: Request, highest: float | None) -> InspectionRequest:
        """The request to inspect the building at a place.

        Args:
            place: x and y [m].
            rules: of the page, whose start is the home where wanted.
            highest: greatest z [m]; None: any.
        """
        home: Point3 | None = rules.places[0] if self.from_start.value else None
        overlap = tuple(round(0.01 * float(one.value), 4) for one in (self.forward, self.sideways))
        return InspectionRequest(
            place,
            home,
            self.camera.value,
            Capture(float(self.distance.value), (overlap[0], overlap[1])),
            dataclasses.replace(rules, **_OTHERS),
            highest,
        )

    def tell(self, words: str, legend: str) -> None:
        """Show what came of an inspection, or what is being done."""
        for control, content in ((self.status, words), (self.legend, legend)):
            control.content = content
            control.visible = bool(content)


def add_answer(gui: GuiApi) -> dict[str, Any]:
    """Where an inspection is told of; nothing is shown before the first."""
    return {"status": gui.add_markdown("", visible=False), "legend": gui.add_html("", visible=False)}


def add_inspection(gui: GuiApi, answer: dict[str, Any], formats: Sequence[str]) -> InspectionControls:
    """Add the folder that says how buildings are inspected.

    Args:
        gui: of the page.
        answer: of `add_answer`.
        formats: endings of files to download.
    """
    names = tuple(row["name"] for row in CAMERAS)
    forward, sideways = (100.0 * share for share in _FIRST.overlap)
    with gui.add_folder("Inspect a building", expand_by_default=False):
        return InspectionControls(
            **answer,
            camera=gui.add_dropdown("Camera", names, initial_value=names[0]),
            distance=gui.add_slider("Distance [m]", _NEAR, _FAR, 0.5, _FIRST.distance),
            forward=gui.add_slider("Overlap in a row [%]", 0.0, _MOST, 5.0, forward),
            sideways=gui.add_slider("Overlap of rows [%]", 0.0, _MOST, 5.0, sideways),
            from_start=gui.add_checkbox("Fly from the start", False),
            export=gui.add_button_group("Download the inspection", tuple(formats)),
        )
