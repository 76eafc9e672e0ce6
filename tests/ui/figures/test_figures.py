"""Figures show what they say: heights, sections and lengths are recomputed by brute force."""

from __future__ import annotations

import builtins
import errno
import itertools
import os
from pathlib import Path

import numpy as np
import pytest

from maxjax import VoxelMap
from maxjax.core.grid import Grid
from maxjax.io import ground_mask, read_map, solidify
from maxjax.ui.figures.figures import Nearness, Overlay, figure_map, figure_plan
from maxjax.ui.figures.style import save_figure

matplotlib = pytest.importorskip("matplotlib")
from matplotlib import pyplot  # noqa: E402
from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: E402

GRID = Grid((30, 24, 16), 2.0, (-29.0, -23.0, -3.0))
START, GOAL = np.array([-20.0, 1.0, 5.0]), np.array([20.0, 1.0, 9.0])


def town() -> tuple[np.ndarray, np.ndarray]:
    """Blocks on flat ground, one of them on stilts."""
    rng = np.random.default_rng(3)
    ground = np.zeros(GRID.shape, bool)
    ground[:, :, :2] = True
    occupied = ground.copy()
    for x, y, height in zip(rng.integers(0, 26, 9), rng.integers(0, 20, 9), rng.integers(3, 14, 9), strict=True):
        occupied[x : x + 4, y : y + 3, :height] = True
    occupied[3:6, 2:6, 2:5] = False
    occupied[3:6, 2:6, 5:7] = True
    return occupied, ground


def paths() -> dict[str, np.ndarray]:
    bent = np.stack([START, [0.0, 9.0, 7.0], GOAL])
    return {"straight": np.stack([START, GOAL]), "bent": bent}


def figure(**changes: object) -> matplotlib.figure.Figure:
    occupied, ground = town()
    given = {"occupied": occupied, "ground": ground, "grid": GRID, "paths": paths(), "start": START, "goal": GOAL}
    given |= changes
    where = VoxelMap.on(*(given.pop(name) for name in ("grid", "occupied", "ground")))
    drawn, start, goal = (given.pop(name) for name in ("paths", "start", "goal"))
    return figure_plan(where, drawn, start, goal, Overlay(**given))


def texts(drawn: matplotlib.figure.Figure) -> list[str]:
    return [text.get_text() for legend in drawn.legends for text in legend.get_texts()]


def test_plan_view_shows_the_top_of_the_obstacles_without_the_ground() -> None:
    occupied, ground = town()
    image = figure().axes[0].images[0]
    shown = np.ma.filled(image.get_array().astype(float), np.nan).T
    for x, y in itertools.product(range(GRID.shape[0]), range(GRID.shape[1])):
        levels = [z for z in range(GRID.shape[2]) if occupied[x, y, z] and not ground[x, y, z]]
        top = GRID.origin[2] + 2.0 * levels[-1] + 1.0 if levels else np.nan
        np.testing.assert_equal(shown[x, y], top)
    assert image.get_extent() == [-30.0, 30.0, -24.0, 24.0]


def test_section_holds_the_voxels_of_the_paths_own_columns() -> None:
    occupied, ground = town()
    shown = figure().axes[2].images[0].get_array().T
    for row, x in zip(shown, np.linspace(-20, 20, len(shown)), strict=True):
        column = int(np.floor((x + 30) / 2)), 12
        expected = np.where(ground[column], 3, np.where(occupied[column], 2, 0))
        beside = (occupied & ~ground)[column[0], 8:17].any(axis=0)  # 8 m to each side
        np.testing.assert_array_equal(row, np.where((expected == 0) & beside, 1, expected))


def test_legend_states_lengths_in_metres_and_axes_are_in_metres() -> None:
    drawn = figure(log_potential=np.random.default_rng(0).normal(size=GRID.shape).astype(np.float32), title="Town")
    labels = texts(drawn)
    assert f"straight, {np.sqrt(40**2 + 4**2):.1f} m" in labels
    assert f"bent, {2 * np.sqrt(20**2 + 8**2 + 2**2):.1f} m" in labels
    assert {"start", "goal", "ground", "log-potential at z = 7 m"} < set(labels)
    plan, _, section = drawn.axes
    for label in (plan.get_xlabel(), plan.get_ylabel(), section.get_xlabel(), section.get_ylabel()):
        assert label.endswith("[m]")
    assert plan.get_aspect() == 1.0


def test_the_main_path_is_coloured_by_clearance_and_its_least_place_named() -> None:
    points = np.linspace(*np.array([[4.0, 4.0, 6.0], [30.0, 20.0, 6.0]]), 40)
    distance = np.abs(np.linspace(-5.0, 6.0, 40)) + 1.5
    near = Nearness(points, distance, tuple(points[distance.argmin()].tolist()))
    drawn = figure(nearness=near)
    assert any(axes.get_ylabel() == "Clearance [m]" for axes in drawn.axes)
    place = ", ".join(f"{x:.0f}" for x in points[distance.argmin()])
    assert any(text == f"least clearance, {distance.min():.1f} m at ({place})" for text in texts(drawn))
    assert not any("least" in text for text in texts(figure(nearness=Nearness(points, distance, None))))


def test_plan_view_is_cropped_to_the_paths() -> None:
    wide = Grid((200, 200, 16), 2.0, (-199.0, -199.0, -3.0))
    empty = np.zeros(wide.shape, bool)
    plan = figure(occupied=empty, ground=empty, grid=wide).axes[0]
    (x0, x1), (y0, y1) = plan.get_xlim(), plan.get_ylim()
    assert -40 < x0 < -20
    assert 20 < x1 < 40
    assert -30 < y0 < 1
    assert 9 < y1 < 30


def test_outline_is_that_of_the_obstacles_at_the_flights_altitude() -> None:
    occupied, ground = town()
    (outline,) = (c for c in figure().axes[0].collections if c.get_label().startswith("obstacle at"))
    part = np.pad((occupied & ~ground)[:, :, 5], 1)  # 7 m is the middle of the straight path
    faces = sum(int((part != np.roll(part, 1, axis)).sum()) for axis in (0, 1))
    assert len(outline.get_segments()) == faces


def test_lines_of_the_potential_are_whole() -> None:
    """Each closes, or ends in a wall that is drawn over it or where the map ends; NaN beside a wall breaks none."""
    occupied, _ = town()
    blocked = occupied.copy()
    for axis, step in itertools.product((0, 1), (-1, 1)):
        moved = np.roll(occupied, step, axis)
        blocked[1:-1, 1:-1] |= moved[1:-1, 1:-1]
    index = np.moveaxis(np.indices(GRID.shape), 0, -1)
    field = np.where(blocked, -np.inf, -np.linalg.norm(index - (24, 12, 5), axis=-1)).astype(np.float32)
    plan = figure(log_potential=field).axes[0]
    (lines,) = (part for part in plan.collections if isinstance(part, matplotlib.contour.QuadContourSet))
    ends = 0
    for line in (part for path in lines.get_paths() for part in path.to_polygons(closed_only=False)):
        if np.array_equal(line[0], line[-1]):
            continue
        for point in line[[0, -1]]:
            index = np.rint((point - np.array(GRID.origin[:2])) / GRID.spacing - 1e-3).astype(int)
            around = occupied[max(index[0] - 1, 0) : index[0] + 2, max(index[1] - 1, 0) : index[1] + 2, 5]
            border = (index <= 0) | (index >= np.array(GRID.shape[:2]) - 1)
            assert around.any() or border.any()
            ends += 1
    assert ends > 10
    # Over them: heights of what stands there, once more.
    over = np.ma.filled(plan.images[1].get_array().astype(float), np.nan).T
    tops = np.ma.filled(plan.images[0].get_array().astype(float), np.nan).T
    np.testing.assert_array_equal(over, np.where(occupied[:, :, 5], tops, np.nan))
    assert plan.images[1].get_zorder() > lines.get_zorder()


def test_what_lies_outside_the_data_is_drawn_as_unknown() -> None:
    within = np.ones(GRID.shape[:2], bool)
    within[18:] = False
    drawn = figure(within=within)
    assert texts(drawn).count("outside the data, unknown") == 2  # from above, and in section
    plan, _, side = drawn.axes
    (hatched,) = (part for part in plan.collections if isinstance(part, matplotlib.contour.QuadContourSet))
    (area,) = hatched.get_paths()
    for x, y in itertools.product(range(GRID.shape[0]), range(GRID.shape[1])):
        centre = np.array(GRID.origin[:2]) + GRID.spacing * np.array([x, y])
        assert area.contains_point(centre) == (not within[x, y])
    kinds = side.images[0].get_array().T
    for row, x in zip(kinds, np.linspace(-20, 20, len(kinds)), strict=True):
        column = int(np.floor((x + 30) / 2)), 12
        assert (row == 5).any() == (not within[column])
        assert not (row == 0).any() or within[column]
    assert "outside the data, unknown" not in texts(figure())


@pytest.mark.parametrize("count", [1, 2, 6, 8])
def test_no_label_overlaps_another_and_nothing_leaves_the_page(count: int) -> None:
    line = np.stack([START, GOAL])
    names = ["maxjax (solver)", "A*", "RRT*", "APF", "maxjax (network)", "straight", "b", "c"]
    drawn = figure(
        paths=dict.fromkeys(names[:count], line),
        log_potential=-np.linalg.norm(np.moveaxis(np.indices(GRID.shape), 0, -1), axis=-1),
        points=np.random.default_rng(1).uniform(-20, 20, (500, 3)),
        title="Town",
    )
    renderer = FigureCanvasAgg(drawn).get_renderer()
    boxes = [axes.get_tightbbox(renderer) for axes in drawn.axes] + [
        artist.get_window_extent(renderer) for artist in [*drawn.legends, drawn.texts[0]]
    ]
    for first, second in itertools.combinations(boxes, 2):
        assert not first.padded(-1).overlaps(second.padded(-1))
    for box in boxes:
        assert 0 <= box.x0 < box.x1 <= drawn.bbox.x1
        assert 0 <= box.y0 < box.y1 <= drawn.bbox.y1


@pytest.mark.parametrize("case", ["vertical", "short", "no obstacles", "no field", "on the border"])
def test_unusual_paths_and_maps_are_drawn(tmp_path: Path, case: str) -> None:
    empty = np.zeros(GRID.shape, bool)
    changes = {
        "vertical": {"paths": {"up": np.array([[0.0, 0.0, 3.0], [0.0, 0.0, 20.0]])}},
        "short": {"paths": {"hop": np.array([[0.0, 0.0, 3.0], [0.1, 0.0, 3.0]])}},
        "no obstacles": {"occupied": empty, "ground": empty},
        "no field": {"log_potential": np.full(GRID.shape, -np.inf, np.float32)},
        "on the border": {"paths": {"edge": np.array([[-30.0, -24.0, -4.0], [30.0, 24.0, 28.0]])}},
    }[case]
    path = next(iter(changes.get("paths", paths()).values()))
    save_figure(figure(start=path[0], goal=path[-1], **changes), tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size > 10_000


@pytest.mark.parametrize(("suffix", "magic"), [("png", b"\x89PNG"), ("pdf", b"%PDF"), ("svg", b"<?xml")])
def test_saved_files_are_whole_and_repeatable(tmp_path: Path, suffix: str, magic: bytes) -> None:
    save_figure(figure(), tmp_path / f"a.{suffix}")
    save_figure(figure(), tmp_path / f"b.{suffix.upper()}")
    content = (tmp_path / f"a.{suffix}").read_bytes()
    assert content.startswith(magic)
    assert content == (tmp_path / f"b.{suffix.upper()}").read_bytes()


def test_failed_saves_leave_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("a.jpg", "a"):
        with pytest.raises(ValueError, match=r"\.pdf, \.png, \.svg, given"):
            save_figure(figure(), tmp_path / name)

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        save_figure(figure(), tmp_path / "a.png")
    assert not os.listdir(tmp_path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"occupied": np.zeros((30, 24, 15), bool), "ground": np.zeros((30, 24, 15), bool)},
            "occupied: expected shape",
        ),
        ({"paths": {}}, "at least one path"),
        ({"paths": {"dot": np.zeros((1, 3))}}, r"paths\['dot'\]: expected finite \(t, 3\)"),
        ({"paths": {"lost": np.full((4, 3), np.nan)}}, r"paths\['lost'\]: expected finite"),
    ],
)
def test_wrong_inputs_are_refused_with_expected_and_given(changes: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        figure(**changes)


def test_a_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    importer = builtins.__import__

    def without(name: str, *args: object, **kwargs: object) -> object:
        if name.startswith("matplotlib"):
            raise ImportError(name)
        return importer(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ImportError, match=r"pip install 'maxjax\[viz\]'"):
        figure()


def test_pyplot_stays_untouched() -> None:
    before = dict(matplotlib.rcParams)
    figure()
    assert dict(matplotlib.rcParams) == before
    assert not pyplot.get_fignums()


def test_delft_and_warframe_at_full_size(data: Path, tmp_path: Path) -> None:
    pytest.importorskip("laspy")
    cloud = read_map(data / "ahn3_delft" / "ahn3_cropped_1.laz")
    grid = Grid.centered((4.0, 27.0, 60.0))
    ground = ground_mask(cloud, grid)
    over = np.array([[-40.0, -20.0, 8.0], [-10.0, 20.0, 20.0], [30.0, 60.0, 8.0]])
    drawn = figure_plan(VoxelMap.on(grid, solidify(cloud, grid) | ground, ground), {"over": over}, over[0], over[2])
    save_figure(drawn, tmp_path / "delft.png")
    assert drawn.axes[0].images[0].get_array().max() > 10
    voxels = read_map(data / "warframe" / "crop101_Complex.npz")
    with np.load(data / "warframe" / "crop101_Complex.npz") as archive:
        ends = np.stack([archive["start"][0], archive["goal"][0]]) + np.array(voxels.origin)
    drawn = figure_plan(VoxelMap.on(voxels.grid, voxels.occupied), {"line": ends}, *ends)
    save_figure(drawn, tmp_path / "warframe.png")
    assert "ground" not in texts(drawn)


@pytest.mark.parametrize("shape", [(300, 30, 4), (30, 300, 4), (500, 6, 4), (3, 3, 3)])
def test_a_map_of_any_shape_fills_its_page(shape: tuple[int, int, int]) -> None:
    """Little of the page above and beside the map is empty, and no two labels of an axis overlap."""
    obstacle = np.zeros(shape, bool)
    obstacle[1, 1, 1] = True
    drawn = figure_map(VoxelMap.on(Grid(shape, 2.0, (85000.0, 447000.0, 1.0)), obstacle), title="a map")
    canvas = FigureCanvasAgg(drawn)
    canvas.draw()
    plan = drawn.axes[0]
    place = plan.get_window_extent()
    assert drawn.bbox.height - place.y1 < 0.9 * drawn.dpi
    for axis, (low, high) in ((plan.xaxis, plan.get_xlim()), (plan.yaxis, plan.get_ylim())):
        seen = [tick for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
        assert seen
        boxes = [tick.label1.get_window_extent() for tick in seen]
        assert not any(a.overlaps(b) for a, b in itertools.combinations(boxes, 2))


def test_colours_tell_floors_under_a_ceiling() -> None:
    """What closes a column above its highest free voxel, as where nothing is known, hides nothing of it."""
    occupied, ground = np.zeros((2, 4, 3, 8), bool)
    ground[:, :, 0] = True
    occupied[:, :, 6:] = True
    occupied[1, :, :2] = True
    occupied[2] = True  # a tower that reaches the top of the map, from the ground on
    plan, bar = figure_map(VoxelMap.on(Grid((4, 3, 8), 2.0, (1.0, 1.0, 1.0)), occupied | ground, ground)).axes
    (image, *_) = plan.images
    heights = np.ma.filled(image.get_array().astype(float), np.nan)
    np.testing.assert_array_equal(heights, np.tile([np.nan, 4.0, 16.0, np.nan], (3, 1)))
    assert image.get_clim() == (4.0, 6.0)
    assert bar is image.colorbar.ax
    assert image.colorbar.extend == "max"


def test_a_path_cuts_no_roof_in_two() -> None:
    """Around its line a roof shows through."""
    halos = [line for line in figure().axes[0].lines if line.get_color() == "white" and line.get_linestyle() == "-"]
    assert halos
    assert all(line.get_alpha() is not None and line.get_alpha() < 0.7 for line in halos)
