"""Common parts of all panels of a page.

Values in its state, and functions that it calls.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from importlib import resources
from typing import TYPE_CHECKING, Any

from coilarray.compute.html import png_url

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from coilarray.viz.studio.page import Page

_DPI = 110


class Panel:
    """Panel of a page.

    It puts its first `values` into the page's state. The page calls its functions by their names.
    """

    def __init__(self, page: Page, values: Mapping[str, Any], **triggers: Callable[..., Any]) -> None:
        self._page = page
        page.state.update(values)
        for name, function in triggers.items():
            page.trigger(name, function)


def template(name: str) -> str:
    """Part of the page from the folder ``html``."""
    return resources.files("coilarray.viz.studio").joinpath("html", f"{name}.html").read_text(encoding="utf-8")


def image_of(figure: Figure) -> str:
    """Figure as an image in a data URL."""
    from coilarray.viz.plots.style import save  # imported late, as Matplotlib loads slowly

    buffer = io.BytesIO()
    save(figure, buffer, format="png", dpi=_DPI)
    return png_url(buffer.getvalue())
