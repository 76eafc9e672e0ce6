"""Waypoints of missions: a place to visit, how the leg to it is flown, and what is done there."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from maxjax.core.grid import Point3
from maxjax.planning.look import Look
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.task import points_of
from maxjax.planning.touchdown import Touchdown

LONGEST_HOVER = 3600.0  # [s]
_BESIDE = 0.1  # from an upright line through a point, nearer to which no heading leads to it [m]


@dataclasses.dataclass(frozen=True)
class Waypoint:
    """A place to visit, and how to fly the leg that leads to it.

    Attributes:
        position: [m], ENU.
        hover: seconds to rest there, 0 to stop without waiting. None: it is flown through.
        speed: greatest speed on the leg [m/s]. None: that of the flight limits.
        radius, margin: distances of the leg [m], as in `Distances`. None: those of the mission.
        heading: where the nose points on the leg and at rest here [degrees], clockwise from north, the map's y axis.
            None: along the course.
        look_at: a point of interest that the nose points to instead [m], ENU.
        look: where the camera looks besides, and what it takes. None: nothing is said of it.
        alternatives: other places to visit in its place [m], or waypoints: the one that costs least to reach is taken.
        touchdown: of the last waypoint, what the vehicle lands on upright below it. None: nothing, or the ground.

    Raises:
        ValueError: if the position or the point of interest is not three finite numbers, the time negative or above an
            hour, the speed not positive, the heading not within ±360 degrees, both a heading and a point are given, or
            the look is none; or the touchdown is none or not below the position.
    """

    position: Point3
    hover: float | None = None
    speed: float | None = None
    radius: float | None = None
    margin: float | None = None
    heading: float | None = None
    look_at: Point3 | None = None
    look: Look | None = None
    alternatives: tuple[Waypoint | Point3, ...] = ()
    touchdown: Touchdown | None = None

    def __post_init__(self) -> None:
        if self.look is not None and not isinstance(self.look, Look):
            raise ValueError(f"Waypoint.look: expected a maxjax.Look, given {self.look!r}")
        for place in ("position",) if self.look_at is None else ("position", "look_at"):
            x, y, z = points_of(f"Waypoint.{place}", getattr(self, place), (3,)).tolist()
            object.__setattr__(self, place, (x, y, z))
        object.__setattr__(self, "alternatives", tuple(map(_alternative, self.alternatives)))
        if self.touchdown is not None and not (
            isinstance(self.touchdown, Touchdown) and self.touchdown.height < self.position[2]
        ):
            raise ValueError(
                f"Waypoint.touchdown: expected a Touchdown below z {self.position[2]:g}, given {self.touchdown!r}"
            )
        if self.look_at is not None and not all(map(math.isfinite, self.look_at)):
            raise ValueError(f"Waypoint.look_at: expected three finite numbers, given {self.look_at}")
        if self.heading is not None and self.look_at is not None:
            raise ValueError(f"Waypoint: expected heading or look_at, given both, {self.heading} and {self.look_at}")
        limits = (
            ("hover", 0.0, LONGEST_HOVER, "seconds"),
            ("speed", 0.0, math.inf, "a positive number of m/s"),
            ("heading", -360.0, 360.0, "degrees"),
        )
        for name, least, most, meaning in limits:
            given = getattr(self, name)
            number = isinstance(given, int | float) and not isinstance(given, bool)
            fits = number and (least < given < most if name == "speed" else least <= given <= most)
            if given is not None and not fits:
                interval = f" from {least:g} to {most:g}" if math.isfinite(most) else ""
                raise ValueError(f"Waypoint.{name}: expected {meaning}{interval}, given {given!r}")

    @property
    def aims(self) -> bool:
        """Whether the nose points elsewhere than along the course."""
        return self.heading is not None or self.look_at is not None

    @property
    def choices(self) -> tuple[Waypoint, ...]:
        """It and its alternatives, each by itself; a place is flown to and rested at as the waypoint is."""
        own = dataclasses.replace(self, alternatives=())
        others = (
            other if isinstance(other, Waypoint) else dataclasses.replace(own, position=other, touchdown=None)
            for other in self.alternatives
        )
        return own, *others

    def yaw_from(self, places: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, " n"]:
        """Where the nose points at some places of the leg [rad], from east to north; NaN where it is left open.

        Args:
            places: [m], ENU; above or below the point of interest nothing is asked for.
        """
        if self.look_at is None:
            return np.full(len(places), math.nan if self.heading is None else math.radians(90.0 - self.heading))
        east, north, _ = (np.asarray(self.look_at) - places).T
        yaw: Float64[np.ndarray, " n"] = np.where(np.hypot(east, north) > _BESIDE, np.arctan2(north, east), math.nan)
        return yaw

    def distances(self, others: Distances) -> Distances:
        """Those of the leg that leads here, where it has none of its own those of the mission.

        Raises:
            ValueError: as `Distances`.
        """
        radius = others.radius if self.radius is None else self.radius
        return Distances(radius, others.margin if self.margin is None else self.margin, others.price)


def _alternative(given: Waypoint | Sequence[float]) -> Waypoint | Point3:
    """A place, or a waypoint without alternatives of its own; raises a ValueError for what is none."""
    if isinstance(given, Waypoint):
        if given.alternatives:
            raise ValueError(
                f"Waypoint.alternatives: expected waypoints without their own, given one with {len(given.alternatives)}"
            )
        return given
    x, y, z = points_of("Waypoint.alternatives", given, (3,)).tolist()
    return x, y, z


def legs_of(waypoints: Sequence[Waypoint]) -> tuple[Float64[np.ndarray, "b 3"], Float64[np.ndarray, "b 3"]]:
    """Starts and goals of the legs between some waypoints [m].

    Raises:
        ValueError: for fewer than two waypoints.
    """
    if len(waypoints) < 2:
        raise ValueError(f"waypoints: expected at least two, the start first, given {len(waypoints)}")
    pairs = np.array([(a.position, b.position) for a, b in itertools.pairwise(waypoints)], np.float64)
    return pairs[:, 0], pairs[:, 1]
