"""State of charge over a flight, from the ground to the ground: what a battery has left, and what it has to keep."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float64

from maxjax.energy.split_flights import BatteryFlight, Supply


@dataclasses.dataclass(frozen=True, eq=False)
class ChargeProfile:
    """Charge over the time of a trajectory; take-off and landing, which are none of its time, are steps at its ends.

    Attributes:
        time: since the trajectory's start [s].
        left: share of the battery; 1 before the take-off, the last one after the landing; negative: it is empty.
        reserve: share that no flight touches.
    """

    time: Float64[np.ndarray, " t"]
    left: Float64[np.ndarray, " t"]
    reserve: float

    @classmethod
    def of(cls, flight: BatteryFlight | None, supply: Supply | None) -> ChargeProfile | None:
        """That of a flight; None where its energy is not known."""
        if flight is None or flight.taken is None or supply is None:
            return None
        taken, battery = flight.taken, supply.battery
        ends = 1.0 - np.array([0.0, taken.total]) / battery.capacity
        return cls(
            np.concatenate([taken.time[:1], taken.time, taken.time[-1:]]),
            np.concatenate([ends[:1], taken.charge(battery), ends[1:]]),
            battery.reserve,
        )
