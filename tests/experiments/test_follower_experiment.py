"""The experiment on the clock that waits, at a small size."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from experiments.follower import TINY, main, section


@pytest.mark.nightly
def test_waiting_keeps_what_time_alone_loses(tmp_path: Path) -> None:
    config = dataclasses.replace(TINY, winds=(10.0,), tilt=22.0, flights=4, out=tmp_path)
    by_time, waits = main(config)
    assert by_time["flights"] == waits["flights"] == 4
    assert waits["error_greatest"] < 2.1 < by_time["error_greatest"]
    assert waits["later_most"] > 0.1 > abs(by_time["later_most"])
    text = section(json.loads((tmp_path / "follower.json").read_text()))
    assert "| 10 | waits | 4 |" in text
