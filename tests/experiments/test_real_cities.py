"""A tiny run of the real cities, with a placeholder for flights."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import jax
import jax.numpy as jnp
import pytest

from maxjax.core.status import Status
from maxjax.sim.loop.flight import FlightConfig, FlightLog
from maxjax.sim.worlds.geoms import Geoms
from maxjax.sim.worlds.solid_distance import distance


def fake_fly(geoms: Geoms, start: jax.Array, goal: jax.Array, key: jax.Array, config: FlightConfig) -> FlightLog:
    """Straight there in ten plans."""
    plans, straight = 10, jnp.linalg.norm(goal - start)
    finite = jnp.isfinite(straight)
    return FlightLog(
        status=jnp.where(finite, Status.OK, Status.NONFINITE_INPUT).astype(jnp.int32),
        position=jnp.zeros((11, 3)),
        flown_length=1.5 * straight,
        duration=straight,
        planning_iterations=jnp.int32(plans),
        failed_plans=jnp.int32(1),
        clearance=distance(geoms, start),
        margin=jnp.zeros(plans),
        certified=jnp.int32(plans - 1),
    )


def fake_draw(geoms: Geoms, key: jax.Array, first: int) -> tuple[jax.Array, ...]:
    """Fifty trials on the spot, the second of them without ends."""
    valid = jnp.arange(50) != 1
    start = jnp.where(valid[:, None], jnp.array([0.0, 0.0, 50.0]), jnp.nan)
    return start, start + jnp.array([60.0, 0.0, 0.0]), valid, jnp.zeros(50, jnp.int32)


@pytest.mark.nightly
def test_a_tiny_run_plans_flies_and_reports(data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("skfmm", reason="the eikonal oracle needs scikit-fmm: pip install 'maxjax[bench]'")
    from experiments import real_cities as module

    monkeypatch.setattr(module, "CITIES", {"Venice": module.CITIES["Venice"][:1]})
    monkeypatch.setattr(module, "fly_closed_loop", fake_fly)
    monkeypatch.setattr(module, "draw", fake_draw)
    config = dataclasses.replace(module.TINY, data=data, trials=3, out=tmp_path)
    geometry, offline, flown = module.main(config)
    assert geometry["windows"] == 1
    assert geometry["missed_share"] == 0
    assert 0 < float(geometry["excess_share"] or 0) < 0.03
    assert offline["problems"] == offline["solved"] == offline["certified"] == offline["astar_solved"] == 2
    assert offline["unsafe"] == 0
    assert flown["trials"] == flown["arrived"] == 2
    assert flown["not_drawn"] == 1
    assert flown["contacts"] == 0
    assert flown["detour_mean"] == 1.5
    assert flown["certified_share"] == 1.0
    assert 30 < float(flown["clearance_least_m"] or 0) < 50  # above the roofs
    text = module.section(json.loads((tmp_path / "real_cities.json").read_text()))
    assert "| Venice | solver | 2 | 2 | 0 |" in text
    assert "| Venice | 2 | 2 | 2 | 2 | 0 |" in text
