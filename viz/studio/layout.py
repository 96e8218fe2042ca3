"""The page as HTML: Vue templates from the folder ``html``, with the view of the scene in its place."""

from __future__ import annotations

from importlib import resources
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from coilarray.viz.studio.page import Page

_PARTS = ("bar", "drawer", "scene", "numbers", "switches", "touch", "runs", "board", "dialogs")


def build_layout(page: Page) -> None:
    """Give the page of a server its template."""
    from trame.ui.vuetify3 import VAppLayout

    text = _read("page")
    for name in _PARTS:
        text = text.replace(f"<!-- {name} -->", _read(name))
    with VAppLayout(page.server) as layout:
        layout.root.add_child(text.replace("<!-- view -->", page.scene.html))
    page.state.trame__template_error = _read("gone")  # in place of all that when the connection is lost


def _read(name: str) -> str:
    return resources.files("coilarray.viz.studio").joinpath("html", f"{name}.html").read_text(encoding="utf-8")
