"""What a planning method is; `maxjax.methods` lists those that there are."""

from __future__ import annotations

import dataclasses
import importlib.util
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from maxjax.planning.route import PathFinder


@dataclasses.dataclass(frozen=True)
class Method:
    """A way to find paths, by name.

    Attributes:
        name: as users write it.
        label: as tables and figures show it.
        finder: makes its path finder: a `planning.field_planner.Climb`, or a search that runs on the host.
        climbs: whether it climbs a field, so that its plans can be certified.
        in_flight: makes the path finder that runs inside a compiled flight, a pure function of arrays; None: it has
            none.
        needs: package that it needs and that maxjax does not require; None: none.
        extra: of maxjax, by which that package is installed.
    """

    name: str
    label: str
    finder: Callable[[], PathFinder]
    climbs: bool = False
    in_flight: Callable[[], PathFinder] | None = None
    needs: str | None = None
    extra: str | None = None

    @property
    def flies(self) -> bool:
        """Whether it can plan inside a flight."""
        return self.in_flight is not None

    def check(self) -> None:
        """Raise at once what planning would raise later.

        Raises:
            ImportError: where a package is missing.
            ValueError: where the weights of a network are.
        """
        if self.needs is not None and importlib.util.find_spec(self.needs) is None:
            raise ImportError(
                f"method {self.name!r} needs {self.needs}, from the extra {self.extra}: "
                f"pip install 'maxjax[{self.extra}]'"
            )
        self.finder()

    def flying(self) -> PathFinder:
        """The path finder of a flight.

        Raises:
            ValueError: where the method cannot fly, or the weights of a network are missing.
        """
        if self.in_flight is None:
            raise ValueError(f"method: expected one that can fly, given {self.name!r}")
        return self.in_flight()
