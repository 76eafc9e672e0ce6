"""Inspections by a round through viewpoints against covering by a field: what is seen, and after how long.

    MAXJAX_DATA=../shared/data python -m experiments.covering       # two cores: 10 minutes

Buildings drawn at random of five cities (two simulated, the sample, The Hague and Venice; those whose data is absent
are left out) are to be photographed at 8 m with half of the next photo twice. The same candidates, sights and costs of
legs, in seconds from rest to rest around what stands between, serve three ways to order photos:

    round      few viewpoints that show all (`inspection.set_cover`), in a short round (`inspection.tour`)
    field      all candidates; the climber of `inspection.field_cover` takes what it comes by
    field, of the round's    the same climber, of the round's viewpoints alone

Shares are of the area that can be seen, seen once or as often as wanted, after a quarter, half, three quarters and all
of the time that the round takes. Expected: the round is the shortest; the field sees more at first, since it flies to
what shows most, and then pays for what it left.
"""

from __future__ import annotations

import dataclasses
import itertools
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Float64, Int64
from scipy import sparse

import maxjax
from benchmarks.common.command import configured
from benchmarks.common.harness import Row, keep, save
from benchmarks.common.markdown import Document, device, table
from maxjax.core.grid import Point3
from maxjax.inspection.candidates import Aim
from maxjax.inspection.capture import Capture
from maxjax.inspection.field_cover import FieldCover, Photos, cover_by_field
from maxjax.inspection.free_space import FreeSpace
from maxjax.inspection.leg_costs import TimeCost, costs_between
from maxjax.inspection.photo_camera import Camera
from maxjax.inspection.scenery import Scenery
from maxjax.inspection.target_surface import Surface, city_faces, surface_of
from maxjax.inspection.tour import shortest_round
from maxjax.inspection.viewpoints import find_viewpoints
from maxjax.inspection.views import Views
from maxjax.inspection.visibility import find_sights
from maxjax.sim.worlds.geoms import Geoms
from maxjax.sim.worlds.scenes import make_scene, occupancy

RESULTS = Path(__file__).parent / "results"
_SAMPLE = Path(__file__).parents[1] / "docs" / "samples" / "quarter.geojson"
_FILES = {"sample": str(_SAMPLE), "The Hague": "the_hague/DenHaag_01.city.json", "Venice": "la_venice"}
_QUARTERS = (0.25, 0.5, 0.75, 1.0)


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        cities: of `downtown`, `suburb`, `sample`, `The Hague` and `Venice`.
        targets: buildings of each.
        distance: of photos from the surface [m].
        radius: to keep [m].
        length: ℓ of the field [voxels].
        share: from which on a photo is a source.
        camera: by its name.
        half: half extent of what is flown in around a building [m].
        step: extents of maps of files are multiples of it, so that few shapes are compiled [m].
        seed: of the buildings, and of simulated cities.
        data: folder of public cities.
        name: of the result file.
        out: where the JSON goes.
    """

    cities: tuple[str, ...] = ("downtown", "suburb", "sample", "The Hague", "Venice")
    targets: int = 4
    distance: float = 8.0
    radius: float = 1.5
    length: float = 3.0
    share: float = 0.5
    camera: str = "DJI M3E"
    half: float = 60.0
    step: float = 2.0
    seed: int = 0
    data: Path = Path(os.environ.get("MAXJAX_DATA", "../shared/data"))
    name: str = "covering"
    out: Path = RESULTS


TINY = Config(cities=("sample",), targets=1)

SYSTEMS = {"The Hague": "EPSG:7415"}  # of files that do not name theirs


def maps(name: str, config: Config) -> Iterator[tuple[maxjax.VoxelMap, str | tuple[Point3, Point3]]]:
    """Maps around random buildings, and the buildings."""
    rng = np.random.default_rng([config.seed, len(name)])
    if name in ("downtown", "suburb"):
        grid = maxjax.Grid.centered((0.0, 0.0, 40.0), (61, 61, 51), 2.0)
        scenes = (make_scene(name, config.seed + k).geoms for k in itertools.count())
        drawn = ((geoms, block) for geoms in scenes if (block := _block(geoms, rng)) is not None)
        for geoms, block in itertools.islice(drawn, config.targets):
            yield maxjax.VoxelMap.on(grid, *map(np.asarray, occupancy(geoms, grid))), block
        return
    reading = maxjax.Reading(crs=SYSTEMS.get(name))
    for path in city_files(name, config.data):
        whole = maxjax.load_map(path, spacing=4.0, reading=reading)
        faces = city_faces(whole)
        height = np.array([np.ptp(faces.triangles[faces.part == p, :, 2]) for p in range(len(faces.names))])
        names = [faces.buildings[p] for p in rng.permutation(np.flatnonzero(height > 5.0))]
        for building in list(dict.fromkeys(names))[: config.targets]:
            own = np.isin(faces.part, [p for p, one in enumerate(faces.buildings) if one == building])
            corners = faces.triangles[own].reshape(-1, 3)
            low, high = corners.min(axis=0) - config.half / 3, corners.max(axis=0) + config.half / 3
            low[2] = corners[:, 2].min() - 4.0
            high = low + config.step * np.ceil((high - low) / config.step)
            bounds = (*low.tolist(), *high.tolist())
            yield maxjax.load_map(path, spacing=2.0, bounds=bounds, reading=reading), building


def city_files(name: str, data: Path) -> list[Path]:
    """The file of a city that is read from one; none where its data is absent."""
    file = Path(_FILES[name]) if name == "sample" else data / _FILES[name]
    return sorted(file.glob("*.osm"))[:1] if file.is_dir() else [file] if file.exists() else []


def _block(geoms: Geoms, rng: np.random.Generator) -> tuple[Point3, Point3] | None:
    """A box around a random solid near the middle of a simulated city; None without one."""
    middle, size = np.asarray(geoms.position), np.asarray(geoms.size)
    near = np.flatnonzero((np.abs(middle[:, :2]).max(axis=1) < 35.0) & (size[:, 2] > 3.0) & (size[:, 0] < 30.0))
    if not len(near):
        return None
    k = int(rng.choice(near))
    (a, b, c), (d, e, f) = (middle[k] - size[k] - 1.0).tolist(), (middle[k] + size[k] + 1.0).tolist()
    return (a, b, c), (d, e, f)


@dataclasses.dataclass(frozen=True, eq=False)
class CoverTask:
    """A surface, photos that show it, and where the vehicle begins."""

    surface: Surface
    views: Views
    shows: sparse.csr_array
    wanted: int
    start: Point3
    free: FreeSpace

    @property
    def costs(self) -> Float64[np.ndarray, "n n"]:
        """Of legs between the start and all photos [s]."""
        return costs_between(np.vstack([[self.start], self.views.position]), self.free, TimeCost())

    def of(self, photos: Int64[np.ndarray, " p"]) -> CoverTask:
        """With some of the photos."""
        return dataclasses.replace(self, views=self.views.some(photos), shows=self.shows[photos])

    def shares(self, order: Int64[np.ndarray, " p"], until: float) -> tuple[list[list[float]], float]:
        """Shares seen once and as often as wanted after parts of a time, and how long all photos in order take [s]."""
        some = self.of(order)
        costs = some.costs
        nodes = np.arange(len(costs))
        times = np.cumsum(costs[nodes[:-1], nodes[1:]])
        back = float(times[-1] + costs[nodes[-1], 0])
        count, need = (
            np.zeros(len(self.surface), int),
            np.minimum(np.asarray(self.shows.sum(axis=0)).ravel(), self.wanted),
        )
        seen = np.zeros((len(order) + 1, 2))
        for k in range(len(order)):
            count[some.shows.indices[some.shows.indptr[k] : some.shows.indptr[k + 1]]] += 1
            seen[k + 1] = [
                self.surface.areas[(count >= least) & (need > 0)].sum() for least in (1, np.maximum(need, 1))
            ]
        seen /= self.surface.areas[need > 0].sum()
        at = np.searchsorted(times, [part * until for part in _QUARTERS], side="right")
        return np.round(seen[at], 4).tolist(), back


def compare(where: maxjax.VoxelMap, target: str | tuple[Point3, Point3], config: Config) -> list[Row]:
    """A row for each way to order photos of a target."""
    camera, capture = Camera.named(config.camera), Capture(distance=config.distance, overlap=(0.5, 0.0))
    faces = city_faces(where)
    scenery = Scenery.of(where, faces, by_voxels=False)
    surface, free = surface_of(where, faces, scenery, target, 1.0), FreeSpace.of(where, config.radius)
    aim = Aim(surface, free, camera, capture)
    limits, chosen = capture.limits(camera), find_viewpoints(aim, scenery).views
    views = chosen.joined(aim.first_views())
    lowest = np.argwhere(free.free)[0]
    start = free.grid.to_metres(lowest.astype(float))
    shows = find_sights(views, surface, scenery, camera, limits).matrix
    task = CoverTask(surface, views, shows, capture.views, tuple(start.tolist()), free)
    few = task.of(np.arange(len(chosen)))
    order = shortest_round(few.costs)[1:] - 1
    _, whole = few.shares(order, 1.0)
    field, own = (
        cover_by_field(
            Photos(one.views.position, one.shows, surface.areas, one.wanted),
            free,
            task.start,
            FieldCover(config.length, config.share),
        ).photos
        for one in (task, few)
    )
    rows = list[Row]()
    for name, one, taken in (("round", few, order), ("field", task, field), ("field, of the round's", few, own)):
        shares, took = one.shares(taken, whole)
        rows.append(
            {
                "way": name,
                "photos": len(taken),
                "seconds": round(took, 1),
                "area_m2": round(surface.area, 1),
                **{f"once_{100 * q:.0f}": share[0] for q, share in zip(_QUARTERS, shares, strict=True)},
                **{f"wanted_{100 * q:.0f}": share[1] for q, share in zip(_QUARTERS, shares, strict=True)},
            }
        )
    return rows


def main(config: Config) -> list[Row]:
    """Compare, save, and return the rows."""
    rows = list[Row]()
    for city in config.cities:
        for number, (where, target) in enumerate(maps(city, config)):
            for row in compare(where, target, config):
                rows.append({"city": city, "target": number, "building": str(target)[:60], **row})
                print(rows[-1], file=sys.stderr, flush=True)
            keep(config.name, config, rows, config.out)
    save(config.name, config, rows, config.out)
    return rows


def section(document: Document) -> str:
    """Its part of RESULTS.md."""
    rows = document["rows"]
    heads = ["order of photos", "photos", "time over the round's", *(f"{100 * q:.0f} %" for q in _QUARTERS)]
    lines = []
    rounds = {(row["city"], row["target"]): row for row in rows if row["way"] == "round"}
    for way in dict.fromkeys(row["way"] for row in rows):
        own = [row for row in rows if row["way"] == way]
        ratio = np.mean([row["seconds"] / rounds[row["city"], row["target"]]["seconds"] for row in own])
        shares = [
            " / ".join(
                f"{100 * np.mean([row[f'{seen}_{100 * q:.0f}'] for row in own]):.0f}" for seen in ("once", "wanted")
            )
            for q in _QUARTERS
        ]
        lines.append([way, f"{np.mean([row['photos'] for row in own]):.0f}", f"{ratio:.2f}", *shares])
    cities = list(dict.fromkeys(row["city"] for row in rows))
    text = (
        f"{len(rounds)} buildings of {', '.join(cities)}, photographed at {document['config']['distance']:g} m with "
        "half of the next photo twice;\nmeans over the buildings. Shares of the area that can be seen, seen once / as "
        "often as wanted [%], after parts of the\ntime that the round takes "
        f"({device(document)}). The round is the default; a field sees more at first, and takes longer for all."
    )
    return f"### Inspections: a round through viewpoints, or a field\n\n{text}\n\n{table(heads, lines)}"


if __name__ == "__main__":
    main(configured(TINY))
