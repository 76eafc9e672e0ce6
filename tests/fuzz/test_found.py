"""Cases that fuzzing found, each small: what once ended in a traceback, an endless sentence or a wrong value."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

pytest.importorskip("viser", reason="messages need the extra view: pip install 'maxjax[view]'")

from maxjax import load_airspace
from maxjax.io.geo.earth import TangentPlane
from maxjax.sim.trials.ledger import CONFIG, TIMES, Ledger
from tests.fuzz.formats import FORMATS
from tests.fuzz.map_files import AIR

LONG = 500 * b"9"


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("trials.jsonl", b'"trial":3', b'"trial":{}'),
        ("trials.jsonl", b'"status":"OK"', b'"status":null'),
        ("trials.jsonl", b'"distance":9.5', b'"distance":NaN'),
        ("trials.jsonl", b'"distance":9.5', b'"distance":1e999'),
        ("trials.jsonl", b'"excluded":0', b'"excluded":' + LONG),
        ("trials.jsonl", b'"margins":{"8":5}', b'"margins":{"8":[]}'),
        ("config.json", b'"batch": 4', b'"batch": 2.5'),
        ("config.json", b'"flown_by": []', b'"flown_by": [[1]]'),
        ("checkpoint.json", b"state-", b"state-" + LONG),
        ("checkpoint.json", b'"sha256": "', b'"sha256": "' + 5000 * b"7"),
        ("positions.npz", b"trial.npy", b"tr2al.npy"),
        ("weights.npz", b"\x0a\x00\x14\x00header", b"\xff\x02\x14\x00header"),
        ("a.geojson", b"12.5", b"1e999"),
    ],
)
def test_it_is_refused_in_a_sentence(tmp_path: Path, name: str, old: bytes, new: bytes) -> None:
    whole = FORMATS[name].valid()
    assert old in whole
    assert FORMATS[name].outcome(whole.replace(old, new), tmp_path) == "refused"


def test_an_endless_number_in_one_zone_closes_it_and_is_cut_in_the_remark(tmp_path: Path) -> None:
    """The other zone of the file is clear."""
    whole = FORMATS["areas.geojson"].valid()
    assert FORMATS["areas.geojson"].outcome(whole.replace(b'"lower": 5', b'"lower": ' + 2 * LONG), tmp_path) == "taken"
    airspace = load_airspace(tmp_path / "areas.geojson", TangentPlane(52.0005, 4.3005), AIR)
    assert [(area.floor, area.ceiling) for area in airspace.areas] == [(-math.inf, math.inf)] * 3
    assert "expected lower as a height" in airspace.remarks[-1]
    assert max(map(len, airspace.remarks)) < 1000


@pytest.mark.parametrize("name", ["mission.toml", "plan.json"])
@pytest.mark.parametrize("seed", [LONG, b"\\u0000"])
def test_names_that_no_file_can_have_are_left_to_the_reader_of_maps(tmp_path: Path, name: str, seed: bytes) -> None:
    assert FORMATS[name].outcome(FORMATS[name].valid().replace(b":0", b":" + seed), tmp_path) == "taken"


@pytest.mark.parametrize("text", ['{"batches": 5}', "[]", 20_000 * "[", '{"batches": NaN}'])
def test_run_times_that_cannot_be_read_are_none(tmp_path: Path, text: str) -> None:
    (tmp_path / CONFIG).write_bytes(FORMATS[CONFIG].valid())
    (tmp_path / TIMES).write_text(text)
    assert Ledger.read(tmp_path).times() == []
