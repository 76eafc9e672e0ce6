"""The section of RESULTS.md: every loop on both maps, in the order in which layers are added."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from scipy.stats import binomtest

from benchmarks.common.harness import Row
from benchmarks.common.markdown import Document, table
from benchmarks.common.paper import FLOWN
from experiments.paper_loop.study import BEFORE, FEW, LAYERS, LOOPS

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


def section(document: Document) -> str:
    """RESULTS.md: who arrives by the paper's loop, and what each layer adds."""
    rows = document["rows"]
    first = [row for row in rows if row["trials"] <= FEW]
    loops = {(row["map"], row["loop"]): row for row in rows}  # the row of most trials comes last
    lacking = [f"{name} ({place})" for name in LOOPS for place in FLOWN if (place, name) not in loops]
    if document["name"] != "paper_loop":
        lines = [_line(row) for row in sorted(loops.values(), key=lambda row: str(row["map"]))]
        return f"### The paper's own loop, by the thousand ({_of(rows)})\n\n{table(_HEADS, lines, left=2)}"
    text = (
        f"### The paper's own loop, and what each layer saves ({_of(rows)})\n\n"
        "One scan a plan, a network's field and nothing behind it, the paper's smoothing and momentum, each path\n"
        "flown as far as it came, a reactive layer of 3 m (ours: it pushes across the way and brakes), at most 100\n"
        "plans. `gradients` and `field` are two readings of what the paper leaves open: gradients of the field\n"
        "outside walls are smoothed, zero within; or walls hold the least value of the field, so that they repel.\n"
        f"Each line with `+` adds to the one before it, the first of them to `{BEFORE}`. The first {FEW} trials a\n"
        "map are the paper's number. Lengths and plans: means ± standard deviations over arrivals; 95 %: the interval\n"
        "of Clopper and Pearson of the share that arrives; PATH_STALLED: ten plans in a row, at rest, led nowhere;\n"
        "after / straight: what flights that did not arrive flew, over the straight line, median. The paper's cities\n"
        "are others than ours, and its weights are not public: `paper` is its network, trained by us.\n\n"
    )
    more = [row for row in loops.values() if row["trials"] > FEW]
    for title, some in ((f"The first {FEW} trials a map", first), ("Loops of which more were flown", more)):
        lines = [_line(row) for row in sorted(some, key=lambda row: str(row["map"]))]
        if some is first:
            lines += [
                [place, f"{method}, the paper", "50 of 50", "–", "0", *figures, "–", "–", "–"]
                for place, methods in FLOWN.items()
                for method, figures in methods.items()
            ]
        text += f"#### {title}\n\n{table(_HEADS, lines, left=2)}\n"
    return text + _layers(loops) + (f"Not flown: {'; '.join(lacking)}.\n" if lacking else "")


def _of(rows: Sequence[Row]) -> str:
    """The devices of rows."""
    return ", ".join(dict.fromkeys(str(row["device"]).removeprefix("1 x ") for row in rows))


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
    """A sentence a map: the share that arrives after each layer."""
    text = ""
    for place in dict.fromkeys(place for place, _ in loops):
        steps = [(name, loops[place, name]) for name in (BEFORE, *LAYERS) if (place, name) in loops]
        shares = [f"{name} {_share(row)}" for name, row in steps]
        if len(shares) > 1:
            text += f"**{place}**, share that arrives: {'; '.join(shares)}.\n\n"
    return text


def _share(row: Row) -> str:
    found: Any = row
    return f"{100 * found['arrived'] / found['trials']:.1f} %"
