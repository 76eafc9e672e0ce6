"""Formulas as MathML, which browsers draw themselves: no script, no font, no network."""

from __future__ import annotations

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging

_LOGGER = logging.getLogger(__name__)


def _drawn(node: nodes.Node, block: bool) -> str:
    text = node.astext()
    try:
        return str(tex2mathml(text, as_block=block))
    except MathError as error:
        _LOGGER.warning("formula %r: %s", text, error, location=node)
        return f"<code>{text}</code>"


def _inline(self: object, node: nodes.Node) -> None:
    self.body.append(_drawn(node, block=False))  # type: ignore[attr-defined]
    raise nodes.SkipNode


def _display(self: object, node: nodes.Node) -> None:
    self.body.append(f'<div class="formula">{_drawn(node, block=True)}</div>')  # type: ignore[attr-defined]
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer `mathml`."""
    app.add_html_math_renderer("mathml", inline_renderers=(_inline, None), block_renderers=(_display, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
