"""Arming, where it was asked for."""

from __future__ import annotations

from maxjax.link.errors import LinkError
from maxjax.link.vehicle import ARM, Vehicle

_SECONDS = 5.0


async def arm(vehicle: Vehicle) -> None:
    """Arm a vehicle.

    Raises:
        LinkError: if it does not.
    """
    answer = await vehicle.command(ARM, 1.0)
    # An answer may be lost: what counts is whether it is armed.
    if not await vehicle.until(lambda: vehicle.armed, _SECONDS):
        raise LinkError(
            f"arming: expected it to be accepted, given: {answer or 'no armed heartbeat'}{vehicle.said}; clear its "
            "checks",
            holds=False,
        )
