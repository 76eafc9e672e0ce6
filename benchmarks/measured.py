"""The tables of docs/measured.md, written from the result files and from nothing else.

    python -m benchmarks.measured

rewrites what stands between `<!-- measured -->` and `<!-- /measured -->`. A test compares both, so that no figure there
can differ from the run that it names.
"""

from __future__ import annotations

import json
from pathlib import Path

from benchmarks import tables
from benchmarks.common.markdown import Document, sources

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "measured.md"
BEGIN, END = "<!-- measured -->\n", "<!-- /measured -->\n"

# File: the command that writes it, for the reader of the message that it is missing.
_FILES = {
    "benchmarks/results/plan.json": "python -m benchmarks.plan",
    "benchmarks/results/plan_h100.json": "python -m benchmarks.plan",
    "benchmarks/results/rivals.json": "python -m benchmarks.rivals",
    "benchmarks/results/rivals_h100.json": "python -m benchmarks.rivals --batch 1024",
    "benchmarks/results/potential.json": "python -m benchmarks.potential",
    "benchmarks/results/potential_h200.json": "python -m benchmarks.potential",
}


def block(root: Path = ROOT) -> str:
    """The text between the markers.

    Raises:
        FileNotFoundError: if a result file is missing; names the command that writes it.
    """
    found: dict[str, Document] = {}
    for name, command in _FILES.items():
        if not (root / name).is_file():
            raise FileNotFoundError(f"{name} is missing; run: {command}")
        found[name] = json.loads((root / name).read_text(encoding="utf-8"))
    plan, plan_gpu, rivals, rivals_gpu, potential, potential_gpu = found.values()
    parts = [
        tables.rivals(rivals, rivals_gpu),
        tables.plans(plan, plan_gpu),
        tables.solves(potential, potential_gpu),
    ]
    return "\n".join(
        [
            *parts,
            "### Where these figures come from\n\n"
            + sources({f"../{name}": document for name, document in found.items()}),
        ]
    )


def rewritten(text: str, measured: str) -> str:
    """The page's text with its measured part replaced.

    Raises:
        ValueError: unless both markers are there, once and in order.
    """
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end) or BEGIN in rest or END in after:
        raise ValueError(f"{PAGE.name}: expected one {BEGIN.strip()} and, after it, one {END.strip()}")
    return before + BEGIN + measured + END + after


def main() -> None:
    """Rewrite the page's measured part."""
    PAGE.write_text(rewritten(PAGE.read_text(encoding="utf-8"), block()), encoding="utf-8")


if __name__ == "__main__":
    main()
