"""Inspections of a page: a pure function of the map and of the building that was clicked.

(City, InspectionRequest) ↦ InspectionAnswer
"""

from __future__ import annotations

import dataclasses
import time

from maxjax.core.grid import Point3
from maxjax.core.status import Status
from maxjax.energy.split_flights import BatteryFlight, weigh_flight
from maxjax.inspection.capture import Capture
from maxjax.inspection.inspect_target import inspect
from maxjax.inspection.inspection import Inspection
from maxjax.inspection.vehicles import Vehicles
from maxjax.ui.page.answer import close_air, describe_battery
from maxjax.ui.page.page_map import City
from maxjax.ui.request import Request

_PARTS = 3  # unseen ones that are named


@dataclasses.dataclass(frozen=True)
class InspectionRequest:
    """A building to inspect, and how.

    Attributes:
        place: of the building, x and y [m].
        home: where the flight begins and ends, in the air [m]; None: a free place near the building.
        camera: its name in the table.
        capture: what the photos are to be like.
        rules: distances, altitude band, limits and battery; its waypoints do not count.
        highest: greatest z [m]; None: any.
    """

    place: tuple[float, float]
    home: Point3 | None
    camera: str
    capture: Capture
    rules: Request
    highest: float | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class InspectionAnswer:
    """The inspection that was asked for, or why there is none.

    Attributes:
        request: what was asked.
        inspection: of the building; None where it cannot be inspected.
        flights: its missions in time, with their energy where a battery is given.
        refusal: why it cannot be inspected; empty else.
        seconds: from request to answer.
    """

    request: InspectionRequest
    inspection: Inspection | None
    flights: tuple[BatteryFlight, ...]
    refusal: str
    seconds: float

    @property
    def verified(self) -> Inspection:
        """The inspection, whose flights are all verified and within the battery.

        Raises:
            ValueError: if there is none.
        """
        if self.inspection is None:
            raise ValueError(f"expected an inspection, given none: {self.refusal}")
        for flight in self.flights:
            if flight.status != Status.OK:
                why = flight.status.advice if flight.verdict is None else flight.verdict.describe()
                raise ValueError(f"{flight.status.name}: {why}")
        return self.inspection

    @property
    def duration(self) -> float:
        """Of all flights that have times [s]."""
        return sum(flight.trajectory.duration for flight in self.flights if flight.trajectory is not None)


def inspect_building(city: City, asked: InspectionRequest) -> InspectionAnswer:
    """Inspect the building at a place, by the rules of the page."""
    began, rules = time.perf_counter(), asked.rules
    homes = () if asked.home is None else (asked.home,)
    try:
        found = inspect(
            close_air(city, rules.altitudes, asked.highest),
            asked.place,
            asked.camera,
            capture=asked.capture,
            vehicles=Vehicles(homes) if rules.supply is None else Vehicles.on_battery(rules.supply, homes),
            distances=rules.distances,
        )
        flights = tuple(weigh_flight(mission, rules.limits, rules.supply) for mission in found.missions)
    except (ValueError, ImportError, MemoryError, RuntimeError) as error:
        return InspectionAnswer(asked, None, (), str(error).partition("\n")[0], time.perf_counter() - began)
    return InspectionAnswer(asked, found, flights, "", time.perf_counter() - began)


def describe_inspection(found: InspectionAnswer) -> str:
    """An inspection in words: Markdown, a headline and the figures."""
    inspection = found.inspection
    if inspection is None:
        return f"### Cannot be inspected\n{found.refusal}"
    coverage, status = inspection.coverage, inspection.status
    head = f"### Inspection of {coverage.surface.name}"
    if status != Status.OK:
        return f"{head}: no flight\n**{status.name}** {status.advice}"
    unseen = sum(part.area for part in coverage.unseen)
    overlap = f"{100.0 * coverage.share(coverage.wanted):.1f} % of it in {coverage.wanted} photos or more"
    rows = [
        head,
        f"**{100.0 * coverage.share():.1f} %** of {coverage.surface.area:,.0f} m² seen"
        f"{f', {overlap}' if coverage.wanted > 1 else ''}; **{unseen:.1f} m²** unseen.",
        f"**{len(inspection.photos)} photos** by {inspection.camera.name}, at most {1e3 * coverage.limit:.3g} mm a "
        f"pixel; **{inspection.length:,.0f} m**, flown in **{found.duration:.0f} s**, verified; "
        f"computed in {found.seconds:.0f} s.",
    ]
    rows += [f"Unseen: {part}." for part in coverage.unseen[:_PARTS]]
    more = coverage.unseen[_PARTS:]
    rows += [f"{len(more)} more parts, {sum(part.area for part in more):.1f} m², are unseen."] if more else []
    rows += [f"Battery: {describe_battery(flight)}." for flight in found.flights if flight.verdict is not None]
    return "\n\n".join(rows)
