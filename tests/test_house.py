"""Files stay short; imports and functions are checked by `make lint`."""

from __future__ import annotations

from pathlib import Path

MAXJAX = Path(__file__).parents[1] / "maxjax"
LINES = 350


def test_files_are_short() -> None:
    lengths = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in sorted(MAXJAX.rglob("*.py"))}
    assert lengths
    assert not [f"{path.relative_to(MAXJAX)}: {n} lines" for path, n in lengths.items() if n > LINES]
