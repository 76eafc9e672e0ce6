"""Limits of a vehicle on a trajectory: speed, climb, acceleration, jerk, turning of the heading."""

from __future__ import annotations

import dataclasses
import math

import jax


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class FlightLimits:
    """Limits of a trajectory; static. The defaults are those of PX4 at full speed.

    Attributes:
        speed: greatest speed [m/s] (MPC_XY_VEL_MAX).
        acceleration: greatest acceleration [m/s²] (MPC_ACC_HOR_MAX).
        jerk: greatest rate of change of the acceleration [m/s³] (MPC_JERK_MAX).
        ascent, descent: greatest speeds of climb and of sinking [m/s] (MPC_Z_VEL_MAX_UP, MPC_Z_VEL_MAX_DN).
        yaw_rate: greatest rate of change of the heading [rad/s] (MPC_YAWRAUTO_MAX).
        near: speed at the radius [m/s]. Further out, the speed is such that braking at `acceleration` brings it
            down to `near` within what is left of the clearance: v² ≤ near² + 2 acceleration (clearance − radius).
        deviation: greatest distance of rounded corners from the path [m].

    Raises:
        ValueError: unless all are positive finite numbers.
    """

    speed: float = 12.0
    acceleration: float = 5.0
    jerk: float = 8.0
    ascent: float = 3.0
    descent: float = 1.5
    yaw_rate: float = math.radians(60.0)
    near: float = 2.0
    deviation: float = 1.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < math.inf:
                raise ValueError(f"FlightLimits.{name}: expected a positive finite number, given {value!r}")


# By name: PX4's own limits at full speed, and what its missions fly at (MPC_XY_CRUISE, MPC_ACC_HOR, MPC_JERK_AUTO).
PX4 = FlightLimits()
PX4_MISSION = FlightLimits(speed=5.0, acceleration=3.0, jerk=4.0)
