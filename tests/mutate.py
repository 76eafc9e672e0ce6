"""Break one line at a time, and see whether a test notices.

    python -m tests.mutate --record                # two CPU cores: an hour; goes on where it was interrupted
    python -m tests.mutate --rooms sets flags      # some rooms alone

`mutations.tsv` lists lines of verifier, certificate, windows, reachable sets, flags, exports, airspace, places,
replanner and page, each with what it is broken to: a comparison, a sign, a bound, a unit. Each is put into a copy of
the tree, in which the tests of its room then run until the first one fails. A mutation that none of them notices has
survived.

Expected: a few survive, each for a reason that stands in `SURVIVORS`: it changes nothing that anybody could see.
"""

from __future__ import annotations

import csv
import dataclasses
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from benchmarks.common.command import configured
from benchmarks.common.harness import RESULTS, Row, begun, keep, show

ROOT = Path(__file__).parents[1]
# The tests of each room, those first that take least.
TESTS = {
    "verifier": ("verification/test_verifier.py", "verification"),
    "certificate": (
        *("fields/test_certificate.py", "fields/test_stencil.py", "fields/test_connectivity.py"),
        *("solvers/test_potential.py", "solvers/test_newton.py"),
    ),
    "windows": (
        *(f"planning/test_{name}.py" for name in ("boxes_of_maps", "window_geometry", "device_maps", "growth")),
        *(f"planning/test_{name}.py" for name in ("focus_window", "corridor", "planning_execution")),
    ),
    "sets": (
        *("sim/movers/test_reachable_sets.py", "sim/movers/test_hard_set.py", "sim/movers/test_body_marks.py"),
        *(f"sim/movers/test_{name}.py" for name in ("motions", "ambiguity", "choice", "perception")),
    ),
    "flags": tuple(f"sim/movers/test_{name}.py" for name in ("flags", "choice", "tracking", "slow_movers")),
    "exports": ("io/export", "ui/cli/test_cli_export.py"),
    "airspace": ("io/airspace", "planning/test_occupied_end.py", "io/export/test_exports.py"),
    "places": tuple(f"io/test_{name}.py" for name in ("own_axes", "vertical_zero", "accuracy")),
    "replanner": ("test_replanner.py",),
    "page": ("ui/page/test_border.py", "ui/page/test_page.py", "ui/page"),
}
# Why a mutation that no test notices cannot matter, by its file and its line as it is broken.
SURVIVORS: dict[tuple[str, str], str] = {
    (
        "maxjax/verification/contacts.py",
        "lowest = np.floor(np.minimum(begin, begin + run) - 4 * tolerance).astype(np.int64)",
    ): "More voxels are looked at than a segment can touch; each is judged by itself all the same.",
    (
        "maxjax/verification/own_distance.py",
        "held &= ((seen >= 0) | (seen <= last)).all(axis=2)",
    ): "A neighbour beyond the map is read as the voxel itself, and a voxel that is ground is left out anyway.",
    (
        "maxjax/verification/clearance.py",
        "return reach > 8 or len(pieces.zone) * (2 * reach + _PIECE) ** 3 <= occupied[0].size",
    ): "It chooses between two ways to the same distance, the quicker one.",
    (
        "maxjax/planning/windows/fixed_shapes.py",
        "best = found if found.ok.any() else best",
    ): "A replanner asks one problem at a time.",
    (
        "maxjax/sim/movers/body_marks.py",
        "return History(-never, never, jnp.full((_EARLIER, slots), jnp.inf))",
    ): "A time that is not finite is no look, with either sign.",
    (
        "maxjax/sim/movers/known_surroundings.py",
        "every = max(round(spacing / 4 / known.spacing), 1)",
    ): "Twice as many points of the way, which lies within half a cell of them either way.",
    (
        "maxjax/io/export/corners.py",
        "count = 1 + math.floor(float(np.linalg.norm(end - middle)) / _STEP)",
    ): "One point fewer on the rim: no two are farther apart than a step all the same.",
    (
        "maxjax/io/export/return_height.py",
        "squares = middles[:, None] - half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])",
    ): "The same four corners of a square, from the opposite one on.",
    (
        "maxjax/ui/page/guard.py",
        "MOST_FAULTS = 40",
    ): "How many faults a browser may send before it is sent away: the promise is that it is.",
}
# A mutation may make a loop endless [s].
_LONGEST = 900


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        rooms: whose lines are broken; none: all.
        workers: trees that are tested at a time.
        out: where the JSON goes.
    """

    rooms: tuple[str, ...] = ()
    workers: int = 2
    out: Path = RESULTS


TINY = Config(rooms=("certificate",), workers=1)


@dataclasses.dataclass(frozen=True)
class Mutation:
    """A line of a file, without its indentation, and what it is broken to."""

    room: str
    file: str
    line: str
    broken: str

    def apply(self, tree: Path) -> None:
        """Break the line in a tree.

        Raises:
            ValueError: if it does not stand there once.
        """
        path = tree / self.file
        lines = path.read_text(encoding="utf-8").splitlines()
        places = [k for k, line in enumerate(lines) if line.strip() == self.line]
        if len(places) != 1:
            raise ValueError(f"{self.file}: expected {self.line!r} once, found it {len(places)} times; list it anew")
        (place,) = places
        lines[place] = lines[place].replace(self.line, self.broken)
        text = "\n".join(lines) + "\n"
        path.unlink()  # a link to the file of the tree itself
        path.write_text(text, encoding="utf-8")


def mutations(rooms: tuple[str, ...] = ()) -> list[Mutation]:
    """Those that are listed, of some rooms or of all."""
    with (ROOT / "tests" / "mutations.tsv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file, delimiter="\t", quoting=csv.QUOTE_NONE))[1:]
    return [one for one in (Mutation(*row) for row in rows) if not rooms or one.room in rooms]


def main(config: Config) -> list[Row]:
    """Try all that were not tried yet; save and return a row for each.

    Raises:
        SystemExit: if tests fail where nothing is broken.
    """
    rows = begun("mutations", config, config.out)
    done = {(row["file"], row["broken"]) for row in rows}
    asked = [one for one in mutations(config.rooms) if (one.file, one.broken) not in done]
    with ThreadPoolExecutor(config.workers) as pool:
        failing = {room: test for room, test in pool.map(_whole, dict.fromkeys(one.room for one in asked)) if test}
        if failing:
            print(f"tests that fail where nothing is broken; their rooms are left out: {failing}", flush=True)
        for row in pool.map(_try, [one for one in asked if one.room not in failing]):
            rows.append(row)
            keep("mutations", config, rows, config.out)
            print(f"{row['room']}: {row['noticed'] or 'SURVIVED'}, {row['seconds']} s: {row['broken']}", flush=True)
    show("mutations", [row for row in rows if not row["noticed"]])
    if failing:
        raise SystemExit(f"tests fail where nothing is broken: {failing}")
    return rows


def _whole(room: str) -> tuple[str, str | None]:
    """A room, and the first of its tests that fails where nothing is broken."""
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        _copy(tree)
        return room, next(filter(None, (_failing(tree, tests) for tests in TESTS[room])), None)


def _try(mutation: Mutation) -> Row:
    """Whether a test notices, and which."""
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        _copy(tree)
        mutation.apply(tree)
        noticed = next(filter(None, (_failing(tree, tests) for tests in TESTS[mutation.room])), None)
    seconds = round(time.perf_counter() - began, 1)
    why = None if noticed else SURVIVORS.get((mutation.file, mutation.broken))
    return {**dataclasses.asdict(mutation), "noticed": noticed, "why": why, "seconds": seconds}


def _copy(tree: Path) -> None:
    """The tree's own files, as links: what is broken is written anew."""
    rooms = ("maxjax", "tests", "benchmarks", "experiments", "docs/samples")
    files = [path for room in rooms for path in (ROOT / room).rglob("*") if "__pycache__" not in path.parts]
    for path in [*files, *ROOT.glob("*.*")]:
        if path.is_file():
            copied = tree / path.relative_to(ROOT)
            copied.parent.mkdir(parents=True, exist_ok=True)
            try:
                os.link(path, copied)
            except OSError:  # another file system
                shutil.copy(path, copied)


def _failing(tree: Path, tests: str) -> str | None:
    """The first test that fails there; None where all pass."""
    words = ["-m", "pytest", "-x", "-q", "-n", "0", "-p", "no:cacheprovider", "--no-header", "-rfE", f"tests/{tests}"]
    where = {**os.environ, "MAXJAX_DATA": os.environ.get("MAXJAX_DATA", str(ROOT.parent / "shared" / "data"))}
    try:
        ended = subprocess.run(
            [sys.executable, *words], cwd=tree, env=where, capture_output=True, text=True, timeout=_LONGEST, check=False
        )
    except subprocess.TimeoutExpired:
        return "does not end"
    if ended.returncode == 0:
        return None
    return next(_named(ended.stdout), f"{tests}: exit code {ended.returncode}")


def _named(text: str) -> Iterator[str]:
    """Tests that failed, as pytest tells them."""
    for line in text.splitlines():
        if line.startswith(("FAILED ", "ERROR ")):
            yield line.split(" ", 1)[1].split(" - ")[0]


if __name__ == "__main__":
    main(configured(TINY))
