"""The ablated parts do what they are named after, and every variant and condition has its row."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import ndimage

pytest.importorskip("skfmm", reason="the eikonal oracle needs scikit-fmm: pip install 'maxjax[bench]'")

import maxjax
from experiments.ablations import study
from experiments.ablations.parts import Bare, bare, smooth
from experiments.ablations.study import TINY, main
from experiments.ablations.tables import section
from experiments.ablations.variants import FLIGHTS, GROUPS
from maxjax.fields.gradient import gradient
from maxjax.sim.trials.campaign import Campaign
from maxjax.sim.trials.outcomes import Outcome
from tests.scenes import outcome

SHAPE = (24, 20, 16)


def slope(towards: np.ndarray) -> np.ndarray:
    """A log-potential that falls by one a voxel of distance from a point."""
    index = np.moveaxis(np.indices(SHAPE), 0, -1)
    return -np.linalg.norm(index - towards, axis=-1).astype(np.float32)


def test_plain_smoothing_is_scipys_and_mixes_both_sides_of_a_wall() -> None:
    u = slope(np.array([4.0, 10.0, 8.0])) / 4
    u[12:] -= 5.0
    free = np.ones(SHAPE, bool)
    free[11] = False
    log_phi = np.where(free, u, -np.inf).astype(np.float32)
    plain = np.asarray(smooth(jnp.asarray(log_phi), jnp.asarray(free), 2.0, "plain"))
    filled = np.where(free, u, u[free].min())
    np.testing.assert_allclose(plain, ndimage.gaussian_filter(filled, 2.0, mode="nearest"), atol=1e-4)
    aware = np.asarray(smooth(jnp.asarray(log_phi), jnp.asarray(free), 2.0, "walls"))
    # What lies behind a closed wall is no matter of the wall-aware one: its mean stays.
    assert aware[12:].mean() == pytest.approx(u[12:].mean(), abs=1e-3)
    assert abs(plain[12:].mean() - u[12:].mean()) > 0.05


@pytest.mark.parametrize("rule", ["momentum", "adam"])
def test_the_bare_ascent_arrives_in_the_open_and_runs_into_walls(rule: Any) -> None:
    start, goal = np.array([3.0, 4.0, 5.0], np.float32), np.array([19.0, 12.0, 9.0], np.float32)
    u, free = jnp.asarray(slope(goal)), np.ones(SHAPE, bool)
    ends, settings = (jnp.asarray(start), jnp.asarray(goal)), Bare(rule)
    path, status = bare(gradient(u, jnp.asarray(free)), jnp.asarray(free), *ends, settings)
    assert int(status) == maxjax.Status.OK
    np.testing.assert_array_equal(np.asarray(path)[[0, -1]], [start, goal])
    free[10] = False
    path, status = bare(gradient(u, jnp.asarray(free)), jnp.asarray(free), *ends, settings)
    assert int(status) == maxjax.Status.PATH_IN_COLLISION
    assert round(float(path[-1, 0])) == 10


@pytest.fixture(scope="module")
def document(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    out = tmp_path_factory.mktemp("ablations")
    main(dataclasses.replace(TINY, out=out))
    found: dict[str, Any] = json.loads((out / "ablations.json").read_text())
    return found


@pytest.mark.nightly
def test_every_variant_has_a_row_or_a_reason(document: dict[str, Any]) -> None:
    rows = {(row["group"], row["setting"]): row for row in document["rows"]}
    assert set(rows) == {(group, setting) for group in TINY.groups for setting in GROUPS[group]}
    for row in rows.values():
        assert all(value is None or isinstance(value, str | int | float) for value in row.values())
        assert row["map"] or row["left_out"]
    default = rows["conductivity", "distance-weighted"]
    assert default["ok"] == default["certified"] == default["problems"] == 1
    assert default["over_default_mean"] == 1
    assert default["climbed_over_geodesic_mean"] >= default["over_geodesic_mean"]
    # The same variant under another name is the same.
    same = rows["rule", "momentum; guards ours"]
    assert {**same, "group": "", "setting": ""} == {**default, "group": "", "setting": ""}
    assert rows["rule", "momentum, κ = 0, σ = 5 plain; guards none (the paper's)"]["certified"] == 0


@pytest.mark.nightly
def test_the_section_has_every_row_and_what_is_left_out(document: dict[str, Any]) -> None:
    text = section(document)
    for row in document["rows"]:
        assert (f"| {row['map']} | {row['setting']} |" if row["map"] else str(row["left_out"])) in text


def test_unknown_groups_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="groups: expected some of smoothing"):
        main(dataclasses.replace(TINY, groups=("colour",), out=tmp_path))


def test_every_condition_of_the_closed_loop_is_flown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    flown: list[Campaign] = []

    def stand_in(campaign: Campaign, **_: Any) -> Iterator[list[Outcome]]:
        flown.append(campaign)
        length = 70.0 + campaign.config.reactive
        yield [
            outcome(k, "OK" if k else "IN_CONTACT", flown_length=length, clearance=0.9 if k else 0.4, margins={"8": 20})
            for k in campaign.trials
        ]

    monkeypatch.setattr(study, "fly_trials", stand_in)
    rows = main(dataclasses.replace(TINY, closed_loop=True, out=tmp_path))
    assert [(c.config.snapshot, c.config.reactive) for c in flown] == list(FLIGHTS.values())
    assert [row["arrived"] for row in rows] == [1] * len(FLIGHTS)
    assert rows[0]["flown_m"] == 70.0
    text = section(json.loads((tmp_path / "ablations_closed_loop.json").read_text()))
    for condition in FLIGHTS:
        assert f"| suburb | {condition} | 1 of 2 | 1 |" in text
    assert "1.021 of the mean way" in text
