"""What all panels of a page share: values in its state and functions that it calls."""

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
    """One panel of a page: first `values` in the page's state, and functions that the page calls by their names."""

    def __init__(self, page: Page, values: Mapping[str, Any], **triggers: Callable[..., Any]) -> None:
        self._page = page
        page.state.update(values)
        for name, function in triggers.items():
            page.trigger(name, function)


def template(name: str) -> str:
    """Return a part of the page from the folder ``html``."""
    return resources.files("coilarray.viz.studio").joinpath("html", f"{name}.html").read_text(encoding="utf-8")


def image_of(figure: Figure) -> str:
    """Return a figure as an image in a data URL."""
    from coilarray.viz.plots.style import save  # Matplotlib, which has drawn the figure, takes long to load

    buffer = io.BytesIO()
    save(figure, buffer, format="png", dpi=_DPI)
    return png_url(buffer.getvalue())
