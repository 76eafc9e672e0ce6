"""Autopilots: how they fly a mission's items, as far as a file of waypoints relies on it.

    ArduCopter   leaves a waypoint within WPNAV_RADIUS of it, whatever acceptance radius its item has; legs blend into
                 one another; a hold of a whole second or more comes to rest at the waypoint
    PX4          leaves it within the item's acceptance radius, else NAV_ACC_RAD, horizontally, and within
                 NAV_MC_ALT_RAD in height; a waypoint with a hold is one that it brakes for, and after two seconds from
                 within these radii it rests there

Return to launch: both climb where they are to the return height above home, fly there level and straight, and descend.
Within a cone above home they stay lower unless RTL_CONE_SLOPE, RTL_CONE_ANG are 0; PX4 within RTL_MIN_DIST of it, too.
That is also what they do without their remote control (FS_THR_ENABLE 1, NAV_RCL_ACT 2) or ground station (FS_GCS_ENABLE
1, NAV_DLL_ACT 2): their defaults for the latter are to fly on.

Values and units of parameters are those of ArduCopter 4.6 (centimetres) and PX4 1.16 for multicopters.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Literal

from maxjax.trajectories.limits import FlightLimits

Name = Literal["px4", "arducopter"]

_GRAVITY = 9.80665  # [m/s²]
_LEFT = 0.2  # of ArduCopter's acceleration and jerk, which set-points leave it to correct errors with

# By parameter: default of the autopilot, and how many of its units are one of m, s, degrees.
_PX4 = {
    "NAV_ACC_RAD": (2.0, 1.0),
    "NAV_MC_ALT_RAD": (0.8, 1.0),
    "RTL_RETURN_ALT": (60.0, 1.0),
    "MPC_XY_CRUISE": (5.0, 1.0),
    "MPC_Z_V_AUTO_UP": (3.0, 1.0),
    "MPC_Z_V_AUTO_DN": (1.5, 1.0),
    "MPC_ACC_HOR": (3.0, 1.0),
    "MPC_ACC_UP_MAX": (4.0, 1.0),
    "MPC_JERK_AUTO": (4.0, 1.0),
    "MPC_XY_VEL_MAX": (12.0, 1.0),
    "MPC_ACC_HOR_MAX": (5.0, 1.0),
    "MPC_JERK_MAX": (8.0, 1.0),
    "MPC_TILTMAX_AIR": (45.0, 1.0),
    "MPC_YAWRAUTO_MAX": (60.0, 1.0),
    "COM_OF_LOSS_T": (1.0, 1.0),
}
_ARDUCOPTER = {
    "WPNAV_RADIUS": (200.0, 100.0),
    "RTL_ALT": (1500.0, 100.0),
    "WPNAV_SPEED": (1000.0, 100.0),
    "WPNAV_SPEED_UP": (250.0, 100.0),
    "WPNAV_SPEED_DN": (150.0, 100.0),
    "WPNAV_ACCEL": (250.0, 100.0),
    "WPNAV_ACCEL_Z": (100.0, 100.0),
    "WPNAV_ACCEL_C": (0.0, 100.0),  # 0: twice WPNAV_ACCEL
    "WPNAV_JERK": (1.0, 1.0),
    "PSC_JERK_XY": (5.0, 1.0),
    "ATC_INPUT_TC": (0.15, 1.0),
    "ANGLE_MAX": (3000.0, 100.0),
    "ATC_SLEW_YAW": (6000.0, 100.0),
    "GUID_TIMEOUT": (3.0, 1.0),
}
_WHOLE = ("RTL_CONE_ANG", "NAV_RCL_ACT", "NAV_DLL_ACT")  # of PX4's parameters, INT32
_KNOWN: Mapping[str, Mapping[str, tuple[float, float]]] = {"px4": _PX4, "arducopter": _ARDUCOPTER}


@dataclasses.dataclass(frozen=True)
class MissionLimits:
    """What an autopilot keeps to on its own way from waypoint to waypoint.

    Attributes:
        speed: horizontal, where the items name none [m/s].
        ascent, descent: speeds of climb and of sinking [m/s].
        acceleration, vertical_acceleration: horizontal and vertical [m/s²].
        corner_acceleration: where two legs blend, horizontal [m/s²].
        jerk: rate of change of the acceleration [m/s³].
        response: time in which the vehicle takes the lean that is asked for [s]; it bounds the snap.
    """

    speed: float
    ascent: float
    descent: float
    acceleration: float
    vertical_acceleration: float
    corner_acceleration: float
    jerk: float
    response: float


@dataclasses.dataclass(frozen=True)
class Autopilot:
    """An autopilot as a multicopter, with its parameters.

    `Autopilot.px4` and `Autopilot.arducopter` make one of its own defaults.

    Attributes:
        name: px4 or arducopter.
        corner_radius: within which a waypoint is left [m]; of PX4 that of items without an acceptance radius.
        height_radius: within which it is left in height, on its own [m]; None: the corner radius is one of a ball.
        return_height: above home, to which a return to launch climbs [m].
        rests_after: shortest hold at a waypoint after which it has come to rest there [s].
        mission: what it keeps to from waypoint to waypoint.
        limits: what set-points may ask of it.
        lean: greatest angle between its thrust and the vertical [rad].
        stream_timeout: how long after the last set-point of a stream it does something else [s].
        given: parameters that differ from its defaults, in its own units.
    """

    name: Name
    corner_radius: float
    height_radius: float | None
    return_height: float
    rests_after: float
    mission: MissionLimits
    limits: FlightLimits
    lean: float
    stream_timeout: float
    given: tuple[tuple[str, float], ...] = ()

    @classmethod
    def px4(cls, **parameters: float) -> Autopilot:
        """PX4 as a multicopter, with its default parameters but for those given.

        Args:
            parameters: in its own units, as NAV_ACC_RAD, NAV_MC_ALT_RAD, RTL_RETURN_ALT, MPC_XY_CRUISE.

        Raises:
            ValueError: for another parameter, or one that is not positive.
        """
        value, given = _read("px4", parameters)
        horizontal = value["MPC_ACC_HOR"]
        return cls(
            "px4",
            value["NAV_ACC_RAD"],
            value["NAV_MC_ALT_RAD"],
            value["RTL_RETURN_ALT"],
            rests_after=2.0,
            mission=MissionLimits(
                speed=value["MPC_XY_CRUISE"],
                ascent=value["MPC_Z_V_AUTO_UP"],
                descent=value["MPC_Z_V_AUTO_DN"],
                acceleration=horizontal,
                vertical_acceleration=value["MPC_ACC_UP_MAX"],
                corner_acceleration=horizontal,
                jerk=value["MPC_JERK_AUTO"],
                response=0.0,
            ),
            limits=FlightLimits(
                speed=value["MPC_XY_VEL_MAX"],
                acceleration=value["MPC_ACC_HOR_MAX"],
                jerk=value["MPC_JERK_MAX"],
                ascent=value["MPC_Z_V_AUTO_UP"],
                descent=value["MPC_Z_V_AUTO_DN"],
                yaw_rate=math.radians(value["MPC_YAWRAUTO_MAX"]),
            ),
            lean=math.radians(value["MPC_TILTMAX_AIR"]),
            stream_timeout=value["COM_OF_LOSS_T"],
            given=given,
        )

    @classmethod
    def arducopter(cls, **parameters: float) -> Autopilot:
        """ArduCopter, with its default parameters but for those given.

        What set-points may ask of it leaves it a fifth of its acceleration and its jerk to correct errors with.

        Args:
            parameters: in its own units, as WPNAV_RADIUS, RTL_ALT, WPNAV_SPEED [cm, cm/s], WPNAV_JERK [m/s³].

        Raises:
            ValueError: for another parameter, or one that is not positive.
        """
        value, given = _read("arducopter", parameters)
        lean = math.radians(value["ANGLE_MAX"])
        return cls(
            "arducopter",
            value["WPNAV_RADIUS"],
            None,
            value["RTL_ALT"],
            rests_after=1.0,
            mission=MissionLimits(
                speed=value["WPNAV_SPEED"],
                ascent=value["WPNAV_SPEED_UP"],
                descent=value["WPNAV_SPEED_DN"],
                acceleration=value["WPNAV_ACCEL"],
                vertical_acceleration=value["WPNAV_ACCEL_Z"],
                corner_acceleration=value["WPNAV_ACCEL_C"] or 2.0 * value["WPNAV_ACCEL"],
                jerk=value["WPNAV_JERK"],
                response=value["ATC_INPUT_TC"],
            ),
            limits=FlightLimits(
                speed=value["WPNAV_SPEED"],
                acceleration=(1.0 - _LEFT) * min(value["WPNAV_ACCEL"], _GRAVITY * math.tan(lean)),
                jerk=(1.0 - _LEFT) * value["PSC_JERK_XY"],
                ascent=value["WPNAV_SPEED_UP"],
                descent=value["WPNAV_SPEED_DN"],
                yaw_rate=math.radians(value["ATC_SLEW_YAW"]),
            ),
            lean=lean,
            stream_timeout=value["GUID_TIMEOUT"],
            given=given,
        )

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
        """The parameters that a file relies on, in the autopilot's own units, and those that were given."""
        if self.name == "px4":
            height = {} if self.height_radius is None else {"NAV_MC_ALT_RAD": self.height_radius}
            safe = {
                "NAV_ACC_RAD": self.corner_radius,
                **height,
                "RTL_RETURN_ALT": self.return_height,
                "RTL_CONE_ANG": 0.0,
                "RTL_MIN_DIST": 0.5,
                "NAV_RCL_ACT": 2.0,
                "NAV_DLL_ACT": 2.0,
            }
        else:
            safe = {
                "WPNAV_RADIUS": 100.0 * self.corner_radius,
                "RTL_ALT": 100.0 * self.return_height,
                "RTL_CONE_SLOPE": 0.0,
                "FS_THR_ENABLE": 1.0,
                "FS_GCS_ENABLE": 1.0,
            }
        return safe | {parameter: value for parameter, value in self.given if parameter not in safe}

    def returning(self, height: float) -> Autopilot:
        """The same with a return height of so much at least [m], rounded up to whole metres where it has to rise."""
        rises = height > self.return_height
        return dataclasses.replace(self, return_height=float(math.ceil(height))) if rises else self

    def radius_of(self, accepted: float) -> float:
        """How near to a waypoint it is left, horizontally [m], where its item has this acceptance radius [m]."""
        return accepted if self.name == "px4" and accepted > 0.0 else self.corner_radius

    def rests(self, hold: float) -> bool:
        """Whether it comes to rest at a waypoint with this hold [s]; ArduCopter stores whole seconds."""
        return self.holds(hold) >= self.rests_after

    def holds(self, hold: float) -> float:
        """How long it stays at a waypoint with this hold [s]."""
        return float(math.floor(hold)) if self.name == "arducopter" else hold

    @property
    def parameter_file(self) -> tuple[str, str]:
        """Ending and text of a file of the parameters, as the ground stations of the autopilot load it."""
        if self.name == "px4":
            head = "# Onboard parameters\n# Vehicle-Id Component-Id Name Value Type\n"
            rows = (
                f"1\t1\t{name}\t{value:.9g}\t{6 if name in _WHOLE else 9}\n" for name, value in self.parameters.items()
            )
            return ".params", head + "".join(rows)
        return ".param", "".join(f"{name},{value:.9g}\n" for name, value in self.parameters.items())


def _read(name: Name, asked: Mapping[str, float]) -> tuple[dict[str, float], tuple[tuple[str, float], ...]]:
    """All parameters in m, s, degrees, and those that differ from the defaults in the autopilot's units."""
    known = _KNOWN[name]
    for parameter, value in asked.items():
        if parameter not in known:
            raise ValueError(f"autopilot: expected parameters of {name} ({', '.join(known)}), given {parameter!r}")
        if not (math.isfinite(value) and value > 0.0):
            raise ValueError(f"autopilot: expected a positive {parameter}, given {value}")
    values = {parameter: asked.get(parameter, default) / units for parameter, (default, units) in known.items()}
    return values, tuple((parameter, value) for parameter, value in asked.items() if value != known[parameter][0])


BOTH = (Autopilot.px4(), Autopilot.arducopter())
"""For whom a file is judged that is made for neither of them alone."""
