"""Energy in the table and in the JSON of a mission: of each leg, and the charge that is left after it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from maxjax.energy.split_flights import BatteryFlight, Supply

HEADS = ("energy\n[Wh]", "left\n[%]")
"""Of the columns."""


def energy_cells(flight: BatteryFlight | None, supply: Supply | None) -> Callable[[int | None], tuple[str, str]]:
    """The cells of a leg by its number, or of the whole flight; empty where nothing is known."""
    if flight is None or flight.taken is None or supply is None:
        return lambda _: ("", "")
    taken, charge = flight.taken, flight.taken.charge_after(supply.battery)

    def cells(k: int | None) -> tuple[str, str]:
        if k is None:
            return f"{taken.total:.1f}", f"{100.0 * charge[-1]:.0f}"
        return (f"{taken.legs[k]:.1f}", f"{100.0 * charge[k]:.0f}") if k < len(charge) else ("", "")

    return cells


def leg_energies(flight: BatteryFlight | None, supply: Supply | None) -> Callable[[int], dict[str, float]]:
    """Energy of a leg [Wh] and the share of the battery that is left after it; nothing where none is asked for."""
    if flight is None or flight.taken is None or supply is None:
        return lambda _: {}
    taken, charge = flight.taken, flight.taken.charge_after(supply.battery)

    def found(k: int) -> dict[str, float]:
        return {"energy": float(taken.legs[k]), "charge": float(charge[k])} if k < len(charge) else {}

    return found


def flight_energy(flight: BatteryFlight | None, supply: Supply | None) -> dict[str, Any]:
    """What flies, and the energy of the whole [Wh]; nothing where none is asked for."""
    if flight is None or flight.taken is None or flight.verdict is None or supply is None:
        return {}
    taken, verdict = flight.taken, flight.verdict
    return {
        "energy": {
            "status": verdict.status.name,
            "message": verdict.describe(),
            "airframe": supply.airframe.name,
            "source": supply.airframe.source,
            "mass": supply.airframe.mass,
            "needed": verdict.needed,
            "usable": verdict.usable,
            "takeoff": taken.takeoff,
            "landing": taken.landing,
            "charge": float(taken.charge_after(supply.battery)[-1]),
            "airspeed": taken.airspeed,
        }
    }
