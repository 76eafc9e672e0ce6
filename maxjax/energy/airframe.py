"""Multirotors as the power model sees them, with the source of each figure.

    P = T (V_c + v_i) / η + c T^(3/2)                (`energy.power`)

Makers state how long a vehicle flies, not η and c: these are such that the model takes as long as they state, with no
payload, in still air at sea level, until the battery is empty. Tests compare both.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable


@dataclasses.dataclass(frozen=True)
class Airframe:
    """A multirotor with its battery, as `Airframe.mavic_3_enterprise()` or of your own figures.

    Attributes:
        name: for sentences.
        mass: with its battery and payload [kg].
        rotors: their number.
        rotor_radius: [m].
        efficiency: power in the air over power out of the battery, η, of what is induced, climbs and drags.
        profile: power out of the battery for the blades' own drag and all that does not move air [W/N^1.5].
        drag_area: drag over dynamic pressure, all round [m²].
        airspeed: greatest one [m/s].
        source: of these figures.

    Raises:
        ValueError: for figures that are none of these.
    """

    name: str
    mass: float
    rotors: int
    rotor_radius: float
    efficiency: float
    profile: float
    drag_area: float
    airspeed: float
    source: str = ""

    def __post_init__(self) -> None:
        for name in ("mass", "rotor_radius", "airspeed"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ValueError(f"Airframe.{name}: expected a positive number, given {getattr(self, name)}")
        for name in ("profile", "drag_area"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise ValueError(f"Airframe.{name}: expected a number from 0 on, given {getattr(self, name)}")
        if self.rotors < 1:
            raise ValueError(f"Airframe.rotors: expected at least 1, given {self.rotors}")
        if not 0.0 < self.efficiency <= 1.0:
            raise ValueError(f"Airframe.efficiency: expected above 0, at most 1, given {self.efficiency}")

    @property
    def disc_area(self) -> float:
        """Of all rotors [m²]."""
        return self.rotors * math.pi * self.rotor_radius**2

    def with_payload(self, mass: float) -> Airframe:
        """The same with so much more to carry [kg]; its drag is not changed.

        Raises:
            ValueError: for a mass that is none.
        """
        if not 0.0 <= mass < math.inf:
            raise ValueError(f"payload: expected a mass from 0 kg on, given {mass}")
        return dataclasses.replace(self, mass=self.mass + mass)

    @classmethod
    def iris_plus(cls) -> Airframe:
        """3DR IRIS+ of 1.5 kg, by the model that Liu et al. fitted to its flights, which this one follows to 5 %.

        Liu, Sengupta and Kurzhanskiy, "A power consumption model for multi-rotor small unmanned aircraft systems",
        ICUAS 2017: k1 0.8554, k2 0.3051, c2 0.3177, c4 0.0296, c5 0.0279. Rotors 10 in. Airspeed: where drag asks for
        30° of lean, ArduCopter's default.
        """
        said = "Liu et al., ICUAS 2017, fitted to flights"
        return cls("3DR IRIS+", 1.5, 4, 0.127, 0.73, 1.317, 0.0335, 20.0, said)

    @classmethod
    def matrice_100(cls) -> Airframe:
        """DJI Matrice 100 with a TB48D (129.96 Wh), 2.431 kg.

        DJI's manual: hovers for 28, 20 and 16 min with 0, 0.5 and 1 kg; that with 0.5 kg counts, so that no longer one
        is promised. 22 m/s at 35° of lean, from which its drag follows. Rotors 13 in. The efficiency is that of the
        Mavic 3 Enterprise.
        """
        said = "DJI, Matrice 100 user manual, specifications"
        return cls("DJI Matrice 100", 2.431, 4, 0.1651, 0.73, 1.035, 0.0563, 22.0, said)

    @classmethod
    def mavic_3_enterprise(cls) -> Airframe:
        """DJI Mavic 3 Enterprise (77 Wh), 0.915 kg.

        DJI's specifications: hovers for 38 min, flies 45 min at 9 m/s, and 32 km at 15 m/s; three figures for η, c and
        the drag area. Rotors 9.4 in; 21 m/s in sport mode.
        """
        said = "DJI, Mavic 3 Enterprise specifications"
        return cls("DJI Mavic 3 Enterprise", 0.915, 4, 0.1194, 0.73, 2.456, 0.0155, 21.0, said)

    @classmethod
    def named(cls, name: str) -> Airframe:
        """The airframe of a name: iris_plus, matrice_100 or mavic_3_enterprise.

        Raises:
            ValueError: for another name.
        """
        if name not in AIRFRAMES:
            raise ValueError(f"airframe: expected one of {', '.join(AIRFRAMES)}, given {name!r}")
        return AIRFRAMES[name]()


AIRFRAMES: dict[str, Callable[[], Airframe]] = {
    "iris_plus": Airframe.iris_plus,
    "matrice_100": Airframe.matrice_100,
    "mavic_3_enterprise": Airframe.mavic_3_enterprise,
}
"""Those with a source, by name."""
