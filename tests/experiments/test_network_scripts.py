"""The networks' tables: rows from real weights on small scenes, and pages from rows."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import jax
import pytest

from experiments import network_accuracy, network_cost, network_training
from maxjax.nn.architecture import CONFIGS
from maxjax.nn.autoencoder import init_params
from maxjax.nn.model import save_model
from maxjax.nn.recipes import RECIPES

ERRORS = ("l2", "l2_worst", "l2_normalised", "angle_median_deg", "angle_95_deg")


@pytest.mark.nightly
def test_accuracy_has_a_row_for_the_closed_law_and_each_network(tmp_path: Path) -> None:
    (tmp_path / "tiny").mkdir()
    save_model(tmp_path / "tiny" / "tiny.npz", "tiny", init_params(jax.random.key(0), CONFIGS["tiny"]))
    config = dataclasses.replace(network_accuracy.TINY, models=("maxjax",), trained=(tmp_path / "tiny",), out=tmp_path)
    rows = network_accuracy.main(config)
    assert [row["height"] for row in rows] == [3.5] * 3 + [0.0] * 3
    for analytic, ours, own in (rows[:3], rows[3:]):
        assert (analytic["network"], ours["network"], own["network"]) == ("analytic", "maxjax", "tiny")
        assert analytic["scenes"] == ours["scenes"] == config.scenes
        assert all(float(row[name] or 0) > 0 for row in (analytic, ours) for name in ERRORS)
        # Of the two networks one is trained.
        assert float(ours["l2"] or 0) < float(own["l2"] or 0)
        # Trained on grids of a finer spacing, it is nearer than where it starts from on this one too.
        assert float(ours["l2"] or 0) < float(analytic["l2"] or 0)
    text = network_accuracy.section(json.loads((tmp_path / "network_accuracy.json").read_text()))
    assert f"{ours['weights']:,}" in text
    assert "0.153" not in text.split("3DMaxConvNet")[0]


@pytest.mark.nightly
def test_certificates_of_every_start(tmp_path: Path) -> None:
    # The networks' own rows are made alike; `tests/nn/test_weights.py` has them certified at full size.
    config = dataclasses.replace(network_cost.TINY, out=tmp_path)
    found = {row["from"]: row for row in network_cost.main(config)}
    assert set(found) == {"solver", "nothing", "analytic"}
    assert all(row["certified"] == row["problems"] == 1 for row in found.values())
    assert found["solver"]["by_sweeps"] == 0
    assert float(found["nothing"]["sweeps_median"] or 0) > float(found["analytic"]["sweeps_median"] or 0)
    text = network_cost.section(json.loads((tmp_path / "network_cost.json").read_text()))
    assert text.count("| suburb |") == 3


@pytest.mark.parametrize(("timed", "minutes"), [(2, "1.5"), (1, "2.0")], ids=["in one go", "stopped, and gone on"])
def test_training_is_told_by_its_own_files(tmp_path: Path, timed: int, minutes: str) -> None:
    last = {"epoch": 2, "seconds": 50.0, "loss": 0.5, "l2": 0.01, "l2_normalised": 0.02}
    last |= {"angle_median": 1.5, "angle_95": 7.0}
    recipe = dataclasses.asdict(RECIPES["maxjax"])
    told = {"training": recipe, "scenes": 8, "seconds": 90.0, "device": "1 x cpu", "versions": {"jax": "1.2"}}
    epochs = {"epochs": [{"epoch": 1, "seconds": 70.0}, last], "epochs_in_these_seconds": timed}
    (tmp_path / "training.json").write_text(json.dumps({**told, "last": last, **epochs}))
    (row,) = network_training.main(network_training.Config((tmp_path,), tmp_path))
    assert (row["network"], row["l2"], row["device"]) == ("maxjax", 0.01, "1 x cpu")
    lines = (tmp_path / "network_training_maxjax.jsonl").read_text().splitlines()
    assert [json.loads(line)["epoch"] for line in lines] == [1, 2]
    text = network_training.section(json.loads((tmp_path / "network_training.json").read_text()))
    assert "200 x 8" in text
    assert f"| {minutes} |" in text
    assert "1.5 (7.0)" in text
