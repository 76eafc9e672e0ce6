"""The names of planners: one table for the command line, campaigns and experiments.

field      climbs the exact conduction potential (`solver` is another word for it)
network    climbs a predicted one, improved until it is certified
astar      searches the inflated grid
rrtstar    samples it (OMPL's, extra `bench`)
apf        descends an artificial potential field
"""

from __future__ import annotations

import dataclasses
import importlib
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from maxjax.planning.planner import Planner


@dataclasses.dataclass(frozen=True)
class Method:
    """A planner by name; its class is imported when it is asked for, since names are wanted without JAX.

    Attributes:
        name: as users write it.
        label: as tables and figures show it.
        where: module and class.
        climbs: whether it climbs a field, so that its plans can be certified.
    """

    name: str
    label: str
    where: tuple[str, str]
    climbs: bool = False

    def planner(self) -> Planner:
        """The planner with its default settings.

        Raises:
            ImportError: if a package is missing.
            ValueError: if the weights of a network are.
        """
        module, name = self.where
        planner: Planner = getattr(importlib.import_module(module), name)()
        return planner


METHODS: Mapping[str, Method] = {
    method.name: method
    for method in (
        Method("field", "maxjax", ("maxjax.planners", "Field"), climbs=True),
        Method("network", "maxjax, network", ("maxjax.nn.network", "Network"), climbs=True),
        Method("astar", "A*", ("maxjax.baselines.astar_planner", "AStar")),
        Method("rrtstar", "RRT*", ("maxjax.baselines.rrt_star", "RRTStar")),
        Method("apf", "APF", ("maxjax.baselines.apf", "APF")),
    )
}

# Other words for them.
ALIASES: Mapping[str, str] = {"solver": "field"}


def method_named(name: Any) -> Method:
    """The method of a name.

    Raises:
        ValueError: if there is none.
    """
    known = ALIASES.get(name, name) if isinstance(name, str) else name
    if not isinstance(known, str) or known not in METHODS:
        raise ValueError(f"method: expected one of {', '.join(METHODS)}, given {name!r}")
    return METHODS[known]


def planner_named(name: Any) -> Planner:
    """The planner of a name, ready to plan; raises as `method_named` and `Method.planner`."""
    return method_named(name).planner()


def label_of(name: str) -> str:
    """How tables and figures show a planner; one of somebody else by its name."""
    known = ALIASES.get(name, name)
    return METHODS[known].label if known in METHODS else name


def climbs(name: str) -> bool:
    """Whether a planner of this name climbs a field."""
    known = ALIASES.get(name, name)
    return known in METHODS and METHODS[known].climbs
