"""The section of RESULTS.md: a table for each ablation, and what follows from its rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.common.markdown import Document, device, table

_TITLES = {
    "smoothing": "Smoothing, with and without regard to walls",
    "rule": "Momentum and ADAM",
    "screening": "Screening length",
    "conductivity": "Conductivity",
    "margin": "Margin",
    "kernels": "Kernel sizes of the network",
}


def _ratio(value: float | None, digits: int = 3) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def section(document: Document) -> str:
    """RESULTS.md: a table for each ablation, and what it says."""
    if document["name"] == "ablations_closed_loop":
        return _section_flights(document)
    rows = [row for row in document["rows"] if row["map"]]
    config = document["config"]
    parts = [
        f"### Offline ({device(document)})\n\n"
        f"{config['problems']} problems a map, margin {config['margin']:g} m as a rule. One part changed at a time;\n"
        "every path before the same verification. Climbed: length of the ascent before tightening, over the eikonal\n"
        "geodesic (between voxel centres: a taut path along faces is a little shorter); tight: after it.\n"
        "Means over a variant's own successes: who fails keeps the easier ones.\n"
        "Guards: `ours` steps by the exact field, `smoothed` by the smoothed one, `none` is the paper's bare ascent.\n"
    ]
    for group in dict.fromkeys(str(row["group"]) for row in rows):
        here = [row for row in rows if row["group"] == group]
        parts += [f"#### {_TITLES[group]}\n", table(_HEADS, map(_line, here), left=2), _summary(here)]
    left = [f"{row['setting']} ({row['left_out']})" for row in document["rows"] if not row["map"]]
    return "\n".join(parts) + (f"\nLeft out: {', '.join(left)}.\n" if left else "")


_HEADS = (
    "map",
    "setting",
    "OK",
    "certified",
    "climbed / geodesic",
    "tight / geodesic",
    "length / default's",
    "length [m]",
    "mean clearance [m]",
    "least [m]",
    "mean margin [m]",
    "failed",
)


def _line(row: Mapping[str, Any]) -> list[str]:
    return [
        row["map"],
        row["setting"],
        f"{row['ok']} of {row['problems']}",
        str(row["certified"]),
        # Geodesics are known at the default's margin only.
        _ratio(row["climbed_over_geodesic_mean"] if row["group"] != "margin" else None),
        _ratio(row["over_geodesic_mean"] if "guards none" not in row["setting"] and row["group"] != "margin" else None),
        _ratio(row["over_default_mean"]),
        _ratio(row["length_m"], 1),
        _ratio(row["clearance_m"], 2),
        _ratio(row["clearance_least_m"], 2),
        _ratio(row["margin_m"], 1),
        row["failures"] or "–",
    ]


def _summary(rows: Sequence[Mapping[str, Any]]) -> str:
    """A group in a sentence for each map, from its rows alone."""
    names = dict.fromkeys(row["map"] for row in rows)
    return "".join(f"{_sentence(name, rows)}\n" for name in names)


def _sentence(name: str, rows: Sequence[Mapping[str, Any]]) -> str:
    by = {row["setting"]: row for row in rows if row["map"] == name}
    solvable = next(iter(by.values()))["solvable"]
    full = {setting: row["over_default_mean"] for setting, row in by.items() if row["ok"] == solvable}
    text = f"- {name}: {len(full)} of {len(by)} settings solve all {solvable} problems that some margin solves."
    known = {setting: ratio for setting, ratio in full.items() if ratio is not None}
    if known:
        best, worst = min(known, key=known.__getitem__), max(known, key=known.__getitem__)
        # What differs by less than what is shown is no difference.
        if known[best] < 0.9995:
            text += f" Shorter than the default: `{best}`, at {known[best]:.3f} of its length."
        if known[worst] > 1.0005:
            text += f" The longest of these: `{worst}`, at {known[worst]:.3f}."
    clear = {setting: row["clearance_m"] for setting, row in by.items() if setting in full and row["clearance_m"]}
    if len(clear) > 1:
        most = max(clear, key=clear.__getitem__)
        text += f" Most clearance of these on average: `{most}`, {clear[most]:.2f} m."
    return text


def _section_flights(document: Document) -> str:
    rows = document["rows"]
    lines = [
        [
            row["map"],
            row["condition"],
            f"{row['arrived']} of {row['trials']}",
            str(row["contacts"]),
            "–" if row["flown_m"] is None else f"{row['flown_m']:.1f} ± {row['flown_std_m']:.1f}",
            _ratio(row["plans"], 1),
            "–" if row["detour_p95"] is None else f"{row['detour_mean']:.3f} ({row['detour_p95']:.3f})",
            _ratio(row["clearance_least_m"], 2),
        ]
        for row in rows
    ]
    heads = ["map", "condition", "arrived", "contacts", "flown [m]", "plans", "flown / straight (95 %)", "least [m]"]
    notes = []
    for name in dict.fromkeys(row["map"] for row in rows):
        by = {row["condition"]: row for row in rows if row["map"] == name}
        fused = by["fused map"]
        for condition, row in by.items():
            if row is not fused and None not in (row["flown_m"], fused["flown_m"]):
                notes.append(
                    f"{name}, {condition}: {row['arrived']} of {row['trials']} arrive (fused map alone "
                    f"{fused['arrived']}), on {row['flown_m'] / fused['flown_m']:.3f} of the mean way."
                )
    return (
        f"### Closed loop ({device(document)})\n\n"
        "The same trials with the rolling map or with the latest scan alone, and with the reactive layer off or on "
        f"(gain {max(row['reactive_gain'] for row in rows):g} m/s²); the paper flies on a snapshot with a reactive "
        "layer.\n\n" + table(heads, lines, left=2) + "\n" + "\n".join(notes) + "\n"
    )
