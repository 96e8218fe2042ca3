"""Places at which no line ends: between a number and its unit, between groups of digits, and within an option."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.transforms.post_transforms import SphinxPostTransform

_UNITS = (
    r"%|°C|‰|(?:[pnµmck]?m|[pnµm]?s|min|[kMG]?Hz|[pnµ]?F|[nµm]?H|[mkM]?Ω|[nµm]?V|[nµm]?A|[mk]?W|[nµm]?T|[kM]?Pa|m?N|[KJ]|[kMGK]?B"
    r"|mm²|mm³|mrad|kPa/mm|scans/s|bits|bytes|baud)(?!\w)"
)
_SPACE = re.compile(rf"(?<=\d) (?=(?:{_UNITS})|\d{{3}}(?![\d.]))|(?<=±) (?=\d)|(?<=\d) (?=±)")


_OPTION = re.compile(r'<span class="pre">(?=-[\w-]{1,28}</span>)')  # longer ones may be wider than a telephone


def unbroken(text: str) -> str:
    """Return a text with no-break spaces within its quantities."""
    return _SPACE.sub("\N{NO-BREAK SPACE}", text)


class _Unbroken(SphinxPostTransform):
    """Keep quantities of running text on one line; code and formulas stay as they are."""

    default_priority = 900

    def run(self, **kwargs: object) -> None:
        for node in list(self.document.findall(nodes.Text)):
            literal = (nodes.FixedTextElement, nodes.literal, nodes.math, nodes.raw)
            parent = node.parent
            while parent is not None and not isinstance(parent, literal):
                parent = parent.parent
            if parent is None and (text := unbroken(str(node))) != node:
                node.parent.replace(node, nodes.Text(text))


def _mark(app: Sphinx, page: str, template: str, context: dict[str, Any], doctree: object) -> None:
    """Mark options for the style sheet: browsers end lines after hyphens."""
    if "body" in context:
        context["body"] = _OPTION.sub('<span class="pre whole">', context["body"])


def setup(app: Sphinx) -> dict[str, bool]:
    """Add the transform and the hook."""
    app.add_post_transform(_Unbroken)
    app.connect("html-page-context", _mark)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
