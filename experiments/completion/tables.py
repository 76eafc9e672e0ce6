"""The completion network in RESULTS.md: how it was trained, how well it is calibrated, what its prices are worth."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.common.harness import Row
from benchmarks.common.markdown import Document, device, table

_TOLD = {
    "free": "free",
    "alike": "priced alike",
    "extruded": "priced below what was seen",
    "network": "priced by the network",
    "truth": "priced by what is there",
}


def section(document: Document) -> str:
    """RESULTS.md: the training, or the judgement."""
    return _trained(document) if document["name"] == "completion_training" else _judged(document)


def _trained(document: Document) -> str:
    rows, config = document["rows"], document["config"]
    lines = [[str(row["epoch"]), f"{row['loss']:.4f}", f"{row['seconds']:.0f}"] for row in rows]
    cities, places = config["cities"], config["places"]
    return (
        f"### What nobody has seen: training ({device(document)})\n\n"
        "The completion network (`experiments.completion`) learns from single scans which unseen voxels are occupied:\n"
        f"{cities} cities of `{config['map']}`, {places} places in each, seed {config['seed']}. Loss: mean −log P of\n"
        "what is there, over unseen voxels.\n\n" + table(["epoch", "loss", "s"], lines)
    )


def _judged(document: Document) -> str:
    rows, height = document["rows"], document["config"]["height"]
    plans = [
        [
            str(row["map"]),
            _TOLD[str(row["unseen"])],
            f"{row['crossed']} of {row['planned']}",
            f"{100 * row['low']:.1f} to {100 * row['high']:.1f} %",
            f"{row['length']:.3f}",
        ]
        for row in rows
        if row["what"] == "plans"
    ]
    told = (
        f"### What nobody has seen: plans from one scan ({device(document)})\n\n"
        "Plans from a single scan by default, in cities that the network never saw. Crossed: the path leads through\n"
        "a building that the scan does not show, with Clopper–Pearson bounds of 95 %. Length: over the straight line,\n"
        f"mean. A metre through unseen voxels costs {height:g} P more; certificate and verifier know what was seen.\n\n"
        + table(["map", "unseen voxels are", "crossed", "bounds", "length"], plans, left=2)
    )
    return told + _calibrated(rows)


def _calibrated(rows: Sequence[Row]) -> str:
    """Share of occupied voxels by predicted probability, a map a row."""
    briers = [row for row in rows if row["what"] == "brier"]
    if not briers:
        return ""
    bins: dict[str, list[str]] = {str(row["map"]): [] for row in briers}
    for row in rows:
        if row["what"] == "reliability":
            bins[str(row["map"])].append(f"{row['occupied']:.2f}" if row["voxels"] else "")
    count = max(map(len, bins.values()))
    heads = [f"{k / count:.1f} to {(k + 1) / count:.1f}" for k in range(count)]
    lines = [[str(row["map"]), *bins[str(row["map"])], f"{row['network']:.4f}", f"{row['mean']:.4f}"] for row in briers]
    return (
        "\nCalibration: the share of unseen voxels that is occupied, by what the network predicts; Brier score,\n"
        "mean of (P − occupied)², beside that of a P which is the map's own mean everywhere.\n\n"
        + table(["map", *heads, "Brier", "of the mean"], lines)
    )
