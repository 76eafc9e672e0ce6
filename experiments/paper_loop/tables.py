"""The section of RESULTS.md: every loop on both maps, in the order in which layers are added."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from scipy.stats import binomtest

from benchmarks.common.harness import Row
from benchmarks.common.markdown import Document, table
from benchmarks.common.paper import FLOWN
from experiments.paper_loop.study import FEW

_HEADS = (
    "map",
    "loop",
    "arrived",
    "95 %",
    "contacts",
    "flown [m]",
    "plans",
    "nearest of all [m]",
    "did not arrive",
    "after / straight",
)


_TOLD = {
    "paper_readings": """### The paper's own loop, in a grid of readings ({devices})

One scan a plan, a field and nothing behind it, smoothed by the paper's Gaussian and climbed by momentum, at most
100 plans. A row names its field, and what in it differs from this reading: gradients of log φ, none within dilated
voxels; a path ends before the first occupied voxel, so that it may lead through dilated ones; the last 10 m are
straight; each plan is flown for a second; a reactive layer of 3 m repels in all directions; no flight is given up.
""",
    "paper_loop": """### The paper's own loop, and what each layer saves ({devices})

One scan a plan, a network's field and nothing behind it, the paper's smoothing and momentum, a reactive layer of
3 m, at most 100 plans. Each line with `+` adds to the one before it, the first of them to the reading in the first
line. Rows named `gradients` and `field` are of one reading, in which a path ends before the first dilated voxel: the
table judges it, not the paper. There gradients are zero within walls, or walls hold the least value of the field; the
first `+` adds to `paper network, field`; PATH_STALLED is ten plans in a row, at rest, that led nowhere.
""",
}


def section(document: Document) -> str:
    """RESULTS.md: who arrives by the paper's loop, and what each layer adds."""
    rows = document["rows"]
    text = _TOLD[document["name"]].format(devices=_of(rows)) + (
        "Lengths and plans: means ± standard deviations over arrivals; 95 %: the interval of Clopper and Pearson of\n"
        "the share that arrives; after / straight: what flights that did not arrive flew, over the straight line,\n"
        "median. `paper` is the paper's network, trained by us: its weights, its cities and its vehicle are not\n"
        "public, and are what differs where no reading reaches its figures.\n\n"
    )
    last = {(row["map"], row["loop"]): row for row in rows}  # the row of most trials comes last
    few, many = (
        [row for row in some if (row["trials"] <= FEW) == less] for some, less in ((rows, True), (last.values(), False))
    )
    for heading, some in ((f"The first {FEW} trials a map, or fewer", few), ("Loops of which more were flown", many)):
        if some:
            lines = [_line(row) for row in sorted(some, key=lambda row: str(row["map"]))]
            lines += _of_the_paper() if some is few else []
            text += f"#### {heading}\n\n{table(_HEADS, lines, left=2)}\n"
    return text + _layers(last)


def _of_the_paper() -> list[list[str]]:
    return [
        [place, f"{method}, the paper", "50 of 50", "–", "0", *figures, "–", "–", "–"]
        for place, methods in FLOWN.items()
        for method, figures in methods.items()
    ]


def _of(rows: Sequence[Row]) -> str:
    """The devices of rows."""
    return ", ".join(dict.fromkeys(str(row["device"]).removeprefix("1 x ").replace("cpu", "CPU") for row in rows))


def _line(row: Row) -> list[str]:
    found: Any = row
    shares = binomtest(found["arrived"], found["trials"]).proportion_ci(method="exact")
    return [
        found["map"],
        found["loop"],
        f"{found['arrived']} of {found['trials']}",
        f"{100 * shares.low:.1f} to {100 * shares.high:.1f} %",
        str(found["contacts"]),
        _spread(found["flown_m"], found["flown_std_m"]),
        _spread(found["plans"], found["plans_std"]),
        "–" if found["clearance_least_m"] is None else f"{found['clearance_least_m']:.2f}",
        found["statuses"] or "–",
        "–" if found["lost_after"] is None else f"{found['lost_after']:.2f}",
    ]


def _spread(mean: float | None, deviation: float | None) -> str:
    return "–" if mean is None else f"{mean:.1f} ± {deviation:.1f}"


def _layers(loops: Mapping[tuple[Any, Any], Row]) -> str:
    """A sentence a map: the share that arrives with each layer."""
    text = ""
    for place in dict.fromkeys(place for place, _ in loops):
        shares = [f"{name} {_share(row)}" for (at, name), row in loops.items() if at == place and name[0] == "+"]
        if shares:
            text += f"**{place}**, share that arrives: {'; '.join(shares)}.\n\n"
    return text


def _share(row: Row) -> str:
    found: Any = row
    return f"{100 * found['arrived'] / found['trials']:.1f} %"
