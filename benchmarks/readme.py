"""The measured part of the README, written from the result files and from nothing else.

    python -m benchmarks.readme

rewrites what stands between `<!-- measured -->` and `<!-- /measured -->`. A test compares both, so that no figure there
can differ from the run that it names.
"""

from __future__ import annotations

import json
from pathlib import Path

from benchmarks import tables
from benchmarks.common.markdown import Document, sources

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
BEGIN, END = "<!-- measured -->\n", "<!-- /measured -->\n"

# File: the command that writes it, for the reader of the message that it is missing.
_FILES = {
    "benchmarks/results/plan.json": "python -m benchmarks.plan",
    "benchmarks/results/plan_h200.json": "python -m benchmarks.plan",
    "benchmarks/results/rivals.json": "python -m benchmarks.rivals",
    "benchmarks/results/rivals_h200.json": "python -m benchmarks.rivals --batch 1024",
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
    return "\n".join([*parts, "### Where these figures come from\n\n" + sources(found)])


def rewritten(text: str, measured: str) -> str:
    """The README's text with its measured part replaced.

    Raises:
        ValueError: unless both markers are there, once and in order.
    """
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end) or BEGIN in rest or END in after:
        raise ValueError(f"README.md: expected one {BEGIN.strip()} and, after it, one {END.strip()}")
    return before + BEGIN + measured + END + after


def main() -> None:
    """Rewrite the README's measured part."""
    README.write_text(rewritten(README.read_text(encoding="utf-8"), block()), encoding="utf-8")


if __name__ == "__main__":
    main()
