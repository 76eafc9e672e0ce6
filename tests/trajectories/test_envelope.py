"""The least envelope against its definition, for uneven steps and for a slope of 0."""

from __future__ import annotations

import numpy as np
import pytest

from maxjax.trajectories.envelope import least_envelope


@pytest.mark.parametrize("slope", [0.0, 0.3, 2.0])
def test_it_is_the_largest_of_all_cones(slope: float) -> None:
    rng = np.random.default_rng(3)
    along = np.cumsum(rng.uniform(0.0, 2.0, 60))
    values = rng.normal(size=60)
    expected = (values[None] - slope * np.abs(along[:, None] - along[None])).max(axis=1)
    np.testing.assert_allclose(least_envelope(values, along, slope), expected, atol=1e-12)
