"""How an area is swept: from how far above what, in which direction, once or twice, with how much room to turn."""

from __future__ import annotations

import dataclasses
import math

from maxjax.inspection.capture import Capture
from maxjax.inspection.height_profile import Above
from maxjax.inspection.photo_camera import Camera


@dataclasses.dataclass(frozen=True)
class Sweep(Capture):
    """Photos of a survey, and its lines.

    Attributes:
        distance: of the photos above what lies below [m].
        overlap: of a photo with the next one of its line, and with one of the next line.
        incidence, resolution: as of `Capture`.
        above: what the distance counts from: the ground, or the roofs where there are any.
        heading: of the legs, clockwise from north [deg]; None: that of fewest turns.
        cross: whether the area is swept once more, at right angles.
        beyond: how far lines and photos reach beyond an outline, so that its border is seen as often as the rest [m].
        turn: how far a leg runs on beyond its photos, to turn there [m].
        pitch: elevation of the camera [deg]; -90 straight down.
        width: of a corridor along a line [m], which the area then is; None: it is an outline.
        speed: greatest on the legs [m/s]; it is less where the shutter asks for it.

    Raises:
        ValueError: for numbers that are not finite, a width or a speed that is not positive, a negative turn or reach,
            a pitch that is not from -90 to 0, or a cross of a corridor; as `Capture`.
    """

    distance: float = 60.0
    overlap: tuple[float, float] = (0.75, 0.65)
    above: Above = "ground"
    heading: float | None = None
    cross: bool = False
    beyond: float = 0.0
    turn: float = 10.0
    pitch: float = -90.0
    width: float | None = None
    speed: float = 10.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.above not in ("ground", "roof"):
            raise ValueError(f"Sweep.above: expected ground or roof, given {self.above!r}")
        if self.heading is not None and not math.isfinite(self.heading):
            raise ValueError(f"Sweep.heading: expected a finite angle [deg], given {self.heading}")
        for name, length in (("turn", self.turn), ("beyond", self.beyond)):
            if not 0.0 <= length < math.inf:
                raise ValueError(f"Sweep.{name}: expected at least 0 m, given {length}")
        if not -90.0 <= self.pitch <= 0.0:
            raise ValueError(f"Sweep.pitch: expected an elevation from -90 to 0 degrees, given {self.pitch}")
        for name, given in (("width", self.width), ("speed", self.speed)):
            if given is not None and not 0.0 < given < math.inf:
                raise ValueError(f"Sweep.{name}: expected a positive finite number, given {given}")
        if self.width is not None and self.cross:
            raise ValueError("Sweep.cross: expected an area to sweep twice, given a corridor; leave one of both out")

    def every(self, camera: Camera) -> float:
        """Distance between the photos of a line: their height lies along it [m]."""
        return (1.0 - self.overlap[0]) * camera.footprint(self.distance)[1]

    def apart(self, camera: Camera) -> float:
        """Distance between lines, at most: the photos' width lies across them [m]."""
        return (1.0 - self.overlap[1]) * camera.footprint(self.distance)[0]
