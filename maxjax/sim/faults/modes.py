"""Modes of faults: how sensors, air, motors, planner and clock fail, and what a flight remembers of it.

    what is said = fault(what is so, mode, time)        t ≥ onset; `Mode.INTERMITTENT`: in random planning periods

| | LiDAR | pose | wind | motors | planner | clock |
|---|---|---|---|---|---|---|
| off | no returns | not a number | – | one gives nothing | no answer | stands |
| stuck | the scan of before | where it was | 12 m/s, constant | one stays at hover | the path of before | stands |
| garbage | random ranges | random within 20 m | 10 m/s, random | thrusts ± 30 % | – | random within a period |
| late | 0.3 s old | 0.5 s old | – | 50 ms old | flown a period later | 0.3 s behind |
| intermittent | no returns | not a number | 12 m/s | one at half | no answer | stands |
| wrong | 0.5 m too long | off by 1.5 m, slowly | 5 m/s down | 85 % of it | – | 30 % fast |
| slow | every third scan | every 2 s | 1 m/s each second, to 15 | follow in 0.1 s | every third period | 30 % slow |

Modes are arrays, so that one program flies all of a batch.

Frame: world.
"""

from __future__ import annotations

import dataclasses
import enum

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int32

from maxjax.sim.vehicle.quadrotor import Vehicle

# Steps between a command and its effect, of motors that are late.
STEPS_LATE = 5


class Target(enum.IntEnum):
    """A target of faults: a column of `Faults.modes`."""

    LIDAR = 0
    POSE = 1
    WIND = 2
    MOTORS = 3
    PLANNER = 4
    CLOCK = 5


class Mode(enum.IntEnum):
    """How it fails."""

    NONE = 0
    OFF = 1
    STUCK = 2
    GARBAGE = 3
    LATE = 4
    INTERMITTENT = 5
    WRONG = 6
    SLOW = 7


# What means nothing: air cannot be off or late, and a planner that answers wrongly is another planner.
MEANINGLESS = frozenset({
    (Target.WIND, Mode.OFF), (Target.WIND, Mode.LATE), (Target.PLANNER, Mode.GARBAGE), (Target.PLANNER, Mode.WRONG)
})  # fmt: skip


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Failing:
    """The part of a flight with faults; batch axes lead.

    Attributes:
        position: what the vehicle takes for its position [m].
        held: the last position that a stuck or slow sensor saw [m].
        ranges: of the last scan as it was delivered [m].
        commands: thrusts that were commanded, the latest first [N].
    """

    position: Float[Array, "*batch 3"]
    held: Float[Array, "*batch 3"]
    ranges: Float[Array, "*batch r"]
    commands: Float[Array, "*batch s 4"]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Unseen:
    """The part of the log of a flight with faults; batch axes lead.

    Attributes:
        samples: times, ten a second, at which the vehicle was more than a voxel from any that was seen free, as
            `sim.faults.effects.account` counts them.
    """

    samples: Int32[Array, "*batch"]


def none_yet(start: Float[Array, "3"], rays: int, vehicle: Vehicle) -> Failing:
    """At take-off."""
    commands = jnp.full((STEPS_LATE + 1, 4), vehicle.hover, jnp.float32)
    return Failing(start, start, jnp.full(rays, jnp.nan, jnp.float32), commands)
