"""Flight modes by the numbers that heartbeats carry: of ArduCopter, and of PX4 as a multicopter."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType


@dataclasses.dataclass(frozen=True)
class Modes:
    """Modes of an autopilot, as a heartbeat's `custom_mode`.

    Attributes:
        label: name of the autopilot.
        mission: in which it flies the items that it holds.
        setpoints: in which it takes set-points.
        hold: in which it stays where it is, without a pilot.
        names: of modes, for people.
    """

    label: str
    mission: int
    setpoints: int
    hold: int
    names: Mapping[int, str]

    def name_of(self, number: int) -> str:
        """What pilots call a mode."""
        return self.names.get(number, f"mode {number}")

    def parameters(self, number: int) -> tuple[float, float]:
        """The second and third parameter of DO_SET_MODE."""
        return (float(number >> 16 & 0xFF), float(number >> 24)) if self.label == "PX4" else (float(number), 0.0)


def _px4(main: int, sub: int = 0) -> int:
    return main << 16 | sub << 24


_COPTER = {
    0: "STABILIZE", 2: "ALT_HOLD", 3: "AUTO", 4: "GUIDED", 5: "LOITER", 6: "RTL", 9: "LAND", 16: "POSHOLD",
    17: "BRAKE", 21: "SMART_RTL",
}  # fmt: skip
_PX4 = {
    _px4(1): "MANUAL", _px4(2): "ALTCTL", _px4(3): "POSCTL", _px4(4, 2): "TAKEOFF", _px4(4, 3): "HOLD",
    _px4(4, 4): "MISSION", _px4(4, 5): "RETURN", _px4(4, 6): "LAND", _px4(6): "OFFBOARD", _px4(7): "STABILIZED",
}  # fmt: skip

# By MAV_AUTOPILOT. ArduCopter's LOITER takes its height from the throttle stick; BRAKE stays without one.
MODES: Mapping[int, Modes] = MappingProxyType({
    3: Modes("ArduCopter", mission=3, setpoints=4, hold=17, names=MappingProxyType(_COPTER)),
    12: Modes("PX4", mission=_px4(4, 4), setpoints=_px4(6), hold=_px4(4, 3), names=MappingProxyType(_PX4)),
})  # fmt: skip
