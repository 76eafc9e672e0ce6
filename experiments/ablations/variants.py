"""What is changed: the variants of each ablation, and the conditions of the closed loop."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Literal

Rule = Literal["momentum", "adam"]
Kernel = Literal["walls", "plain"]
Guard = Literal["ours", "smoothed", "none"]


@dataclasses.dataclass(frozen=True)
class Source:
    """Where a potential comes from.

    Attributes:
        length: screening length [voxels]; None: what the solver chooses; 0: no leak, outer faces grounded.
        weighted: by distance to the goal, or the same everywhere.
        network: the name of one instead of the solver, alone.
        weights: its file; None: the one that comes with maxjax.
    """

    length: float | None = None
    weighted: bool = True
    network: str | None = None
    weights: Path | None = None


@dataclasses.dataclass(frozen=True)
class Variant:
    """A planner; the default is the library's.

    Attributes:
        source: of its potential.
        rule: of its ascent.
        smoothing: standard deviation [voxels].
        kernel: that smooths.
        guard: see the head of this module.
        margin: [m]; None: that of the configuration.
    """

    source: Source = Source()
    rule: Rule = "momentum"
    smoothing: float = 0.0
    kernel: Kernel = "walls"
    guard: Guard = "ours"
    margin: float | None = None


DEFAULT = Variant()
# The library's guards need the exact field, and smooth by walls only.
_KERNELS: dict[Guard, tuple[Kernel, ...]] = {
    "ours": ("walls",),
    "smoothed": ("walls", "plain"),
    "none": ("walls", "plain"),
}
_SMOOTHED = [
    Variant(smoothing=sigma, kernel=kernel, guard=guard)
    for sigma in (1.0, 2.0, 5.0)
    for guard, kernels in _KERNELS.items()
    for kernel in kernels
]
_PAPER = Variant(Source(length=0.0), "momentum", 5.0, "plain", "none")
GROUPS: dict[str, dict[str, Variant]] = {
    "smoothing": {
        "none; guards ours": DEFAULT,
        "none; guards none": Variant(guard="none"),
        **{f"σ = {v.smoothing:g}, {v.kernel}; guards {v.guard}": v for v in _SMOOTHED},
    },
    "rule": {
        "momentum; guards ours": DEFAULT,
        "ADAM; guards ours": Variant(rule="adam"),
        "momentum; guards none": Variant(guard="none"),
        "ADAM; guards none": Variant(rule="adam", guard="none"),
        "momentum, κ = 0; guards none": Variant(Source(length=0.0), guard="none"),
        "momentum, κ = 0, σ = 5 plain; guards none (the paper's)": _PAPER,
        "ADAM, κ = 0, σ = 5 plain; guards none (its predecessor's)": dataclasses.replace(_PAPER, rule="adam"),
    },
    "screening": {
        "default": DEFAULT,
        **{f"ℓ = {length} voxels": Variant(Source(length=float(length))) for length in (5, 10, 20, 50)},
        "κ = 0 (the paper's)": Variant(Source(length=0.0)),
    },
    "conductivity": {"distance-weighted": DEFAULT, "uniform": Variant(Source(weighted=False))},
    "margin": {f"{margin} m": Variant(margin=float(margin)) for margin in (0, 2, 4, 6, 8)},
    "kernels": {f"{name} alone": Variant(Source(network=name)) for name in ("paper", "paper_large")},
}
# Conditions of the closed loop: snapshot, gain of the reactive layer [m/s²].
FLIGHTS: dict[str, tuple[bool, float]] = {
    "fused map": (False, 0.0),
    "snapshot": (True, 0.0),
    "fused map, reactive layer": (False, 1.5),
    "snapshot, reactive layer (the paper's)": (True, 1.5),
}
