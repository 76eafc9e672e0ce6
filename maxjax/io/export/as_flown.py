"""The judgement on what a file makes a vehicle fly: its lines on the true ground, against the map.

    text → lines in the map (`io.export.read_back`) → verifier → what is kept, or a refusal

What is flown has to be what was planned, to `AWAY`: a home on ground that is not there is refused even where there is
room to spare. Each leg has to keep its own radius outside its exemptions, as when it was planned; a trajectory's
set-points, joined by straight lines, keep it but for the sag of these below the curve. A rise and a descent touch
nothing but the ground. Waypoints are left within the radius of the autopilots that are to fly them
(`io.export.corners`): so do the corners that these cut. How the vehicle itself moves about its set-points is modelled
(`io.export.flown_track`): it touches nothing, and its clearance counts.

Of a file with latitudes, each leg has to keep as much more as the places of its map may be off (`io.geo.accuracy`), and
an end that stands nearer than that its own distance: buildings and lines move together, but the vehicle flies to where
its receiver says that it is.

Numbers in files are rounded. Where that alone, at most a millimetre, makes a line touch something, what was meant is
judged in its place.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from maxjax.core.voxel_map import VoxelMap
from maxjax.io.export.autopilot import BOTH, Autopilot
from maxjax.io.export.corners import Waypoints, cut_corners
from maxjax.io.export.flown_track import fly_track
from maxjax.io.export.halts import Halts, halts_of
from maxjax.io.export.read_back import Lines, Points
from maxjax.io.export.upright_ways import landing_fault, upright
from maxjax.planning.look import AimedLook
from maxjax.planning.mission import Mission
from maxjax.trajectories.clear_curve import project
from maxjax.trajectories.trajectory import Trajectory
from maxjax.verification.verdicts import Verification
from maxjax.verification.verifier import verify

_SPREAD = 2.0  # of a distance to keep, around ends that stand nearer
AWAY = 0.05  # from what was planned, at most [m]
_ROUNDED = 1e-3  # [m]
_FINE = 0.005  # between samples of what was meant [s]


@dataclasses.dataclass(frozen=True)
class AsFlown:
    """A file as flown by a vehicle.

    Attributes:
        clearance: least distance to an occupied voxel [m], ground left out; infinite where the map has none.
        aside: how far it leads from what was planned, but for corners that are cut, at most [m].
        remarks: sentences on what the format does not hold, and on what the file relies.
        left_out: numbers of the path's points that a file of waypoints has not.
        stops: numbers of the file's waypoints at which it stops, so that their corners are not cut.
        return_height: above home, from which on a return to launch is clear from everywhere [m]; None where the file
            counts from no home.
        autopilots: that it was judged for, with the parameters that it relies on.
        flights: of each of them.
        line: the waypoints of its only part, as read back [m]; empty where it has several.
        looks: what is done with a camera at them, by number.
    """

    clearance: float
    aside: float
    remarks: tuple[str, ...] = ()
    left_out: tuple[int, ...] = ()
    stops: tuple[int, ...] = ()
    return_height: float | None = None
    autopilots: tuple[Autopilot, ...] = ()
    flights: tuple[AutopilotFlight, ...] = ()
    line: Points = dataclasses.field(default_factory=lambda: np.zeros((0, 3)), repr=False)
    looks: Mapping[int, AimedLook] = dataclasses.field(default_factory=dict, repr=False)

    @property
    def duration(self) -> float:
        """How long all of its autopilots take, one after the other [s]."""
        return sum(one.duration for one in self.flights)

    def __str__(self) -> str:
        by = ", ".join(f"by {one.label} in {one.duration:.0f} s" for one in self.flights)
        said = f"as flown {by}" if by else "as flown"
        if math.isinf(self.clearance):
            return f"{said}: nothing in the map to come near to"
        return f"{said}: least clearance {self.clearance:.2f} m"


@dataclasses.dataclass(frozen=True)
class AutopilotFlight:
    """A file of waypoints as flown by an autopilot's model (`io.export.flown_track`), in still air.

    Attributes:
        label: of the autopilot.
        duration: from the first waypoint to the last one [s].
        clearance: of the vehicle, least distance to an occupied voxel [m], ground left out.
        swing: how far the vehicle is from its set-point, at most [m].
        halts: stops from everywhere on it; None where its speeds are not modelled.
    """

    label: str
    duration: float
    clearance: float
    swing: float
    halts: Halts | None = None


@dataclasses.dataclass(frozen=True)
class _Piece:
    """A line with what it has to keep, but for its sag below the curve that is meant [m]."""

    points: Points
    radius: float
    exemptions: tuple[float, float]
    sag: float = 0.0


def add_to_keep(mission: Mission, metres: float) -> Mission:
    """The mission with as much more to keep [m] on all of its legs, but around ends that stand nearer."""
    if metres == 0.0:
        return mission
    legs = []
    for leg in mission.legs:
        start, goal = (max(reach, _SPREAD * (leg.radius + metres)) for reach in leg.exemptions)
        legs.append(dataclasses.replace(leg, radius=leg.radius + metres, exemptions=(start, goal)))
    return dataclasses.replace(mission, legs=tuple(legs))


def judge_lines(
    file: Path,
    lines: Lines,
    mission: Mission,
    trajectory: Trajectory | None,
    away: float = AWAY,
    autopilots: Sequence[Autopilot] = BOTH,
) -> AsFlown:
    """Judge the lines of a file: their least clearance, and how far aside they lead.

    Args:
        file: for messages.
        lines: read from it.
        mission: that it holds.
        trajectory: where the file holds set-points; None for waypoints.
        away: how far they may lead from what was planned [m].
        autopilots: that are to fly them, where they are waypoints.

    Raises:
        ValueError: if they leave the map, touch something, come nearer to it than the plan may, or lead elsewhere.
    """
    clearance, wrong = _verdict(_pieces(file, lines, mission, trajectory), mission.map)
    aside = _aside(lines, mission, trajectory)
    if wrong and aside <= _ROUNDED:
        wrong = _verdict(_pieces(file, _meant(mission, trajectory), mission, trajectory), mission.map)[1]
    hint = "check the place on Earth and the ground at home, and state it where the map tells it by voxels only"
    if not wrong:
        wrong = landing_fault(lines, mission, away)
    for what, line, leg in (("take-off", lines.rise, 0), ("landing", lines.descent, -1)):
        if line is not None and not wrong:
            found = upright(line, mission, leg)
            clearance = float(np.fmin(clearance, found.clearance))
            if not found.ok:
                wrong = f"on {what} {_complaint(found, mission.legs[leg].radius)}"
                out = "" if lines.holds is None else ", or leave both out"
                hint = f"{what} is straight, to or from the ground: choose another end{out}"
    flights = tuple[AutopilotFlight, ...]()
    if not wrong and lines.holds is not None:
        flights = tuple(_flight(waypoints_of(lines), mission, autopilot) for autopilot in autopilots)
        clearance = min([clearance, *(one.clearance for one in flights)])
        wrong = next((_touches(one) for one in flights if not one.clearance > 0.0), "")
        hint = "fly slower, or plan with more margin"
    if not wrong and lines.holds is not None:
        for autopilot in autopilots:
            corners, least = cut_corners(waypoints_of(lines), mission, autopilot)
            clearance = min(clearance, least)
            if corners and not wrong:
                wrong = _cut_too_near(corners, lines, mission, autopilot)
                hint = (
                    f"hold there for {autopilot.rests_after:g} s, so that the vehicle stops, or plan with more margin"
                )
    if not wrong and not aside <= away:
        wrong = f"it leads {aside:.2f} m aside from what was planned; its least clearance is {clearance:.2f} m"
    if wrong:
        raise ValueError(f"{file}: as flown {wrong}; nothing was written: {hint}")
    line = lines.parts[0] if len(lines.parts) == 1 else np.zeros((0, 3))
    return AsFlown(clearance, aside, flights=flights, line=line, looks=lines.looks)


def waypoints_of(lines: Lines) -> Waypoints:
    """The waypoints of a file that has holds; raises a ValueError for one that has none."""
    if lines.holds is None or lines.accepted is None:
        raise ValueError("expected a file of waypoints with holds and acceptance radii")
    return Waypoints(lines.parts[0], lines.holds, lines.accepted, lines.rise, lines.descent is not None, lines.speeds)


def _flight(waypoints: Waypoints, mission: Mission, autopilot: Autopilot) -> AutopilotFlight:
    """The flight of an autopilot; a clearance of 0 where the vehicle touches something or leaves the map.

    The rules of the air are kept by its set-points: what it swings about them does not count for these.
    """
    track = fly_track(waypoints, autopilot)
    where = mission.map
    solid = VoxelMap(np.asarray(where.occupied), np.asarray(where.ground), None, where.grid)
    found = verify(track.points, solid)
    clearance = found.clearance if found.ok and math.isfinite(track.duration) else 0.0
    halts = halts_of(track, where) if track.timed else None
    return AutopilotFlight(autopilot.label, track.duration, clearance, track.swing, halts)


def _touches(flight: AutopilotFlight) -> str:
    """What is wrong with a flight that touches something, in words."""
    if math.isinf(flight.duration):
        return f"{flight.label} cannot follow: its vehicle would never arrive"
    return (
        f"by {flight.label} it leaves the map or touches something: "
        f"the vehicle swings up to {flight.swing:.2f} m about its set-points"
    )


def _cut_too_near(corners: Mapping[int, float], lines: Lines, mission: Mission, autopilot: Autopilot) -> str:
    """The fault of the first of some corners, in words."""
    k = min(corners)
    x, y, z = lines.parts[0][k].tolist()
    where = f"waypoint {k + 1} of {len(lines.parts[0])} (x {x:.1f}, y {y:.1f}, z {z:.1f})"
    if math.isnan(corners[k]):
        return f"{autopilot.label} does not stop at {where}, where it has to"
    return (
        f"{autopilot.label} cuts the corner at {where} and comes within {corners[k]:.2f} m of something, "
        f"where {mission.radius:g} m are to be kept"
    )


def _meant(mission: Mission, trajectory: Trajectory | None) -> Lines:
    if trajectory is None:
        return Lines((mission.path,))
    motion = trajectory.sampled(_FINE)
    return Lines((motion.position,), motion.time)


def _pieces(file: Path, lines: Lines, mission: Mission, trajectory: Trajectory | None) -> list[_Piece]:
    if trajectory is not None and lines.times is not None:
        return list(_stretches(lines.parts[0], lines.times, mission, trajectory))
    parts = lines.parts
    if len(parts) == 1 and len(mission.legs) > 1:
        (line,) = parts
        if len(line) != len(mission.path):
            raise ValueError(f"{file}: expected {len(mission.path)} waypoints, read back {len(line)}")
        parts = tuple(line[first : last + 1] for first, last in itertools.pairwise(mission.places.tolist()))
    if len(parts) != len(mission.legs):
        raise ValueError(f"{file}: expected lines of {len(mission.legs)} legs, read back {len(parts)}")
    found = []
    for k, (line, leg) in enumerate(zip(parts, mission.legs, strict=True)):
        # Where two legs' ends differ by what they were moved, the exemption covers both.
        joint = math.dist(mission.path[mission.places[k]], leg.path[0])
        start, goal = (reach + joint if reach else 0.0 for reach in leg.exemptions)
        found.append(_Piece(line, leg.radius, (start, goal)))
    return found


def _stretches(
    points: Points, times: Float64[np.ndarray, " n"], mission: Mission, trajectory: Trajectory
) -> Iterator[_Piece]:
    """Set-points from one waypoint where something changes to the next, where the vehicle is at rest."""
    exempt, legs = trajectory.exemptions, mission.legs
    cuts = [k for k in range(1, len(legs)) if exempt[k] > 0.0 or legs[k - 1].radius != legs[k].radius]
    for first, last in itertools.pairwise([0, *cuts, len(legs)]):
        begin = -math.inf if first == 0 else float(trajectory.passes[first])
        end = math.inf if last == len(legs) else float(trajectory.passes[last])
        inside = points[(times > begin) & (times < end)]
        cut = [_at(time, times, points) if math.isfinite(time) else points[:0] for time in (begin, end)]
        line = np.concatenate([cut[0], inside, cut[1]])
        yield _Piece(line, legs[first].radius, (exempt[first], exempt[last]), _sag(trajectory, times))


def _at(time: float, times: Float64[np.ndarray, " n"], points: Points) -> Points:
    return np.array([[np.interp(time, times, column) for column in points.T]])


def _sag(trajectory: Trajectory, times: Float64[np.ndarray, " n"]) -> float:
    """How far a curve lies from the straight lines between some of its points, at most: a t² / 8 [m].

    It is the curve's that was meant, not that of what a file holds: that may be anything.
    """
    fastest = np.linalg.norm(trajectory.at(times).acceleration, axis=1).max()
    return float(fastest * np.diff(times, prepend=times[0]).max() ** 2) / 8.0


def _verdict(pieces: list[_Piece], where: VoxelMap) -> tuple[float, str]:
    """Least clearance [m], and what is wrong in words; empty where nothing is."""
    whole = verify(np.concatenate([piece.points for piece in pieces]), where)
    if not whole.ok:
        return whole.clearance, _complaint(whole, 0.0)
    for piece in pieces:
        kept = max(piece.radius - piece.sag, 0.0)
        found = verify(piece.points, where, radius=kept, exemptions=piece.exemptions)
        if not found.ok:
            return whole.clearance, _complaint(found, piece.radius)
    return whole.clearance, ""


def _complaint(found: Verification, radius: float) -> str:
    if not found.inside:
        return "it leaves the map"
    near = ""
    if found.nearest is not None:
        x, y, z = found.nearest
        near = f"its least clearance is {found.clearance:.2f} m, at x {x:.1f}, y {y:.1f}, z {z:.1f}"
    if found.too_near:
        return f"{near}, where {radius:g} m are to be kept"
    return f"it comes onto the ground or touches something, voxel {found.first_hit}; {near or 'near nothing else'}"


def _aside(lines: Lines, mission: Mission, trajectory: Trajectory | None) -> float:
    """Greatest distance between what was read and what was meant [m]: at each time, else of points to lines."""
    if trajectory is not None and lines.times is not None:
        return float(np.linalg.norm(trajectory.at(lines.times).position - lines.parts[0], axis=1).max())
    read, meant = _moving(np.concatenate(lines.parts)), _moving(mission.path)
    if min(len(read), len(meant)) < 2:
        return float(np.linalg.norm(read[:, None] - meant[None], axis=2).max())
    return float(max(project(read, meant)[0].max(), project(meant, read)[0].max()))


def _moving(points: Points) -> Points:
    """Points without those that are the one before."""
    found: Points = points[np.r_[True, (points[1:] != points[:-1]).any(axis=1)]]
    return found
