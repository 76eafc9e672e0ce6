"""A small town and a line across it, for figures of flights."""

from __future__ import annotations

import numpy as np

from maxjax.core.grid import Grid

GRID = Grid((60, 60, 20), 2.0, (-59.0, -59.0, 1.0))
GOAL = np.array([30.0, 5.0, 8.0])


def town() -> np.ndarray:
    obstacle = np.zeros(GRID.shape, bool)
    obstacle[25:33, 27:33, :12] = True
    obstacle[10:16, 40:50, :4] = True
    return obstacle


def line(end: np.ndarray = GOAL, points: int = 61) -> np.ndarray:
    start = np.array([-40.0, -10.0, 6.0])
    along = np.linspace(0.0, 1.0, points)[:, None]
    return start + along * (end - start) + np.sin(np.pi * along) * np.array([0.0, 30.0, 4.0])
