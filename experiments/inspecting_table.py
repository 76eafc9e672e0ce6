"""The section of RESULTS.md on photographs of buildings and areas."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.stats import binomtest

from benchmarks.common.markdown import Document, device, number, table, trials
from experiments.qgc_patterns import LOWEST

_HEADS = (
    "photos",
    "flown [m]",
    "time [s]",
    "seen [%], maxjax / C MuJoCo",
    "as often as asked [%]",
    "façades [%]",
    "incidence [°]",
    "least clearance [m]",
    "legs that hit",
    "flights that hit",
    "pass the verifier",
)
Rows = Sequence[dict[str, Any]]


def section(document: Document) -> str:
    """Its part of RESULTS.md."""
    config, rows = document["config"], document["rows"]
    flown = [row for row in rows if "photos" in row]
    of_buildings = [row for row in flown if row["target"] is not None]
    of_areas = [row for row in flown if row["target"] is None]
    ways = list(dict.fromkeys(row["way"] for row in of_buildings))
    # What one way could not do is left out of all means.
    common = (
        set.intersection(*({_key(row) for row in of_buildings if row["way"] == way} for way in ways)) if ways else set()
    )
    both = [row for row in of_buildings if _key(row) in common]
    cities = list(dict.fromkeys(row["city"] for row in both))
    overall = [[way, *_cells([row for row in both if row["way"] == way])] for way in ways]
    each = [
        [f"{city}, {way}", *_cells([row for row in both if row["city"] == city and row["way"] == way])]
        for city in cities
        for way in ways
    ]
    above = [[f"{row['city']}, {row['way']}", *_cells([row])] for row in of_areas]
    forward, sideways = config["overlap"]
    text = (
        f"### Photographs of buildings and areas ({device(document)})\n\n"
        f"{len(common)} buildings of {', '.join(cities)}, photographed from {config['distance']:g} m with overlaps of "
        f"{forward:g} and {sideways:g};\n{trials(document)}.\n"
        "maxjax is `maxjax.inspect`; greedy takes of the same candidates always the one that shows most; the structure "
        "scan is\nQGroundControl's by its user guide, written anew: it knows the outline of the building and its "
        "height, and nothing around it.\nMeans over the buildings; the least clearance is that of all flights, as the "
        "true distance to the faces of the city, 0 where\na flight passes through one. Photos count as if nothing had "
        "been hit before. Simulated cities are known by their voxels,\nand a building there is a single solid. Laps at "
        f"{LOWEST:g} m do not pass the verifier, which keeps a voxel off the ground. "
        f"{_planned(both)}\n\n"
        f"{table(['way', *_HEADS], overall)}\n{_bounds(both, ways)}\n{_refused(rows)}\n"
        f"{table(['city, way', *_HEADS], each)}\n{_files(flown)}\n"
    )
    if not above:
        return text
    return (
        f"{text}\nAreas of {config['side']:g} × {config['side']:g} m around one building of each city, from "
        f"{config['above']:g} m above the ground with overlaps of 0.75 and 0.65,\nlines reaching "
        f"{0.25 * config['side']:g} m beyond; survey is QGroundControl's by its user guide, over the same square.\n\n"
        f"{table(['city, way', *_HEADS], above)}"
    )


def _key(row: dict[str, Any]) -> tuple[str, int]:
    return row["city"], row["target"]


def _cells(rows: Rows) -> list[str]:
    """Means of some flights, and the least clearance."""

    def mean(name: str, how: Callable[[float], str] = number, scale: float = 1.0) -> str:
        return how(scale * float(np.mean([row[name] for row in rows])))

    def share(name: str) -> str:
        return mean(name, lambda value: f"{value:.1f}", 100.0)

    return [
        mean("photos", lambda value: f"{value:,.0f}"),
        mean("length_m", lambda value: f"{value:,.0f}"),
        mean("seconds", lambda value: f"{value:,.0f}"),
        f"{share('share')} / {share('share_rays')}",
        f"{share('share_wanted')} / {share('share_wanted_rays')}",
        share("share_walls") if rows[0]["target"] is not None else "",
        mean("incidence_deg", lambda value: f"{value:.1f}"),
        f"{min(row['clearance_m'] for row in rows):.2f}",
        str(sum(row["legs_hit"] for row in rows)),
        f"{sum(row['legs_hit'] > 0 for row in rows)} of {len(rows)}",
        f"{sum(row['verified'] for row in rows)} of {len(rows)}",
    ]


def _planned(rows: Rows) -> str:
    """How long it took to plan."""
    told = [
        f"{way} {np.median([row['plan_s'] for row in rows if row['way'] == way]):.1f} s"
        for way in dict.fromkeys(row["way"] for row in rows if row["plan_s"] is not None)
    ]
    return f"Planned and verified in the median, with what was compiled anew: {', '.join(told)}."


def _bounds(rows: Rows, ways: Sequence[str]) -> str:
    """Bounds of the shares of flights that hit something."""
    told = []
    for way in ways:
        own = [row for row in rows if row["way"] == way]
        hit = sum(row["legs_hit"] > 0 for row in own)
        bounds = binomtest(hit, len(own)).proportion_ci(confidence_level=0.95, method="exact")
        told.append(f"{way} {100 * bounds.low:.1f} to {100 * bounds.high:.1f} %")
    return f"Flights that hit something, by Clopper and Pearson, 95 %: {'; '.join(told)}.\n"


def _refused(rows: Rows) -> str:
    """What could not be photographed, and why."""
    told = [
        f"{row['city']}, target {row['target']}, {row['way']}: {row['status'].partition(', given')[0]}"
        for row in rows
        if "photos" not in row
    ]
    return f"Left out of the means: {'; '.join(told)}.\n" if told else ""


def _files(rows: Rows) -> str:
    """What the files of maxjax's flights show, and how many there are."""
    own, told = [row for row in rows if "share.plan" in row or "refused.plan" in row], list[str]()
    for ending in (".plan", ".waypoints", ".kmz", "_litchi.csv"):
        written = [row for row in own if f"share{ending}" in row]
        if written:
            less = 100.0 * max(max(row["share"] - row[f"share{ending}"] for row in written), 0.0)
            told.append(f"`{ending}` {len(written)} of {len(own)}, {less:.1f}")
    taken = [row for row in own if row["target"] is not None and row.get("photos_by_pymavlink") is not None]
    same = sum(row["photos_by_pymavlink"] == row["photos"] for row in taken)
    text = (
        f"Files of {len(own)} of maxjax's flights, read back: how many could be written, and by how many points of 100 "
        f"the share\nthat their photos show is lower at most: {'; '.join(told)}."
    )
    if taken:
        text += f" pymavlink finds every\nphoto in {same} of {len(taken)} files of buildings for ArduCopter."
    reasons = Counter(row[name].partition(", given")[0] for row in own for name in row if name.startswith("refused"))
    why = "; ".join(f"{count} times: {reason}" for reason, count in sorted(reasons.items()))
    return f"{text} Refused {why}." if why else text
