"""Solves beside their peers, and where their time goes."""

from __future__ import annotations

from benchmarks.common.markdown import Document, device, is_cpu, number, table
from benchmarks.tables.rows import Row, pick

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
            ours = pick(document, "what", f"solve, {name}: maxjax")
            if ours is not None:
                peers = [_peer(pick(document, "what", f"solve, {name}: {peer}"), ours) for peer in _PEERS]
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
