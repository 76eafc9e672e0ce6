"""Trained networks: their files, and the potential that they predict.

    (sigma, goal_index) ↦ Potential        the slot that `solve_potential` fills as well

A file holds the weights in float16, and the architecture and the recipe that they were trained with as metadata, all
under one hash (`core.serialization`); nothing in it is executed.
"""

from __future__ import annotations

import dataclasses
import functools
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int32

from maxjax.compile import lowering
from maxjax.compile.forked import refuse_after_fork
from maxjax.core.files import brief
from maxjax.core.serialization import load_metadata, load_pytree, save_pytree
from maxjax.core.status import Status
from maxjax.fields import gradient as slope
from maxjax.fields import stencil
from maxjax.fields.price import SCREENING_LENGTH
from maxjax.nn.architecture import CONFIGS, Autoencoder
from maxjax.nn.autoencoder import Params, apply_folded, cast, fold, init_params
from maxjax.nn.encoding import UNIT, Known, decode, encode
from maxjax.nn.layers import Formulation
from maxjax.solvers.certify import input_status, sweep_until_certified, swept
from maxjax.solvers.medium import medium_of, no_progress
from maxjax.solvers.potential import Potential, check_inputs, potential_of, solve_potential

WEIGHTS = Path(__file__).parent / "weights"
# Positive sweeps that a prediction is given to be certified; where they do not suffice, the solver takes over.
MAX_SWEEPS = 64
# Standard deviation of the smoothing of a predicted log-potential [voxels]: local maxima of a voxel or two would hold
# up the ascent, and cost the sweeps more than all the rest. The paper smooths too, by 5.
_SMOOTHING = 1.0
# Sweeps between two looks at the certificate.
_LOOK = 4
# A predicted −ℓ log φ [voxels], as `Model.log_potential`.
LogPotential = Callable[[Known], Array]


@dataclasses.dataclass(frozen=True, eq=False)
class Model:
    """A network and its weights; two are equal only if they are one, so it can be a static argument.

    Attributes:
        name: in `architecture.CONFIGS`.
        network: architecture.
        params: weights as `autoencoder.fold` and `cast` leave them.
        by: how convolutions are computed.
        metadata: of the file: recipe, errors.
    """

    name: str
    network: Autoencoder
    params: Params
    by: Formulation
    metadata: Mapping[str, Any]

    def log_potential(self, known: Known) -> Float[Array, "nx ny nz"]:
        """The network's −ℓ log φ [voxels]."""
        x, base = encode(self.network.start, self.network.flood, known)
        return base + UNIT[self.network.start] * apply_folded(self.params, x[None], self.network, by=self.by)[0]


def predict_potential(
    model: Model,
    sigma: Float[Array, "nx ny nz"],
    goal_index: Int32[Array, " 3"],
    price: Float[Array, "nx ny nz"] | None = None,
    *,
    max_sweeps: int = 0,
) -> Potential:
    """The potential that a network predicts, in the slot of `solve_potential`.

    The prediction is smoothed within free space. With sweeps, it is then improved by positive sweeps
    φ_i ← Σ_j w_ij φ_j / d_i until it is certified; where they do not suffice, the solver takes over. Without sweeps,
    `certified` states whether an ascent is proved to arrive; a status of OK only that the field can be climbed.

    Args:
        model: from `load_model`. Static: `functools.partial(predict_potential, model)` is a `PotentialFn`.
        sigma: conductivity, zero in obstacles.
        goal_index: voxel of the goal.
        price: as of `solve_potential`; networks without the flood among their inputs do not read it, sweeps do.
        max_sweeps: 0: the network alone. Static.

    Returns:
        A `Potential`: `sweeps` that were made, `iterations` 0 unless the solver had to take over. `residual` is the
        largest relative change that one more sweep would make.

    Raises:
        ValueError: for a sigma or goal_index of a wrong shape or dtype, or a grid too small for the network.
    """
    sigma, goal_index = jnp.asarray(sigma), jnp.asarray(goal_index)
    check_inputs(sigma, goal_index)
    return certify_prediction(model.log_potential, sigma, goal_index.astype(jnp.int32), price, max_sweeps)


def certify_prediction(
    start: LogPotential,
    sigma: Float[Array, "nx ny nz"],
    goal_index: Int32[Array, " 3"],
    price: Float[Array, "nx ny nz"] | None,
    max_sweeps: int,
) -> Potential:
    """The potential from any predicted log-potential, of a network or a formula; the rest is `predict_potential`'s.

    Args:
        start: the log-potential from which the sweeps start. Static.
        sigma, goal_index, price, max_sweeps: as of `predict_potential`.
    """
    medium = medium_of(sigma, goal_index, price)
    component, length = medium.component, jnp.asarray(SCREENING_LENGTH, sigma.dtype)
    goal = stencil.cell(sigma.shape, goal_index) & component
    wrong = input_status(medium, length)
    # A network turns one NaN into many; with a bad sigma its output is not used.
    finite = wrong != Status.NONFINITE_INPUT
    given = jnp.where(finite, sigma, 0), jnp.where(finite, 1 if price is None else price, jnp.ones_like(sigma))
    log_phi = decode(start(Known(*given, goal_index, medium.distance, length)), component, goal, length)
    log_phi = jnp.where(goal, 0, jnp.where(component, slope.smooth(log_phi, component, _SMOOTHING), 0))
    progress = dataclasses.replace(no_progress(medium, length), log_phi=log_phi)
    progress = sweep_until_certified(medium, progress, most=max_sweeps, between=_LOOK)
    change = jnp.abs(jnp.expm1(swept(medium, length, progress.log_phi, 1) - progress.log_phi))
    usable = wrong == Status.OK
    predicted = dataclasses.replace(
        potential_of(progress, component),
        status=wrong,
        residual=jnp.max(jnp.where(component & ~goal, change, 0)),
        certified=usable & (progress.uncertified == 0),
    )
    if max_sweeps == 0:
        return predicted

    def solved() -> Potential:
        exact = solve_potential(sigma, goal_index, price)
        return dataclasses.replace(exact, sweeps=exact.sweeps + predicted.sweeps)

    field: Potential = lax.cond(usable & ~predicted.certified, solved, lambda: predicted)
    return field


@functools.cache
def network_potential(name: str = "maxjax", max_sweeps: int = MAX_SWEEPS) -> Callable[..., Potential]:
    """(sigma, goal_index, price) ↦ Potential by a trained network; the same function each time, for a planner's cache.

    Args:
        name, max_sweeps: as of `load_model` and `predict_potential`.

    Raises:
        ValueError: as `load_model`.
    """
    return functools.partial(predict_potential, load_model(name), max_sweeps=max_sweeps)


def save_model(
    path: str | os.PathLike[str], name: str, params: Params, *, metadata: Mapping[str, Any] | None = None
) -> None:
    """Write the weights of a network for `load_model`.

    Args:
        path: file, .npz.
        name: in `architecture.CONFIGS`.
        params: of `autoencoder.init_params`, trained.
        metadata: anything that JSON can hold.

    Raises:
        ValueError: for an unknown name, or weights that float16 cannot hold.
        OSError: if the file cannot be written.
    """
    network = _network(name)
    with np.errstate(over="ignore"):  # checked below
        half = jax.tree.map(lambda w: np.asarray(w).astype(np.float16), params)
    if not all(np.isfinite(w).all() for w in jax.tree.leaves(half)):
        raise ValueError(f"{name}: expected finite weights within float16's range")
    save_pytree(path, half, metadata={**(metadata or {}), "model": name, "network": _described(network)})


def shipped_networks() -> list[str]:
    """Names of the networks whose weights come with maxjax."""
    return sorted(file.stem for file in WEIGHTS.glob("*.npz") if file.stem in CONFIGS)


@functools.lru_cache(maxsize=8)
def load_model(name: str, path: str | os.PathLike[str] | None = None) -> Model:
    """A trained network.

    Args:
        name: in `architecture.CONFIGS`.
        path: file of `save_model`; by default the one that comes with maxjax.

    Raises:
        ValueError: for an unknown name, one without weights, or a file that is damaged or of another architecture.
        RuntimeError: in a process that was forked after JAX had run.
    """
    refuse_after_fork()
    network = _network(name)
    file = WEIGHTS / f"{name}.npz" if path is None else Path(path)
    if path is None and not file.exists():
        names = ", ".join(shipped_networks()) or "none"
        raise ValueError(
            f"model: no weights of {name!r} come with maxjax (there are: {names}); train it, or give a path"
        )
    metadata = load_metadata(file)
    given, expected = metadata.get("network"), _described(network)
    if metadata.get("model") != name or given != expected:
        raise ValueError(
            f"{file}: expected weights of {name} ({expected}), given {brief(metadata.get('model'))} ({brief(given)})"
        )
    shapes = jax.eval_shape(lambda: init_params(jax.random.key(0), network))
    half = load_pytree(file, jax.tree.map(lambda leaf: np.empty(leaf.shape, np.float16), shapes))
    gpu = lowering.target() == "gpu"
    with jax.ensure_compile_time_eval():  # the weights are kept: within a trace, too, they are numbers
        folded = fold(jax.tree.map(lambda w: jnp.asarray(w, jnp.float32), half), network)
        params = cast(folded, "bfloat16") if gpu else folded
    return Model(name, network, params, "direct" if gpu else "planes", metadata)


def _network(name: str) -> Autoencoder:
    if name not in CONFIGS:
        raise ValueError(f"model: expected one of {', '.join(CONFIGS)}, given {name!r}")
    return CONFIGS[name]


def _described(network: Autoencoder) -> dict[str, Any]:
    """An architecture as it stands in a file: tuples as JSON's lists, and the edge of a patch as "block"."""
    description = {key: _as_json(value) for key, value in dataclasses.asdict(network).items()}
    description["block"] = description.pop("patch")
    return description


def _as_json(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _as_json(item) for key, item in value.items()}
    return [_as_json(item) for item in value] if isinstance(value, tuple | list) else value
