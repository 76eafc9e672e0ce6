"""Autopilots: how they fly a mission's items, as far as a file of waypoints relies on it.

    ArduCopter   leaves a waypoint within WPNAV_RADIUS of it, whatever acceptance radius its item has; legs blend into
                 one another; a hold of a whole second or more comes to rest at the waypoint
    PX4          leaves it within the item's acceptance radius, else NAV_ACC_RAD, horizontally, and within
                 NAV_MC_ALT_RAD in height; a waypoint with a hold is one that it brakes for, and after two seconds from
                 within these radii it rests there

Return to launch: both climb where they are to the return height above home, fly there level and straight, and descend.
Within a cone above home they stay lower unless RTL_CONE_SLOPE, RTL_CONE_ANG are 0; PX4 within RTL_MIN_DIST of it, too.

Values and units of parameters are those of ArduCopter 4.6 (centimetres) and PX4 1.16 for multicopters.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Literal

Name = Literal["px4", "arducopter"]

# What a file relies on, by parameter: default of the autopilot, and how many of its units are a metre.
_PX4 = {"NAV_ACC_RAD": (2.0, 1.0), "NAV_MC_ALT_RAD": (0.8, 1.0), "RTL_RETURN_ALT": (60.0, 1.0)}
_ARDUCOPTER = {"WPNAV_RADIUS": (200.0, 100.0), "RTL_ALT": (1500.0, 100.0)}
_KNOWN: Mapping[str, Mapping[str, tuple[float, float]]] = {"px4": _PX4, "arducopter": _ARDUCOPTER}


@dataclasses.dataclass(frozen=True)
class Autopilot:
    """An autopilot with the parameters that a file of waypoints relies on.

    `Autopilot.px4` and `Autopilot.arducopter` make one of its own defaults.

    Attributes:
        name: px4 or arducopter.
        corner_radius: within which a waypoint is left [m]; of PX4 that of items without an acceptance radius.
        height_radius: within which it is left in height, on its own [m]; None: the corner radius is one of a ball.
        return_height: above home, to which a return to launch climbs [m].
        rests_after: shortest hold at a waypoint after which it has come to rest there [s].
    """

    name: Name
    corner_radius: float
    height_radius: float | None
    return_height: float
    rests_after: float

    @classmethod
    def px4(cls, **parameters: float) -> Autopilot:
        """PX4 as a multicopter, with its default parameters but for those given.

        Args:
            parameters: NAV_ACC_RAD, NAV_MC_ALT_RAD, RTL_RETURN_ALT [m].

        Raises:
            ValueError: for another parameter, or one that is not positive.
        """
        metres = _in_metres("px4", parameters)
        return cls("px4", metres["NAV_ACC_RAD"], metres["NAV_MC_ALT_RAD"], metres["RTL_RETURN_ALT"], 2.0)

    @classmethod
    def arducopter(cls, **parameters: float) -> Autopilot:
        """ArduCopter, with its default parameters but for those given.

        Args:
            parameters: WPNAV_RADIUS, RTL_ALT [cm].

        Raises:
            ValueError: for another parameter, or one that is not positive.
        """
        metres = _in_metres("arducopter", parameters)
        return cls("arducopter", metres["WPNAV_RADIUS"], None, metres["RTL_ALT"], 1.0)

    @classmethod
    def named(cls, text: str) -> Autopilot:
        """That of a name, with parameters or without, as `arducopter` or `px4:NAV_MC_ALT_RAD=0.5,RTL_RETURN_ALT=80`.

        Raises:
            ValueError: where the text names none.
        """
        name, _, listed = text.strip().partition(":")
        made = {"px4": cls.px4, "arducopter": cls.arducopter}.get(name.lower())
        pairs = [pair.partition("=") for pair in listed.split(",") if pair.strip()]
        try:
            given = {key.strip().upper(): float(value) for key, _, value in pairs}
        except ValueError:
            made = None
        if made is None:
            raise ValueError(
                f"autopilot: expected px4 or arducopter, with parameters as arducopter:WPNAV_RADIUS=50, given {text!r}"
            )
        return made(**given)

    @property
    def label(self) -> str:
        """Its name as it is written."""
        return "PX4" if self.name == "px4" else "ArduCopter"

    @property
    def parameters(self) -> Mapping[str, float]:
        """The parameters that a file relies on, in the autopilot's own units."""
        if self.name == "px4":
            height = {} if self.height_radius is None else {"NAV_MC_ALT_RAD": self.height_radius}
            return {
                "NAV_ACC_RAD": self.corner_radius,
                **height,
                "RTL_RETURN_ALT": self.return_height,
                "RTL_CONE_ANG": 0.0,
                "RTL_MIN_DIST": 0.5,
            }
        return {
            "WPNAV_RADIUS": 100.0 * self.corner_radius,
            "RTL_ALT": 100.0 * self.return_height,
            "RTL_CONE_SLOPE": 0.0,
        }

    def returning(self, height: float) -> Autopilot:
        """The same with a return height of so much at least [m], rounded up to whole metres where it has to rise."""
        rises = height > self.return_height
        return dataclasses.replace(self, return_height=float(math.ceil(height))) if rises else self

    def radius_of(self, accepted: float) -> float:
        """How near to a waypoint it is left, horizontally [m], where its item has this acceptance radius [m]."""
        return accepted if self.name == "px4" and accepted > 0.0 else self.corner_radius

    def rests(self, hold: float) -> bool:
        """Whether it comes to rest at a waypoint with this hold [s]; ArduCopter stores whole seconds."""
        return (math.floor(hold) if self.name == "arducopter" else hold) >= self.rests_after

    @property
    def parameter_file(self) -> tuple[str, str]:
        """Ending and text of a file of the parameters, as the ground stations of the autopilot load it."""
        if self.name == "px4":
            head = "# Onboard parameters\n# Vehicle-Id Component-Id Name Value Type\n"
            rows = (
                f"1\t1\t{name}\t{value:.9g}\t{6 if name == 'RTL_CONE_ANG' else 9}\n"
                for name, value in self.parameters.items()
            )
            return ".params", head + "".join(rows)
        return ".param", "".join(f"{name},{value:.9g}\n" for name, value in self.parameters.items())


def _in_metres(name: Name, given: Mapping[str, float]) -> dict[str, float]:
    known = _KNOWN[name]
    for parameter, value in given.items():
        if parameter not in known:
            raise ValueError(f"autopilot: expected parameters of {name} ({', '.join(known)}), given {parameter!r}")
        if not (math.isfinite(value) and value > 0.0):
            raise ValueError(f"autopilot: expected a positive {parameter}, given {value}")
    return {parameter: given.get(parameter, default) / per_metre for parameter, (default, per_metre) in known.items()}


BOTH = (Autopilot.px4(), Autopilot.arducopter())
"""For whom a file is judged that is made for neither of them alone."""
