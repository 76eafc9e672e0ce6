"""Windows hold every way of a cost; plans in windows are those of the whole map."""

import dataclasses
import itertools

import numpy as np
import pytest

import maxjax
from maxjax import VoxelMap
from maxjax.compile import native
from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.planning.path.route import Route
from maxjax.planning.plan import Plans
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.task import Task
from maxjax.planning.run import execution as execute
from maxjax.planning.run.execution import plan_task
from maxjax.planning.windows import focus_window as focus
from maxjax.planning.windows import growth
from maxjax.ui.methods import planner_named

SMALL = ((12, 8, 8), (18, 14, 12))
# One grid for most tests, so that they share programs.
GRID = Grid((34, 30, 20), 2.0, (3.0, -7.0, 1.0))
DISTANCES = Distances(1.0, 4.0)


@pytest.fixture
def small_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows of few voxels, so that small maps have some."""
    monkeypatch.setattr(focus, "SHAPES", SMALL)


def with_and_without(task: Task) -> tuple[Plans, Plans]:
    """Plans of a task in windows, and in whole maps."""
    find = planner_named("field")
    return plan_task(task, find), plan_task(task, dataclasses.replace(find, focus=False))  # type: ignore[type-var]


def check_same(task: Task) -> Plans:
    """Plans in windows, after a comparison with those in whole maps."""
    windowed, whole = with_and_without(task)
    for one, other in zip(windowed, whole, strict=True):
        assert one.status == other.status
        assert one.certified == other.certified
        if one.status == Status.OK:
            assert one.exemptions == pytest.approx(other.exemptions, abs=1e-4)
    ratios = [a.cost / b.cost for a, b in zip(windowed, whole, strict=True) if a.status == Status.OK]
    assert np.mean(ratios or [1]) <= 1.002
    return windowed


def task_of(occupied: np.ndarray, ends: np.ndarray) -> Task:
    """A task in index coordinates; maps may lead, as problems do."""
    where = VoxelMap.of(occupied, spacing=1.0, origin=(0.0, 0.0, 0.0))
    return Task.of(where, ends[..., 0, :].reshape(-1, 3), ends[..., 1, :].reshape(-1, 3), Distances(0.5, 4.0))


def window_of(occupied: np.ndarray, ends: np.ndarray, cost: float) -> tuple[np.ndarray, np.ndarray, float] | None:
    """Corner, size and bound of the window of one problem; None: it is the whole map."""
    window = focus.windows_around(task_of(occupied, ends), np.array([cost]))
    return None if np.isnan(window.bounds[0]) else (window.corners[0], window.sizes[0], float(window.bounds[0]))


def window_by_definition(
    occupied: np.ndarray, ends: np.ndarray, cost: float
) -> tuple[np.ndarray, np.ndarray, float] | None:
    """`window_of`, step by step."""
    limits = np.array(occupied.shape)
    whole = np.floor(np.where(np.isfinite(ends), ends, -1) + 0.5)
    if (whole < 0).any() or (whole >= limits).any() or (ends[0] == ends[1]).all():
        return None

    def solid(low: np.ndarray, high: np.ndarray) -> bool:
        return bool(occupied[tuple(slice(max(a, 0), b + 1) for a, b in zip(low, high, strict=True))].all())

    def floor(low: np.ndarray, high: np.ndarray) -> int:
        layers = range(low[2], high[2] + 1)
        return next((z for z in layers if not solid(np.array([*low[:2], z]), np.array([*high[:2], z]))), high[2])

    middle, chord = ends.mean(axis=0), ends[1] - ends[0]
    half = np.sqrt(max(cost**2 - float((chord**2).sum()), 0.0) / 4 + chord**2 / 4)
    low = np.clip(np.floor(middle - half).astype(int), 0, limits - 1)
    high = np.clip(np.ceil(middle + half).astype(int), 0, limits - 1)
    low[2] = floor(low, high)
    either_way = [np.array(size) for x, y, z in focus.SHAPES for size in ((x, y, z), (y, x, z))]
    fitting = [s for s in either_way if (high - low < s).all() and 2 * np.prod(s) < limits.prod()]
    if not fitting:
        return None
    size = fitting[0]
    last = np.maximum(limits - size, 0)
    corner = np.minimum(np.maximum((low + high + 1 - size) // 2, 0), last)
    corner[2] = min(floor(corner, np.append((corner + size)[:2] - 1, low[2])), last[2])
    bound = np.inf
    for axis, side in itertools.product(range(3), (0, 1)):
        first, outermost = corner.copy(), corner + size - 1
        face = (first, outermost)[side][axis]
        first[axis] = outermost[axis] = face + (-1, 1)[side]
        if 0 <= first[axis] < limits[axis] and not solid(first, outermost):
            mirrored = ends[0].copy()
            mirrored[axis] = 2 * face - mirrored[axis]
            bound = min(bound, float(np.linalg.norm(mirrored - ends[1])))
    return corner, size, bound


def rolling_map(rng: np.random.Generator, shape: tuple[int, int, int]) -> np.ndarray:
    """Flat or sloped ground under buildings, with a cave or two."""
    x, y, z = np.indices(shape)
    slope = rng.choice([0.0, 0.15], 2)
    occupied = z < rng.integers(0, shape[2] // 2) + slope[0] * x + slope[1] * y
    for _ in range(rng.integers(0, 12)):
        low = rng.integers(0, shape)
        high = low + rng.integers(1, 12, 3)
        occupied[tuple(map(slice, low, high))] = rng.random() < 0.8
    return occupied


@pytest.mark.parametrize("compiled", [True, False])
def test_windows_of_many_problems_are_those_of_the_definition(
    small_windows: None, monkeypatch: pytest.MonkeyPatch, compiled: bool, request: pytest.FixtureRequest
) -> None:
    """Each in a map of its own, or all in one, in any order in memory; ends anywhere, also outside and equal."""
    library = request.getfixturevalue("compiled_boxes") if compiled else None
    monkeypatch.setattr(native, "at_hand", lambda source: library)
    rng, whole = np.random.default_rng(11), 0
    for shape in ((40, 34, 24), (60, 9, 30), (24, 24, 24)):
        maps = np.pad([rolling_map(rng, shape) for _ in range(300)], 1)[1:-1, 1:-1, 1:-1, 1:-1]
        ends = rng.uniform(-0.5, np.array(shape) - 0.5, (300, 2, 3))
        ends[::2, 1] = ends[::2, 0] + rng.uniform(-5, 5, (150, 3))
        ends[::5] = np.round(2 * ends[::5]) / 2
        ends[::20, 1], ends[3::20, 0, 1], ends[7::20, 1, 2] = ends[::20, 0], np.nan, np.inf
        costs = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) * rng.uniform(1, 1.6, 300)
        for given in (maps, maps[3], np.asfortranarray(maps[4])):
            found = focus.windows_around(task_of(given, ends), costs)
            for k, one in enumerate(maps if given.ndim == 4 else [given] * 300):
                expected = window_by_definition(one, ends[k], costs[k])
                whole += expected is None
                assert (expected is None) == bool(np.isnan(found.bounds[k]))
                if expected is not None:
                    assert np.array_equal([found.corners[k], found.sizes[k]], expected[:2])
                    assert found.bounds[k] == pytest.approx(expected[2], rel=1e-15)
    assert 300 < whole < 2000


def test_a_window_holds_every_point_of_the_ellipsoid_of_its_cost() -> None:
    rng = np.random.default_rng(0)
    open_map = np.zeros((101, 101, 101), bool)
    for _ in range(50):
        ends = rng.uniform(0, 100, (2, 3))
        ends[1] = np.clip(ends[0] + rng.uniform(-25, 25, 3), 0, 100)
        cost = np.linalg.norm(ends[1] - ends[0]) * rng.uniform(1, 1.3)
        if (window := window_of(open_map, ends, cost)) is None:
            continue
        low, size, bound = window
        high = low + size - 1
        points = rng.uniform(-0.5, 100.5, (20000, 3))
        within = np.linalg.norm(points - ends[0], axis=1) + np.linalg.norm(points - ends[1], axis=1) <= cost
        rim = (points[within] < 0) | (points[within] > 100)
        assert (((points[within] >= low) & (points[within] <= high)) | rim).all()
        assert bound >= cost


def test_the_bound_is_the_least_cost_over_the_faces_that_a_way_may_cross() -> None:
    rng = np.random.default_rng(1)
    occupied = np.zeros((60, 60, 60), bool)
    occupied[:, :, :20] = True
    for _ in range(20):
        ends = rng.uniform((15, 15, 20), (45, 45, 35), (2, 3))
        window = window_of(occupied, ends, 1.2 * float(np.linalg.norm(ends[1] - ends[0])))
        assert window is not None
        low, size, bound = window
        high = low + size - 1
        assert low[2] >= 20
        least = np.inf
        for axis, face in itertools.product(range(3), (0, 1)):
            at = (low, high)[face][axis]
            if (face == 0 and at == (20 if axis == 2 else 0)) or (face == 1 and at == 59):
                continue
            # The nearest points are reflections: points of the whole plane, finely.
            others = [k for k in range(3) if k != axis]
            points = np.full((300 * 300, 3), float(at))
            points[:, others] = np.stack(np.meshgrid(*[np.linspace(-40, 100, 300)] * 2), axis=-1).reshape(-1, 2)
            sums = np.linalg.norm(points - ends[0], axis=1) + np.linalg.norm(points - ends[1], axis=1)
            least = min(least, float(sums.min()))
        assert bound <= least + 1e-9
        assert bound == pytest.approx(least, abs=0.05)


def test_windows_of_any_map_have_one_of_the_shapes_and_hold_both_ends() -> None:
    rng = np.random.default_rng(7)
    found = 0
    for _ in range(60):
        limits = rng.integers((20, 20, 5), (400, 300, 40))
        ends = rng.uniform(0, limits - 1, (2, 3))
        ends[1] = np.clip(ends[0] + rng.uniform(-30, 30, 3), 0, limits - 1)
        window = window_of(np.zeros(limits, bool), ends, 1.2 * float(np.linalg.norm(ends[1] - ends[0])))
        if window is None:
            continue
        found += 1
        corner, size, _ = window
        assert (max(size[:2]), min(size[:2]), size[2]) in focus.SHAPES
        assert (ends >= corner).all()
        assert (ends <= np.minimum(corner + size, limits) - 1).all()
        # Only what is smaller than the window lets it reach beyond.
        beyond = corner + size > limits
        assert (corner[beyond] == 0).all()
        assert (limits[beyond] < size[beyond]).all()
    assert found > 20


def test_a_window_longer_along_y_is_shown_as_that_of_the_map_with_x_and_y_exchanged() -> None:
    """Volumes, rims, ends and ways back: a row of turned and upright windows, and each by itself."""
    rng = np.random.default_rng(12)
    occupied = rolling_map(rng, (60, 60, 30))
    ends = np.array([[[20, 10, 25], [22, 40, 27]], [[10, 20, 25], [40, 22, 27]]], np.float64)
    task, mirror = task_of(occupied, ends), task_of(occupied.swapaxes(0, 1), ends[..., [1, 0, 2]])
    shown = []
    for one in (task, mirror):
        windows = focus.windows_around(one, np.full(2, 36.0))
        assert windows.shape == (windows.shapes[1].tolist()[0], *windows.shape[1:]), "one shape, whichever way they lie"
        shown.append(focus.View(one, windows))
    turned, upright = (view.windows.turned.tolist() for view in shown if view.windows is not None)
    assert (turned, upright) == ([True, False], [False, True])
    both, rows = shown, np.arange(2)
    for name, volume in both[0].own(rows).items():
        np.testing.assert_array_equal(volume, both[1].own(rows)[name])
        np.testing.assert_array_equal(volume[:1], both[0].own(rows[:1])[name])
    np.testing.assert_array_equal(both[0].rim(rows), both[1].rim(rows))
    np.testing.assert_array_equal(both[0].ends(rows), both[1].ends(rows))
    # A map that is narrower than the window.
    narrow = task_of(rolling_map(rng, (34, 90, 40)), np.array([[17, 20, 30], [17, 64, 31]], np.float64))
    window = focus.windows_around(narrow, np.array([47.0]))
    assert (window.turned[0], window.shape) == (True, (56, 40, 24))
    assert focus.View(narrow, window).rim(rows[:1])[0].tolist() == [56, 34, 24]
    nothing = np.zeros(2, bool), np.zeros((2, 2), np.float32), np.zeros(2, bool), np.zeros(2, np.float32)
    route = Route(both[0].ends(rows), np.zeros(2, np.int32), *nothing)
    np.testing.assert_allclose(both[0].in_map(route).path, task.index, atol=1e-5)
    np.testing.assert_allclose(both[1].in_map(route).path, mirror.index, atol=1e-5)


def test_no_window_for_ends_that_are_not_inside_the_map() -> None:
    occupied = np.zeros((101, 101, 101), bool)
    inside = np.array([50.0, 50.0, 50.0])
    for other in ([-0.6, 50, 50], [50, 100.6, 50], [np.nan, 50, 50], inside):
        assert window_of(occupied, np.array([inside, other]), 50.0) is None
        assert window_of(occupied, np.array([other, inside]), 50.0) is None


def random_case(rng: np.random.Generator, shape: tuple[int, int, int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A map with walls, doors, noise and a ground, and two ends, many of them on faces, at the rim or in obstacles."""
    occupied = rng.random(shape) < rng.choice([0.0, 0.02, 0.1, 0.35])
    for _ in range(rng.integers(0, 3)):
        axis = int(rng.integers(0, 2))
        at = int(rng.integers(0, shape[axis]))
        wall: list[slice | int] = [slice(None)] * 3
        wall[axis] = at
        occupied[tuple(wall)] = True
        door = [int(rng.integers(0, n)) for n in shape]
        door[axis] = at
        if rng.random() < 0.7:
            occupied[tuple(door)] = False
    ground = np.zeros(shape, bool)
    if rng.random() < 0.5:
        ground[:, :, : rng.integers(1, max(2, shape[2] // 3))] = True
    occupied |= ground
    free = np.argwhere(~occupied)
    ends = np.empty((2, 3))
    for k in range(2):
        if len(free) and rng.random() < 0.9:
            ends[k] = free[rng.integers(0, len(free))]
        else:
            ends[k] = rng.uniform(-1, np.array(shape))
    if rng.random() < 0.7:  # near each other, so that a window is small
        near = free[np.abs(free - ends[0]).max(axis=1) < 8] if len(free) else free
        if len(near):
            ends[1] = near[rng.integers(0, len(near))]
    return occupied, ground, ends + rng.choice([0.0, 0.5, -0.5, 0.3], (2, 3)) * (rng.random((2, 3)) < 0.3)


@pytest.mark.large
@pytest.mark.parametrize(("shape", "cases"), [
    pytest.param(GRID.shape, 80, marks=pytest.mark.nightly), ((3, 60, 40), 30),
    pytest.param((40, 36, 7), 30, marks=pytest.mark.nightly),
])  # fmt: skip
def test_statuses_and_costs_are_those_of_the_whole_map(
    small_windows: None, shape: tuple[int, int, int], cases: int
) -> None:
    rng = np.random.default_rng(sum(shape))
    grid = dataclasses.replace(GRID, shape=shape)
    maps = [random_case(rng, shape) for _ in range(cases)]
    world = np.array([np.array(grid.origin) + 2.0 * ends for _, _, ends in maps])
    volumes = (np.stack([m[k] for m in maps]) for k in (0, 1))
    occupied, ground = volumes
    plans = check_same(Task.of(VoxelMap.on(grid, occupied, ground), world[:, 0], world[:, 1], Distances(1.5, 4.0)))
    assert {Status.OK, Status.NO_VALID_PATH} <= {plan.status for plan in plans}


@pytest.mark.large
def test_a_way_along_the_rim_of_a_flat_map_stays_inside_it(small_windows: None) -> None:
    grid = dataclasses.replace(GRID, shape=(40, 36, 7))
    occupied = np.zeros(grid.shape, bool)
    occupied[19:22, :, :6] = True  # only the highest layer leads over the wall
    ends = np.array(grid.origin) + grid.spacing * np.array([[16.0, 18.0, 5.0], [25.0, 18.0, 5.0]])
    (plan,) = check_same(Task.of(VoxelMap.on(grid, occupied), ends[:1], ends[1:], DISTANCES))
    assert plan.status == Status.OK
    assert plan.path[:, 2].max() <= grid.upper[2]


def corridor(outer: bool) -> np.ndarray:
    """Two cells whose only way from one to the other leads far around, or nowhere."""
    occupied = np.ones(GRID.shape, bool)
    occupied[15:20, 14, 2:4] = False
    occupied[15:20, 16, 2:4] = False
    if outer:
        occupied[2:16, 14, 2:4] = False
        occupied[2, 14:28, 2:4] = False
        occupied[2:32, 27, 2:4] = False
        occupied[31, 16:28, 2:4] = False
        occupied[19:32, 16, 2:4] = False
    return occupied


@pytest.mark.large
@pytest.mark.parametrize("outer", [True, False])
def test_a_way_that_leaves_the_window_and_comes_back_is_found(small_windows: None, outer: bool) -> None:
    ends = np.array(GRID.origin) + GRID.spacing * np.array([[17.0, 14.0, 2.5], [17.0, 16.0, 2.5]])
    (plan,) = check_same(Task.of(VoxelMap.on(GRID, corridor(outer)), ends[:1], ends[1:], DISTANCES))
    assert plan.status == (Status.OK if outer else Status.NO_VALID_PATH)
    if outer:
        # From the window in the middle to all four sides of the map.
        assert plan.length > 2 * (12 + 13 + 28 + 11 + 11)


@pytest.mark.large
def test_a_batch_in_chunks_of_windows_is_what_single_plans_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(focus, "SHAPES", SMALL[1:])
    rng = np.random.default_rng(5)
    occupied = np.zeros((6, *GRID.shape), bool)
    occupied[:, 16:18, 13:17, :16] = True
    starts = np.array(GRID.origin) + 2.0 * rng.uniform((12, 12, 8), (14, 16, 12), (6, 3))
    goals = np.array(GRID.origin) + 2.0 * rng.uniform((20, 12, 8), (22, 16, 12), (6, 3))
    task = Task.of(VoxelMap.on(GRID, occupied), starts, goals, DISTANCES)
    find = planner_named("field")
    in_chunks, alone = plan_task(task, find, chunk=4), plan_task(task, find)
    for one, other in zip(in_chunks, alone, strict=True):
        assert one.status == other.status == Status.OK
        assert one.length == pytest.approx(other.length, rel=1e-3)


def test_the_public_argument_chooses_the_whole_map(small_windows: None, monkeypatch: pytest.MonkeyPatch) -> None:
    planned: list[bool] = []
    real = growth.find_in_windows
    monkeypatch.setattr(execute, "find_in_windows", lambda *given: planned.append(True) or real(*given))
    occupied = np.zeros(GRID.shape, bool)
    occupied[16:18, 12:16, :18] = True
    ends = np.array(GRID.origin) + GRID.spacing * np.array([[13.0, 13.5, 9.0], [21.0, 13.5, 9.0]])
    where = VoxelMap.on(GRID, occupied)
    whole = maxjax.plan(where, *ends, planner=maxjax.Field(focus=False), distances=DISTANCES)
    assert not planned
    windowed = maxjax.plan(where, *ends, planner=maxjax.Field(focus=True), distances=DISTANCES)
    assert planned
    assert windowed.status == whole.status == Status.OK
    assert windowed.cost == pytest.approx(whole.cost, rel=2e-3)
