"""Tables of the benchmarks' result files, for the README and RESULTS.md.

Each function takes the documents of one table, those that there are: CPU first, then GPU.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from benchmarks.common.markdown import Document, device, is_cpu, number, table
from benchmarks.common.paper import PAPER

Row = dict[str, Any]
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


def _pick(document: Document, key: str, value: str) -> Row | None:
    return next((row for row in document["rows"] if row[key] == value), None)


def _cell(document: Document, what: str, key: str = "median") -> str:
    row = _pick(document, "what", what)
    return number(row[key]) if row is not None and key in row else ""


def plans(*documents: Document) -> str:
    """Of `benchmarks.plan`."""

    def line(label: str, what: str, key: str = "median") -> list[str]:
        return [label, *(_cell(document, what, key) for document in documents)]

    def stage_line(label: str, stage: str) -> list[str]:
        # Where a plan is one program, its stages were timed by themselves.
        names = f"stages, solver: {stage}", f"plan, solver: {stage}"
        return [label, *(next(filter(None, (_cell(document, name) for name in names)), "") for document in documents)]

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
    totals = [row for d in documents if (row := _pick(d, "what", "plan, solver: total"))]
    solved = " and ".join(f"{row['solved']} of {row['n']}" for row in totals)
    batches = [
        f"{row['what'].removesuffix(': a plan').capitalize()}, {device(document)}: "
        f"{row['plans_per_second']:,.0f} plans a second{_compiled(row)}."
        for document in documents
        for row in document["rows"]
        if "plans_per_second" in row
    ]
    memory = _cell(documents[0], "peak memory of a process that plans once")
    return (
        "### A plan, stage by stage\n\n"
        "Random problems on the three maps, 101³ voxels, margin asked 8 m: median [ms], compilation apart. Each stage\n"
        "has its own median; on a GPU, where a plan runs as one program, the stages are of another run that waits for\n"
        f"each. Solved: {solved} problems. A process that plans once peaks at {memory} MB.\n\n"
        + table(["", *map(device, documents)], lines)
        + "".join(f"\n{batch}\n" for batch in batches)
        + "".join(f"\n{_beside_the_paper(document)}\n" for document in documents[1:])
        + "\nOn a GPU a single plan waits, it does not compute: flood fills, ascent and tightening are many kernels\n"
        "of a few microseconds, one after the other. In a batch the host packs the next chunk while the\n"
        "device plans, and verifies all paths together at the end.\n"
    )


def _compiled(row: Row) -> str:
    """What a first batch compiles; nothing where the one before it left its programs."""
    told = f"; before the first,\nprograms of all sizes compile, {row['compile_s']:.0f} s added up"
    return told if row["compile_s"] else ""


def _beside_the_paper(document: Document) -> str:
    """How many times as long the paper's planner takes, on its own machine and problems."""
    total = _pick(document, "what", "plan, solver: total")
    assert total is not None
    alone = total["median"]
    together = min((row["median"] for row in document["rows"] if "plans_per_second" in row), default=alone)
    # The quicker of its two maps.
    theirs = min(1e3 * methods["3DMaxConvNet"][2] for methods in PAPER.values())
    return (
        f"The paper states {theirs:.0f} ms for a plan by its network, on its own machine and problems: "
        f"{number(theirs / alone)} times\n"
        f"a plan on the {device(document)}, {number(theirs / together)} times one of a batch."
    )


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


# Rows of `solve, MAP: …`, and their heads.
_PEERS = {
    "SciPy CG, Jacobi, component": "SciPy",
    "SciPy CG, Jacobi, whole grid": "SciPy, whole grid",
    "PyAMG smoothed aggregation + CG, component": "PyAMG",
    "JAX, Jacobi-PCG, whole grid": "JAX",
    "CuPy CG, Jacobi, component": "CuPy",
}


def solves(*documents: Document) -> str:
    """Of `benchmarks.potential`."""
    lines = []
    for document in documents:
        for name in [*document["config"]["maps"], document["config"]["crop"]]:
            ours = _pick(document, "what", f"solve, {name}: maxjax")
            if ours is not None:
                peers = [_peer(_pick(document, "what", f"solve, {name}: {peer}"), ours) for peer in _PEERS]
                angle = f"{100 * ours['within_1deg']:.2f} %"
                lines.append([name, device(document), number(ours["median"]), *peers, angle])
    heads = ["map", "maxjax on", "maxjax", *_PEERS.values(), "within 1°"]
    batches = [
        f"{row['what'].removeprefix('batch: ')} scenes a call, {device(document)}: {number(row['median'])} ms a scene, "
        f"{number(row['times_floor'])} times\nthe floor of reading σ and writing φ once at the rate of a copy."
        for document in documents[1:]
        for row in document["rows"]
        if row["what"].startswith("batch: ") and row["what"] != "batch: 1"
    ]
    return (
        "### The solve beside its peers\n\n"
        "From conductivity to certified potential, 101³ voxels: median [ms]. Peers: conjugate gradients with\n"
        "Jacobi's preconditioner by SciPy (on the free voxels of the goal's component, or on the whole grid), JAX and\n"
        "CuPy, and PyAMG's smoothed aggregation, set-up included; in brackets how many times ours. They are handed\n"
        "the assembled matrix and stopped, with hindsight, as soon as their gradient directions are as good as ours.\n"
        "Last column: voxels whose gradient of log φ from maxjax lies within 1° of a float64 reference.\n\n"
        + table(heads, lines, left=2)
        + "".join(f"\n{batch}\n" for batch in batches)
    )


def _peer(row: Row | None, ours: Row) -> str:
    if row is None or "median" not in row:
        return ""
    return f"{number(row['median'])} ({number(row['times_ours'])})" + ("" if row["as_good"] else ", not as good")


def profile(*documents: Document) -> str:
    """Of `benchmarks.profile`."""
    return (
        "### Where a device's time goes\n\n"
        "Kernel time by step of the method [µs a scene], in brackets the kernels of a call; what wall clock exceeds\n"
        "the sum by is spent between kernels. `waits`: a synchronisation at the condition of a loop. `city`: on so\n"
        "many devices, means over these; `exchange`: what they exchange, waits included. On a CPU operations stand\n"
        "for kernels; some run beside each other, and those that shift arrays by a voxel have lost their names.\n\n"
        + "\n".join(map(_profile, documents))
    )


def _profile(document: Document) -> str:
    rows = {row["what"]: row for row in document["rows"]}
    config = document["config"]
    kinds = ("solve", config["scenes"]), ("plan", config["plans"]), ("city", config.get("cities", ()))
    counts = [(what, n) for what, several in kinds for n in several]
    # Scenes that share the time of a call.
    scenes = {(what, n): 1 if what == "city" else n for what, n in counts}
    steps = dict.fromkeys(what.split(": ")[1] for what in rows if not what.startswith("copy"))
    lines = []
    for step in (*(step for step in steps if step != "all"), "all"):
        found = [(rows.get(f"{what}, {n}: {step}"), scenes[what, n]) for what, n in counts]
        cells = [f"{number(row['us'] / share)} ({row['kernels']:.0f})" if row else "" for row, share in found]
        lines.append(["**all kernels**" if step == "all" else step, *cells])
    walls = ((rows[f"{what}, {n}: all"]["wall_us"], scenes[what, n]) for what, n in counts)
    lines.append(["wall clock", *(number(wall / share) for wall, share in walls)])
    rates = []
    for what, n in counts:
        sweep, copy = rows.get(f"{what}, {n}: sweep"), rows.get(f"copy, {n}: copy")
        if what == "solve" and sweep and copy:
            least, most = number(sweep["gb_per_s"]), number(copy["gb_per_s"])
            rates.append(
                f"\nIn `solve, {n}` a sweep passes the six arrays that it cannot do without at {least} GB/s; a plain\n"
                f"copy runs at {most} GB/s.\n"
            )
    heads = ["step", *(f"{what}, {n}" for what, n in counts)]
    where = device(document)
    several = is_cpu(document) or " x " in where
    size = f", a city of {' × '.join(map(str, config['city']))} voxels" if config.get("cities") else ""
    return f"On {where if several else f'one {where}'}{size}:\n\n" + table(heads, lines) + "".join(rates)


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


def lidar(*documents: Document) -> str:
    """Of `benchmarks.lidar`."""
    methods = ("fused kernel", "scan: fused kernel, noise, dropout", "vmapped mjx.ray", "C mj_multiRay")
    lines = []
    for document in documents:
        for name in document["config"]["maps"]:
            rows = {row["method"]: row for row in document["rows"] if row["map"] == name}
            off = " / ".join(str(rows[method]["rays_off_by_1mm"]) for method in (methods[0], methods[2]))
            times = [number(rows[method]["median_ms"]) for method in methods]
            lines.append([name, device(document), str(rows[methods[0]]["geoms"]), *times, off])
    rays = documents[0]["config"]["rays"]
    heads = ["map", "on", "geoms", "fused kernel", "with noise", "`mjx.ray`", "C `mj_multiRay`", "off"]
    return (
        "### LiDAR\n\n"
        f"One scan of {rays:,} rays: median [ms]. With noise: the fused kernel with range noise and dropout.\n"
        "`mjx.ray` runs under `vmap`, C MuJoCo on one thread of the machine's CPU. Off: rays of the fused kernel / of\n"
        "`mjx.ray` that differ from C `mj_ray` by more than a millimetre within range.\n\n"
        + table(heads, lines, left=2)
    )


def flights(*documents: Document) -> str:
    """Of `benchmarks.flight`."""
    lines, stages = [], []
    for document in documents:
        for row in document["rows"]:
            what, name = row["what"].split(", ")
            if what == "flights":
                figures = [number(row[key]) for key in ("seconds", "flights_per_s")]
                lines.append([name, device(document), str(row["batch"]), *figures, str(row["arrived"])])
        for name in document["config"]["maps"]:
            found = [row for row in document["rows"] if row["what"].startswith(f"stage, {name}: ")]
            if found:
                shares = [f"{row['ms_per_flight']:.3f}" for row in found]
                stages.append([name, device(document), str(found[0]["batch"]), *shares])
    heads = ["map", "on", "flights", "seconds", "flights a second", "arrived"]
    return (
        "### Flights in batches\n\n"
        "Whole flights, 50 to 80 m, from drawn worlds to logs on the host, all of a batch in one call; compilation\n"
        "apart.\n\n"
        + table(heads, lines, left=2)
        + "\nOne planning iteration by stage, in a batch under way [ms a flight]:\n\n"
        + table(["map", "on", "flights", "sense", "fuse", "plan", "follow"], stages, left=2)
    )


def cities(*documents: Document) -> str:
    """Of `benchmarks.city_plan`."""
    lines, whole = [], {str(row["what"]): row for row in _rows(documents) if not row["focus"]}
    for row in _rows(documents):
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


def _rows(documents: tuple[Document, ...]) -> list[Row]:
    return [row for document in documents for row in document["rows"]]


def scaling(*documents: Document) -> str:
    """Of `benchmarks.flight --devices`, `benchmarks.training` and `benchmarks.city_scale`."""
    lines = []
    for document in documents:
        single: dict[str, float] = {}
        for row in document["rows"]:
            if "flights_per_s" in row:
                what = f"{row['batch'] // row['devices']} flights a device, {row['what'].removeprefix('devices, ')}"
                figure, rate = f"{row['flights_per_s']:.1f} a second", row["flights_per_s"]
            elif "seconds_an_epoch" in row:
                what = f"{row['what']}, batch of {row['batch']}"
                figure, rate = f"{row['seconds_an_epoch']:.2f} s an epoch", 1 / row["seconds_an_epoch"]
            elif "median" in row:
                what = f"potential of a city, {' × '.join(map(str, document['config']['shape']))}"
                figure, rate = f"{row['median']:.0f} ms", 1 / row["median"]
            else:
                continue
            times = rate / single.setdefault(what, rate / row["devices"])
            lines.append([what, str(row["devices"]), figure, f"{times:.2f}", f"{times / row['devices']:.2f}"])
    kinds = ", ".join(dict.fromkeys(str(d["provenance"]["device"]).split(" x ")[-1] for d in documents))
    flown = any("flights_per_s" in row for document in documents for row in document["rows"])
    flights = "Flights: as many on each device (weak scaling). " if flown else ""
    return (
        f"### Several devices ({kinds})\n\n"
        f"{flights}Training and city: the same work, split (strong scaling).\n\n"
        + table(["what", "devices", "", "times one device", "of linear"], lines)
    )


def fuzz(document: Document) -> str:
    """Of `tests.fuzz`."""
    counts = ("inputs", "refused", "taken", "otherwise")
    rows = document["rows"]
    total = {"format": "all", **{key: sum(row[key] for row in rows) for key in (*counts, "seconds")}}
    lines = [[row["format"], *(f"{row[key]:,}" for key in counts), f"{row['seconds']:,.0f}"] for row in (*rows, total)]
    return (
        "### Mutated inputs\n\n"
        "Small valid files and messages with one to three changes each. Refused: in a sentence of maxjax. Taken: what\n"
        "is read is finite. Otherwise: neither.\n\n" + table(["format", *counts, "seconds"], lines, left=1)
    )


def startup(*documents: Document) -> str:
    """Of `benchmarks.startup`."""
    lines = []
    for document in documents:
        for row in document["rows"]:
            figures = [number(row[key]) if key in row else "" for key in ("median", "min", "max", "cpu")]
            lines.append([row["what"], device(document), *figures, str(row["n"]), str(row.get("equations", ""))])
    return (
        "### From the start of a process to its end\n\n"
        "First: nothing on disk. Second: with the executables that the first left. CPU: of all threads [s].\n"
        "The program of a window is that of one problem as an accelerator runs it: traced, lowered, compiled.\n\n"
        + table(["what", "on", "median [s]", "min", "max", "CPU", "n", "equations"], lines, left=2)
    )


def page(*documents: Document) -> str:
    """Of `benchmarks.page`."""
    lines = []
    for document in documents:
        for row in document["rows"]:
            least, most = (number(row[key]) if key in row else "" for key in ("min", "max"))
            count = str(row.get("n", row.get("triangles", row.get("boxes", ""))))
            lines.append([row["what"], device(document), f"{number(row['median'])} {row['unit']}", least, most, count])
    return (
        "### The page in the browser\n\n"
        "Headless Chromium of 1280 x 800 pixels, which computes WebGL on the cores that the server plans on; drags are "
        "timed in the browser. Half: `?fixedDpr=0.5` in the page's address.\n\n"
        + table(["what", "on", "median", "min", "max", "drags or triangles"], lines, left=2)
    )
