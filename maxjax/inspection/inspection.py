"""What comes of an inspection or a survey: photos, what they show, and the missions that take them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Int64

from maxjax.core.status import Status
from maxjax.inspection.capture import Capture
from maxjax.inspection.photo_camera import Camera
from maxjax.inspection.scenery import Scenery
from maxjax.inspection.seen_area import Coverage
from maxjax.inspection.views import Views
from maxjax.planning.mission import Mission


@dataclasses.dataclass(frozen=True, eq=False)
class Inspection:
    """Photos of a surface, and the missions that take them.

    Attributes:
        photos: in the order in which they are taken, flight by flight.
        flight: (n,) number of the flight that takes each photo.
        coverage: what they show, and what cannot be seen.
        missions: one a flight, verified.
        vehicles: of each flight, the number of the vehicle.
        camera: that takes the photos.
        capture: what was asked of them.
        tried: how many views the photos were chosen from.
        remarks: sentences that a user should know.
        timings: seconds by stage.
        scenery: what hides.
        least: no fewer of the views that were tried show as much; 0: not known.
    """

    photos: Views
    flight: Int64[np.ndarray, " n"]
    coverage: Coverage
    missions: tuple[Mission, ...]
    vehicles: tuple[int, ...]
    camera: Camera
    capture: Capture
    tried: int
    remarks: tuple[str, ...]
    timings: Mapping[str, float]
    scenery: Scenery = dataclasses.field(repr=False)
    least: int = 0

    @property
    def status(self) -> Status:
        """OK if every mission is; else that of the first that is not."""
        return next((mission.status for mission in self.missions if mission.status != Status.OK), Status.OK)

    @property
    def mission(self) -> Mission:
        """The only mission.

        Raises:
            ValueError: if there are several.
        """
        if len(self.missions) != 1:
            raise ValueError(f"mission: expected one flight, and there are {len(self.missions)}; use missions[k]")
        return self.missions[0]

    @property
    def length(self) -> float:
        """Of all flights [m]; NaN unless all are OK."""
        return float(sum(mission.length for mission in self.missions))

    def __str__(self) -> str:
        flights = f"{len(self.missions)} flights" if len(self.missions) != 1 else "one flight"
        return f"{len(self.photos)} photos in {flights} of {self.length:,.0f} m: {self.coverage}"

    def to_dict(self) -> dict[str, Any]:
        """As texts, numbers and lists, as `inspection.json` holds it; angles in degrees."""
        photos = self.photos
        return {
            "status": self.status.name,
            "camera": dataclasses.asdict(self.camera),
            "capture": dataclasses.asdict(self.capture),
            "coverage": self.coverage.to_dict(),
            "photos": [
                {
                    "flight": flight,
                    "position": place,
                    "yaw": yaw,
                    "pitch": pitch,
                }
                for flight, place, yaw, pitch in zip(
                    self.flight.tolist(),
                    np.round(photos.position, 6).tolist(),
                    np.round(np.degrees(photos.yaw), 6).tolist(),
                    np.round(np.degrees(photos.pitch), 6).tolist(),
                    strict=True,
                )
            ],
            "tried": self.tried,
            "least": self.least,
            "flights": [
                {
                    "vehicle": vehicle,
                    "status": mission.status.name,
                    "length": mission.length,
                    "clearance": mission.clearance,
                    "path": np.round(mission.path, 6).tolist(),
                    "waypoints": [list(waypoint.position) for waypoint in mission.waypoints],
                }
                for vehicle, mission in zip(self.vehicles, self.missions, strict=True)
            ],
            "remarks": list(self.remarks),
            "timings": dict(self.timings),
        }
