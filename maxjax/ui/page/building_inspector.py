"""Inspects the building that was clicked, in a thread of its own: paths are planned meanwhile.

click, controls → InspectionRequest → worker → InspectionAnswer → scene, words
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from maxjax.core.status import Status
from maxjax.ui.page.charge_chart import charge_chart
from maxjax.ui.page.inspection_answer import InspectionAnswer, InspectionRequest, describe_inspection, inspect_building
from maxjax.ui.page.inspection_controls import InspectionControls
from maxjax.ui.page.inspection_scene import PhotographedFaces, inspection_legend, inspection_scene, without_building
from maxjax.ui.page.nodes import Scene
from maxjax.ui.page.page_map import City
from maxjax.ui.page.worker import Worker
from maxjax.ui.request import Request

Show = Callable[[Scene, City], None]
"""Called with what is to be shown below `/inspection`, and the map to draw around it."""


class BuildingInspector:
    """Inspects a building of a page's map again whenever something that counts for it has changed.

    Args:
        city: the map.
        controls: of inspections.
        show: shows what came of one.
    """

    def __init__(self, city: City, controls: InspectionControls, show: Show) -> None:
        self._city, self._controls, self._show = city, controls, show
        self._place: tuple[float, float] | None = None
        self._asked: InspectionRequest | None = None
        self.answer: InspectionAnswer | None = None
        """The last one; None before the first."""
        self.worker: Worker[InspectionRequest] = Worker(self._work)

    @property
    def points(self) -> Float[np.ndarray, "n 3"]:
        """What is to be seen of the inspection: viewpoints [m]; none before the first."""
        found = None if self.answer is None else self.answer.inspection
        return np.zeros((0, 3)) if found is None else found.photos.position

    def choose(self, place: tuple[float, float], rules: Request) -> None:
        """Inspect the building at a place, x and y [m]."""
        self._place, self._asked = place, None
        self.ask(rules)

    def ask(self, rules: Request) -> None:
        """Inspect the chosen building anew, where that would be another inspection."""
        if self._place is None:
            return
        asked = self._controls.request(self._place, rules, self._city.highest(rules.places[0]))
        if asked != self._asked:
            self._asked = asked
            self.worker.ask(asked)

    def _work(self, asked: InspectionRequest) -> None:
        self._controls.tell("### Inspecting …\nA large building takes a minute; the first one compiles, once.", "")
        found = inspect_building(self._city, asked)
        if self.worker.stale:
            return
        self.answer, inspection = found, found.inspection
        scene: Scene = {}
        legend, drawn = "", self._city
        if inspection is not None and inspection.status == Status.OK:
            faces = PhotographedFaces.of(self._city.voxels, asked.place, inspection.coverage)
            scene = inspection_scene(faces, inspection, self._city.frame)
            legend, drawn = inspection_legend(faces, inspection.coverage), without_building(self._city, faces)
            legend += charge_chart(found.flights, asked.rules.supply)
        self._show(scene, drawn)
        self._controls.tell(describe_inspection(found), legend)
