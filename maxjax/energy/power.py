"""The power that a multirotor takes out of its battery as it flies.

    T  = m (a − g) + ½ ρ f |v| v                  thrust: weight, acceleration, drag; v through the air, a over ground
    v_i = (T / 2ρA) / √(V_t² + (V_c + v_i)²)      what the rotors add to the air (momentum theory, Glauert)
    P  = T (V_c + v_i) / η + c T^(3/2)            climb, parasite and induced power; profile power

V_c is the part of v along the thrust, V_t that across. T V_c = T · v is all that climbs, drags and accelerates. In
hover v_i = √(T / 2ρA). The form is that of Stolaroff et al., "Energy use and life cycle greenhouse gas emissions of
drones for commercial package delivery", Nature Communications 9 (2018), with the profile power of Liu et al. (ICUAS
2017).

Momentum theory does not hold where a rotor sinks into its own wake. What a descent gives back is not counted: V_c is at
least 0, so that no descent takes less than level flight of the same thrust and V_t.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from maxjax.energy.airframe import Airframe

GRAVITY = 9.80665  # [m/s²]
DENSITY = 1.225  # of the air at sea level [kg/m³]
_STEPS = 20

Rows = Float64[np.ndarray, " t"]
Vectors = Float64[np.ndarray, "t 3"]


def rotor_inflow(thrust: Rows, across: Rows, along: Rows, disc_area: float, density: float = DENSITY) -> Rows:
    """Induced velocity: what rotors add to the air that flows through them [m/s].

    Newton's method from v_i of hover: v √(V_t² + (V_c + v)²) rises and is convex, so that it comes down to the root.

    Args:
        thrust: [N].
        across: part of the airspeed in the plane of the discs [m/s].
        along: part along the thrust, at least 0 [m/s].
        disc_area: of all rotors [m²].
        density: of the air [kg/m³].
    """
    wanted = thrust / (2.0 * density * disc_area)
    found = np.sqrt(wanted)
    for _ in range(_STEPS):
        through = np.maximum(np.hypot(across, along + found), 1e-12)
        slope = through + found * (along + found) / through
        found = found - (found * through - wanted) / np.maximum(slope, 1e-12)
    return np.maximum(found, 0.0)


def power(airframe: Airframe, velocity: Vectors, acceleration: Vectors, density: float = DENSITY) -> Rows:
    """Power out of the battery [W], a row a time.

    Args:
        airframe: that flies.
        velocity: through the air [m/s], ENU.
        acceleration: over ground [m/s²].
        density: of the air [kg/m³].
    """
    speed = np.linalg.norm(velocity, axis=1, keepdims=True)
    drag = 0.5 * density * airframe.drag_area * speed * velocity
    force = airframe.mass * (acceleration + np.array([0.0, 0.0, GRAVITY])) + drag
    thrust = np.linalg.norm(force, axis=1)
    axis = force / np.maximum(thrust, 1e-12)[:, None]
    inflow = (velocity * axis).sum(axis=1)
    across = np.linalg.norm(velocity - inflow[:, None] * axis, axis=1)
    along = np.maximum(inflow, 0.0)
    induced = rotor_inflow(thrust, across, along, airframe.disc_area, density)
    taken: Rows = thrust * (along + induced) / airframe.efficiency + airframe.profile * thrust**1.5
    return taken
