"""The field and A* beside each other."""

from __future__ import annotations

from collections.abc import Mapping

from benchmarks.common.markdown import Document, device, number, table
from benchmarks.tables.rows import Row


def rivals(*documents: Document) -> str:
    """Of `benchmarks.rivals`."""
    parts = "\n".join(map(_rivals, documents))
    return (
        "### Who wins where\n\n"
        "Beside A\\* with the same rules, prices and maps, 101³ voxels, compiled (C++) and in Python. A search begins\n"
        "with blocked voxels and prices and ends with a path of voxels; a plan begins with the map and ends with a\n"
        "verified path, whichever method finds it; the field's paths are certified and at any angle. Queries and\n"
        "plans: median and, in brackets, 99th percentile [ms] over problems, of each the least of three runs;\n"
        "searches on one core. Batches: on all cores, plans by A\\* a process a core. Fleets, priced: all starts\n"
        "together [ms], 20 to 80 m from their goal or anywhere on the map; plans by A\\* one after the other.\n\n"
        + parts
    )


def _rivals(document: Document) -> str:
    rows = {str(row["what"]): row for row in document["rows"]}

    def cell(what: str) -> str:
        row = rows.get(what)
        if row is None or "note" in row:
            return ""
        if "per_second" in row:
            return f"{number(row['per_second'])} a second"
        return number(row["median"]) + (f" ({number(row['p99'])})" if row["n"] > _PERCENTILE else "")

    lines = []
    for told in ("by length", "priced"):
        searches = (cell(f"query, {told}: {one}") for one in ("compiled A*", "A* in Python"))
        lines.append([f"one search, {told}", "", *searches])
        lines.append([f"one plan, {told}", cell(f"plan, {told}: solver"), cell(f"plan, {told}: astar"), ""])
    for told in ("by length", "priced"):
        lines.append([f"batch, {told}: searches", "", cell(f"batch, {told}: compiled A*"), ""])
        lines.append(
            [f"batch, {told}: plans", cell(f"batch, {told}: plan_batch"), cell(f"batch, {told}: plans by A*"), ""]
        )
    fleets = list(dict.fromkeys(what.split(":")[0] for what in rows if what.startswith("fleet")))
    for fleet in fleets:
        lines.append(
            [f"{fleet}: field, searches", cell(f"{fleet}: the field alone"), cell(f"{fleet}: compiled A*"), ""]
        )
        lines.append([f"{fleet}: plans", cell(f"{fleet}: plan_fleet"), cell(f"{fleet}: plans by A*"), ""])
    sentences = [_field_and_searches(rows, fleet) for fleet in fleets if f"{fleet}: compiled A*" in rows]
    peers = [row for what, row in rows.items() if "dijkstra3d." in what]
    if peers:
        figures = {str(row["what"]).split(".")[1]: number(row["median"]) for row in peers}
        told = " and ".join(f"`{name}` {figure} ms" for name, figure in figures.items())
        sentences.append(f"dijkstra3d's full distance fields, which cut corners, on one core: {told}.")
    if (row := rows.get("sampled paths")) is not None and row["over"] is not None:
        rate, found, safe = number(row["per_second"]), row["found"], row["safe"]
        sentences.append(
            f"Paths through three layers of random points, as GTMP finds them (arXiv:2411.19393): {rate} a second;\n"
            f"of {found:,} that were found free at points, {safe:,} are safe to the verifier; the shortest safe one\n"
            f"of each problem ({row['solved']} have one) is {row['over']:.2f} times as long as the field's, median.\n"
            "They have no clearance price and no certificate."
        )
    sentences += [f"{row['what']}: {row['note']}." for row in rows.values() if "note" in row]
    heads = [f"on {device(document)}", "field", "A\\*, compiled", "A\\*, Python"]
    measured = [line for line in lines if any(line[1:])]
    return table(heads, measured) + "".join(f"\n{sentence}\n" for sentence in sentences)


# Of so many times a 99th percentile says something.
_PERCENTILE = 10


def _field_and_searches(rows: Mapping[str, Row], fleet: str) -> str:
    """What a fleet's field, or all of its plans, take beside searches and plans by A*."""
    field, plans, searches, rival = (
        rows[f"{fleet}: {what}"]["median"] for what in ("the field alone", "plan_fleet", "compiled A*", "plans by A*")
    )
    whole, bare, verified = (number(ratio) for ratio in (searches / field, plans / searches, rival / plans))
    return (
        f"{fleet.capitalize()}: the searches take {whole} times as long as the field alone; `plan_fleet`, which\n"
        f"verifies its paths, takes {bare} times as long as these, and plans by A\\* {verified} times as long as it."
    )
