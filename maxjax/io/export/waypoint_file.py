"""Files of waypoints, `.plan` and `.waypoints`, made so that the autopilots that are to fly them keep the radius.

    text → read back → corners that are cut too near (`io.export.corners`) → a stop at each → text

Inserted points would not do: an autopilot passes over those within its radius. A hold does, since it comes to rest for
one. What a file relies on, and the height of a return to launch that is clear, are stated in it and beside it.

`.kmz` and `_litchi.csv` are for aircraft that stop at each waypoint (`io.export.stops`).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from maxjax.io.airspace.airspace import Airspace
from maxjax.io.export.as_flown import waypoints_of
from maxjax.io.export.autopilot import Autopilot
from maxjax.io.export.corners import cut_corners
from maxjax.io.export.endings import STOPPING, ending_of
from maxjax.io.export.fences import fences_of
from maxjax.io.export.flown_track import set_point_duration
from maxjax.io.export.items import Feet, Items, items_of
from maxjax.io.export.litchi import litchi_text
from maxjax.io.export.qgroundcontrol import plan_text
from maxjax.io.export.read_back import Standing, lines_in
from maxjax.io.export.return_height import ReturnHeight, return_height
from maxjax.io.export.stops import LIMITS, StopFlight, speed_remarks, stop_points
from maxjax.io.export.thinning import thinning_remark
from maxjax.io.export.upright_ways import upright
from maxjax.io.export.waypoint_list import waypoint_text
from maxjax.io.export.wpml import kmz_content, return_height_of
from maxjax.io.geo.earth import Earth
from maxjax.planning.mission import Mission, looks_of

_SHOWN = 3  # places that a sentence names


@dataclasses.dataclass(frozen=True, eq=False)
class WaypointFile:
    """Contents of a file of waypoints.

    Attributes:
        file: whose name says the format.
        mission: in the map.
        earth: where the map lies.
        speed: of legs that have none of their own, and the most of those that have [m/s].
        feet: where the ground is.
        airspace: whose areas become a geofence, where the format has one.
        autopilots: that are to fly it, each by itself.
        standings: where the vehicle may stand.
        remarks: sentences on the mission and on the place, first of its own.
    """

    file: Path
    mission: Mission
    earth: Earth
    speed: float
    feet: Feet
    airspace: Airspace | None
    autopilots: tuple[Autopilot, ...]
    standings: tuple[Standing, ...]
    remarks: tuple[str, ...] = ()

    def without(self, thinned: Mission) -> WaypointFile:
        """The file of a mission that was thinned."""
        remarks = (*self.remarks, thinning_remark(self.mission, thinned))
        return dataclasses.replace(self, mission=thinned, remarks=remarks)

    def shortest(self) -> float:
        """How long its autopilots take at least, one after the other, if they need not stop for corners [s]."""
        items = items_of(self.mission, self.earth, self.speed, Feet(self.feet.home))
        waypoints = waypoints_of(lines_in(Path("a.waypoints"), waypoint_text(items), self.standings[0]))
        return sum(set_point_duration(waypoints, autopilot) for autopilot in self.autopilots)

    def taking_off(self) -> WaypointFile:
        """The file with a take-off where ArduCopter's AUTO needs one, and the way up is clear."""
        if ending_of(self.file) in STOPPING or all(one.name != "arducopter" for one in self.autopilots):
            return self
        x, y, z = self.mission.path[0].tolist()
        feet = [self.feet.home, *(standing.level(x, y, self.feet.home) for standing in self.standings)]
        if all(upright(np.array([[x, y, foot], [x, y, z]]), self.mission, 0).ok for foot in feet):
            return dataclasses.replace(self, feet=dataclasses.replace(self.feet, takes_off=True))
        return dataclasses.replace(self, remarks=(*self.remarks, _NO_TAKE_OFF))

    def made(self) -> Made:
        """The text, with as many stops as it needs."""
        back = return_height(self.mission)
        if ending_of(self.file) in STOPPING:
            return dataclasses.replace(self, autopilots=())._stopping(back)
        hold = max(autopilot.rests_after for autopilot in self.autopilots)
        ends = [0] * self.feet.takes_off + [len(self.mission.path) - 1] * (self.feet.landing is not None)
        photos = [k for k, look in looks_of(self.mission).items() if look.photo]
        stops = dict.fromkeys([*ends, *photos], hold)
        needed = dict[int, float]()
        while True:
            draft = self._draft(stops, back, needed)
            found = self._too_near(draft.text)
            if not found.keys() - stops.keys():
                return draft
            needed |= {k: found[k] for k in found.keys() - stops.keys()}
            stops |= dict.fromkeys(found, hold)

    def _stopping(self, back: ReturnHeight) -> Made:
        """The content for aircraft that stop at each waypoint."""
        ending, height = ending_of(self.file), self._above_home(back.height)
        limits, lands = LIMITS[ending], self.feet.landing is not None
        points = stop_points(self.file, self.mission, self.earth, self.feet.home, self.speed, limits)
        flight = StopFlight(points, height, lands)
        remarks = [*self.remarks, *speed_remarks(self.mission, self.speed, limits)]
        if self.airspace is not None and self.airspace.areas:
            remarks.append(f"the {len(self.airspace.areas)} areas of the airspace are not in it: it has no geofence")
        remarks += _kmz_remarks(flight) if ending == ".kmz" else _litchi_remarks(flight)
        content = kmz_content(flight) if ending == ".kmz" else litchi_text(flight)
        return Made(content, (*remarks, *self._return_remarks(back, height)), (), height, ())

    def _too_near(self, text: str | bytes) -> dict[int, float]:
        """Least clearance at the corners that lead too near to something, by number, for any autopilot and standing."""
        found = dict[int, float]()
        for standing in self.standings:
            waypoints = waypoints_of(lines_in(self.file, text, standing))
            if len(waypoints.places) != len(self.mission.path):
                continue  # which the judgement refuses
            for autopilot in self.autopilots:
                corners, _ = cut_corners(waypoints, self.mission, autopilot)
                found |= {k: float(np.fmin(found.get(k, math.nan), least)) for k, least in corners.items()}
        return found

    def _draft(self, stops: Mapping[int, float], back: ReturnHeight, needed: Mapping[int, float]) -> Made:
        height = self._above_home(back.height)
        autopilots = tuple(autopilot.returning(height) for autopilot in self.autopilots)
        names = tuple(autopilot.name for autopilot in self.autopilots)
        items = items_of(self.mission, self.earth, self.speed, self.feet, stops, names)
        remarks = [
            *self.remarks,
            *self._camera_remarks(),
            *self._stop_remarks(stops, needed),
            *self._return_remarks(back, height),
        ]
        if self.file.suffix.lower() == ".waypoints":
            return Made(waypoint_text(items), (*remarks, *map(_relies, autopilots)), tuple(needed), height, autopilots)
        fences, lost = fences_of(self.airspace, self.mission.path, self.earth)
        remarks = [*lost, *remarks]
        text = plan_text(self._with_rally(items, height), fences, autopilots, remarks)
        return Made(text, (*remarks, *map(_relies, autopilots)), tuple(needed), height, autopilots)

    def _camera_remarks(self) -> list[str]:
        aimed = [look for look in looks_of(self.mission).values() if look.photo and look.yaw is not None]
        if len(self.autopilots) < 2 or not aimed:
            return []
        return [
            "made for both autopilots it has places to look at, which leave the heading of photos straight down open; "
            "a file for one of them has headings"
        ]

    def _above_home(self, height: float) -> float:
        """A height of the map above the ground at home, as low as that may be [m], rounded up to 0.1 m."""
        doubt = self.standings[0].terrain.doubt if len(self.standings) > 1 else 0.0
        return (
            max(0.0, math.ceil(10.0 * (height - self.feet.home + doubt) - 1e-6) / 10.0) if height > -math.inf else 0.0
        )

    def _with_rally(self, items: Items, height: float) -> Items:
        """The items with a rally point at home, where they are made for one autopilot.

        ArduCopter flies to a rally point at its height; PX4 counts its return height from there.
        """
        if len(self.autopilots) > 1:
            return items
        north, east, _ = items.home
        above = height if self.autopilots[0].name == "arducopter" else 0.0
        return dataclasses.replace(items, rally=(north, east, above))

    def _stop_remarks(self, stops: Mapping[int, float], needed: Mapping[int, float]) -> list[str]:
        if not needed:
            return []
        least = float(np.nanmin([*needed.values(), math.inf]))
        shown = sorted(needed)[:_SHOWN]
        places = "; ".join(_place(self.mission.path[k].tolist()) for k in shown)
        more = f" and {len(needed) - len(shown)} more" if len(needed) > len(shown) else ""
        names = " or ".join(autopilot.label for autopilot in self.autopilots)
        return [
            f"the vehicle stops for {max(stops.values()):g} s at {len(needed)} of {len(self.mission.path)} waypoints, "
            f"{places}{more}: flown through, {names} would cut their corners and come within {least:.2f} m of "
            f"something, where {self.mission.radius:g} m are to be kept; more margin makes them wider"
        ]

    def _return_remarks(self, back: ReturnHeight, height: float) -> list[str]:
        found = []
        why = "nothing stands on the way from anywhere"
        if height > 0.0:
            over = self._above_home(back.top)
            why = (
                f"on the way from {_place(back.origin)} it leads over what is {over:.1f} m high at "
                f"x {back.over[0]:.1f}, y {back.over[1]:.1f}"
            )
        found.append(f"a return to launch is clear {height:.1f} m above home and higher: {why}")
        if self.autopilots:
            found.append(
                "without its remote control or its ground station the vehicle returns, with the parameters of the file"
            )
        for autopilot in self.autopilots:
            if autopilot.return_height < height:
                parameter = "RTL_ALT" if autopilot.name == "arducopter" else "RTL_RETURN_ALT"
                value = autopilot.returning(height).parameters[parameter]
                found.append(
                    f"{autopilot.label} returns at {autopilot.return_height:g} m and may touch something on its way: "
                    f"set {parameter} to {value:g}"
                )
        if back.covered:
            found.append(
                f"from {len(back.covered)} of {back.places} places of the way no return to launch is clear, since "
                f"something stands above them, first at {_place(back.covered[0])}"
            )
        x, y, z = self.mission.path[0].tolist()
        if not upright(np.array([[x, y, self.feet.home], [x, y, z]]), self.mission, 0).ok:
            found.append("home is not clear: a descent from the start to the ground below it would touch something")
        return found


@dataclasses.dataclass(frozen=True)
class Made:
    """A file of waypoints.

    Attributes:
        text: of the file; bytes of a `.kmz`.
        remarks: sentences on what it does not hold, and on what it relies.
        stops: numbers of the path's points that are stopped at for their corners.
        return_height: above home, from which on a return to launch is clear [m].
        autopilots: with the parameters that it relies on.
    """

    text: str | bytes
    remarks: tuple[str, ...]
    stops: tuple[int, ...]
    return_height: float
    autopilots: tuple[Autopilot, ...]


_NO_TAKE_OFF = (
    "it has no take-off, since something stands above home or beside the way up; ArduCopter's AUTO does not begin on "
    "the ground without one: take off in GUIDED to the height of the start first"
)
_FROM_THERE = "its heights count from where the aircraft takes off: take off on the ground below the start"


def _kmz_remarks(flight: StopFlight) -> list[str]:
    end = "lands below it" if flight.lands else "hovers there until the pilot takes over"
    return [
        _FROM_THERE,
        f"the aircraft stops at each of its {len(flight.points)} waypoints; after the last one it {end}",
        f"without a signal of its remote control it flies on; a return leads {return_height_of(flight):g} m above home",
        "it names no aircraft and no camera: choose them where it is imported",
    ]


def _litchi_remarks(flight: StopFlight) -> list[str]:
    found = [
        _FROM_THERE,
        "it does not hold what Litchi sets for all of a mission: set Path Mode to Straight Lines, so that the aircraft "
        "stops at each waypoint and cuts no corner, and choose the finish action and the heading mode there",
    ]
    if flight.lands:
        found.append("it holds no take-off and no landing")
    return found


def _relies(autopilot: Autopilot) -> str:
    listed = ", ".join(f"{name} {value:g}" for name, value in autopilot.parameters.items())
    return f"flown by {autopilot.label} it relies on {listed}"


def _place(point: Sequence[float]) -> str:
    x, y, z = point
    return f"x {x:.1f}, y {y:.1f}, z {z:.1f}"
