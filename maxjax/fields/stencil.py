"""The 7-point finite-volume operator of steady conduction with a leak.

    (A φ)_i = Σ_j w_ij (φ_i − φ_j) + (κ σ_i + g_i) φ_i = q_i        w_ij = 2 σ_i σ_j / (σ_i + σ_j)

is −∇·(σ∇φ) + κ σ φ = q integrated over voxels of unit edge. The harmonic mean makes a face that touches an obstacle
(σ = 0) conduct nothing: walls are insulated. κ = 1/ℓ² is the leak of the screened setting [1/voxel²]; g_i = 2 σ_i for
each outer face that is grounded (φ = 0 half a voxel away), the paper's setting, else 0. A is symmetric with
non-positive off-diagonals and, with a leak or a grounded face, positive definite on the free voxels. It is never
stored: three arrays hold the conductances of the faces between i and i + 1 along each axis, one holds the diagonal.

Positive q is a source: current flows from high φ to low φ, and φ is highest at the goal.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int32

from maxjax.compile.lowering import shift_axis

Volume = Float[Array, "nx ny nz"]

# Per axis, the weight of the face between each voxel and the one ahead.
Faces = tuple[Volume, Volume, Volume]
# Per axis, the weights of the neighbour ahead and of the one behind, where they are not the same number seen from
# either side.
Links = tuple[tuple[Volume, Volume], tuple[Volume, Volume], tuple[Volume, Volume]]


def ahead(array: Volume, axis: int) -> Volume:
    """The value one voxel further along `axis`; zero beyond the grid."""
    return shift_axis(array, axis, 1)


def behind(array: Volume, axis: int) -> Volume:
    """The value one voxel back along `axis`; zero beyond the grid."""
    return shift_axis(array, axis, -1)


def cell(shape: tuple[int, ...], index: Int32[Array, " 3"]) -> Bool[Array, "nx ny nz"]:
    """True at one voxel, by comparison: an index outside the grid marks nothing."""
    x, y, z = (lax.broadcasted_iota(jnp.int32, shape, axis) == index[axis] for axis in range(3))
    return x & y & z


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Operator:
    """The matrix A on one grid.

    Attributes:
        faces: conductance of the face between i and i + 1 along x, y, z; zero at walls and beyond the grid.
        diagonal: Σ_j w_ij + κ σ_i + g_i; zero exactly in obstacles.
    """

    faces: Faces
    diagonal: Volume


@jax.named_scope("assemble")
def assemble(sigma: Volume, leak: Float[Array, "*#grid"] | float, grounded: bool = False) -> Operator:
    """The operator of a conductivity field.

    Args:
        sigma: conductivity, ≥ 0, zero in obstacles.
        leak: κ n² [1/voxel²], κ = 1/ℓ²; one number, or one a voxel.
        grounded: whether the outer faces of the grid are held at φ = 0 (else insulated). Static.
    """
    faces = (_conductance(sigma, 0), _conductance(sigma, 1), _conductance(sigma, 2))
    diagonal = leak * sigma
    for axis, face in enumerate(faces):
        diagonal = diagonal + face + behind(face, axis)
        if grounded:
            position = lax.broadcasted_iota(jnp.int32, sigma.shape, axis)
            outer = (position == 0).astype(sigma.dtype) + (position == sigma.shape[axis] - 1).astype(sigma.dtype)
            diagonal = diagonal + 2 * outer * sigma
    return Operator(faces, diagonal)


def _conductance(sigma: Volume, axis: int) -> Volume:
    """Harmonic mean of each voxel and the next along `axis`; its derivative exists at σ = 0 too."""
    following = ahead(sigma, axis)
    total = sigma + following
    return jnp.where(total > 0, 2 * sigma * following / jnp.where(total > 0, total, 1), 0)


def inflow(faces: Faces, phi: Volume, around: Links | None = None) -> Volume:
    """Σ_j w_ij φ_j: what the six neighbours send; adds only positive terms where φ ≥ 0.

    Args:
        faces: w.
        phi: φ.
        around: its `neighbours`, where they are at hand.
    """
    total = jnp.zeros_like(phi)
    for axis, face in enumerate(faces):
        following, preceding = around[axis] if around else (ahead(phi, axis), behind(phi, axis))
        # Shifting each factor, not the product, runs twice as fast on CPU.
        total = total + face * following + behind(face, axis) * preceding
    return total


def apply(operator: Operator, phi: Volume) -> Volume:
    """A φ."""
    return operator.diagonal * phi - inflow(operator.faces, phi)


def residual(operator: Operator, phi: Volume, source: Volume) -> Volume:
    """Return q − A φ: zero where the current balances."""
    return source - apply(operator, phi)


def hold(operator: Operator, held: Float[Array, "nx ny nz"]) -> tuple[Operator, Volume]:
    """Hold φ = 1 on the voxels where `held` is 1 (a mask of zeros and ones, free voxels).

    Their rows and columns leave the matrix (unit diagonal) and their current enters the right-hand side, so the matrix
    stays symmetric: returns (A_held, q) with A_held φ = q.
    """
    kept = 1 - held
    faces = tuple(face * kept * ahead(kept, axis) for axis, face in enumerate(operator.faces))
    source = kept * inflow(operator.faces, held) + held
    return Operator(faces, operator.diagonal * kept + held), source  # type: ignore[arg-type]


def normalize(operator: Operator) -> tuple[Faces, Volume]:
    """Scale A symmetrically to a unit diagonal: D^-1/2 A D^-1/2 = I − G.

    This is Jacobi preconditioning done once. Returns the faces of G, which is symmetric and non-negative (G y =
    `inflow(faces, y)`), and D^-1/2 (zero in obstacles): φ = D^-1/2 y with y = G y + D^-1/2 q.
    """
    free = operator.diagonal > 0
    scale = jnp.where(free, lax.rsqrt(jnp.where(free, operator.diagonal, 1)), 0)
    faces = tuple(face * scale * ahead(scale, axis) for axis, face in enumerate(operator.faces))
    return faces, scale  # type: ignore[return-value]


@jax.named_scope("rates")
def rates(faces: Faces, log_phi: Volume) -> Links:
    """w_ij φ_j / φ_i: what each neighbour sends, in terms of the voxel's own φ.

    Of φ only the ratios of neighbours are computed, so its logarithm may be of any size.

    Args:
        faces: w.
        log_phi: log φ, finite wherever a face conducts; elsewhere it is not read.
    """
    links = []
    for axis, face in enumerate(faces):
        preceding = behind(face, axis)
        fall = jnp.where(face > 0, log_phi - ahead(log_phi, axis), 0)
        rise = jnp.where(preceding > 0, log_phi - behind(log_phi, axis), 0)
        links.append((face / jnp.exp(fall), preceding / jnp.exp(rise)))
    return tuple(links)  # type: ignore[return-value]


def gather(links: Links, y: Volume) -> Volume:
    """Σ_j w_ij y_j with weights that need not be symmetric."""
    total = jnp.zeros_like(y)
    for axis, (forward, backward) in enumerate(links):
        total = total + forward * ahead(y, axis) + backward * behind(y, axis)
    return total
