"""Formulas as MathML, which browsers draw themselves: no script and no network."""

from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx

_BAR = '<mo stretchy="false">&#x0007C;'


def _mathml(node: nodes.Element, display: str = "inline") -> str:
    """Return the formula; bars are brackets here, but browsers space them as the operator ``divides``."""
    return convert(node.astext(), display=display).replace(_BAR, _BAR.replace(">", ' lspace="0" rspace="0">'))


def _inline(writer: Any, node: nodes.math) -> None:
    writer.body.append(_mathml(node) + "\N{WORD JOINER}")  # else a full stop after it may begin a line
    raise nodes.SkipNode


def _displayed(writer: Any, node: nodes.math_block) -> None:
    writer.body.append(f'<div class="formula">{_mathml(node, "block")}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Add the renderer ``native``."""
    app.add_html_math_renderer("native", (_inline, None), (_displayed, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
