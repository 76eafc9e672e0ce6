"""Folders of flights: what is read of them, and the film of a trial."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from maxjax.ui.page.timeline import PLUMB_NODE, VEHICLE_NODE
from maxjax.ui.page.trial_folder import city_of, film_of, headline, open_folder, trial_in_words
from tests.ui.page.flown import folder, line, outcome


def test_a_folder_is_read_and_not_changed(tmp_path: Path) -> None:
    path = folder(tmp_path)
    before = {file: file.read_bytes() for file in path.rglob("*") if file.is_file()}
    name, ledger = open_folder(path)
    assert name == "suburb"
    assert list(ledger.outcomes) == [0, 1, 2]
    np.testing.assert_array_equal(ledger.positions()[1], line(0.5))
    assert {file: file.read_bytes() for file in path.rglob("*") if file.is_file()} == before
    assert [headline(one) for one in ledger.outcomes.values()] == ["0: OK, 64 m", "1: IN_CONTACT, 64 m", "2: not flown"]
    assert "arrived" in trial_in_words(ledger.outcomes[0])
    assert "touched" in trial_in_words(ledger.outcomes[1])
    assert "not flown" in trial_in_words(ledger.outcomes[2])


def test_a_folder_that_is_no_campaign_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="expected a folder that maxjax fly --out has written"):
        open_folder(tmp_path)


def test_the_vehicle_is_on_its_line_at_every_time() -> None:
    city = city_of("suburb", 0)
    film = film_of(outcome(0, "OK"), line(1.0), city)
    assert film.duration == 8.0
    for moment, at in ((0.0, line(1.0)[0]), (4.0, line(1.0)[40]), (8.0, line(1.0)[-1])):
        np.testing.assert_allclose(film.vehicle(moment), city.frame.page(at), atol=1e-4)
    # It is seen over the whole way, and what leads down from it reaches the ground wherever it is.
    begin = film.begin()
    assert begin[VEHICLE_NODE].radius >= 0.01 * np.ptp(film.positions, axis=0).max()
    (depth,) = np.unique(begin[PLUMB_NODE].points[0, 1, 2])
    assert (film.positions[:, 2] + depth <= 0.0).all()
    assert {VEHICLE_NODE, "/flown/line", "/map/ground", "/map/obstacles"} <= set(film.begin())
