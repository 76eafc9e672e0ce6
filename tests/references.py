"""Oracles shared by the tests: slow, plain, and sharing no code or idea with what they judge."""

from __future__ import annotations

import itertools
from fractions import Fraction

import numpy as np
from scipy import ndimage, sparse
from scipy.sparse.linalg import splu

from benchmarks.common.dilation import ball
from maxjax import Grid


def grid_graph(blocked: np.ndarray) -> sparse.csr_matrix:
    """Graph of all 26-neighbour steps whose spanned block is free; node i is voxel i of the ravelled grid.

    Weights are Euclidean lengths in voxels. Every step stands there in both directions.
    """
    nodes = np.arange(blocked.size).reshape(blocked.shape)
    rows, columns, weights = [], [], []
    for step in itertools.product((-1, 0, 1), repeat=3):
        if step <= (0, 0, 0):
            continue  # each of the 13 axes once
        source = tuple(slice(max(-s, 0), n - max(s, 0)) for s, n in zip(step, blocked.shape, strict=True))
        target = tuple(slice(max(s, 0), n - max(-s, 0)) for s, n in zip(step, blocked.shape, strict=True))
        free = np.ones(nodes[source].shape, bool)
        for part in itertools.product(*({0, s} for s in step)):
            span = tuple(slice(c.start + p, c.stop + p) for c, p in zip(source, part, strict=True))
            free &= ~blocked[span]
        rows.append(nodes[source][free])
        columns.append(nodes[target][free])
        weights.append(np.full(free.sum(), np.linalg.norm(step)))
    row, column, weight = (np.concatenate(x) for x in (rows, columns, weights))
    half = sparse.coo_matrix((weight, (row, column)), shape=(blocked.size, blocked.size))
    return (half + half.T).tocsr()


def priced_graph(blocked: np.ndarray, price: np.ndarray) -> sparse.csr_matrix:
    """`grid_graph` with every step's length times the mean of the prices of its two voxels."""
    graph, n = grid_graph(blocked).tocoo(), price.ravel().astype(np.float64)
    mean = 0.5 * (n[graph.row] + n[graph.col])
    return sparse.csr_matrix((graph.data * mean, (graph.row, graph.col)), shape=graph.shape)


def cuts_no_corner(path: np.ndarray, blocked: np.ndarray) -> bool:
    """Whether consecutive voxels are neighbours, and every voxel of every block that a step spans is free."""
    for a, b in itertools.pairwise(path.tolist()):
        if max(abs(p - q) for p, q in zip(a, b, strict=True)) != 1:
            return False
        if any(blocked[v] for v in itertools.product(*({p, q} for p, q in zip(a, b, strict=True)))):
            return False
    return not blocked[tuple(path[0])]


def entry_time(
    a: tuple[Fraction, ...], b: tuple[Fraction, ...], voxel: tuple[int, ...], grown: Fraction
) -> Fraction | None:
    """First t ∈ [0, 1] at which a + t (b − a) is in the closed cube [voxel − grown, voxel + 1 + grown]."""
    first, last = Fraction(0), Fraction(1)
    for p, q, v in zip(a, b, voxel, strict=True):
        lower, upper = v - grown, v + 1 + grown
        if p == q:
            if not lower <= p <= upper:
                return None
            continue
        s, t = sorted(((lower - p) / (q - p), (upper - p) / (q - p)))
        first, last = max(first, s), min(last, t)
    return first if first <= last else None


def touched(
    a: np.ndarray, b: np.ndarray, shape: tuple[int, ...], grown: float = 0.0
) -> dict[tuple[int, ...], Fraction]:
    """Voxels of the grid whose closed, `grown` cube meets the segment, with the exact time of entry.

    Coordinates are voxels, voxel i being [i, i + 1]; floats are taken at their exact values.
    """
    start, stop = (tuple(map(Fraction, p.tolist())) for p in (a, b))
    times = {v: entry_time(start, stop, v, Fraction(grown)) for v in itertools.product(*map(range, shape))}
    return {v: t for v, t in times.items() if t is not None}


def keeps(path: np.ndarray, blocked: np.ndarray, room: float) -> bool:
    """Whether open boxes path ± room meet free voxels only, at points along the edges (index coordinates)."""
    ends = [(a, b, int(40 * np.abs(b - a).max()) + 2) for a, b in itertools.pairwise(path.astype(float))]
    points = np.concatenate([np.linspace(a, b, count) for a, b, count in ends])
    low, high = np.floor(points + 0.5 - room).astype(int), np.ceil(points - 0.5 + room).astype(int)
    padded = np.pad(blocked, 2, constant_values=True)
    for corner in itertools.product((False, True), repeat=3):
        if padded[tuple(np.clip(np.where(corner, high, low) + 2, 0, np.array(padded.shape) - 1).T)].any():
            return False
    return True


def distances_to_cubes(points: np.ndarray, voxels: np.ndarray) -> np.ndarray:
    """From each point to the nearest cube of these voxels, all of them measured; whole numbers at voxel centres."""
    least = np.full(len(points), np.inf)
    for centre in np.argwhere(voxels):
        gap = np.maximum(np.abs(points - centre) - 0.5, 0)
        least = np.minimum(least, np.sqrt((gap**2).sum(axis=1)))
    return least


def inflated(obstacles: np.ndarray, ground: np.ndarray, radius: float) -> np.ndarray:
    """Voxels whose centres are nearer than the radius to the cube of an obstacle, or beside the ground: by dilation.

    Radius [voxels], above 0; of one map, or of several along a first axis.
    """
    faces = ndimage.generate_binary_structure(3, 1)
    lead = (None,) * (obstacles.ndim - 3)
    blocked = ndimage.binary_dilation(obstacles, ball(radius)[lead]) | ndimage.binary_dilation(ground, faces[lead])
    return np.asarray(blocked | obstacles | ground)


def to_world(u: np.ndarray, grid: Grid) -> np.ndarray:
    """Index coordinates, voxel i being [i, i + 1], in metres of the world frame."""
    return np.array(grid.origin) + grid.spacing * (np.asarray(u, float) - 0.5)


def conduction_matrix(sigma: np.ndarray, leak: float | np.ndarray, grounded: bool) -> sparse.csr_matrix:
    """The stored float64 matrix of steady conduction: graph Laplacian of the faces, leak, and grounded outer faces.

    Two half voxels in series conduct 1 / (1/2σ_i + 1/2σ_j), the half voxel at a grounded face 2σ; σ = 0 conducts
    nothing. Node i is voxel i of the ravelled grid, and so is entry i of a leak a voxel.
    """
    sigma = sigma.astype(np.float64)
    nodes = np.arange(sigma.size).reshape(sigma.shape)
    rows, columns, weights = [], [], []
    exposed = np.zeros(sigma.shape)
    for axis, n in enumerate(sigma.shape):
        lower, upper = (np.take(nodes, k, axis).ravel() for k in (range(n - 1), range(1, n)))
        a, b = sigma.ravel()[lower], sigma.ravel()[upper]
        open_faces = (a > 0) & (b > 0)
        lower, upper, a, b = (x[open_faces] for x in (lower, upper, a, b))
        rows.append(lower)
        columns.append(upper)
        weights.append(1 / (1 / (2 * a) + 1 / (2 * b)))
        for end in (0, n - 1):  # the same layer twice where the grid is one voxel thick: it has both faces
            face = [slice(None)] * 3
            face[axis] = slice(end, end + 1)
            exposed[tuple(face)] += 1
    row, column, weight = (np.concatenate(x) for x in (rows, columns, weights))
    half = sparse.coo_matrix((weight, (row, column)), shape=(sigma.size, sigma.size))
    links = (half + half.T).tocsr()
    loss = leak * sigma.ravel() + (2 * exposed * sigma).ravel() * grounded
    return (sparse.diags(np.asarray(links.sum(axis=1)).ravel() + loss) - links).tocsr()


def component_of(free: np.ndarray, seed: tuple[int, ...]) -> np.ndarray:
    """The face-connected component of free voxels that holds `seed`, by `scipy.ndimage.label`."""
    labels, _ = ndimage.label(free)
    return labels == labels[seed] if free[seed] else np.zeros(free.shape, bool)


def direct_potential(
    sigma: np.ndarray, goal: tuple[int, ...], leak: float | np.ndarray, grounded: bool = False
) -> np.ndarray:
    """φ by sparse elimination in float64: 1 on the goal, 0 wherever no current from the goal arrives.

    The matrix is an M-matrix and is eliminated along its diagonal, so only positive terms are added up and every
    entry is relatively accurate, however small.
    """
    matrix = conduction_matrix(sigma, leak, grounded)
    joined = component_of(sigma > 0, goal)
    source = int(np.ravel_multi_index(goal, sigma.shape))
    unknown = np.flatnonzero(joined.ravel())
    unknown = unknown[unknown != source]
    phi = np.zeros(sigma.size)
    phi[source] = 1
    if unknown.size:
        inner = matrix[unknown][:, unknown].tocsc()
        factors = splu(inner, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        phi[unknown] = factors.solve(-matrix[unknown][:, [source]].toarray().ravel())
    return phi.reshape(sigma.shape)


def random_blocks(rng: np.random.Generator, shape: tuple[int, int, int], count: int, largest: int) -> np.ndarray:
    """A map of `count` random boxes of at most `largest` voxels an edge; they may overlap."""
    blocked = np.zeros(shape, bool)
    for _ in range(count):
        corner, size = rng.integers(0, shape), rng.integers(1, largest + 1, 3)
        blocked[tuple(slice(c, c + s) for c, s in zip(corner, size, strict=True))] = True
    return blocked


def serpentine(nx: int, ny: int, nz: int) -> np.ndarray:
    """A corridor one voxel wide, of full height, that folds along y: about nx/2 (ny + 1) voxels from end to end."""
    blocked = np.zeros((nx, ny, nz), bool)
    for turn, x in enumerate(range(1, nx, 2)):
        blocked[x] = True
        blocked[x, -1 if turn % 2 == 0 else 0] = False
    return blocked


def random_free(rng: np.random.Generator, blocked: np.ndarray, count: int) -> np.ndarray:
    """(count, 3) distinct free voxels."""
    return rng.permutation(np.argwhere(~blocked))[:count]
