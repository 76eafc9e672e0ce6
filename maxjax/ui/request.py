"""What a user asks to be planned: arguments, a mission's TOML file, a plan's JSON and the page become one `Request`.

arguments, mission.toml, plan.json, page  →  Request  →  (with a map) MapTask  →  Plan or Mission
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from typing import Any

from maxjax.energy.airframe import Airframe
from maxjax.energy.battery import Battery
from maxjax.energy.split_flights import Supply
from maxjax.energy.wind import Wind
from maxjax.fields.price import Price
from maxjax.inspection.landing_place import Landing
from maxjax.io.airspace.airspace import Airspace
from maxjax.io.export.autopilot import Autopilot
from maxjax.io.geo.earth import Earth, TangentPlane
from maxjax.io.reading import Reading
from maxjax.planning.problem.distances import Distances
from maxjax.planning.waypoint import Waypoint
from maxjax.trajectories.limits import PX4, FlightLimits
from maxjax.ui.option_groups import (
    EnergyOptions,
    ExportOptions,
    LandingOptions,
    LimitOptions,
    Point3,
    ReadOptions,
    RouteOptions,
)

# What says where an answer goes, and not what is asked.
_OUTPUTS = tuple(field.name for field in dataclasses.fields(ExportOptions))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Request(ReadOptions, RouteOptions, LandingOptions, LimitOptions, EnergyOptions, ExportOptions):
    """A path from place to place through a map, how to read that, what to keep, and where the answer goes.

    Attributes:
        waypoints: start, places on the way and goal, in `frame`, without the way back; none: a page finds its own.
        return_to_start: whether the way leads back to the start.
        speed: greatest on the way [m/s]; a waypoint's own is that of the leg that leads to it.
        partial: whether the legs before the first that fails are written.
        beside: whether A* plans the same, to compare.
        notes: sentences on the files that it was made of.
    """

    waypoints: tuple[Waypoint, ...] = ()
    return_to_start: bool = False
    speed: float = PX4.speed
    partial: bool = False
    beside: bool = False
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, options: Any) -> Request:
        """The request of a command's options.

        Raises:
            ValueError: for a start without a goal or a roof to land on, or the other way round.
        """
        given = {
            field.name: getattr(options, field.name)
            for field in dataclasses.fields(cls)
            if hasattr(options, field.name)
        }
        lands = bool(getattr(options, "land_on", ())) or getattr(options, "land_at", None) is not None
        if (options.start is None) != (options.goal is None) and not (lands and options.goal is None):
            raise ValueError("--start and --goal: expected both or none, given one")
        via, others = getattr(options, "via", ()), getattr(options, "or_goal", ())
        if via and options.start is None:
            raise ValueError("--via: expected with --start and --goal, given without")
        places = (options.start, *via, options.goal)
        return cls.between(given.pop("map"), *(one for one in places if one is not None), **given).or_ending(others)

    @classmethod
    def between(cls, map: str, *places: Point3, **options: Any) -> Request:
        """The request of a path through places of a map, the start first."""
        return cls(map=map, waypoints=tuple(Waypoint(place) for place in places), **options)

    def or_ending(self, places: tuple[Point3, ...]) -> Request:
        """The same with further alternatives of its last waypoint.

        Raises:
            ValueError: for some where there is no waypoint but the start.
        """
        if not places:
            return self
        if len(self.waypoints) < 2:
            raise ValueError(f"--or-goal: expected with a goal, given {len(places)} and no waypoint after the start")
        last = self.waypoints[-1]
        last = dataclasses.replace(last, alternatives=(*last.alternatives, *places))
        return dataclasses.replace(self, waypoints=(*self.waypoints[:-1], last))

    @property
    def landing(self) -> Landing:
        """What a place to land on has to have; raises a ValueError for what is none."""
        return Landing(self.landing_radius, self.landing_slope, self.landing_edge, self.landing_height)

    @property
    def roofs(self) -> tuple[str | tuple[float, float], ...]:
        """What it may land on: names of buildings, and a place in its frame; raises a ValueError on the way back."""
        found = (*self.land_on, *(() if self.land_at is None else (self.land_at,)))
        if found and self.return_to_start:
            raise ValueError(
                f"--return-to-start: expected a mission that ends on a roof or at its start, given {found[0]!r} and "
                "the way back; leave one out"
            )
        return found

    @property
    def stops(self) -> tuple[Waypoint, ...]:
        """The waypoints in order, back to the start if asked."""
        back = (Waypoint(self.waypoints[0].position),) if self.return_to_start and self.waypoints else ()
        return (*self.waypoints, *back)

    @property
    def places(self) -> tuple[Point3, ...]:
        """Where the stops are."""
        return tuple(stop.position for stop in self.stops)

    @property
    def every_place(self) -> tuple[Point3, ...]:
        """Where the stops are, and then their alternatives."""
        others = (other.position for stop in self.stops for other in stop.choices[1:])
        return (*self.places, *others)

    @property
    def flown(self) -> tuple[Waypoint, ...]:
        """The stops, each with the speed of the leg that leads to it, its own or the mission's."""

        def own(stop: Waypoint) -> Waypoint:
            others = tuple(own(other) if isinstance(other, Waypoint) else other for other in stop.alternatives)
            return dataclasses.replace(stop, speed=stop.speed or self.speed, alternatives=others)

        return tuple(map(own, self.stops))

    @property
    def altitudes(self) -> tuple[float | None, float | None]:
        """Least and greatest height above ground [m]; None: any."""
        return self.floor, self.ceiling

    @property
    def is_mission(self) -> bool:
        """Whether there is more to it than a path from a start to a goal."""
        # Without their places, of which NaN is not equal to itself.
        plain = Waypoint((0.0, 0.0, 0.0))
        more = any(dataclasses.replace(stop, position=plain.position) != plain for stop in self.stops)
        return len(self.stops) > 2 or bool(self.roofs) or more

    def visiting(self, stops: Iterable[Waypoint]) -> Request:
        """The same with stops in the coordinates of the map [m], the roof that it ends on among them."""
        found = tuple(stops)
        return dataclasses.replace(self, waypoints=found, return_to_start=False, frame="map", land_on=(), land_at=None)

    @property
    def limits(self) -> FlightLimits:
        """The limits of the trajectory: those asked for, others of the autopilot; the speed is the greatest asked for.

        Raises:
            ValueError: for a limit that is not positive, or an autopilot that is none.
        """
        limits = PX4 if self.autopilot is None else Autopilot.named(self.autopilot).limits
        asked = {field.name: getattr(self, field.name) for field in dataclasses.fields(LimitOptions)}
        if asked["yaw_rate"] is not None:
            asked["yaw_rate"] = math.radians(asked["yaw_rate"])
        given = {name: value for name, value in asked.items() if value is not None}
        limits = dataclasses.replace(limits, speed=self.speed, **given)
        return dataclasses.replace(limits, speed=max([limits.speed, *(stop.speed or 0.0 for stop in self.stops)]))

    @property
    def supply(self) -> Supply | None:
        """Airframe, battery and wind; None where nothing is asked of energy.

        Raises:
            ValueError: for some of them without the others, or for figures that are none.
        """
        given = {name: getattr(self, name) for name in ("airframe", "battery", "reserve")}
        missing = [f"--{name}" for name, value in given.items() if value is None]
        if len(missing) == len(given) and self.wind is None and self.payload is None:
            return None
        if missing:
            raise ValueError(
                f"energy: expected --airframe, --battery and --reserve together, given no {' and no '.join(missing)}; "
                "there is no default: what flies, and what is to be left, is for you to say"
            )
        airframe = Airframe.named(self.airframe or "").with_payload(self.payload or 0.0)
        battery = Battery(self.battery or 0.0, self.reserve or 0.0)
        return Supply(airframe, battery, Wind.calm() if self.wind is None else Wind.blowing(*self.wind))

    @property
    def distances(self) -> Distances:
        """The distances to keep; raises a ValueError if they are none."""
        return Distances(self.radius, self.margin, price_of(self.price))

    @property
    def configuration(self) -> dict[str, Any]:
        """What is needed to ask the same again but the stops, by the names of options; for JSON."""
        left_out = (*_OUTPUTS, "waypoints", "partial", "beside", "notes")
        return {name: value for name, value in vars(self).items() if name not in left_out}

    def earth(self, named: Earth | None) -> Earth | None:
        """Where the map lies on Earth: where its file has it, else at the place that is asked for; None: unknown.

        Args:
            named: where the file says that it lies.

        Raises:
            ValueError: if the place is none, or the file says where it lies itself.
        """
        if self.place is None:
            return named
        if named is not None:
            raise ValueError(
                "--place: expected a map that does not say where it lies, and this one does; leave it out "
                "(--height-of-zero H states the height of its z = 0 above sea level)"
            )
        return TangentPlane(*self.place)

    def check(self) -> None:
        """Find out before a map is read whether what is told about it can be used.

        Raises:
            ValueError: for a place, a reference system or heights that are none.
            ImportError: where a package is missing that reference systems need.
        """
        if self.place is not None and self.crs is not None:
            raise ValueError("--crs: expected one of --place and --crs, given both; leave one out")
        if self.place is not None and self.height_of_zero is not None:
            raise ValueError(
                "--height-of-zero: expected one height of z = 0, given another by --place LAT LON H; leave it out"
            )
        self.earth(None)
        Airspace(self.floor, self.ceiling, self.ceiling_above_start)


def reading_of(options: ReadOptions) -> Reading:
    """How to read what a file leaves open."""
    return Reading(
        below=options.below,
        unknown=options.unknown,
        crs=options.crs,
        unit=options.unit,
        vertical_unit=options.vertical_unit,
        band=options.band,
        drop_classes=options.drop_class,
        only=options.only,
        height=options.height,
        levels=options.levels,
        up=options.up,
        offset=options.offset,
        inside=options.inside,
        accuracy=options.accuracy,
        height_of_zero=options.height_of_zero,
    )


def price_of(text: str) -> Price:
    """The price that `SHAPE`, `SHAPE:HEIGHT` or `none` names; raises a ValueError where it names none."""
    shape, _, height = text.partition(":")
    try:
        if shape == "none":
            return Price(height=0.0)
        return Price(shape, float(height)) if height else Price(shape)  # type: ignore[arg-type]
    except ValueError as error:
        raise ValueError(
            "--price: expected none, quadratic, exponential or speed, with a height of at least 0 as in quadratic:3.5, "
            f"given {text!r}"
        ) from error
