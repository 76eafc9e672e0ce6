"""Who flies: how many vehicles, from where, for how long at a time.

A home is a place in the air above the spot where a vehicle stands: it rises there, and ends its flights there.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from maxjax.core.grid import Point3
from maxjax.core.voxel_map import VoxelMap
from maxjax.energy.consumption import RISE, SINK, upright_energy
from maxjax.energy.split_flights import Supply
from maxjax.inspection.free_space import FreeSpace
from maxjax.inspection.leg_costs import EnergyCost, LegCost, TimeCost
from maxjax.planning.problem.task import points_of

_HEIGHT = 5.0  # of a home that is chosen, above ground [m]


@dataclasses.dataclass(frozen=True)
class Vehicles:
    """Vehicles that share the work.

    Attributes:
        homes: of each [m]; one for all; none: a free place under open sky near the target.
        count: how many there are.
        capacity: what a flight may cost at most, landing included; None: any.
        cost: of straight legs with what is done at their end, in the unit of the capacity; by default seconds.

    Raises:
        ValueError: if there is no vehicle, homes are no places or neither one nor one for each, or the capacity is not
            positive.
    """

    homes: tuple[Point3, ...] = ()
    count: int = 1
    capacity: float | None = None
    cost: LegCost | None = None

    def __post_init__(self) -> None:
        if self.count < 1:
            raise ValueError(f"Vehicles.count: expected at least one vehicle, given {self.count}")
        if len(self.homes) not in (0, 1, self.count):
            raise ValueError(f"Vehicles.homes: expected one or {self.count}, given {len(self.homes)}")
        if self.homes:
            places = points_of("Vehicles.homes", self.homes, ("n", 3))
            if not np.isfinite(places).all():
                raise ValueError(f"Vehicles.homes: expected finite coordinates [m], given {self.homes}")
            object.__setattr__(self, "homes", tuple((x, y, z) for x, y, z in places.tolist()))
        if self.capacity is not None and not 0.0 < self.capacity < math.inf:
            raise ValueError(f"Vehicles.capacity: expected a positive finite number, given {self.capacity}")

    @classmethod
    def on_battery(
        cls,
        supply: Supply,
        homes: tuple[Point3, ...] = (),
        count: int = 1,
        *,
        height: float = 10.0,
        spare: float = 0.15,
    ) -> Vehicles:
        """Vehicles whose flights a battery lasts for, as far as straight legs tell.

        Args:
            supply: airframe, battery and wind.
            homes, count: as of the class.
            height: of homes above where the vehicles stand, for take-off and landing [m].
            spare: share of what these leave that is kept for what straight legs do not count, as ways around.

        Raises:
            ValueError: as the class; unless the spare share is at least 0 and below 1; if a battery does not last for
                take-off and landing.
        """
        if not 0.0 <= spare < 1.0:
            raise ValueError(f"spare: expected a share of at least 0, below 1, given {spare:g}")
        strongest = supply.wind.velocities[np.linalg.norm(supply.wind.velocities, axis=1).argmax()]
        upright = sum(upright_energy(supply.airframe, speed, height, strongest) for speed in (RISE, -SINK))
        usable = supply.battery.usable
        if usable <= upright:
            raise ValueError(
                f"battery: expected more than the {upright:.2g} Wh that take-off and landing of {height:g} m take, "
                f"given {usable:.2g} Wh without the reserve"
            )
        cost = EnergyCost(supply.airframe, wind=float(np.linalg.norm(strongest)))
        return cls(homes, count, (1.0 - spare) * (usable - upright), cost)

    @property
    def home_of(self) -> tuple[int, ...]:
        """Of each vehicle, the number of its home."""
        return tuple(range(self.count)) if len(self.homes) == self.count else (0,) * self.count

    @property
    def most(self) -> float:
        """What a flight may cost; infinite: any."""
        return math.inf if self.capacity is None else self.capacity

    def leg_cost(self, stay: float) -> LegCost:
        """What legs cost, where each ends with a stay [s]."""
        if isinstance(self.cost, EnergyCost):
            return dataclasses.replace(self.cost, time=dataclasses.replace(self.cost.time, stay=stay))
        return TimeCost(stay=stay) if self.cost is None else self.cost


def check_homes(homes: Sequence[Point3], free: FreeSpace) -> Float64[np.ndarray, "h 3"]:
    """Homes [m]; raises a ValueError for one that is not free."""
    at = np.array(homes, np.float64)
    fits = free.holds(at)
    if not fits.all():
        x, y, z = homes[int(np.argmin(fits))]
        raise ValueError(
            f"home: expected a place in the map that keeps the radius of {free.radius:g} m and is joined to the "
            f"others, given ({x:g}, {y:g}, {z:g})"
        )
    return at


def choose_home(where: VoxelMap, free: FreeSpace, near: np.ndarray, away: float) -> Point3:
    """A free place with nothing above it and the ground below it.

    Args:
        where: the map.
        free: the air.
        near: points of what is to be photographed [m]; the place is as near to them as may be.
        away: from all of them at least, horizontally [m].

    Raises:
        ValueError: if there is none.
    """
    from scipy.spatial import cKDTree  # a quarter of a second that most commands can do without

    grid, heights = where.grid, where.terrain.everywhere
    level = np.floor((heights + _HEIGHT - grid.origin[2]) / grid.spacing + 0.5)
    known = np.isfinite(level) & (level >= 0) & (level < grid.shape[2])
    layer = np.where(known, level, 0).astype(np.int64)
    # Nothing stands from there to the top of the map; air above a ceiling is no obstacle, but no home either.
    from_top = np.logical_and.accumulate(free.open[:, :, ::-1], axis=2)[:, :, ::-1] & free.free
    open_sky = np.take_along_axis(from_top, layer[:, :, None], axis=2)[:, :, 0] & known
    columns = np.argwhere(open_sky)
    places = np.array(grid.origin[:2]) + grid.spacing * columns
    distance = np.asarray(cKDTree(near[:, :2]).query(places)[0]) if len(places) else np.zeros(0)
    fits = np.flatnonzero(distance >= away)
    if not len(fits):
        raise ValueError(
            f"home: expected a free place under open sky at least {away:g} m from the target, found none in the map; "
            "give one, by Vehicles(homes=((x, y, z),)), or load more of the map"
        )
    i, j = columns[fits[distance[fits].argmin()]].tolist()
    x, y, z = (np.array(grid.origin) + grid.spacing * np.array([i, j, layer[i, j]])).tolist()
    return x, y, z
