"""Problems planned in slices and judged beside; a row for each kind and radius, and the section of RESULTS.md."""

from __future__ import annotations

import dataclasses
import json
import multiprocessing
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from scipy.stats import binomtest

import maxjax
from benchmarks.common.harness import Row, save
from benchmarks.common.markdown import Document, device, table
from experiments.hard_maps.images import DEARER, SPACING, WORST, compared, planned
from experiments.hard_maps.judge import Answer, Verdict, judge
from experiments.hard_maps.maps import CELLS, SIZE, Problems, drawn
from maxjax.core.files import atomic_write

RESULTS = Path(__file__).parents[1] / "results"
_KEPT = 20  # failures that a row names

Judges = Callable[[Callable[[Answer], Verdict], Sequence[Answer]], list[Verdict]]


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        problems: in all, an equal part of each kind and radius.
        slice: problems of a batch.
        images: every so many slices is planned in a mirror and moved, too.
        seed: of everything.
        workers: processes that judge; 0: this one.
        keep: folder for the counts of each slice; a run that was killed goes on.
        out: where the JSON goes.
    """

    problems: int = 2000
    slice: int = 100
    images: int = 2
    seed: int = 0
    workers: int = 2
    keep: Path | None = None
    out: Path = RESULTS


TINY = Config(problems=40, slice=4, images=1, workers=0)


def main(config: Config) -> list[Row]:
    """Plan, judge, save; one row a kind and radius."""
    each = -(-config.problems // len(CELLS))
    counts = {cell: Counter[str]() for cell in CELLS}
    failed: dict[tuple[str, float], list[int]] = {cell: [] for cell in CELLS}

    def plan_all(judges: Judges) -> None:
        for first in range(0, each, config.slice):
            for cell in CELLS:
                numbers = range(first, min(first + config.slice, each))
                found = _kept(config, cell, numbers, judges)
                failed[cell] += found.pop("failures")
                counts[cell].update({name: count for name, count in found.items() if not name.startswith("worst")})
                for name in WORST:
                    counts[cell][name] = max(counts[cell][name], found.get(name, 0))
            print(f"{first + len(numbers)} of {each} a row", file=sys.stderr, flush=True)

    if config.workers:
        with multiprocessing.get_context("spawn").Pool(config.workers) as pool:
            plan_all(lambda function, answers: pool.map(function, answers, chunksize=8))
    else:
        plan_all(lambda function, answers: list(map(function, answers)))
    rows: list[Row] = [
        {"kind": kind, "radius_m": SPACING * radius, **counts[kind, radius], "failures": _named(failed[kind, radius])}
        for kind, radius in CELLS
    ]
    save("hard_maps", config, rows, config.out)
    return rows


def _named(numbers: Sequence[int]) -> str:
    return ", ".join(map(str, numbers[:_KEPT]))


def _kept(config: Config, cell: tuple[str, float], numbers: range, judges: Judges) -> dict[str, Any]:
    """Counts of one batch, from its file where there is one."""
    if config.keep is None:
        return _slice(config, cell, numbers, judges)
    file = config.keep / f"{cell[0]}-{cell[1]}-{numbers.start:07}-{numbers.stop:07}.json"
    if file.is_file():
        return dict(json.loads(file.read_text(encoding="utf-8")))
    found = _slice(config, cell, numbers, judges)
    file.parent.mkdir(parents=True, exist_ok=True)
    atomic_write(file, json.dumps(found) + "\n")
    return found


def _slice(config: Config, cell: tuple[str, float], numbers: range, judges: Judges) -> dict[str, Any]:
    """Counts of one batch."""
    kind, radius = cell
    problems = drawn(config.seed, kind, radius, numbers)
    plans = planned(problems, radius)
    verdicts = judges(judge, _answers(problems, radius, plans))
    found: dict[str, Any] = {
        "problems": len(verdicts),
        "joined": sum(v.joined for v in verdicts),
        "solved": int(plans.ok.sum()),
        "certified": int(plans.certified.sum()),
        "wrong": sum(not v.right for v in verdicts),
        "unsafe": sum(not v.safe for v in verdicts),
        "failures": [k for k, v in zip(numbers, verdicts, strict=True) if not (v.right and v.safe)],
    }
    place = numbers.start // config.slice
    if place % config.images:
        return found
    return found | compared(problems, plans, radius, place // config.images % 3)


def _answers(problems: Problems, radius: float, plans: maxjax.Plans) -> list[Answer]:
    def one(k: int) -> Answer:
        path = plans.points[k, : plans.counts[k]] / SPACING
        named = float(plans.radius[k]) / SPACING
        return Answer(
            problems.occupied[k], problems.ends[k], radius, maxjax.Status(int(plans.status[k])).name, named, path
        )

    return [one(k) for k in range(len(problems.occupied))]


def section(document: Document) -> str:
    """RESULTS.md: what is right, of each kind; failures by number."""
    rows = document["rows"]
    heads = ["maps", "radius [m]", "problems", "joined", "solved", "certified", "wrong status", "unsafe", "images"]
    heads += [
        "another status, mirrored",
        "dearer by",
        "on faces",
        "another status, moved",
        "dearer by",
        "unlike",
        "again",
    ]
    counts = ("problems", "joined", "solved", "certified", "wrong", "unsafe", "images")
    lines = [
        [
            row["kind"],
            f"{row['radius_m']:g}",
            *(f"{row[name]:,}" for name in counts),
            str(row["mirrored_otherwise"]),
            *(f"{100 * row[name]:.2f} %" for name in WORST[:2]),
            str(row["moved_otherwise"]),
            f"{100 * row['worst_moved']:.2f} %",
            str(row["unlike"]),
            f"{100 * row['worst_again']:.2f} %",
        ]
        for row in rows
    ]
    count = sum(row["problems"] for row in rows)
    wrong = sum(row["wrong"] + row["unsafe"] for row in rows)
    most = binomtest(wrong, count).proportion_ci(confidence_level=0.95, method="exact").high
    failures = "; ".join(f"{row['kind']}, {row['radius_m']:g} m: {row['failures']}" for row in rows if row["failures"])
    return (
        f"### Hard maps ({device(document)})\n\n"
        f"Maps of {SIZE}³ voxels of 2 m: random ones near the percolation threshold, doors of one voxel and more,\n"
        "blocks that touch along edges and at corners, free rims around a solid; ends at centres, anywhere, and on\n"
        "faces, edges and corners of voxels. Right is OK where SciPy's dilation and labels join the ends at the\n"
        "radius, NO_SAFE_PATH with the largest radius that does where a lesser one does, else NO_VALID_PATH; safe is\n"
        "a path whose dense samples keep the radius from every occupied cube. Images: planned again in a mirror with\n"
        "two axes exchanged, and moved by voxels and by hundreds of kilometres; dearer by: the most that one of two\n"
        "such paths costs more; on faces: where an end lies on one, which is of another voxel in a mirror. Unlike:\n"
        f"images of which one costs over {100 * DEARER:g} % more; again: the most that it does when both are planned\n"
        "with `Screened(tolerance=1e-4)`, where the solver's own tolerance no longer decides between ways; left are\n"
        "lines of one length along corners of voxels, whose price is that of the voxels on one side or the other.\n\n"
        f"{table(heads, lines)}\n"
        f"{wrong} of {count:,} wrong or unsafe: at most {100 * most:.4f} % (Clopper and Pearson, 95 %).\n"
        + (f"\nNumbers of failures (`experiments.hard_maps.maps.drawn`): {failures}.\n" if failures else "")
    )
