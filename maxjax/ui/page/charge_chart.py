"""State of charge over a flight, drawn in a panel: a line a flight, and the reserve that none may touch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from maxjax.energy.charge_profile import ChargeProfile
from maxjax.energy.split_flights import BatteryFlight, Supply
from maxjax.ui.page.colors import FAILED, FLIGHTS, html_color
from maxjax.ui.page.controls import legend_box

_WIDE, _HIGH = 300.0, 70.0  # of the drawing [px]
_MOST = 200  # points of a line
_LINE = 'fill="none" vector-effect="non-scaling-stroke"'


def charge_chart(flights: Sequence[BatteryFlight | None], supply: Supply | None) -> str:
    """The charge of some flights over their times, as HTML; empty where no battery is given."""
    profiles = [found for flight in flights if (found := ChargeProfile.of(flight, supply)) is not None]
    if not profiles:
        return ""
    duration, reserve = max(float(one.time[-1]) for one in profiles), profiles[0].reserve
    lines = "".join(
        f'<polyline points="{_points(one, duration)}" stroke="{html_color(FLIGHTS[k % len(FLIGHTS)])}" '
        f'stroke-width="2" {_LINE}/>'
        for k, one in enumerate(profiles)
    )
    level = _HIGH * (1.0 - reserve)
    kept = (
        f'<rect x="0" y="{level:.1f}" width="{_WIDE:g}" height="{_HIGH - level:.1f}" fill="{html_color(FAILED)}" '
        'fill-opacity="0.25"/>'
    )
    left = ", ".join(f"{100.0 * one.left[-1]:.0f} %" for one in profiles)
    drawing = (
        f'<svg viewBox="0 0 {_WIDE:g} {_HIGH:g}" preserveAspectRatio="none" width="100%" height="{_HIGH:g}" '
        f'style="display:block;margin-top:6px;background:rgba(128,128,128,0.12)">{kept}{lines}</svg>'
    )
    ends = (
        '<div style="display:flex;justify-content:space-between">'
        f"<span>battery: 100 % to {left}, reserve {100.0 * reserve:.0f} %</span><span>{duration:.0f} s</span></div>"
    )
    return legend_box([drawing, ends])


def _points(profile: ChargeProfile, duration: float) -> str:
    """Points of a line in the drawing; an empty battery lies on its lower edge."""
    some = np.unique(np.linspace(0, len(profile.time) - 1, _MOST).round().astype(int))
    x = _WIDE * profile.time[some] / max(duration, 1e-9)
    y = _HIGH * (1.0 - np.clip(profile.left[some], 0.0, 1.0))
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x.tolist(), y.tolist(), strict=True))
