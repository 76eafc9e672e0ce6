"""What training the networks took and came to, from the files that `maxjax train` leaves.

    maxjax train --config maxjax --out OUT                                # one H200: 6 minutes
    python -m experiments.network_training --trained OUT/maxjax

One row a network: its recipe, scenes, time (compilation and validation included, drawing and labelling the scenes not;
of a run that stopped and went on, the sum of its epochs), the device it was trained on, and its errors on 64 validation
scenes of the training map. The curve, an epoch a line, goes beside the result file as network_training_NAME.jsonl.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import tyro

from benchmarks.common.harness import Row, save
from benchmarks.common.markdown import Document, table
from maxjax.core.files import atomic_write

RESULTS = Path(__file__).parent / "results"


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        trained: folders of networks, each with training.json.
        out: where the JSON goes.
    """

    trained: tuple[Path, ...]
    out: Path = RESULTS


def main(config: Config) -> list[Row]:
    """Read, save; one row a network."""
    rows: list[Row] = []
    for folder in config.trained:
        found = json.loads((folder / "training.json").read_text(encoding="utf-8"))
        recipe, last = found["training"], found["last"]
        in_one_go = found["epochs_in_these_seconds"] == len(found["epochs"])
        rows.append(
            {
                "network": recipe["model"],
                "epochs": recipe["epochs"],
                "scenes": found["scenes"],
                "batch": recipe["batch"],
                "rate": recipe["rate"],
                "precision": recipe["precision"],
                "seed": recipe["seed"],
                "seconds": found["seconds"] if in_one_go else round(sum(e["seconds"] for e in found["epochs"]), 1),
                "device": found["device"],
                "jax": found["versions"]["jax"],
                "loss": last["loss"],
                "l2": last["l2"],
                "l2_normalised": last["l2_normalised"],
                "angle_median_deg": last["angle_median"],
                "angle_95_deg": last["angle_95"],
            }
        )
        lines = "".join(json.dumps(line) + "\n" for line in found["epochs"])
        config.out.mkdir(parents=True, exist_ok=True)
        atomic_write(config.out / f"network_training_{recipe['model']}.jsonl", lines)
    save("network_training", config, rows, config.out)
    return rows


def section(document: Document) -> str:
    """RESULTS.md: one line a network."""
    lines = [
        [
            str(row["network"]),
            f"{row['epochs']} x {row['scenes']}",
            str(row["batch"]),
            str(row["device"]),
            f"{row['seconds'] / 60:.1f}",
            f"{row['l2']:.4f}",
            f"{row['l2_normalised']:.4f}",
            f"{row['angle_median_deg']:.1f} ({row['angle_95_deg']:.1f})",
        ]
        for row in document["rows"]
    ]
    rows = {row["network"]: row for row in document["rows"]}
    small, large = rows.get("paper"), rows.get("paper_large")
    kernels = ""
    if small and large:
        better, worse = (["better", "worse"][large[key] > small[key]] for key in ("loss", "l2"))
        kernels = (
            f"\n`paper_large`, the planar original's kernels of up to 11 voxels in three dimensions, by the recipe of\n"
            f"`paper`: it fits its own scenes {better} (loss {large['loss']:.1e}, `paper` {small['loss']:.1e})\n"
            f"and the validation scenes {worse}.\n"
        )
    heads = ["network", "epochs x scenes", "batch", "on", "minutes", "L2", "L2, normalised", "angle (95 %) [°]"]
    return (
        "### Training of the networks\n\n"
        "By `maxjax train --config NAME`, AdamW from a rate of 1e-3 down a cosine; errors on 64 validation scenes of\n"
        "the training map (the paper's validation error: 0.103). `maxjax` learns prices whose height is drawn between\n"
        "0 and 5, and is judged on such; the paper's networks know none. Curves: results/network_training_NAME.jsonl.\n"
        "`paper` and `paper_difference` shared their GPU with each other and with flights: their minutes are no\n"
        "measure.\n\n" + table(heads, lines, left=1) + kernels
    )


if __name__ == "__main__":
    main(tyro.cli(Config))
