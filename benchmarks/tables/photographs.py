"""The table of photographs of buildings and areas."""

from __future__ import annotations

from typing import Any

from benchmarks.common.markdown import Document, device, number, table


def inspection(*documents: Document) -> str:
    """Of `benchmarks.inspection`."""
    return "\n".join(map(_inspection, documents))


def _inspection(document: Document) -> str:
    rows, config = document["rows"], document["config"]
    length, width, height = config["building"]
    building, _, area, _ = rows
    rival = next((row["ortools_seconds"] for row in rows if row.get("ortools_cost_s") is not None), None)
    beside = (
        "OR-Tools is not installed there"
        if rival is None
        else f"OR-Tools' guided local search has the same costs and {rival:g} s"
    )
    return (
        f"### Photographs ({device(document)})\n\n"
        f"A building of {length:g} × {width:g} × {height:g} m from 8 m with overlaps of {config['overlap'][0]:g} and "
        f"{config['overlap'][1]:g}: {building['viewpoints']} viewpoints of {building['tried']:,},\nno fewer than "
        f"{building['least']} of which would do, show {100 * building['share']:.1f} % of {building['area_m2']:,.0f} "
        f"m². An area of {config['area']:g} × {config['area']:g} m from 50 m: {area['photos']} photos of "
        f"{100 * area['share']:.1f} %.\nPlanned and verified all; the first call compiles. A cost is that of the "
        f"longest round, in seconds of flight; {beside}.\n\n"
        + table(["", "first call [s]", "second [s]", "flown [m]", "cost", "OR-Tools' cost"], map(_cells, rows))
    )


def _cells(row: dict[str, Any]) -> list[str]:
    names = ("first_s", "seconds", "length_m", "cost_s", "ortools_cost_s")
    return [row["what"], *("" if row.get(name) is None else number(row[name]) for name in names)]
