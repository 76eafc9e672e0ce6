"""Files of an inspection's flights, read back and judged: what their photos show is counted anew.

    missions → files → waypoints and looks as read back → photos → rays → coverage as flown

The coverage is that of the files, not of the plan: waypoints left out, rounded numbers and a heading that a format does
not hold all count. Photos at waypoints are taken where the file has these, photos by distance on the straight lines
between them.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from maxjax.inspection.inspection import Inspection
from maxjax.inspection.mission_photos import photos_along
from maxjax.inspection.seen_area import Coverage
from maxjax.inspection.views import Views
from maxjax.inspection.visibility import find_sights
from maxjax.io.export.as_flown import AsFlown
from maxjax.io.export.endings import FROM_HOME, ending_of, number_file
from maxjax.io.export.export import export


@dataclasses.dataclass(frozen=True, eq=False)
class FlownFiles:
    """Files of an inspection, and what they make vehicles photograph.

    Attributes:
        files: one a flight.
        flown: what each makes a vehicle fly.
        photos: in the order in which they are taken.
        coverage: what they show; None for formats that hold no photos.
    """

    files: tuple[Path, ...]
    flown: tuple[AsFlown, ...]
    photos: Views
    coverage: Coverage | None

    @classmethod
    def of(cls, files: Sequence[Path], flown: Sequence[AsFlown], inspection: Inspection) -> FlownFiles:
        """What the photos of files that are written show together; one file a flight, all of one format."""
        photos = functools.reduce(Views.joined, (photos_along(one.line, one.looks) for one in flown))
        held = ending_of(files[0]) in FROM_HOME
        return cls(tuple(files), tuple(flown), photos, _seen(photos, inspection) if held else None)

    def __str__(self) -> str:
        names = ", ".join(file.name for file in self.files)
        if self.coverage is None:
            return f"{names}: this format holds no photos"
        return f"{names}: as flown {len(self.photos)} photos: {self.coverage}"


def export_inspection(file: str | Path, inspection: Inspection, **options: Any) -> FlownFiles:
    """Write the flights of an inspection, and count what the photos of the files show.

    Args:
        file: to write or to replace; of several flights each has its number in the name, as town_1.plan.
        inspection: one that is OK.
        options: as those of `maxjax.export`: earth, ground, autopilot and the others.

    Returns:
        The files, and the coverage as flown.

    Raises:
        ValueError, ImportError, OSError: as `maxjax.export`.
    """
    path, count = Path(file), len(inspection.missions)
    files = [path] if count == 1 else [number_file(path, number) for number in range(1, count + 1)]
    flown = [export(one, mission, **options) for one, mission in zip(files, inspection.missions, strict=True)]
    return FlownFiles.of(files, flown, inspection)


def _seen(photos: Views, inspection: Inspection) -> Coverage:
    """What photos show of the surface of an inspection."""
    planned = inspection.coverage
    limits = inspection.capture.limits(inspection.camera)
    sights = find_sights(photos, planned.surface, inspection.scenery, inspection.camera, limits)
    return Coverage.of(planned.surface, sights, planned.wanted, planned.limit)
