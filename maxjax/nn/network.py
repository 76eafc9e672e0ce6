"""The planner that climbs a field which a network predicts."""

from __future__ import annotations

import dataclasses

from maxjax.nn.model import MAX_SWEEPS, network_potential
from maxjax.planning.run.field_planner import FieldPlanner
from maxjax.planning.run.stages import PotentialFn


@dataclasses.dataclass(frozen=True, kw_only=True)
class Network(FieldPlanner):
    """Climb a predicted potential, improved until it is certified; where that does not suffice, the solver takes over.

    A network plans the whole map, where `Field` plans a window of it: on two cores that takes three times as long in
    a city of 128 × 128 × 64 voxels, 29 times in one of 384 × 384 × 64 (experiments/results/network_plans.json).

    Attributes:
        model: name of the network, one whose weights come with maxjax.
        max_sweeps: positive sweeps that a prediction is given to be certified; 0: the network alone, and no solver.

    Raises:
        ValueError: if the network is unknown, its weights are missing, or the sweeps are negative.
    """

    potential: PotentialFn = dataclasses.field(init=False, repr=False)
    focus: bool = dataclasses.field(default=False, init=False)  # networks are trained on whole maps
    name: str = dataclasses.field(default="network", init=False)
    model: str = "maxjax"
    max_sweeps: int = MAX_SWEEPS

    def __post_init__(self) -> None:
        if self.max_sweeps < 0:
            raise ValueError(f"Network.max_sweeps: expected a whole number, 0 or more, given {self.max_sweeps}")
        object.__setattr__(self, "potential", network_potential(self.model, self.max_sweeps))
