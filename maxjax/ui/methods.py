"""The names of planners: one table for the command line, campaigns and experiments, and planners of one's own.

field          climbs the exact conduction potential (`solver` is another word for it)
network        climbs a predicted one, improved until it is certified
astar          searches the inflated grid
rrtstar        samples it (OMPL's, extra `bench`)
apf            descends an artificial potential field
module:Class   one of one's own by its import path, or `module:value`
"""

from __future__ import annotations

import dataclasses
import functools
import importlib
import os
import re
import sys
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

_MEMBERS = ("name", "batched", "route")  # of `planning.planner.Planner`, which JAX comes with
_PATH = re.compile(r"([^\W\d]\w*(?:\.[^\W\d]\w*)*):([^\W\d]\w*(?:\.[^\W\d]\w*)*)")

# Other words for them.
ALIASES: Mapping[str, str] = {"solver": "field"}


def method_named(name: Any) -> Method:
    """The method of a name or, for `module:Class` and `module:value`, of a planner of one's own.

    Raises:
        ValueError: if there is none.
    """
    known = ALIASES.get(name, name) if isinstance(name, str) else name
    if isinstance(known, str) and known in METHODS:
        return METHODS[known]
    if not is_import_path(known):
        raise ValueError(
            f"method: expected one of {', '.join(METHODS)}, given {name!r}; {', '.join(ALIASES)} is another word for "
            "field, and a planner of your own is MODULE:CLASS (docs/own_planner.md)"
        )
    module, _, place = known.partition(":")
    return Method(known, known, (module, place))


def is_import_path(name: Any) -> bool:
    """Whether a name is that of a planner of one's own, `module:Class` or `module:value`."""
    return isinstance(name, str) and _PATH.fullmatch(name) is not None


def planner_named(name: Any) -> Planner:
    """The planner of a name, ready to plan; raises as `method_named`, `Method.planner` and `own_planner`."""
    method = method_named(name)
    return own_planner(method) if is_import_path(method.name) else method.planner()


@functools.cache  # one value, as programs are compiled for a planner
def own_planner(method: Method) -> Planner:
    """The planner that an import path leads to; a class is called without arguments.

    Modules are looked for in the working directory too, after all others.

    Raises:
        ValueError: if the module, the name in it or a member of the planner's protocol is missing, or it does not load.
    """
    where, (module, place) = f"method {method.name}", method.where
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())
    try:
        found: Any = importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{module}.".startswith(f"{error.name}."):
            raise ValueError(f"{where}: module {module} needs {error.name}, which is not installed") from error
        raise ValueError(
            f"{where}: expected a module {module}, found none in {os.getcwd()} or on Python's path; "
            "start in its folder, or install it"
        ) from error
    except Exception as error:  # whatever a stranger's module raises
        raise ValueError(f"{where}: module {module} does not load: {type(error).__name__}: {error}") from error
    for part in place.split("."):
        if not hasattr(found, part):
            planners = [name for name, value in getattr(found, "__dict__", {}).items() if hasattr(value, "route")]
            there = ", ".join(planners) or "no planner"
            raise ValueError(f"{where}: expected {part} in {module}, found {there} there")
        found = getattr(found, part)
    if isinstance(found, type):
        try:
            found = found()
        except Exception as error:  # whatever a stranger's class raises
            raise ValueError(
                f"{where}: expected a class that takes no arguments, or the name of a value: {error}"
            ) from error
    return _fitting(found, where)


def _fitting(found: Any, where: str) -> Planner:
    """What was found, as a planner; raises a ValueError that says which members are missing or of another kind."""
    lacks = [name for name in _MEMBERS if not hasattr(found, name)]
    if lacks:
        raise ValueError(
            f"{where}: expected a planner with {', '.join(_MEMBERS)}, given a {type(found).__name__} without "
            f"{', '.join(lacks)}; docs/own_planner.md has an example"
        )
    kinds = {"name": isinstance(found.name, str), "batched": isinstance(found.batched, bool)}
    wrong = [name for name, right in {**kinds, "route": callable(found.route)}.items() if not right]
    if wrong:
        raise ValueError(
            f"{where}: expected name as text, batched as True or False and route(problem) as a function, given "
            f"{wrong[0]} = {getattr(found, wrong[0])!r}"
        )
    if found.name in METHODS or found.name in ALIASES:
        raise ValueError(
            f"{where}: expected a name of its own, given {found.name!r}, which is a planner of maxjax; "
            "tables and folders tell planners by their names"
        )
    try:
        hash(found)
    except TypeError as error:
        raise ValueError(
            f"{where}: expected a planner with a hash, for which programs are compiled, given {error}; make it a "
            "frozen dataclass"
        ) from error
    planner: Planner = found
    return planner


def label_of(name: str) -> str:
    """How tables and figures show a planner; one of somebody else by its name."""
    known = ALIASES.get(name, name)
    return METHODS[known].label if known in METHODS else name


def climbs(name: str) -> bool:
    """Whether a planner of this name climbs a field."""
    known = ALIASES.get(name, name)
    return known in METHODS and METHODS[known].climbs
