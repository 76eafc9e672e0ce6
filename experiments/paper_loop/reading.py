"""How the paper's loop is read: what it leaves open as values, so that a grid of readings is a list of them.

The paper is Bong and Beltrame, arXiv:2605.10880; each choice stands beside the sentence that it reads.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Literal

from experiments.paper_loop.sources import SOURCES
from maxjax.sim.loop.reactive import RANGE


@dataclasses.dataclass(frozen=True)
class Reading:
    """One reading of the paper's loop; static.

    Attributes:
        field: climbed, one of `sources.SOURCES`: "a 3D convolutional autoencoder" trained on "Ground truth … solved
            using SciPy's conjugate gradient solver". Its own κ is 0; `exact` has a leak.
        climbs: φ itself or its logarithm: "predicted magnetic field (φ) and its normalized form … revealing the
            gradient structure that guides the UAV", beside a "log-scaled representation" of σ.
        walls: dilated voxels have no gradient ("none") or hold the field's "least" value: "Obstacle voxels … have zero
            conductivity".
        sees_walls: whether smoothing stops at walls: "gradients are smoothed with a 3D Gaussian filter (σ = 5 voxels)"
            names none.
        ends: before the first of these voxels a path ends: "obstacle voxels (from LiDAR, dilated by 4 voxels for safety
            margin)" are either; "nowhere": at the end of the ascent alone. Only before "dilated" ones no path leads
            through these.
        straight: distance along each axis from which the goal is flown to straight [m]: ends are "validated
            collision-free with a 10m clearance check".
        segment: length flown of each plan [m]; None: what a period of 1 s leads along. "replanning, and flying
            segments"; 109.0 m in 31.0 plans and 74.1 m in 19.9 are 3.5 and 3.7 m a plan.
        reactive: the layer "across" the course alone, as maxjax has it; "repulsive" in all directions, as an
            acceleration; or "drift", by which set-points move away: it "can drift the UAV away from the planned
            magnetic-field path when an obstacle is near" and is "repulsive only".
        reach: of the layer [m]: "3m range".
        plans: of a flight, at most: "Maximum 100 planning iterations per trial".
        patience: plans in a row which at rest lead nowhere, after which a flight is given up; None: none is, as the
            paper knows no other end.

    Raises:
        ValueError: for a field that there is none of, or a number that is not positive.
    """

    field: str = "paper"
    climbs: Literal["log φ", "φ"] = "log φ"
    walls: Literal["none", "least"] = "none"
    sees_walls: bool = False
    ends: Literal["dilated", "occupied", "nowhere"] = "occupied"
    straight: float = 10.0
    segment: float | None = None
    reactive: Literal["across", "repulsive", "drift"] = "repulsive"
    reach: float = RANGE
    plans: int = 100
    patience: int | None = None

    def __post_init__(self) -> None:
        if self.field not in SOURCES:
            raise ValueError(f"field: expected one of {', '.join(SOURCES)}, given {self.field!r}")
        for name in ("straight", "segment", "reach", "plans", "patience"):
            if (number := getattr(self, name)) is not None and not number > 0:
                raise ValueError(f"{name}: expected a positive number, given {number}")

    def __str__(self) -> str:
        """Its field, and what differs from the usual reading."""
        words = {
            "climbs": f"gradients of {self.climbs}",
            "walls": "walls of the least value",
            "sees_walls": "smoothing that sees walls",
            "ends": f"paths end {'' if self.ends == 'nowhere' else 'before '}{self.ends}",
            "straight": f"last {self.straight:g} m straight",
            "segment": f"{self.segment} m a plan",
            "reactive": {"across": "layer across the course", "drift": "layer that drifts"}.get(self.reactive, ""),
            "reach": f"layer of {self.reach:g} m",
            "plans": f"{self.plans} plans",
            "patience": f"given up after {self.patience} plans at rest",
        }
        changed = [text for name, text in words.items() if getattr(self, name) != getattr(_USUAL, name)]
        return "; ".join([self.field, *changed])


_USUAL = Reading()

# What maxjax flew first: a vehicle rests 8 m before every wall, and is given up there.
BEFORE = Reading(ends="dilated", straight=3.0, reactive="across", patience=10)

_VARIED: tuple[Mapping[str, object], ...] = (
    {},
    {"ends": "dilated"},
    {"ends": "nowhere"},
    {"climbs": "φ"},
    {"walls": "least"},
    {"sees_walls": True},
    {"straight": 3.0},
    {"segment": 3.5},
    {"reactive": "across"},
    {"reactive": "drift"},
    {"reactive": "drift", "reach": 6.0},
    {"reactive": "drift", "segment": 3.5},
    {"reactive": "drift", "sees_walls": True, "segment": 3.5},
)


def _named(readings: Iterable[Reading]) -> dict[str, Reading]:
    return {str(reading): reading for reading in readings}


READINGS: Mapping[str, Reading] = _named(
    [
        *(
            dataclasses.replace(BEFORE, field=field, walls=walls)
            for field in ("paper", "exact")
            for walls in ("none", "least")
        ),
        *(dataclasses.replace(_USUAL, field=field, **change) for field in ("paper", "exact") for change in _VARIED),  # type: ignore[arg-type]
        Reading("paper_difference"),
        *(Reading(field, climbs) for field in ("exact, κ = 0", "exact, κ = 0, float64") for climbs in ("log φ", "φ")),
    ]
)
"""The grid, by name: what was flown before, then each choice changed alone, then fields without a leak."""
