"""Standing objects by the tags of OpenStreetMap: kind, width, and height where no tag gives it.

A thing without a height of its own is as tall as such things may be, where that is known (trees, walls, pylons), and
counted where it is not (a mast may have any height). What the table does not name stands where a height is stated,
unless it is a way to go, whose height is that of vehicles. A node or a line is as wide as its tags say, else as the
table does. All reach down to the ground; wires and bridges too, as nobody wants to fly under them. A bridge without a
height is 12 m tall for each layer, with its girders and what drives on it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from maxjax.io.readers.tag_heights import length, tall

_NOTHING = ("no", "none", "proposed", "construction_site", "demolished", "razed", "underground")
# No, as OpenStreetMap and files made of it write it.
_NO = ("", "no", "none", "n", "f", "false", "0", "null", "nan")
_LAYER = 12.0  # from deck to deck of bridges [m]
_LANE, _BESIDE_LANES = 3.5, 3.0  # widths [m]
# Keys by which what lies flat is counted.
_FLAT_KEYS = (
    "highway", "railway", "waterway", "natural", "landuse", "leisure", "amenity", "aeroway", "historic", "tourism",
    "place", "boundary", "public_transport",
)  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Kind:
    """A kind of thing that stands.

    Attributes:
        name: in the plural, for counts.
        key: of the tag that says so, by which a user chooses.
        width: of a node or a line [m].
        height: where nothing says it [m]; None: any.
        line: whether a closed way of it is a line around something, not an area.
    """

    name: str
    key: str
    width: float
    height: float | None = None
    line: bool = False


_KINDS: Mapping[str, Mapping[str, Kind]] = {
    "man_made": {
        name: Kind(plural, "man_made", width, height)
        for name, plural, width, height in (
            ("mast", "masts", 4.0, None), ("tower", "towers", 10.0, None), ("chimney", "chimneys", 10.0, None),
            ("communications_tower", "towers", 20.0, None), ("water_tower", "water towers", 15.0, None),
            ("lighthouse", "lighthouses", 15.0, None), ("silo", "silos", 15.0, None),
            ("antenna", "antennas", 4.0, None),
            ("storage_tank", "tanks", 25.0, None), ("gasometer", "tanks", 50.0, None), ("crane", "cranes", 20.0, None),
            ("cooling_tower", "chimneys", 60.0, None), ("windmill", "windmills", 30.0, None),
            ("flagpole", "flagpoles", 2.0, 25.0), ("utility_pole", "poles", 2.0, 20.0),
            ("street_lamp", "poles", 4.0, 15.0), ("monitoring_station", "masts", 4.0, None),
            ("kiln", "chimneys", 10.0, None), ("obelisk", "towers", 10.0, None), ("works", "works", 10.0, None),
            ("gantry", "gantries", 4.0, 12.0), ("pipeline", "pipelines", 3.0, 10.0),
            ("bridge", "bridges", 15.0, _LAYER),
            ("pier", "piers", 5.0, 10.0), ("dyke", "dykes", 20.0, 15.0), ("embankment", "dykes", 10.0, 15.0),
        )
    },
    "power": {
        "tower": Kind("pylons", "power", 15.0, 80.0),
        "pole": Kind("poles", "power", 4.0, 20.0),
        "portal": Kind("pylons", "power", 25.0, 40.0),
        "line": Kind("power lines", "power", 30.0, 80.0, line=True),
        "minor_line": Kind("power lines", "power", 6.0, 20.0, line=True),
        "catenary_mast": Kind("poles", "power", 4.0, 15.0),
        "substation": Kind("substations", "power", 10.0, 20.0),
        "generator": Kind("generators", "power", 100.0, None),
    },
    "barrier": {
        name: Kind(plural, "barrier", width, height, line=True)
        for name, plural, width, height in (
            ("wall", "walls", 1.0, 6.0), ("fence", "fences", 1.0, 4.0), ("hedge", "hedges", 3.0, 6.0),
            ("city_wall", "walls", 4.0, 20.0), ("retaining_wall", "walls", 1.0, 10.0),
            ("guard_rail", "fences", 1.0, 2.0),
        )
    },
    "natural": {
        "tree": Kind("trees", "natural", 12.0, 30.0),
        "tree_row": Kind("rows of trees", "natural", 12.0, 30.0, line=True),
        "wood": Kind("woods", "natural", 12.0, 30.0),
    },
    "landuse": {
        "forest": Kind("woods", "natural", 12.0, 30.0),
    },
    "advertising": {
        name: Kind("billboards", "man_made", width, height)
        for name, width, height in (
            ("billboard", 8.0, 20.0), ("screen", 8.0, 20.0), ("totem", 4.0, 40.0), ("column", 3.0, 8.0),
            ("sign", 4.0, 15.0), ("board", 4.0, 6.0),
        )
    },
    "historic": {
        "monument": Kind("monuments", "man_made", 20.0, 60.0),
    },
    "leisure": {
        "stadium": Kind("stadiums", "man_made", 100.0, 60.0),
    },
    "highway": {
        "street_lamp": Kind("poles", "man_made", 4.0, 15.0),
    },
    "aerialway": {
        "pylon": Kind("pylons", "aerialway", 10.0, 50.0),
    },
}  # fmt: skip
BUILDING = Kind("buildings", "building", 10.0)
_OTHER = {
    key: Kind(plural, key, 5.0, line=key == "barrier")
    for key, plural in (
        ("man_made", "other structures"),
        ("power", "other power structures"),
        ("barrier", "other barriers"),
        ("aerialway", "other aerialways"),
    )
}
# A line or a point that is neither named nor known, with a height of its own.
ANYTHING = Kind("shapes", "other", 2.0)
# What lies flat or below the ground, whatever it is tagged.
_FLAT = (
    "cutline", "surveillance", "survey_point", "water_well", "reservoir_covered", "manhole", "tunnel",
    "cable", "plant", "entrance", "ditch", "kerb", "border_control", "toll_booth",
)  # fmt: skip


def kind_of(tags: Mapping[str, str]) -> Kind | None:
    """The kind of standing object with these tags; None if it is none."""
    if any(tags.get(key, "no") not in _NOTHING for key in ("building", "building:part")):
        return BUILDING
    if tags.get("bridge", "no").lower() not in (*_NO, *_NOTHING, "boardwalk", "low_water_crossing"):
        return _bridge(tags)
    for key, values in _KINDS.items():
        value = tags.get(key, "no")
        if value in values:
            return _bridge(tags) if value == "bridge" else values[value]
        if key in _OTHER and value not in (*_NOTHING, *_FLAT):
            return _OTHER[key]
    # Of a road, a height is that of what may pass; what is no building is nothing.
    if any(key in tags for key in ("building", "building:part", "highway", "railway")):
        return None
    stated = any(key in tags for key in ("height", "est_height", "height:hub"))
    return ANYTHING if stated and tall(tags).metres is not None else None


def _bridge(tags: Mapping[str, str]) -> Kind:
    """A bridge as tall as its layer says."""
    lanes = length(tags.get("lanes", ""))
    kind = _KINDS["man_made"]["bridge"]
    width = kind.width if lanes is None else max(kind.width, _LANE * lanes[0] + _BESIDE_LANES)
    return dataclasses.replace(kind, width=width, height=_LAYER * max(_layer(tags), 1))


def is_underground(tags: Mapping[str, str]) -> bool:
    """Whether a thing lies below the ground, or below water."""
    below = tags.get("location") in ("underground", "underwater") or _layer(tags) < 0
    return below or any(tags.get(key, "no").lower() not in _NO for key in ("tunnel", "is_underground"))


def flat_name(tags: Mapping[str, str]) -> str:
    """How what is no standing thing is counted."""
    other = "address" if any(key.startswith("addr:") for key in tags) else "other"
    return f"{next((key for key in _FLAT_KEYS if key in tags), other)} shapes without a height"


def _layer(tags: Mapping[str, str]) -> int:
    """The number of the layer; 0 where it is none."""
    try:
        return int(tags.get("layer", "0"))
    except ValueError:
        return 0


def width_of(tags: Mapping[str, str], kind: Kind) -> tuple[float, bool]:
    """Width of a node or a line [m], and whether its tags say it."""
    # The diameter of a tree is its trunk's.
    keys = ("diameter_crown",) if kind.key == "natural" else ("diameter", "rotor:diameter")
    found = [read[0] for key in ("width", *keys) if (read := length(tags.get(key, ""))) is not None and read[0] > 0]
    return (max(found), True) if found else (kind.width, False)
