"""Convolution, pooling and upsampling of channels-last volumes of any dimension, plainly and folded.

    y[v, o] = Σ_t Σ_i x[v + t − p, i] w[t, i, o]        p = (k − 1)/2, zeros beyond the grid

Shapes: x (n, *space, i), w (*k, i, o).

Folding. Nearest-neighbour upsampling repeats each coarse value, u[v] = x[⌊v/2⌋], so neighbouring taps of the
next convolution read the same number, and their weights can be added up beforehand. Along one axis, with k = 3, the
fine voxels 2j − 1 and 2j read the coarse pair (x[j−1], x[j]) and nothing else:

    y[2j − 1] = w₀ x[j−1] + (w₁ + w₂) x[j]        y[2j] = (w₀ + w₁) x[j−1] + w₂ x[j]

In three dimensions eight phase kernels of 2³ taps, which are one convolution with eight times the channels on the
coarse grid: 27/8 fewer products than on the fine one, and no fine volume in memory. Its result comes in *patches*:
patch j along an axis holds the fine voxels 2j − 1 and 2j as channels. A convolution with k = 3 from patches gives the
voxels 2j and 2j + 1, by 2³ taps again; the max-pooling after it is a maximum over channels.

An odd fine axis, 2n + 1: the coarse one is continued by its last voxel, and what exceeds the grid is cut off.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence
from typing import Literal

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

Volumes = Float[Array, "n ... _"]  # n, space, channels; sizes differ from argument to result
Kernel = Float[Array, "... _ _"]  # taps, channels in, channels out

# `direct` is XLA's convolution. `product` gathers the taps of every voxel into one row and multiplies matrices.
# `planes` hands the taps along the first axis over as channels of a convolution with one dimension less.
Formulation = Literal["direct", "product", "planes"]


def convolve(x: Volumes, kernel: Kernel, *, same: bool = True, by: Formulation = "direct") -> Volumes:
    """Correlate with a kernel, stride one.

    Args:
        x: volumes.
        kernel: of the same dtype.
        same: pad with zeros so that the space keeps its size (odd kernels); else only whole windows count. Static.
        by: how it is computed; all give the same numbers but for rounding. Static.
    """
    size = kernel.shape[:-2]
    if same:
        x = pad(x, [((k - 1) // 2, k // 2) for k in size])
    if by == "product":
        rows = _windows(x, size)
        return jnp.matmul(rows, kernel.reshape(-1, kernel.shape[-1]))
    if by == "planes" and len(size) == 3:
        n, out = x.shape[0], x.shape[1] - size[0] + 1
        x = jnp.concatenate([lax.slice_in_dim(x, t, t + out, axis=1) for t in range(size[0])], axis=-1)
        flat = x.reshape(n * out, *x.shape[2:])
        taps = jnp.moveaxis(kernel, 0, -3).reshape(*size[1:], -1, kernel.shape[-1])
        y = convolve(flat, taps, same=False)
        return y.reshape(n, out, *y.shape[1:])
    letters = "XYZ"[: len(size)]
    numbers = (f"N{letters}C", f"{letters}IO", f"N{letters}C")
    return lax.conv_general_dilated(x, kernel, (1,) * len(size), "VALID", dimension_numbers=numbers)


def _windows(x: Volumes, size: Sequence[int]) -> Volumes:
    """The taps of every window as channels, in the order of the kernel."""
    out = [n - k + 1 for n, k in zip(x.shape[1:-1], size, strict=True)]
    views = []
    for start in itertools.product(*map(range, size)):
        stop = [a + n for a, n in zip(start, out, strict=True)]
        views.append(lax.slice(x, (0, *start, 0), (x.shape[0], *stop, x.shape[-1])))
    return jnp.concatenate(views, axis=-1)


def pad(x: Volumes, widths: Sequence[tuple[int, int]]) -> Volumes:
    """Zeros around the space; negative widths cut."""
    config = [(0, 0, 0), *((low, high, 0) for low, high in widths), (0, 0, 0)]
    return lax.pad(x, jnp.zeros((), x.dtype), config)


def pool(x: Volumes) -> Volumes:
    """Maximum over patches of two along each axis; an odd last voxel is left out."""
    for axis in range(1, x.ndim - 1):
        even = x.shape[axis] // 2 * 2
        # Two strided views: the gradient of a maximum of two is cheap, that of a reduction over windows is not.
        x = jnp.maximum(lax.slice_in_dim(x, 0, even, 2, axis), lax.slice_in_dim(x, 1, even, 2, axis))
    return x


def upsample(x: Volumes, space: Sequence[int]) -> Volumes:
    """Nearest neighbour, u[v] = x[⌊v/2⌋], on the smallest even grid that covers `space`: 2n, or 2n + 2 for 2n + 1."""
    for axis, wanted in enumerate(space, start=1):
        n = x.shape[axis]
        if wanted not in (2 * n, 2 * n + 1):
            raise ValueError(f"upsample: expected {2 * n} or {2 * n + 1} voxels along axis {axis - 1}, given {wanted}")
        index = np.minimum(np.arange(2 * (n + wanted % 2)) // 2, n - 1)
        x = jnp.take(x, index, axis=axis)
    return x


def crop(x: Volumes, space: Sequence[int]) -> Volumes:
    """The first voxels along each axis."""
    return lax.slice(x, (0,) * x.ndim, (x.shape[0], *space, x.shape[-1]))


def patches(x: Volumes) -> Volumes:
    """Patches of two along each axis as channels, voxels of a patch in order, channels within; even axes."""
    n, *space, c = x.shape
    d = len(space)
    x = x.reshape(n, *(part for m in space for part in (m // 2, 2)), c)
    order = (0, *range(1, 2 * d, 2), *range(2, 2 * d + 1, 2), 2 * d + 1)
    return x.transpose(order).reshape(n, *(m // 2 for m in space), 2**d * c)


def unpatch(x: Volumes) -> Volumes:
    """Inverse of `patches`."""
    n, *space, c = x.shape
    d = len(space)
    x = x.reshape(n, *space, *(2,) * d, c // 2**d)
    order = (0, *(axis for a in range(1, d + 1) for axis in (a, a + d)), 2 * d + 1)
    return x.transpose(order).reshape(n, *(2 * m for m in space), c // 2**d)


def _phases(kernel: Kernel, along: np.ndarray) -> Array:
    """Apply the matrix (outputs..., taps) along each axis of taps; its outputs lead, axis by axis."""
    d = kernel.ndim - 2
    folded = kernel
    for _ in range(d):
        # The axis just treated goes last, so that after d turns the order is that of the axes again.
        folded = jnp.tensordot(folded, along.astype(kernel.dtype), axes=((0,), (along.ndim - 1,)))
    return folded


def fold_up(kernel: Kernel) -> Kernel:
    """Kernel (2, …, i, 2^d · o) of `convolve_up`, from one of three taps an axis (3, …, i, o)."""
    _check_three(kernel)
    d, (i, o) = kernel.ndim - 2, kernel.shape[-2:]
    # (phase, coarse tap, tap): fine voxel 2j − 1 + phase, tap t reads ⌊(2j − 1 + phase + t − 1)/2⌋.
    along = np.zeros((2, 2, 3), np.float32)
    for phase, tap in itertools.product(range(2), range(3)):
        along[phase, (phase + tap - 2) // 2 + 1, tap] = 1
    folded = _phases(kernel, along)  # i, o, (phase, coarse) per axis
    order = (*(3 + 2 * a for a in range(d)), 0, *(2 + 2 * a for a in range(d)), 1)
    return folded.transpose(order).reshape(*(2,) * d, i, 2**d * o)


def fold_patches(kernel: Kernel) -> Kernel:
    """Kernel (2, …, 2^d · i, 2^d · o) from patches 2j − 1, 2j to patches 2j, 2j + 1, from (3, …, i, o)."""
    _check_three(kernel)
    d, (i, o) = kernel.ndim - 2, kernel.shape[-2:]
    # (phase out, patch, phase in, tap): voxel 2j + out reads 2j + out + t − 1, number out + t from the patch's first.
    along = np.zeros((2, 2, 2, 3), np.float32)
    for out, tap in itertools.product(range(2), range(3)):
        along[out, (out + tap) // 2, (out + tap) % 2, tap] = 1
    folded = _phases(kernel, along)  # i, o, (out, patch, in) per axis
    order = (
        *(3 + 3 * a for a in range(d)),
        *(4 + 3 * a for a in range(d)),
        0,
        *(2 + 3 * a for a in range(d)),
        1,
    )
    return folded.transpose(order).reshape(*(2,) * d, 2**d * i, 2**d * o)


def _check_three(kernel: Kernel) -> None:
    if set(kernel.shape[:-2]) != {3}:
        raise ValueError(f"kernel: expected three taps along each axis, given {kernel.shape[:-2]}")


def shifted_patches(x: Volumes) -> Volumes:
    """Patches of the voxels 2j − 1 and 2j, zeros beyond the grid: what a kernel of `fold_patches` reads."""
    return patches(pad(x, [(1, 1 + m % 2) for m in x.shape[1:-1]]))


def convolve_up(x: Volumes, folded: Kernel, space: Sequence[int], *, by: Formulation = "direct") -> Volumes:
    """Upsampling to `space` and a convolution, in shifted patches.

    Args:
        x: coarse volumes.
        folded: from `fold_up`.
        space: fine voxels along each axis, 2n or 2n + 1. Static.
        by: see `convolve`. Static.

    Returns:
        Patches of the voxels 2j − 1 and 2j, j from 0 to n; the first voxel and, on even axes, the last one lie beyond
        the grid and hold what the formula gives there.
    """
    x = pad(x, [(1, 1)] * len(space))
    for axis, m in enumerate(space, start=1):
        if m % 2:
            inner = lax.slice_in_dim(x, 0, x.shape[axis] - 1, axis=axis)
            x = jnp.concatenate([inner, lax.slice_in_dim(inner, inner.shape[axis] - 1, None, axis=axis)], axis)
    return convolve(x, folded, same=False, by=by)


def from_shifted(x: Volumes, space: Sequence[int]) -> Volumes:
    """Voxels of shifted patches."""
    fine = unpatch(x)
    return lax.slice(fine, (0, *(1 for _ in space), 0), (x.shape[0], *(1 + m for m in space), fine.shape[-1]))


def inside_shifted(space: Sequence[int]) -> Bool[np.ndarray, "*patches phases"]:
    """Whether a shifted patch's voxels lie in the grid."""
    mask: Bool[np.ndarray, "*patches phases"] = np.ones((1,), bool)
    for m in space:
        voxel = 2 * np.arange(m // 2 + 1)[:, None] - 1 + np.arange(2)
        axis = (voxel >= 0) & (voxel < m)
        phases = mask[..., None, :, None] & axis[:, None, :]
        mask = phases.reshape(*mask.shape[:-1], len(axis), -1)
    return mask


def pool_patches(x: Volumes, dimensions: int) -> Volumes:
    """`pool` of patches: the maximum over the voxels of each."""
    *outer, c = x.shape
    return jnp.max(x.reshape(*outer, 2**dimensions, c // 2**dimensions), axis=-2)


@functools.cache
def receptive_field(kernels: tuple[int, ...]) -> int:
    """Voxels along an axis that one voxel depends on after levels of a convolution and a pooling each."""
    field, stride = 1, 1
    for kernel in kernels:
        field += (kernel - 1) * stride + stride
        stride *= 2
    return field


def count(tree: object) -> int:
    """Numbers in a pytree of arrays."""
    import jax

    return sum(math.prod(leaf.shape) for leaf in jax.tree.leaves(tree))
