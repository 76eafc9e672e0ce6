"""How much of a surface photos show: counted point by point, photo by photo.

share(k) = area of the points that at least k photos show / area of all
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Float64, Int64

from maxjax.core.grid import Point3
from maxjax.inspection.candidates import Reason
from maxjax.inspection.target_surface import GROUND, Surface
from maxjax.inspection.visibility import Sights

_WORDS = {
    "hidden": "hidden, or too oblique, from everywhere that may be flown to",
    "no room": "with no room for the radius before it",
    "closed": "before which the air is closed",
    "missed": "on none of the photos",
}


@dataclasses.dataclass(frozen=True)
class Unseen:
    """A part of a surface that no photo shows.

    Attributes:
        area: [m²].
        place: its middle [m].
        reason: why.
        what: façade or roof, and of which part of which building.
    """

    area: float
    place: Point3
    reason: Reason
    what: str

    def __str__(self) -> str:
        x, y, z = self.place
        return f"{self.area:.1f} m² of {self.what} around x {x:.1f}, y {y:.1f}, z {z:.1f}: {_WORDS[self.reason]}"


@dataclasses.dataclass(frozen=True, eq=False)
class Coverage:
    """What photos show of a surface.

    Attributes:
        surface: that is to be seen.
        counts: (n,) photos that show each point.
        incidence: (n,) the least of them [deg]; NaN where there is none.
        resolution: (n,) the least side of a pixel on it [m]; NaN where there is none.
        wanted: photos that are to show each point.
        limit: of the side of a pixel that counts [m].
        unseen: what no photo shows, largest first.
    """

    surface: Surface
    counts: Int64[np.ndarray, " n"]
    incidence: Float64[np.ndarray, " n"]
    resolution: Float64[np.ndarray, " n"]
    wanted: int
    limit: float
    unseen: tuple[Unseen, ...] = ()

    @classmethod
    def of(
        cls, surface: Surface, sights: Sights, wanted: int, limit: float, unseen: tuple[Unseen, ...] = ()
    ) -> Coverage:
        """That of some photos."""
        counts = np.bincount(sights.point, minlength=len(surface)).astype(np.int64)
        least = []
        for values in (sights.incidence, sights.resolution):
            found = np.full(len(surface), np.inf)
            np.minimum.at(found, sights.point, values)
            least.append(np.where(counts > 0, found, np.nan))
        return cls(surface, counts, least[0], least[1], wanted, limit, unseen)

    def share(self, photos: int = 1) -> float:
        """Share of the area that so many photos show at least."""
        return float(self.surface.areas[self.counts >= photos].sum()) / self.surface.area

    @property
    def overlaps(self) -> dict[int, float]:
        """Area by the number of photos that show it [m²]."""
        area = np.bincount(self.counts, self.surface.areas)
        return {number: float(size) for number, size in enumerate(area.tolist()) if size > 0.0}

    def __str__(self) -> str:
        seen = f"{100 * self.share():.1f} % of {self.surface.area:,.0f} m² at ≤ {1e3 * self.limit:.3g} mm/pixel"
        return f"{seen}, {100 * self.share(self.wanted):.1f} % of it in {self.wanted} photos or more"

    def to_dict(self) -> dict[str, Any]:
        """As texts, numbers and lists, without the points."""
        return {
            "area": self.surface.area,
            "covered_by_others": self.surface.covered,
            "share": self.share(),
            "share_wanted": self.share(self.wanted),
            "wanted": self.wanted,
            "resolution": self.limit,
            "overlaps": {str(number): area for number, area in self.overlaps.items()},
            "unseen": [{**vars(one), "place": list(one.place)} for one in self.unseen],
        }


def unseen_parts(
    surface: Surface, unseen: Int64[np.ndarray, " u"], reasons: list[Reason], apart: float
) -> tuple[Unseen, ...]:
    """What no photo shows, in parts of points that lie beside each other and have one reason.

    Args:
        surface: that is to be seen.
        unseen: numbers of points.
        reasons: of each.
        apart: distance up to which points are beside each other [m].
    """
    from scipy.spatial import cKDTree  # a quarter of a second that most commands can do without

    if not len(unseen):
        return ()
    points, roof = surface.points[unseen], surface.roof[unseen]
    pairs = cKDTree(points).query_pairs(apart, output_type="ndarray")
    told = np.array([f"{reason} {kind}" for reason, kind in zip(reasons, roof, strict=True)])
    pairs = pairs[told[pairs[:, 0]] == told[pairs[:, 1]]]
    from scipy.sparse import coo_array, csgraph

    links = coo_array((np.ones(len(pairs)), tuple(pairs.T)), shape=(len(points),) * 2)
    _, label = csgraph.connected_components(links, directed=False)
    found = []
    for part in np.unique(label):
        rows = np.flatnonzero(label == part)
        size = surface.areas[unseen[rows]]
        x, y, z = (size @ points[rows] / size.sum()).tolist()
        number = int(surface.part[unseen[rows[size.argmax()]]])
        name = surface.names[number] if number != GROUND else ""
        what = f"roof of {name}" if roof[rows[0]] else f"façade of {name}"
        what = "the ground" if number == GROUND else what
        found.append(Unseen(float(size.sum()), (x, y, z), reasons[rows[0]], what))
    return tuple(sorted(found, key=lambda one: -one.area))
