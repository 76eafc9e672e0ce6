"""Markdown of result files: tables, numbers, and the line that says where a figure comes from."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

Document = Mapping[str, Any]


def table(heads: Sequence[str], rows: Iterable[Sequence[str]], left: int = 1) -> str:
    """A table whose first `left` columns are words, the others numbers."""
    rule = ["---" if k < left else "--:" for k in range(len(heads))]
    return "".join(f"| {' | '.join(line)} |\n" for line in (heads, rule, *rows))


def number(value: float) -> str:
    """Three digits or more, no exponent."""
    return f"{value:,.0f}" if value >= 100 else f"{value:.1f}" if value >= 10 else f"{value:.2f}"


def device(document: Document) -> str:
    """The accelerator, else the processor's cores."""
    name = str(document["provenance"]["device"])
    return f"{document['provenance']['cpus']} CPU cores" if is_cpu(document) else name.removeprefix("1 x ")


def trials(document: Document) -> str:
    """Whether a result's trials were drawn after the code that it judges, from its commit, or may have shaped it."""
    seed, commit = int(document["config"]["seed"]), str(document["provenance"]["commit"] or "")
    if commit and seed == int(commit[:7], 16):
        return f"fresh trials: seed {seed} is drawn from commit `{commit[:7]}`, after the code"
    if "seed" in document["provenance"]:
        return f"fresh trials: seed {seed} was {document['provenance']['seed']}"
    return f"development trials, seed {seed}: some of them were looked at while the code was written"


def is_cpu(document: Document) -> bool:
    """Whether it was measured without an accelerator."""
    return str(document["provenance"]["device"]).lower().endswith("cpu")


def sources(found: Mapping[str, Document]) -> str:
    """A table of where figures come from.

    Args:
        found: documents by path, from the folder of the page that links them.
    """
    lines = []
    for name, document in found.items():
        origin = document["provenance"]
        commit = f"`{(origin['commit'] or 'unknown')[:7]}`" + " with changes" * bool(origin["dirty"])
        where = device(document) + ("" if is_cpu(document) else f", {origin['cpus']} CPU cores")
        versions = f"{origin['versions']['python']} / {origin['versions']['jax']}"
        link = f"[{Path(name).name}]({name})"
        lines.append([link, f"`{origin['command']}`", where, commit, versions, origin["date"][:10]])
    heads = ["file", "command", "device", "commit", "Python / JAX", "date"]
    return table(heads, lines, left=len(heads))
