"""What processes do from outside: how soon they begin and answer, and how they end."""

from __future__ import annotations

from benchmarks.common.markdown import Document, device, number, table
from benchmarks.tables.rows import rows_of


def fuzz(document: Document) -> str:
    """Of `tests.fuzz`."""
    counts = ("inputs", "refused", "taken", "otherwise")
    rows = document["rows"]
    total = {"format": "all", **{key: sum(row[key] for row in rows) for key in counts}}
    lines = [[row["format"], *(f"{row[key]:,}" for key in counts)] for row in (*rows, total)]
    return (
        "### Mutated inputs\n\n"
        "Small valid files and messages with one to three changes each. Refused: in a sentence of maxjax. Taken: what\n"
        "is read is finite. Otherwise: neither.\n\n" + table(["format", *counts], lines, left=1)
    )


def mutations(document: Document) -> str:
    """Of `tests.mutate`."""
    rows = document["rows"]
    rooms = list(dict.fromkeys(row["room"] for row in rows))
    counted = [(room, [row for row in rows if row["room"] == room]) for room in rooms] + [("all", rows)]
    lines = [[room, str(len(some)), str(sum(not row["noticed"] for row in some))] for room, some in counted]
    survivors = [row for row in rows if not row["noticed"]]
    told = [f"- {row['file']}: `{row['broken']}`. {row.get('why') or 'No reason is known.'}\n" for row in survivors]
    return (
        "### Broken lines\n\n"
        "One line of the sources broken at a time, in a copy of the tree: a comparison, a sign, a bound. Survived: no\n"
        "test of its room fails.\n\n"
        + table(["lines of", "broken", "survived"], lines, left=1)
        + ("\nThose that survived, and why they cannot matter:\n\n" + "".join(told) if told else "")
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


def first_hour(document: Document) -> str:
    """Of `benchmarks.first_hour`."""
    lines = [
        [f"`{row['what']}`" if row["what"] != "all" else "all", f"{row['median']:.1f}"] for row in document["rows"]
    ]
    return (
        "### From a clone to a mission over a city of one's own\n\n"
        "README's commands, in an empty folder, with an empty home and no caches; the city is The Hague, from a\n"
        "CityJSON file, with other waypoints in a copy of the round.\n\n" + table(["command", "[s]"], lines, left=1)
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
        + "".join(map(_limits, documents))
    )


def _limits(document: Document) -> str:
    """What frames of the page are beside those of the same triangles by WebGL alone."""
    rates = {row["what"]: row["median"] for row in document["rows"]}
    by = {row["by"] for row in document["rows"] if "by" in row}
    bare = {what.removeprefix("bare WebGL, "): rate for what, rate in rates.items() if what.startswith("bare WebGL, ")}
    shares = [f"{name} {100 * rates[f'frames, {name}'] / rate:.0f} %" for name, rate in bare.items()]
    if not shares:
        return ""
    return (
        f"\nThe pixels are computed by {', '.join(sorted(by))}.\n"
        f"Frames of the page beside those of the same triangles by WebGL alone: {'; '.join(shares)}.\n"
    )


def service(*documents: Document) -> str:
    """Of `benchmarks.service`."""
    return (
        "### A day of service\n\n"
        "Plans that a day would ask every few seconds, one after the other in one process, while clients of its page\n"
        "come and go; and processes that write one folder of executables at once, which was full before.\n\n"
        + "\n".join(map(_service, documents))
    )


def _service(document: Document) -> str:
    rows = {row["what"]: row for row in document["rows"]}
    last, flat, cache = rows["service"], rows["after the warm-up"], rows["one folder of executables"]
    heads = {"memory_MB": "memory [MB]", "handles": "open files and sockets", "threads": "threads"}
    lines = [
        [
            head,
            *(f"{flat[f'{key}_{end}']:.0f}" for end in ("first", "last")),
            f"{100 * (flat[f'{key}_last'] / flat[f'{key}_first'] - 1):+.1f} %",
        ]
        for key, head in heads.items()
    ]
    return (
        f"{last['plans']:,} plans ({last['solved']:,} OK) and {last['clients']:,} clients in {last['seconds']:,.0f} s\n"
        f"on {device(document)}. Medians of the first and the last fifth after a warm-up of a fifth:\n\n"
        + table(["", "first", "last", "change"], lines)
        + f"\n{cache['processes']} processes wrote {cache['programs']} executables. The folder then held "
        f"{cache['last_MB']:.0f} MB, at the most\n{cache['most_MB']:.0f}, of {cache['limit_MB']:.0f}; as many "
        f"processes after them compiled {cache['compiled_again']} of these anew.\n"
    )


def history(*documents: Document) -> str:
    """Of `benchmarks.history`."""
    rows = rows_of(documents)
    told = [key for key in rows[0] if key not in ("number", "commit", "date", "peer [ms]")]
    lines = [
        [f"{row['number']}, {row['date']}", f"`{row['commit']}`"]
        + ["–" if row[key] is None else _ratio(row[key]) for key in told]
        for row in rows
    ]
    return (
        "### Speed over the history\n\n"
        "Time of the processor on one core over that of a peer that never changes (SciPy, six steps of conjugate\n"
        "gradients on 64³), at commits of the branch; –: the commit has not this, or calls it another way. First\n"
        "plan: of a process whose caches are empty. Nothing is refused for these figures.\n\n"
        + table(["commit", "", *told], lines, left=2)
    )


def _ratio(value: float) -> str:
    """Two digits, no exponent."""
    return f"{value:,.0f}" if value >= 10 else f"{value:.1f}" if value >= 1 else f"{value:.2g}"
