"""New design from a few choices.

It is made in a process beside the page.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, get_args

from coilarray.compute.threads import Progress
from coilarray.design.model import DesignFile
from coilarray.errors import CoilarrayError, DesignError, OutputError
from coilarray.geometry.values import SIDES
from coilarray.studies.create.choices import Choices, Shape, read_arrangement, read_size
from coilarray.viz.studio.entries import number_of
from coilarray.viz.studio.job import with_progress
from coilarray.viz.studio.panel import Panel
from coilarray.viz.studio.work import MOST_COILS, work_on

if TYPE_CHECKING:
    from coilarray.viz.studio.page import Page

_FIRST = {
    "name": "mine", "coils": str(Choices.coils), "shape": Choices.shape, "size": f"{Choices().sides[0] * 1e3:g}",
    "inductance": "", "layers": "", "pitch": "", "connector": "none",
    "decoupled": Choices.overlap == "decoupled", "elastomer": Choices.elastomer,
}  # fmt: skip


class NewPanel(Panel):
    """Dialog for a new design."""

    def __init__(self, page: Page) -> None:
        values = {
            "new_dialog": False, "new_shapes": list(get_args(Shape)), "new_edges": ["none", *SIDES],
            "choice": _FIRST, "new_problem": "", "new_over": False,
        }  # fmt: skip
        super().__init__(page, values, make_design=self._make)

    def _make(self, texts: Mapping[str, Any], discard: bool = False) -> None:
        """Make a design.

        If this loses changes, `discard` must confirm it.
        """
        page, state = self._page, self._page.state
        name = str(texts.get("name", "")).strip().removesuffix(".toml")
        try:
            path = page.setup.shelf.path(f"{name}.toml")
        except OutputError:
            state.new_problem = f"name must have letters, digits, _ . + and, not first, - only; got {name[:60]!r}."
            return
        if path.exists():
            state.new_problem = f"{path.name} is there already; give the new design another name."
            return
        state.new_over = bool(page.work.changed) and not discard
        if state.new_over:
            state.new_problem = page.work.unsaved
            return
        try:
            choices = choices_of(texts)
        except CoilarrayError as error:
            state.new_problem = str(error)
            return

        begun = page.work

        def failed(problem: str) -> None:
            state.new_problem, state.new_dialog = problem, True

        def done(file: DesignFile) -> None:
            """Show the new design."""
            if page.work is not begun and page.work.changed:  # meanwhile
                state.new_over = True
                failed(page.work.unsaved)
                return
            try:
                page.take(replace(work_on(file, path.name), kept={}))
            except CoilarrayError as error:
                failed(str(error))

        state.new_problem = ""
        state.new_dialog = not page.start_bar(
            "new", f"new design {name}", with_progress, (make_design, name, choices), done, failed
        )


def choices_of(texts: Mapping[str, Any]) -> dict[str, Any]:
    """Choices for a new design from texts of the page.

    They are arguments of `coilarray.studies.create.new_design`. The sizes in the texts are in mm.

    Examples
    --------
    >>> choices_of({"coils": "4x4", "shape": "rectangle", "size": "20×12", "inductance": "18"})
    {'coils': '4x4', 'shape': 'rectangle', 'size': (0.02, 0.012), 'inductance': 1.8e-05}
    """
    given = {key: str(texts.get(key, "")).strip() for key in _FIRST}
    arrangement = read_arrangement(given["coils"], given["shape"])
    if arrangement.columns * arrangement.rows > MOST_COILS:
        raise DesignError(f"coils must be at most {MOST_COILS} for the studio to follow; got {given['coils']}.")
    choices: dict[str, Any] = {"coils": given["coils"], "shape": given["shape"], "size": read_size(given["size"])}
    for key, scale in (("inductance", 1e-6), ("pitch", 1e-3)):
        if given[key]:
            choices[key] = number_of(key, given[key]) * scale
    if given["layers"]:
        layers = number_of("layers", given["layers"])
        if layers != round(layers):
            raise DesignError(f"layers must be a whole number; got {given['layers']}.")
        choices["layers"] = round(layers)
    if given["connector"] not in ("", "none"):
        choices["connector"] = given["connector"]
    if texts.get("decoupled"):
        choices["overlap"] = "decoupled"
    if not texts.get("elastomer", True):
        choices["elastomer"] = False
    return choices


def make_design(name: str, choices: Mapping[str, Any], _: Progress) -> DesignFile:
    """Make a design in a process of its own."""
    from coilarray.studies.create.new_design import new_design

    return new_design(name, **choices)
