"""Plans stage by stage, verdicts, and ways across whole cities."""

from __future__ import annotations

from benchmarks.common.markdown import Document, device, number, table
from benchmarks.common.paper import PAPER
from benchmarks.tables.rows import Row, cell_of, pick, rows_of

_STAGES = {
    "transfer": "to the device and back",
    "dilate": "dilate, choose the margin",
    "formulate": "distances, inflated obstacles, exemptions",
    "solve": "solve, certify",
    "ascend": "ascend",
    "tighten": "tighten",
    "price": "price of the path",
    "verify": "verify",
}


def plans(*documents: Document) -> str:
    """Of `benchmarks.plan`."""

    def line(label: str, what: str, key: str = "median") -> list[str]:
        return [label, *(cell_of(document, what, key) for document in documents)]

    def stage_line(label: str, stage: str) -> list[str]:
        # Where a plan is one program, its stages were timed by themselves.
        names = f"stages, solver: {stage}", f"plan, solver: {stage}"
        return [label, *(next(filter(None, (cell_of(document, name) for name in names)), "") for document in documents)]

    stages = [stage_line(label, stage) for stage, label in _STAGES.items()]
    lines = [cells for cells in stages if any(cells[1:])]
    lines += [
        line("all before verify, as one program", "plan, solver: device"),
        line("**whole plan**", "plan, solver: total"),
        line("whole plan, slowest", "plan, solver: total", "max"),
        line("programs compiled, or read from disk, once [s]", "plan, solver: total", "compile_s"),
        line("A\\*: search", "plan, astar: search"),
        line("**A\\*: whole plan**", "plan, astar: total"),
    ]
    totals = [row for d in documents if (row := pick(d, "what", "plan, solver: total"))]
    solved = " and ".join(f"{row['solved']} of {row['n']}" for row in totals)
    batches = [
        f"{row['what'].removesuffix(': a plan').capitalize()}, {device(document)}: "
        f"{row['plans_per_second']:,.0f} plans a second{_compiled(row)}."
        for document in documents
        for row in document["rows"]
        if "plans_per_second" in row
    ]
    memory = cell_of(documents[0], "peak memory of a process that plans once")
    return (
        "### A plan, stage by stage\n\n"
        "Random problems on the three maps, 101³ voxels, margin asked 8 m: median [ms], compilation apart. Each stage\n"
        "has its own median; on a GPU, where a plan runs as one program, the stages are of another run that waits for\n"
        f"each. Solved: {solved} problems. A process that plans once peaks at {memory} MB.\n\n"
        + table(["", *map(device, documents)], lines)
        + "".join(f"\n{batch}\n" for batch in batches)
        + "".join(f"\n{_beside_the_paper(document)}\n" for document in documents[1:])
        + "\nOn a GPU a single plan waits, it does not compute: flood fills, ascent and tightening are many kernels\n"
        "of a few microseconds, one after the other. Of a batch it is sent each map once, as bits, and the ends; it\n"
        "chooses and cuts the windows itself, and all paths are verified together at the end.\n"
    )


def _compiled(row: Row) -> str:
    """What a first batch compiles; nothing where the one before it left its programs."""
    told = f"; before the first,\nprograms of all sizes compile, {row['compile_s']:.0f} s added up"
    return told if row["compile_s"] else ""


def _beside_the_paper(document: Document) -> str:
    """How many times as long the paper's planner takes, on its own machine and problems."""
    total = pick(document, "what", "plan, solver: total")
    assert total is not None
    # The quicker of its two maps.
    theirs = min(1e3 * methods["3DMaxConvNet"][2] for methods in PAPER.values())
    told = (
        f"The paper states {theirs:.0f} ms for a plan by its network, on its own machine and problems: "
        f"{number(theirs / total['median'])} times\na plan on the {device(document)}"
    )
    together = min((row["median"] for row in document["rows"] if "plans_per_second" in row), default=None)
    return f"{told}{'' if together is None else f', {number(theirs / together)} times one of a batch'}."


def verdicts(*documents: Document) -> str:
    """Of `benchmarks.verifier`."""
    lines = []
    for document in documents:
        rows = {row["what"]: row for row in document["rows"]}
        several = next((row for what, row in rows.items() if what.endswith("cores")), None)
        figures = (rows.get(f"{who}, {what}") for what in ("one", "batch") for who in ("plain", "compiled"))
        cells = [f"{row['median']:.3g}" if row else "" for row in (*figures, several)]
        paths = str(rows["plain, batch"]["paths"])
        lines.append([device(document), *cells, paths, str(several["differ"]) if several else ""])
    heads = ["on", "one, plain", "one, compiled", "batch, plain", "batch, compiled", "on all cores", "paths", "differ"]
    return (
        "### Verdicts\n\n"
        "The verifier in NumPy and the same compiled, on one core and at last on all: median [ms a path]. Each path\n"
        "lies in a map of its own, of 101³ voxels. Differ: paths of which the two do not say the same, bit by bit.\n\n"
        + table(heads, lines)
    )


def cities(*documents: Document) -> str:
    """Of `benchmarks.city_plan`."""
    lines, whole = [], {str(row["what"]): row for row in rows_of(documents) if not row["focus"]}
    for row in rows_of(documents):
        beside = whole.get(str(row["what"]), row)
        lines.append(
            [
                str(row["what"]) + ("" if row["focus"] else ", whole map"),
                str(row["status"]) + (", certified" if row["certified"] else ""),
                *(number(row[key]) for key in ("straight_m", "length_m")),
                f"{row['length_m'] / beside['length_m']:.4f}" if beside is not row else "",
                *(number(row[key]) for key in ("seconds", "first_seconds", "memory_beyond_MB")),
            ]
        )
    heads = ["", "", "straight [m]", "length [m]", "over whole map", "[s]", "first [s]", "beyond the map [MB]"]
    return (
        f"### Across whole cities ({device(documents[0])})\n\n"
        "Voxels of 2 m. The second plan of a process, and the first, which compiles; and the peak memory of both\n"
        "beyond that of a process that holds the map.\n\n" + table(heads, lines, left=2)
    )
