"""A quadrotor in MJX: one free body, four thrusts with motor lag, drag and wind.

    m v̇ = R e₃ Σ f_i − m g e₃ + D(v − w, R)
    J ω̇ = Σ f_i (r_i × e₃ + s_i c e₃) − ω × J ω + M(ω)
    τ ḟ_i = u_i − f_i

f_i are the thrusts [N] at r_i in the body frame (x forward, y left, z up), s_i the sense of the propeller's drag, u_i
the commanded thrusts, w the wind. D and M are MuJoCo's drag on the box whose inertia is the body's. One `advance` is
one `mjx.step` of a model without contacts and constraints; collisions are detected by exact distances instead.

Velocity and wind are in the world frame, the angular velocity in the body frame, quaternions are (w, x, y, z), body
-> world.

Mass, inertia, arms, thrust range and yaw moment are those of the Skydio X2 in MuJoCo Menagerie. The motors' lag is not
published; 0.03 s is typical of propellers of that size.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from maxjax.sim.worlds.mjx_import import import_mjx

if TYPE_CHECKING:
    import mujoco

GRAVITY = 9.81


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class Vehicle:
    """Constants of a quadrotor; static.

    Attributes:
        mass: [kg].
        inertia: principal moments about body x, y, z [kg m²].
        arm: distance of the motors from the centre along body x and y [m].
        thrust: greatest thrust of one motor [N].
        yaw_moment: drag moment of a propeller for its thrust [N m/N].
        motor_lag: τ, time constant of a thrust [s].
        density: of the air [kg/m³].
        viscosity: of the air [Pa s].
        timestep: of one `advance` [s].

    Raises:
        ValueError: for values that are not physical, or a vehicle that cannot hover.
    """

    mass: float = 1.325
    inertia: tuple[float, float, float] = (0.0367, 0.0254, 0.0605)
    arm: tuple[float, float] = (0.14, 0.18)
    thrust: float = 13.0
    yaw_moment: float = 0.0201
    motor_lag: float = 0.03
    density: float = 1.225
    viscosity: float = 1.8e-5
    timestep: float = 0.01

    def __post_init__(self) -> None:
        for name in ("mass", "thrust", "yaw_moment", "motor_lag"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"Vehicle.{name}: expected a positive number, given {getattr(self, name)}")
        if not min(self.arm) > 0.0:
            raise ValueError(f"Vehicle.arm: expected two positive lengths [m], given {self.arm}")
        if not (min(self.inertia) > 0.0 and 2.0 * max(self.inertia) <= sum(self.inertia)):
            raise ValueError(f"Vehicle.inertia: expected the principal moments of a body, given {self.inertia}")
        if not (self.density > 0.0 and self.viscosity >= 0.0):
            raise ValueError(f"Vehicle: expected air of positive density, given {self.density}, {self.viscosity}")
        if not 0.0 < self.timestep <= 0.02:
            raise ValueError(f"Vehicle.timestep: expected 0 to 0.02 s, given {self.timestep}")
        if not 4.0 * self.thrust > self.mass * GRAVITY:
            raise ValueError(f"Vehicle: four thrusts of {self.thrust} N do not lift {self.mass} kg")

    @property
    def hover(self) -> float:
        """Thrust of one motor in hover, a quarter of the weight [N]."""
        return self.mass * GRAVITY / 4.0

    @property
    def mixing(self) -> Float[np.ndarray, "4 4"]:
        """Thrusts [N] -> (collective [N], moments about body x, y, z [N m])."""
        x, y = self.arm
        rows = [(1.0, 1.0, 1.0, 1.0), (-y, y, y, -y), (x, x, -x, -x)]
        return np.array([*rows, tuple(self.yaw_moment * s for s in (-1.0, 1.0, -1.0, 1.0))])


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class State:
    """State of the vehicle; batch axes lead.

    Attributes:
        position: of the centre of mass, world frame [m].
        quaternion: unit, (w, x, y, z), body -> world.
        velocity: world frame [m/s].
        rate: angular velocity, body frame [rad/s].
        thrust: of the four motors [N].
    """

    position: Float[Array, "*batch 3"]
    quaternion: Float[Array, "*batch 4"]
    velocity: Float[Array, "*batch 3"]
    rate: Float[Array, "*batch 3"]
    thrust: Float[Array, "*batch 4"]

    @property
    def rotation(self) -> Float[Array, "*batch 3 3"]:
        """Body axes as columns, body -> world."""
        w, x, y, z = jnp.moveaxis(self.quaternion, -1, 0)
        rows = [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
        return jnp.stack([jnp.stack(row, -1) for row in rows], -2)


def hover(vehicle: Vehicle, position: Float[Array, "*batch 3"], yaw: float | Float[Array, "*#batch"] = 0.0) -> State:
    """The state at rest, level, with thrust equal to the weight.

    Args:
        vehicle: static.
        position: [m].
        yaw: heading of body x, counter-clockwise from east [rad].
    """
    batch = position.shape[:-1]
    half = jnp.broadcast_to(0.5 * jnp.asarray(yaw, position.dtype), batch)
    zero = jnp.zeros_like(half)
    return State(
        position,
        jnp.stack([jnp.cos(half), zero, zero, jnp.sin(half)], -1),
        jnp.zeros((*batch, 3), position.dtype),
        jnp.zeros((*batch, 3), position.dtype),
        jnp.full((*batch, 4), vehicle.hover, position.dtype),
    )


def mujoco_model(vehicle: Vehicle) -> mujoco.MjModel:
    """The vehicle as a model for C MuJoCo: a free body, actuators of four thrusts, no geoms."""
    import mujoco  # a flight that was compiled before does without

    x, y = vehicle.arm
    corners = ((-x, -y), (-x, y), (x, y), (x, -y))
    sites = "".join(f'<site name="motor{i}" pos="{a} {b} 0"/>' for i, (a, b) in enumerate(corners))
    motors = "".join(
        f'<general site="motor{i}" gear="0 0 1 0 0 {moment}" dyntype="filterexact" dynprm="{vehicle.motor_lag}" '
        f'ctrllimited="true" ctrlrange="0 {vehicle.thrust}"/>'
        for i, moment in enumerate(vehicle.mixing[3])
    )
    # The sparse Jacobian factors the mass matrix without calls to a linear algebra library: half the time in a batch.
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco>
          <option timestep="{vehicle.timestep}" gravity="0 0 {-GRAVITY}" density="{vehicle.density}"
                  viscosity="{vehicle.viscosity}" integrator="Euler" jacobian="sparse">
            <flag contact="disable" constraint="disable" eulerdamp="disable"/>
          </option>
          <worldbody>
            <body name="vehicle"><freejoint/>
              <inertial pos="0 0 0" mass="{vehicle.mass}" diaginertia="{" ".join(map(str, vehicle.inertia))}"/>
              {sites}
            </body>
          </worldbody>
          <actuator>{motors}</actuator>
        </mujoco>"""
    )


@functools.lru_cache(maxsize=8)
def _model_and_data(vehicle: Vehicle) -> tuple[Any, Any]:
    """Model and data as templates, on the host: device arrays would be bound to the mesh of their first trace."""
    model, mjx = mujoco_model(vehicle), import_mjx()
    with jax.ensure_compile_time_eval():
        pair: tuple[Any, Any] = jax.tree.map(np.asarray, (mjx.put_model(model), mjx.make_data(model)))
        return pair


def advance(vehicle: Vehicle, state: State, command: Float[Array, "4"], wind: Float[Array, "3"]) -> State:
    """One time step; pure, safe under `jit`, `vmap`, `grad` and `lax.scan`.

    Only the state is carried. The rest of MJX's data follows from it and is recomputed, so XLA eliminates what the next
    state does not depend on.

    Args:
        vehicle: static.
        state: of one vehicle; `vmap` for batches.
        command: thrusts [N], clipped to the motors' range.
        wind: velocity of the air, world frame [m/s].

    Returns:
        The state `vehicle.timestep` later.

    Raises:
        ValueError: for wrong shapes.
    """
    if state.position.shape != (3,) or command.shape != (4,) or wind.shape != (3,):
        raise ValueError(
            f"step: expected position (3,), command (4,), wind (3,), given {state.position.shape}, {command.shape}, "
            f"{wind.shape}; use vmap for batches"
        )
    model, data = jax.tree.map(jnp.asarray, _model_and_data(vehicle))
    data = data.replace(
        qpos=jnp.concatenate([state.position, state.quaternion]),
        qvel=jnp.concatenate([state.velocity, state.rate]),
        act=state.thrust,
        ctrl=command,
    )
    data = import_mjx().step(model.tree_replace({"opt.wind": wind}), data)
    return State(data.qpos[:3], data.qpos[3:], data.qvel[:3], data.qvel[3:], data.act)


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class Gusts:
    """Turbulence as a first-order process on each axis, g' = −g / T + white noise; static.

    The default is that of the Dryden model near the ground (10 m) in a wind of 10 m/s.

    Attributes:
        deviation: standard deviation along x, y, z [m/s].
        time: correlation time T along x, y, z [s].
    """

    deviation: tuple[float, float, float] = (1.9, 1.9, 1.0)
    time: tuple[float, float, float] = (6.8, 6.8, 1.0)


def gust(
    gusts: Gusts, now: Float[Array, "*batch 3"], noise: Float[Array, "*batch 3"], dt: float
) -> Float[Array, "*batch 3"]:
    """The gust [m/s] a time `dt` [s] after it was `now`; exact for any `dt`.

    Args:
        gusts: static.
        now: gust [m/s]; initially deviation times standard normal numbers.
        noise: standard normal numbers, independent for each call.
        dt: [s].
    """
    decay = np.exp(-dt / np.asarray(gusts.time))
    kick = np.asarray(gusts.deviation) * np.sqrt(1.0 - decay**2)
    return jnp.asarray(decay, now.dtype) * now + jnp.asarray(kick, now.dtype) * noise
