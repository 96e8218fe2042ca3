"""Formulas as MathML, which browsers draw themselves: no script and no network."""

import re
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx

_FOLLOWED = re.compile(r'<math [^>]*display="inline"[^>]*>(?:(?!</math>).)*</math>[.,;:)]+', re.DOTALL)
_BAR = '<mo stretchy="false">&#x0007C;'


def _mathml(node: nodes.Element, display: str = "inline") -> str:
    """Return the formula; bars are brackets here, but browsers space them as the operator ``divides``."""
    return convert(node.astext(), display=display).replace(_BAR, _BAR.replace(">", ' lspace="0" rspace="0">'))


def _inline(writer: Any, node: nodes.math) -> None:
    writer.body.append(_mathml(node))
    raise nodes.SkipNode


def _displayed(writer: Any, node: nodes.math_block) -> None:
    writer.body.append(f'<div class="formula">{_mathml(node, "block")}</div>')
    raise nodes.SkipNode


def punctuated(body: str) -> str:
    """Return a page's text in which no line begins with the full stop after a formula, as browsers let it."""
    return _FOLLOWED.sub(r'<span class="unbroken">\g<0></span>', body)


def _join(app: Sphinx, page: str, template: str, context: dict[str, Any], doctree: object) -> None:
    if "body" in context:
        context["body"] = punctuated(context["body"])


def setup(app: Sphinx) -> dict[str, bool]:
    """Add the renderer ``native`` and the hook."""
    app.add_html_math_renderer("native", (_inline, None), (_displayed, None))
    app.connect("html-page-context", _join)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
