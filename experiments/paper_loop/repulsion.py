"""The reactive layer of the paper, "3 m range, repulsive only", in three readings.

F: the push of `sim.loop.reactive`, at most its gain [m/s²], scaled in length to another range R

    across       of F what is across the course, and brakes: maxjax's own layer
    repulsive    F, in whatever direction: a set-point's acceleration
    drift        set-points move by R F / gain, at most R [m]
"""

from __future__ import annotations

import dataclasses
from typing import Literal

import jax
import jax.numpy as jnp

from maxjax.sim.loop.flight_state import Extension, Flight, FlightConfig, World, estimated_position
from maxjax.sim.loop.reactive import RANGE, push
from maxjax.trajectories.online import Setpoint

# Gain of the reactive layer [m/s²].
GAIN = 1.5


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class Repulsion(Extension):
    """The layer as an extension of a flight; static.

    Attributes:
        by: how it acts.
        reach: R [m].
    """

    by: Literal["across", "repulsive", "drift"]
    reach: float = RANGE

    def setpoint(self, world: World, flight: Flight, config: FlightConfig, setpoint: Setpoint) -> Setpoint:
        """The set-point, accelerated or moved away from what the latest scan shows near the vehicle."""
        scale = RANGE / self.reach
        course = setpoint.velocity if self.by == "across" else jnp.zeros_like(setpoint.velocity)
        position = estimated_position(world, flight, config)
        force = push(scale * flight.scan.points, scale * position, course, GAIN)
        if self.by == "drift":
            return dataclasses.replace(setpoint, position=setpoint.position + self.reach / GAIN * force)
        return dataclasses.replace(setpoint, acceleration=setpoint.acceleration + force)
