"""Slices through the field of a plan, as pictures: what the way to the goal costs, with isolines, or the price.

    −ℓ log φ   [m]: tends to the cost of the cheapest way to the goal (`fields.price`)        n: what a metre costs

Both are of the last leg's problem in the whole map, as the verifier and the figures of `viz` see it.
"""

from __future__ import annotations

import dataclasses
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, UInt8

from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.fields.price import SCREENING_LENGTH
from maxjax.planning.run.execution import problem_of
from maxjax.planning.run.stages import potential_field
from maxjax.solvers.potential import solve_potential
from maxjax.ui.page.answer import task_of
from maxjax.ui.page.colors import FIELD, PRICE, ramp
from maxjax.ui.page.nodes import Frame, Picture, Quaternion, point3
from maxjax.ui.page.page_map import City
from maxjax.ui.request import Request

Axis = Literal["x", "y", "z"]
LARGEST = 2**22
"""Voxels of the largest map whose whole field is shown."""

_FINER = 10  # pixels a voxel
_LINE = 1.8  # half the width of an isoline [pixels]
_DENSE = 10.0  # between two isolines [m]
_OPACITY = 215
# From the picture's axes (x right, y down, z away) to the page's, for slices across x, y and z.
_TURNS: dict[Axis, Quaternion] = {
    "x": (0.5, -0.5, 0.5, -0.5),
    "y": (0.5**0.5, -(0.5**0.5), 0.0, 0.0),
    "z": (0.0, 1.0, 0.0, 0.0),
}


@dataclasses.dataclass(frozen=True, eq=False)
class Field:
    """The field of a request's last leg.

    Attributes:
        cost: −ℓ log φ [m]; NaN where no way leads.
        price: n; NaN in what is blocked.
    """

    cost: Float[np.ndarray, "nx ny nz"]
    price: Float[np.ndarray, "nx ny nz"]


@dataclasses.dataclass(frozen=True)
class Slice:
    """Which slice of which field.

    Attributes:
        of: `cost` or `price`.
        axis: that it lies across.
        place: voxel along the axis.
    """

    of: Literal["cost", "price"]
    axis: Axis
    place: int


def field_of(city: City, request: Request) -> Field | None:
    """The field of the last leg; None where its problem has none.

    Raises:
        ValueError: for a map that is too large, or distances that it cannot have.
    """
    if city.occupied.size > LARGEST:
        raise ValueError(f"expected a map of at most {LARGEST} voxels to show the field of, given {city.occupied.size}")
    task = task_of(city, request, slice(-1, None))
    problem = problem_of(dataclasses.replace(task, distances=request.stops[-1].distances(task.distances)))
    if int(problem.status) not in (Status.OK, Status.NO_SAFE_PATH, Status.NO_VALID_PATH):
        return None
    field = potential_field(problem.blocked, problem.price, problem.goal_index, solve_potential)
    cost = -SCREENING_LENGTH * city.grid.spacing * np.asarray(field.log_phi, np.float64)
    blocked = np.asarray(problem.blocked)
    price = np.ones(blocked.shape) if problem.price is None else np.asarray(problem.price, np.float64)
    return Field(np.where(np.isfinite(cost), cost, np.nan), np.where(blocked, np.nan, price))


def picture(field: Field, wanted: Slice, grid: Grid, frame: Frame) -> Picture:
    """A slice as an image in its place."""
    volume = field.cost if wanted.of == "cost" else field.price
    number = "xyz".index(wanted.axis)
    plane = np.take(volume, min(wanted.place, grid.shape[number] - 1), axis=number)
    middle = 0.5 * (np.array(grid.lower) + np.array(grid.upper))
    middle[number] = grid.origin[number] + grid.spacing * wanted.place
    pixels = _costs(plane) if wanted.of == "cost" else _prices(plane)
    width, height = (grid.spacing * n for n in plane.shape)
    return Picture(pixels, width, height, point3(frame.page(middle)), _TURNS[wanted.axis])


def _costs(plane: Float[np.ndarray, "a b"]) -> UInt8[np.ndarray, "h w 4"]:
    """Colours by the cost, and a line wherever it is a whole multiple of 10 m."""
    known = np.isfinite(plane)
    far = float(np.quantile(plane[known], 0.98)) if known.any() else 1.0
    fine, shown = _finer(plane, known)
    # Pixels to the nearest isoline, by the slope: so a line is as wide everywhere.
    slope = np.linalg.norm(np.gradient(fine), axis=0) if min(fine.shape) > 1 else np.ones(fine.shape)
    away = _DENSE * np.abs(fine / _DENSE - np.round(fine / _DENSE)) / np.maximum(slope, 1e-9)
    line = np.clip(_LINE - away, 0.0, 1.0)[..., None]
    rgb = ramp(FIELD, fine / max(far, 1e-9))
    return _upright(np.round((1.0 - line) * rgb + 255.0 * line).astype(np.uint8), shown)


def _prices(plane: Float[np.ndarray, "a b"]) -> UInt8[np.ndarray, "h w 4"]:
    """Colours by the price; where a metre costs its length alone nothing is drawn."""
    known = np.isfinite(plane)
    fine, shown = _finer(plane, known)
    most = float(np.nanmax(plane, initial=1.0))
    part = (fine - 1.0) / max(most - 1.0, 1e-9)
    return _upright(ramp(PRICE, part), shown & (part > 0.01))


def _finer(
    plane: Float[np.ndarray, "a b"], known: Bool[np.ndarray, "a b"]
) -> tuple[Float[np.ndarray, "c d"], Bool[np.ndarray, "c d"]]:
    """Several pixels a voxel: values linear in between, and which voxels are known."""
    from scipy.ndimage import distance_transform_edt, map_coordinates

    shown = np.repeat(np.repeat(known, _FINER, axis=0), _FINER, axis=1)
    if not known.any():
        return np.zeros(shown.shape), shown
    # What is unknown takes the nearest value, so that lines reach walls.
    nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
    places = np.stack(np.meshgrid(*((np.arange(n * _FINER) + 0.5) / _FINER - 0.5 for n in plane.shape), indexing="ij"))
    return map_coordinates(plane[tuple(nearest)], places, order=1, mode="nearest"), shown


def _upright(rgb: UInt8[np.ndarray, "a b 3"], shown: Bool[np.ndarray, "a b"]) -> UInt8[np.ndarray, "h w 4"]:
    """Rows from the top: the second axis of a slice points up."""
    alpha = np.where(shown, _OPACITY, 0).astype(np.uint8)
    return np.ascontiguousarray(np.concatenate([rgb, alpha[..., None]], axis=-1).transpose(1, 0, 2)[::-1])
