"""State of charge over time, drawn: a line a flight, and the reserve that none may touch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from maxjax.energy.charge_profile import ChargeProfile
from maxjax.ui.figures.style import FAILED

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_EMPTY = -5.0  # where an axis of charge begins [%]; an empty battery is drawn there


def draw_charge(axes: Axes, charges: Sequence[ChargeProfile], colors: Sequence[str]) -> None:
    """The charge of some flights over their times [%]; take-off and landing are steps at the ends.

    Args:
        axes: to draw in.
        charges: of each flight.
        colors: of their lines, in turn.
    """
    for k, one in enumerate(charges):
        color = colors[k % len(colors)]
        axes.plot(one.time, np.maximum(100.0 * one.left, _EMPTY), color=color, linewidth=1.2)
    axes.axhspan(_EMPTY, 100.0 * charges[0].reserve, color=FAILED, alpha=0.25, linewidth=0.0, label="reserve")
    axes.set_ylim(_EMPTY, 108.0)
    axes.set_ylabel("Charge\n[%]")
