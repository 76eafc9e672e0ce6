"""Docstrings are plain text with `code` in it: what reStructuredText would take for markup is escaped.

Signatures have their types, each array once: Float[Array, '3'] | Float[ndarray, '3'] is Float[Array, '3'] there.
"""

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


def shortened(types: str) -> str:
    """Types of a signature, without where JAX's array is defined, and arrays of either library as one."""
    types = re.sub(r"(~?[\w.]+)\[(~?[\w.]*Array), ('[^']*')\] \| \1\[~?[\w.]*ndarray, \3\]", r"\1[\2, \3]", types)
    # Defaults by the names of what they are (`maxjax.api`).
    for name, value in (("FIELD", "Field()"), ("DISTANCES", "Distances()")):
        types = types.replace(f" = {name}", f" = {value}")
    for ours, shown in (("jaxlib._jax.", ""), ("~jaxtyping.", ""), ("<factory>", "…")):
        types = types.replace(ours, shown)
    return "" if types == "(*args, **kwargs)" else types  # of a protocol, which nobody makes


def _shorten(
    _app: Sphinx, _what: str, _name: str, _thing: object, _options: object, given: str | None, returned: str | None
) -> tuple[str | None, str | None]:
    return tuple(None if types is None else shortened(types) for types in (given, returned))  # type: ignore[return-value]


def setup(app: Sphinx) -> dict[str, bool]:
    """Escape before napoleon reads the sections."""
    app.connect("autodoc-process-signature", _shorten)
    app.connect("autodoc-process-docstring", _escape, priority=400)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
