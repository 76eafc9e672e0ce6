"""What a vehicle leaves behind it in a film: the last seconds of its way, and no more."""

from __future__ import annotations

import numpy as np

from maxjax.ui.page.nodes import Lines
from maxjax.ui.page.timeline import TRAIL_NODE, Film, trail_cues


def test_a_trail_ends_where_the_vehicle_is_and_is_three_seconds_long() -> None:
    times = np.arange(0.0, 10.05, 0.1)
    positions = np.stack([4.0 * times, 3.0 * times, 10.0 + 0.0 * times], axis=1)  # 5 m/s
    film = Film({}, trail_cues(times, positions), times, positions)
    assert TRAIL_NODE not in film.showing(0.0)
    for now in (0.4, 3.0, 7.0, 10.0):
        line = film.showing(now)[TRAIL_NODE][TRAIL_NODE]
        assert isinstance(line, Lines)
        np.testing.assert_allclose(line.points[-1, 1, :2], film.vehicle(now)[:2], atol=1e-6)
        length = np.linalg.norm(line.points[:, 1] - line.points[:, 0], axis=1).sum()
        np.testing.assert_allclose(length, 5.0 * min(now, 3.0), atol=0.51)


def test_a_vehicle_that_rests_has_no_trail_to_draw() -> None:
    assert trail_cues(np.zeros(1), np.zeros((1, 3))) == ()
