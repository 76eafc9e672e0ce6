"""A real city: surveyed footprints as upright boxes, for exact ray casting and distances.

    polygon ⊂ union of boxes,   each point of a box within √2 · tolerance of the polygon

A footprint is swept in its own frame, along the direction that most of its outline follows, or across it, whichever
takes fewer boxes. Between two corners it is a stack of trapezoids, an interval [low(x), high(x)] each. Where low or
high would vary by more than the tolerance, the strip is cut, down to a width of the tolerance. Intervals of consecutive
strips are merged into one box as long as the variation of low and of high stays within the tolerance; gaps up to twice
as wide are closed, and boxes thinner than the tolerance are merged into a neighbour that is at least as long. So walls
move outwards by at most the tolerance along each of the two axes. A rectangle is one box, without error.

The terrain is flattened: each footprint stands on the plane z = 0, its own floor subtracted. The slope is lost: heights
of neighbouring roofs are wrong relative to each other by the difference of their floors, and so is the height above sea
of a path. Roofs are flat, at their highest point; overhangs above a passage are solid down to the ground.

Footprints are float64 in any frame (national coordinates, for example); geoms are float32 in a local frame. `crop`
moves the origin to the middle of the part that is flown in.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from maxjax.sim.worlds.geoms import Geoms, concatenate, ground_plane
from maxjax.sim.worlds.solids import ABSENT, upright_boxes

Ring = Float[np.ndarray, "_ 2"]
# (west, east, south, north) of boxes in the footprint's frame.
Boxes = Float[np.ndarray, "_ 4"]

TOLERANCE = 0.5  # [m]
# Corners that differ only by the rounding of a rotation must not cut strips; so the cover holds to a micrometre.
_DIGITS = 6
_ROUNDING = 1e-6  # of a rotation and its inverse [m]
_FARTHEST = 1e5  # float32 resolves 8 mm here; beyond, boxes have to be centred first [m]


def city(rows: Float[np.ndarray, "n 7"], slots: int) -> Geoms:
    """Ground and boxes; padded, so that cities of one size share a program.

    Args:
        rows: from `footprint_rows` and `crop`, within 100 km of the origin.
        slots: boxes in all.

    Raises:
        ValueError: if there are more rows than slots; if a box is too far from the origin for float32.
    """
    farthest = float(np.abs(rows[:, :2]).max(initial=0.0))
    if not farthest <= _FARTHEST:
        raise ValueError(
            f"rows: expected coordinates within {_FARTHEST:g} m of the origin, given {farthest:g} m; "
            "centre them first, by `crop`"
        )
    if len(rows) > slots:
        raise ValueError(f"slots: expected at least {len(rows)}, one a box, given {slots}")
    padding = np.tile(ABSENT, (slots - len(rows), 1))
    return concatenate([ground_plane(), upright_boxes(jnp.asarray(np.concatenate([rows, padding]), jnp.float32))])


def crop(rows: Float[np.ndarray, "n 7"], centre: Float[np.ndarray, "2"], half: float) -> Float[np.ndarray, "m 7"]:
    """The boxes that reach into the square of half extent `half` [m] around `centre`, which becomes the origin."""
    moved = rows.copy()
    moved[:, :2] -= centre
    c, s = np.abs(np.cos(rows[:, 6])), np.abs(np.sin(rows[:, 6]))
    extent = np.stack([c * rows[:, 2] + s * rows[:, 3], s * rows[:, 2] + c * rows[:, 3]], -1)
    return moved[np.all(np.abs(moved[:, :2]) - extent < half, axis=1)]


def footprint_rows(rings: Sequence[Ring], height: float, tolerance: float = TOLERANCE) -> Float[np.ndarray, "n 7"]:
    """A footprint as rows of `solids.upright_boxes`, standing on z = 0.

    Args:
        rings: outlines and holes [m], even-odd.
        height: [m].
        tolerance: see the module [m].

    Raises:
        ValueError: for a tolerance that is not positive.
    """
    if not tolerance > 0:
        raise ValueError(f"tolerance: expected a positive number of metres, given {tolerance}")
    yaw = _direction(rings)
    covers = [
        (turn, _cover([np.round(_turned(ring, -turn), _DIGITS) for ring in rings], tolerance))
        for turn in (yaw, yaw + np.pi / 2)
    ]
    yaw, boxes = min(covers, key=lambda one: (len(one[1]), _area(one[1])))
    west, east, south, north = boxes.T
    middle = _turned(np.stack([0.5 * (west + east), 0.5 * (south + north)], -1), yaw)
    count = np.ones(len(boxes))
    columns = [*middle.T, 0.5 * (east - west), 0.5 * (north - south), 0 * count, height * count, yaw * count]
    return np.stack(columns, -1)


def _turned(points: Float[np.ndarray, "n 2"], angle: float) -> Float[np.ndarray, "n 2"]:
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(points @ np.array([[c, s], [-s, c]]))


def _area(boxes: Boxes) -> float:
    return float(np.sum((boxes[:, 1] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 2])))


def _direction(rings: Sequence[Ring]) -> float:
    """The direction of the edge with the least sum of deviations of all edges, up to right angles [rad]."""
    edges = np.concatenate([np.roll(ring, -1, axis=0) - ring for ring in rings])
    length = np.hypot(*edges.T)
    angle = np.arctan2(edges[:, 1], edges[:, 0])
    lean = np.abs(np.sin(angle[:, None] - angle)), np.abs(np.cos(angle[:, None] - angle))
    # Among equal costs the longest edge: its direction is the most accurate.
    cost = np.minimum(*lean) @ length - 1e-9 * length
    return float(angle[np.argmin(cost)])


@dataclasses.dataclass(frozen=True)
class _Span:
    """One interval over a strip: the range of its lower and that of its upper bound [m]."""

    low: float
    highest_low: float
    lowest_high: float
    high: float

    def joined(self, other: _Span) -> _Span:
        """The span over both strips."""
        return _Span(
            min(self.low, other.low),
            max(self.highest_low, other.highest_low),
            min(self.lowest_high, other.lowest_high),
            max(self.high, other.high),
        )

    def fits(self, tolerance: float) -> bool:
        """Whether one box exceeds the interval by no more than the tolerance anywhere."""
        return self.highest_low - self.low <= tolerance and self.high - self.lowest_high <= tolerance


@dataclasses.dataclass(frozen=True)
class _Strip:
    """The polygon between two abscissae [m]."""

    west: float
    east: float
    spans: list[_Span]


def _cover(rings: Sequence[Ring], tolerance: float) -> Boxes:
    """Boxes along the axes, their union a cover of the polygon."""
    finished: list[tuple[float, float, _Span]] = []
    growing: list[tuple[float, float, _Span]] = []  # boxes (west, east, span) that reach the present strip
    for strip in _strips(rings, tolerance):
        longer: list[tuple[float, float, _Span]] = []
        for span in strip.spans:
            fitting = (box for box in growing if box[1] == strip.west and box[2].joined(span).fits(tolerance))
            box = next(fitting, None)
            if box is None:
                longer.append((strip.west, strip.east, span))
            else:
                growing.remove(box)
                longer.append((box[0], strip.east, box[2].joined(span)))
        finished += growing
        growing = longer
    boxes = [[west, east, span.low, span.high] for west, east, span in [*finished, *growing]]
    return _merge_thin(np.array(boxes).reshape(-1, 4), tolerance)


def _strips(rings: Sequence[Ring], tolerance: float) -> Iterator[_Strip]:
    """The polygon in strips, from west to east."""
    a = np.concatenate(list(rings))
    b = np.concatenate([np.roll(ring, -1, axis=0) for ring in rings])
    a, b = np.where(a[:, :1] <= b[:, :1], a, b), np.where(a[:, :1] <= b[:, :1], b, a)
    slanted = a[:, 0] < b[:, 0]
    a, b = a[slanted], b[slanted]
    cuts = np.unique(np.concatenate([a[:, 0], b[:, 0], _crossings(a, b)])).tolist()
    for left, right in itertools.pairwise(cuts):
        crossing = (a[:, 0] <= left) & (b[:, 0] >= right)
        p, q = a[crossing], b[crossing]
        slope = (q[:, 1] - p[:, 1]) / (q[:, 0] - p[:, 0])
        if not len(slope):
            continue
        rise, width = float(np.abs(slope).max()) * (right - left), right - left
        parts = max(1, int(np.ceil(min(rise, width) / tolerance - 1e-9)))
        for west, east in itertools.pairwise(np.linspace(left, right, parts + 1).tolist()):
            at_west, at_east = (p[:, 1] + slope * (x - p[:, 0]) for x in (west, east))
            order = np.argsort(at_west + at_east, kind="stable")
            least = np.minimum(at_west, at_east)[order].tolist()
            most = np.maximum(at_west, at_east)[order].tolist()
            spans: list[_Span] = []
            for low, high in zip(range(0, len(order), 2), range(1, len(order), 2), strict=True):
                span = _Span(least[low], most[low], least[high], most[high])
                # No point of a closed gap is further than the tolerance from the interval above or below.
                if spans and span.highest_low - spans[-1].lowest_high <= 2 * tolerance:
                    spans[-1] = _Span(spans[-1].low, spans[-1].highest_low, span.lowest_high, span.high)
                else:
                    spans.append(span)
            yield _Strip(west, east, spans)


def _crossings(a: Ring, b: Ring) -> Float[np.ndarray, " _"]:
    """Abscissae at which edges from a to b (to the east) cross each other; a simple polygon has none."""
    slope = (b[:, 1] - a[:, 1]) / (b[:, 0] - a[:, 0])
    height = a[:, 1] - slope * a[:, 0]
    turn = slope[:, None] - slope
    x = (height - height[:, None]) / np.where(turn == 0, np.inf, turn)
    west, east = np.maximum(a[:, None, 0], a[:, 0]), np.minimum(b[:, None, 0], b[:, 0])
    return np.asarray(np.round(x[(turn > 0) & (x > west + _ROUNDING) & (x < east - _ROUNDING)], _DIGITS))


def _merge_thin(boxes: Boxes, tolerance: float) -> Boxes:
    """Boxes thinner than the tolerance merged into a thicker neighbour that is as long, which grows by their width."""
    width = boxes[:, 1] - boxes[:, 0]
    room = np.full((len(boxes), 2), tolerance)  # of each box to grow, to the west and to the east
    kept = np.ones(len(boxes), bool)
    for thin in np.flatnonzero(width <= tolerance)[np.argsort(width[width <= tolerance], kind="stable")]:
        west, east, south, north = boxes[thin]
        longer = (width > tolerance) & (boxes[:, 2] <= south) & (boxes[:, 3] >= north)
        for side, edge, far in ((1, west, east), (0, east, west)):
            takers = np.flatnonzero(longer & (boxes[:, side] == edge) & (room[:, side] >= width[thin]))
            if len(takers):
                boxes[takers[0], side], kept[thin] = far, False
                room[takers[0], side] -= width[thin]
                break
    return boxes[kept]


def inside(rings: Sequence[Ring], points: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
    """Whether points lie in a polygon: even-odd over all rings [m]."""
    odd = np.zeros(len(points), bool)
    x, y = points.T
    for ring in rings:
        for (ax, ay), (bx, by) in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            if ay != by:
                odd ^= ((y < ay) != (y < by)) & (x < ax + (y - ay) * (bx - ax) / (by - ay))
    return odd


def inside_boxes(rows: Float[np.ndarray, "m 7"], points: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
    """Whether points lie in the ground plan of any box [m]."""
    covered = np.zeros(len(points), bool)
    for x, y, half_length, half_width, _, _, yaw in rows:
        along, across = np.abs(_turned(points - np.array([x, y]), -yaw)).T
        covered |= (along <= half_length + _ROUNDING) & (across <= half_width + _ROUNDING)
    return covered
