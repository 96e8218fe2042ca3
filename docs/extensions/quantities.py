"""Numbers of running text: powers of ten, and no line that ends before a unit, in a group of digits or an option."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.transforms.post_transforms import SphinxPostTransform

from coilarray.compute.display_units import power_of_ten

_UNITS = (
    r"%|°C|‰|(?:[pnµmck]?m|[pnµm]?s|min|[kMG]?Hz|[pnµ]?F|[nµm]?H|[mkM]?Ω|[nµm]?V|[nµm]?A|[mk]?W|[nµm]?T|[kM]?Pa|m?N|[KJ]|[kMGK]?B"
    r"|mm²|mm³|mrad|kPa/mm|scans/s|bits|bytes|baud)(?!\w)"
)
_SPACE = re.compile(rf"(?<=\d) (?=(?:{_UNITS})|\d{{3}}(?![\d.]))|(?<=[±<>≤≥]) (?=\d)|(?<=\d) (?=±)")
_POWER = re.compile(r"(?<![\w.·])(\d+(?:\.\d+)?)e([+-]?\d+)(?!\w|\.\w)")
_FULL = 0.01, 1000.0  # numbers between them are written in full
_OPTION = re.compile(r'<span class="pre">(?=-[\w-]{1,28}</span>)')  # longer ones may be wider than a telephone


def unbroken(text: str) -> str:
    """Return a text with no-break spaces within its quantities."""
    return _SPACE.sub("\N{NO-BREAK SPACE}", text)


def powers(text: str) -> str:
    """Return a text with numbers such as 3e-05 written with powers of ten, those of usual size in full."""

    def power(found: re.Match[str]) -> str:
        number = float(found[0])
        if _FULL[0] <= number < _FULL[1]:
            return f"{number:g}"
        factor = "" if found[1] == "1" else f"{found[1]}·"
        return f"{factor}{power_of_ten(int(found[2]))}"

    return _POWER.sub(power, text)


class _Quantities(SphinxPostTransform):
    """Write the quantities of running text; code, formulas and signatures stay as they are."""

    default_priority = 4  # before Sphinx-Gallery makes nodes of the words of programs

    def run(self, **kwargs: object) -> None:
        for node in list(self.document.findall(nodes.Text)):
            literal = (nodes.FixedTextElement, nodes.literal, nodes.math, nodes.raw, addnodes.desc_signature)
            parent = node.parent
            while parent is not None and not isinstance(parent, literal):
                parent = parent.parent
            if parent is None and (text := unbroken(powers(str(node)))) != node:
                node.parent.replace(node, nodes.Text(text))


def _mark(app: Sphinx, page: str, template: str, context: dict[str, Any], doctree: object) -> None:
    """Mark options for the style sheet: browsers end lines after hyphens."""
    if "body" in context:
        context["body"] = _OPTION.sub('<span class="pre whole">', context["body"])


def setup(app: Sphinx) -> dict[str, bool]:
    """Add the transform and the hook."""
    app.add_post_transform(_Quantities)
    app.connect("html-page-context", _mark)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
