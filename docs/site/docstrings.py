"""Docstrings are plain text with `code` in it: what reStructuredText would take for markup is escaped."""

from __future__ import annotations

import re

from sphinx.application import Sphinx

_CODE = re.compile(r"(`[^`]*`)")


def escaped(line: str) -> str:
    """A line whose stars and bars outside of `code` stand for themselves."""
    parts = _CODE.split(line)
    return "".join(part if part.startswith("`") else re.sub(r"([*|])", r"\\\1", part) for part in parts)


def _escape(_app: Sphinx, _what: str, _name: str, _thing: object, _options: object, lines: list[str]) -> None:
    lines[:] = [escaped(line) for line in lines]


def setup(app: Sphinx) -> dict[str, bool]:
    """Escape before napoleon reads the sections."""
    app.connect("autodoc-process-docstring", _escape, priority=400)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
