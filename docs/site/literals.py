"""Short literals in one piece: a browser would break `--drift` behind its first hyphen.

Those whose words all fit beside each other on a telephone get the class `short`, which static/site.css does not break;
longer ones break wherever a line ends.
"""

from __future__ import annotations

from docutils import nodes
from sphinx.application import Sphinx

LONGEST = 32  # characters of a word


def mark_short(app: Sphinx, doctree: nodes.document, name: str) -> None:
    """Give the class `short` to the literals of a page that are."""
    for literal in doctree.findall(nodes.literal):
        if all(len(word) <= LONGEST for word in literal.astext().split()):
            literal["classes"].append("short")


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect it."""
    app.connect("doctree-resolved", mark_short)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
