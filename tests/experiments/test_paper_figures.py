"""The figures are drawn from what they say they are, and stay small."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import jax
import numpy as np
import pytest

pytest.importorskip("matplotlib")
from PIL import Image

from experiments.paper_figures import planned as module
from experiments.paper_figures.architecture import volumes_of, weights_of
from experiments.paper_figures.flights import worst_flights
from experiments.paper_figures.planned import Choice, planned
from experiments.paper_figures.study import TINY, main
from maxjax.nn.architecture import CONFIGS
from maxjax.nn.autoencoder import apply, init_params
from maxjax.sim.loop.flight import FlightConfig
from maxjax.sim.trials.campaign import Campaign
from maxjax.sim.trials.outcomes import Outcome
from maxjax.ui.methods import planner_named


def outcome(trial: int, status: str, flown: float) -> Outcome:
    return Outcome(
        trial, 0, status, [-40.0, 0.0, 4.0], [30.0, 10.0, 12.0], math.dist((-40, 0, 4), (30, 10, 12)), 0, flown, 20.0,
        2.0, 18, 0, {"8": 18}, 1.0, "maxjax fly suburb",
    )  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A campaign of four flights: two straight, one that wanders, one that failed."""
    config = FlightConfig(planner=planner_named("field"))
    ledger = Campaign("suburb", 0, range(4), config=config).ledger(tmp_path / "flights")
    along = np.linspace(0, 1, 50)[:, None]
    start, goal = np.array([-40.0, 0.0, 4.0]), np.array([30.0, 10.0, 12.0])
    bulge = np.sin(np.pi * along) * np.array([0.0, 30.0, 0.0])
    lines = np.stack([start + along * (goal - start) + k * bulge for k in (0.0, 0.1, 1.0, 0.5)]).astype(np.float32)
    lines[3, 30:] = np.nan
    ledger.append(
        [outcome(0, "OK", 71.2), outcome(1, "OK", 71.5), outcome(2, "OK", 95.0), outcome(3, "IN_CONTACT", 50.0)]
    )
    ledger.record_positions(range(4), lines)
    return tmp_path / "flights"


def test_the_worst_flights_come_first(folder: Path) -> None:
    worst = worst_flights(folder, 3)
    assert [flight.outcome.trial for flight in worst] == [3, 2, 1]
    assert [len(flight.position) for flight in worst] == [30, 50, 50]
    assert worst[1].detour == pytest.approx(95.0 / 71.162, rel=1e-3)
    with pytest.raises(ValueError, match="expected a folder that maxjax fly --out has written"):
        worst_flights(folder.parent, 3)


@pytest.mark.parametrize("name", ["paper", "maxjax"])
def test_the_boxes_of_the_architecture_are_its_volumes(name: str) -> None:
    network, boxes = CONFIGS[name], volumes_of(CONFIGS[name])
    params = jax.eval_shape(lambda key: init_params(key, network), jax.random.key(0))
    kernels = [
        layer["kernel"].shape for side in ("encoder", "decoder") for level in params[side] for layer in level
    ] + [params["head"]["kernel"].shape]
    layers = [k for k, box in enumerate(boxes) if box.made_by in ("convolution, ReLU", "head")]
    assert [boxes[k].channels for k in layers] == [shape[-1] for shape in kernels]
    # Skips to the head aside, every layer reads the box before it.
    assert [boxes[k - 1].channels for k in layers][:-1] == [shape[-2] for shape in kernels][:-1]
    assert weights_of(network) == sum(math.prod(x.shape) for x in jax.tree.leaves(params))
    x = jax.ShapeDtypeStruct((1, 101, 101, 101, network.inputs), np.float32)
    assert jax.eval_shape(lambda p, x: apply(p, x, network), params, x).shape == (1, 101, 101, 101)
    assert boxes[-1].voxels == -(-101 // network.patch)


@pytest.mark.nightly
def test_all_figures_are_drawn_and_small(folder: Path, tmp_path: Path) -> None:
    files = main(dataclasses.replace(TINY, flights=(folder,), out=tmp_path))
    names = ["path", "training_map", "architecture", "fields", "flights"]
    assert [file.name for file in files] == [f"paper_{name}.png" for name in names]
    for file in files:
        assert file.stat().st_size < 250_000
        with Image.open(file) as image:
            assert min(image.size) > 300
            assert len(image.convert("RGB").getcolors(2**24) or []) > 20


def test_flights_are_left_out_without_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(dataclasses.replace(TINY, only=("flights",), out=tmp_path)) == []
    assert "no --flights given" in capsys.readouterr().err


def test_a_problem_that_cannot_be_solved_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "problems", lambda *_: [])
    with pytest.raises(ValueError, match="candidates: expected one of 1 problems of downtown"):
        planned("downtown", Choice(TINY.candidates, TINY.shape, TINY.margin, seed=9))
