"""Cascaded control of a quadrotor: position and velocity → thrust vector → attitude on SO(3) → four thrusts.

    a = a_ref + 2 ω (v_ref + sat(ω/2 (x_ref − x)) − v) − d̂         position: both poles at ω
    v̂' = f/m + g + d̂ + 2 ω_d (v − v̂),   d̂' = ω_d² (v − v̂)          disturbance observer: both poles at ω_d
    F = m (a − g), tilted by `tilt` at most                         thrust vector, world frame
    M_u = N + (1 − 3 p τ) (M_f − N) − τ J (3 p² Ω + p³ e_R)         attitude: three poles at p, motors' lag τ included
    u = mixing⁻¹ (F · R e₃, M_u)                                    N = Ω × J Ω

d̂ is the acceleration that the thrust does not account for: drag in flight and wind, and an error of the mass.
f and M_f are the present thrust and moment of the motors. e_R = ½ (R_dᵀ R − Rᵀ R_d)^∨ with R_d the attitude of
body z along F and body x towards the yaw, saturated smoothly at 0.3 rad. The attitude lags by 3 / p seconds, so the
acceleration of a reference is evaluated that much earlier (`Controller.lead`).

Saturation gives priority to roll and pitch, then to the collective thrust, then to yaw, so that the direction of the
thrust is kept.

Every gain follows from a bandwidth: ω = 2.5 rad/s, ω_d = 5 rad/s, p = 25 rad/s (roll, pitch), 4 rad/s (yaw). With
these the position loop crosses over at 5 rad/s with a phase margin of 40 degrees; with exact mass and motor lag the
observer does not reduce it.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from maxjax.compile.lowering import matmul
from maxjax.sim.vehicle.quadrotor import GRAVITY, State, Vehicle
from maxjax.trajectories.online import Setpoint

# Least collective thrust as a share of the weight: enough moment for attitude control in the fastest descent.
_FLOOR = 0.3
# Saturation of the attitude error [rad]; it limits the angular velocity to p / 3 times it, 2.5 rad/s. Without it large
# errors demand more moment than a vehicle at low thrust has, and their priority would increase the collective thrust.
_FARTHEST = 0.3
# Greatest heading error passed to the attitude loop [rad].
_TURN = 0.3


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class Controller:
    """Bandwidths and limits; static.

    Attributes:
        position: ω [rad/s].
        observer: ω_d [rad/s].
        attitude: p of roll and pitch [rad/s].
        yaw: p of yaw [rad/s].
        tilt: greatest angle between thrust and the vertical [deg].
        approach: greatest speed that a position error adds to that of the reference [m/s].
        disturbance: greatest |d̂| along each axis [m/s²].

    Raises:
        ValueError: for values outside these meanings.
    """

    position: float = 2.5
    observer: float = 5.0
    attitude: float = 25.0
    yaw: float = 4.0
    tilt: float = 45.0
    approach: float = 3.0
    disturbance: float = 8.0

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            if not getattr(self, field.name) > 0.0:
                raise ValueError(
                    f"Controller.{field.name}: expected a positive number, given {getattr(self, field.name)}"
                )
        if not self.tilt < 80.0:
            raise ValueError(f"Controller.tilt: expected less than 80 degrees, given {self.tilt}")

    @property
    def lead(self) -> float:
        """Time by which the acceleration of a reference should be evaluated in advance [s]."""
        return 3.0 / self.attitude


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Observer:
    """Estimates of the disturbance observer; batch axes lead.

    Attributes:
        velocity: v̂ [m/s].
        disturbance: d̂ [m/s²].
    """

    velocity: Float[Array, "*batch 3"]
    disturbance: Float[Array, "*batch 3"]


def init(state: State) -> Observer:
    """The observer at take-off: the present velocity, no disturbance."""
    return Observer(state.velocity, jnp.zeros_like(state.velocity))


def mix(vehicle: Vehicle, collective: Float[Array, ""], moment: Float[Array, "3"]) -> Float[Array, "4"]:
    """Four thrusts [N] in the motors' range for a collective thrust [N] and moments about body x, y, z [N m].

    In saturation roll and pitch have priority (scaled by one factor if they alone saturate), then the collective thrust
    as near as they allow, then as much of yaw as is left.
    """
    inverse = jnp.asarray(np.linalg.inv(vehicle.mixing), moment.dtype)
    level = matmul(inverse[:, 1:3], moment[:2])
    spread = jnp.max(level) - jnp.min(level)
    level = level * jnp.where(spread > vehicle.thrust, vehicle.thrust / jnp.where(spread > 0.0, spread, 1.0), 1.0)
    base = level + jnp.clip(0.25 * collective, -jnp.min(level), vehicle.thrust - jnp.max(level))
    turn = inverse[:, 3] * moment[2]
    room = jnp.where(turn > 0.0, vehicle.thrust - base, base)
    size = jnp.abs(turn)
    share = jnp.min(jnp.where(size > room, room / jnp.where(size > 0.0, size, 1.0), 1.0))
    return jnp.clip(base + jnp.maximum(share, 0.0) * turn, 0.0, vehicle.thrust)


def command(
    controller: Controller, vehicle: Vehicle, observer: Observer, state: State, setpoint: Setpoint
) -> tuple[Observer, Float[Array, "4"]]:
    """One iteration of the control loop, every `vehicle.timestep`.

    Args:
        controller: static.
        vehicle: static.
        observer: from `init` or the iteration before.
        state: of one vehicle, as it is; `vmap` for batches.
        setpoint: from `reference.evaluate`, best with `controller.lead`.

    Returns:
        The observer, and the thrusts to command [N], all within the motors' range.

    Raises:
        ValueError: for wrong shapes.
    """
    if state.position.shape != (3,) or setpoint.position.shape != (3,):
        raise ValueError(
            f"step: expected positions (3,), given {state.position.shape} and {setpoint.position.shape}; use vmap"
        )
    rotation = state.rotation
    up = jnp.array([0.0, 0.0, 1.0])

    omega = controller.position
    approach = 0.5 * omega * (setpoint.position - state.position)
    # Smooth saturation at `controller.approach`.
    approach = approach / jnp.sqrt(1.0 + jnp.sum(approach * approach) / controller.approach**2)
    acceleration = setpoint.acceleration + 2.0 * omega * (setpoint.velocity + approach - state.velocity)
    force = _tilted(controller, acceleration - observer.disturbance)

    direction = force / jnp.sqrt(jnp.sum(force * force))
    collective = vehicle.mass * jnp.sum(force * rotation[:, 2])
    moment = _moment(controller, vehicle, state, rotation, _attitude(direction, _nearby(rotation, setpoint.yaw)))
    command = mix(vehicle, jnp.maximum(collective, 0.0), moment)

    dt, rate = vehicle.timestep, controller.observer
    residual = state.velocity - observer.velocity
    explained = jnp.sum(state.thrust) / vehicle.mass * rotation[:, 2] - GRAVITY * up
    velocity = observer.velocity + dt * (explained + observer.disturbance + 2.0 * rate * residual)
    disturbance = observer.disturbance + dt * rate**2 * residual
    return Observer(velocity, jnp.clip(disturbance, -controller.disturbance, controller.disturbance)), command


def _tilted(controller: Controller, acceleration: Float[Array, "3"]) -> Float[Array, "3"]:
    """Thrust per mass [m/s²] for an acceleration: upwards, the vertical component before the horizontal ones."""
    vertical = jnp.clip(acceleration[2] + GRAVITY, _FLOOR * GRAVITY, 3.0 * GRAVITY)
    horizontal = acceleration[:2]
    limit = vertical * np.tan(np.deg2rad(controller.tilt))
    square = jnp.sum(horizontal * horizontal)
    over = square > limit * limit
    scale = jnp.where(over, limit / jnp.sqrt(jnp.where(over, square, 1.0)), 1.0)
    return jnp.concatenate([scale * horizontal, vertical[None]])


def _nearby(rotation: Float[Array, "3 3"], yaw: Float[Array, ""]) -> Float[Array, ""]:
    """The heading setpoint at most `_TURN` away, since a large yaw error would take up the saturated attitude error."""
    now = jnp.arctan2(rotation[1, 0], rotation[0, 0])
    turn = yaw - now
    return now + jnp.clip(jnp.arctan2(jnp.sin(turn), jnp.cos(turn)), -_TURN, _TURN)


def _attitude(z: Float[Array, "3"], yaw: Float[Array, ""]) -> Float[Array, "3 3"]:
    """The rotation with body z along a unit vector and body x as near to the heading as possible."""
    heading = jnp.stack([jnp.cos(yaw), jnp.sin(yaw), jnp.zeros_like(yaw)])
    y = jnp.cross(z, heading)
    y = y / jnp.sqrt(jnp.sum(y * y))
    return jnp.stack([jnp.cross(y, z), y, z], axis=1)


def _moment(
    controller: Controller, vehicle: Vehicle, state: State, rotation: Float[Array, "3 3"], desired: Float[Array, "3 3"]
) -> Float[Array, "3"]:
    """Moments to command [N m], body frame."""
    skew = matmul(desired.T, rotation)
    skew = 0.5 * (skew - skew.T)
    error = jnp.stack([skew[2, 1], skew[0, 2], skew[1, 0]])
    error = error / jnp.sqrt(1.0 + jnp.sum(error * error) / _FARTHEST**2)
    inertia = jnp.asarray(vehicle.inertia)
    p = jnp.asarray((controller.attitude, controller.attitude, controller.yaw))
    tau = vehicle.motor_lag
    moment = matmul(jnp.asarray(vehicle.mixing[1:], error.dtype), state.thrust)
    gyroscopic = jnp.cross(state.rate, inertia * state.rate)
    return (
        (1.0 - 3.0 * p * tau) * (moment - gyroscopic)
        - tau * inertia * (3.0 * p**2 * state.rate + p**3 * error)
        + gyroscopic
    )
