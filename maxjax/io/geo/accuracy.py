"""How true a map's places are on Earth: the transformation to WGS84 that PROJ takes, and the grids that it lacks.

National systems rest on a datum of their own. A few parameters bring it to WGS84 to some metres, a grid to decimetres;
where PROJ has no grid it takes the parameters. What is wrong by that is the same for a whole map: its buildings and the
paths between them move together, away from where they are.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import warnings

import numpy as np
from jaxtyping import Float64

from maxjax.io.geo.earth import Earth, TangentPlane, on_own_zero

_AROUND = 0.01  # [degrees]; the transformation is that of a place, not the best of a whole system


@dataclasses.dataclass(frozen=True)
class Accuracy:
    """How far the places of a map may lie from where it says.

    Attributes:
        metres: [m]; NaN where PROJ does not know.
        transformation: from the map's system to WGS84, in PROJ's words; empty where there is none.
        missing: files of the grids that a better one needs, from cdn.proj.org.
    """

    metres: float = 0.0
    transformation: str = ""
    missing: tuple[str, ...] = ()

    @property
    def known(self) -> bool:
        """Whether it is known."""
        return not math.isnan(self.metres)

    @property
    def clause(self) -> str:
        """What it adds to a sentence on a place; nothing where places are true."""
        return f"; {self}" if self.metres != 0.0 else ""

    def __str__(self) -> str:
        true = f"places are true to {self.metres:g} m" if self.known else "how true places are is not known"
        by = f", by {self.transformation}" if self.transformation else ""
        grid = f"; a better transformation needs the grid {' and '.join(self.missing)}" if self.missing else ""
        return f"{true}{by}{grid}"


def accuracy_of(earth: Earth, place: Float64[np.ndarray, " 3"]) -> Accuracy:
    """How true a map is around a place [m], as the user states it, else as PROJ knows it."""
    if isinstance(earth, TangentPlane):
        return Accuracy()
    if earth.accuracy is not None:
        return Accuracy(earth.accuracy, "what is asked for")
    latitude, longitude, _ = on_own_zero(earth).geodetic(place[None])[0].tolist()
    return _around(earth.crs, round(longitude, 2), round(latitude, 2))


@functools.lru_cache(maxsize=64)
def _around(crs: str, longitude: float, latitude: float) -> Accuracy:
    """The accuracy of a system around a place [degrees]."""
    from pyproj.transformer import AreaOfInterest, TransformerGroup

    area = AreaOfInterest(longitude - _AROUND, latitude - _AROUND, longitude + _AROUND, latitude + _AROUND)
    with warnings.catch_warnings(action="ignore"):  # about the missing grid, which is told instead
        found = TransformerGroup(crs, "EPSG:4326", always_xy=True, area_of_interest=area)
    if not found.transformers:
        return Accuracy(math.nan)
    taken = found.transformers[0]
    better = [] if found.best_available else [one.grids for one in found.unavailable_operations[:1]]
    return Accuracy(
        taken.accuracy if taken.accuracy >= 0.0 else math.nan,
        _plain(taken.description),
        tuple(grid.short_name for grids in better for grid in grids if not grid.available),
    )


def _plain(description: str) -> str:
    """PROJ's words for a transformation, without those for projections and for the order of axes."""
    steps = [step.removeprefix("Inverse of ") for step in description.split(" + ")]
    return " + ".join(step for step in steps if " to " in step) or description
