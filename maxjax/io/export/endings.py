"""Formats by the endings of names: what each of them needs."""

from __future__ import annotations

from pathlib import Path

STOPPING = (".kmz", "_litchi.csv")
"""Waypoints for programs whose vehicles stop at each of them."""
FROM_HOME = (".plan", ".waypoints", *STOPPING)
"""Waypoints at heights above the ground at home."""
ON_EARTH = (*FROM_HOME, ".geojson", ".kml")
"""Latitudes and longitudes, which need a place on Earth."""
IN_TIME = (".csv", ".tum", ".rosbag")
"""Times, which need a trajectory."""


def ending_of(file: Path) -> str:
    """What says the format of a file, in small letters: `_litchi.csv`, else what follows the last dot of its name."""
    name = file.name.lower()
    return "_litchi.csv" if name.endswith("_litchi.csv") else file.suffix.lower()


def number_file(file: Path, number: int) -> Path:
    """The file of one of several flights: `way.plan` as `way_2.plan`, `way_ned.csv` as `way_2_ned.csv`."""
    ending = "_ned.csv" if is_ned(file) else ending_of(file)
    stem, kept = file.name[: len(file.name) - len(ending)], file.name[len(file.name) - len(ending) :]
    return file.with_name(f"{stem}_{number}{kept}")


def is_ned(file: Path) -> bool:
    """Whether a file holds set-points in NED."""
    return file.name.lower().endswith("_ned.csv")
