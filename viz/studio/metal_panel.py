"""Tab of metal.

Plates and a target are added and removed, and the target is moved by a slider of its distance.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

from coilarray.design.model import Design
from coilarray.errors import CoilarrayError
from coilarray.geometry import MATERIALS, Plate
from coilarray.viz.scenes.scene import Scene
from coilarray.viz.studio.calculator import Step
from coilarray.viz.studio.entries import number_of, place_text
from coilarray.viz.studio.metal import (
    FIRST,
    KINDS,
    SIZES,
    Moved,
    body_rows,
    moved,
    target_rows,
    with_body,
    without_body,
)
from coilarray.viz.studio.panel import Panel
from coilarray.viz.studio.scene_making import BoardParts, metal_scene
from coilarray.viz.studio.services import Document

if TYPE_CHECKING:
    from coilarray.viz.studio.page import Page
    from coilarray.viz.studio.work import Work

_REST = 0.4  # s without a change before a target is computed


class MetalPanel(Panel):
    """Panel with the metal near the coils."""

    def __init__(self, page: Page) -> None:
        self._moved: Moved | None = None
        self._place: tuple[float, float] | None = None  # chosen place
        self._step = 0
        values = {
            "bodies": [], "body_form": FIRST, "body_kinds": list(KINDS), "body_shapes": list(SIZES),
            "body_materials": list(MATERIALS), "body_sizes": dict(SIZES), "body_problem": "", "has_target": False,
            "distances": [], "distance_at": 0, "target_rows": [], "target_problem": "", "target_place": ["", ""],
            "show_eddies": False,
            "target_endless": False,
        }  # fmt: skip
        page.state.client_only("body_form")
        super().__init__(
            page, values, add_body=self._add, remove_body=self._remove, move_target=self._move,
            place_target=self._put, toggle_eddies=self._toggle_eddies,
        )  # fmt: skip

    def show(self, design: Design, *, anew: bool) -> None:
        """Show the bodies of a design.

        The effect of a target on another design is marked as out of date.
        """
        state = self._page.state
        state.bodies, state.body_problem = body_rows(design), ""
        state.has_target = design.target is not None
        state.target_endless = design.target is not None and isinstance(design.target.body, Plate)
        if anew:
            self._place, self._step = None, 0
        if design.target is None:
            self._moved = None
            state.target_rows, state.distances, state.target_problem = [], [], ""

    def steps(self, design: Design) -> list[Step]:
        """Make the step that moves the target over its place.

        A design without a target has no step.
        """
        if design.target is None:
            return []
        compute = partial(moved, design, self._place)
        return [Step("target", compute, self._show, partial(self._fail, design), rest=_REST)]

    def scene(self, design: Design, board: BoardParts) -> Scene | None:
        """Board with its metal, and the target at its distance.

        The distance is set by the slider. The method runs in a thread.
        """
        if not design.plates and design.target is None:
            return None
        known = self._moved if self._moved is not None and self._moved.design is design else None
        circuit = self._page.numbers.circuit
        coupling = None if circuit is None or not self._page.state.show_eddies else circuit.coupling
        return metal_scene(board, known, self._step, coupling)

    def _show(self, found: Moved) -> None:
        """Show the numbers of a moved target."""
        if not self._page.is_current(found.design):
            return
        self._moved = found
        with self._page.state as state:
            state.distances = [f"{distance * 1e3:.3g}" for distance in found.distances]
            self._step = min(self._step, len(found.distances) - 1)
            state.distance_at, state.target_problem = self._step, ""
            state.target_place = [place_text(value) for value in found.place]
            state.target_rows = target_rows(found, self._step)
            self._page.arrived("target", found.design)
        self._page.redraw()

    def _fail(self, design: Design, problem: str) -> None:
        with self._page.state as state:
            state.target_problem, state.target_rows = problem, []
            self._page.failed("target", design, problem)

    def _move(self, step: int) -> None:
        """Show the target at a position of the slider."""
        if self._moved is None or not 0 <= int(step) < len(self._moved.distances):
            return
        self._step = int(step)
        with self._page.state as state:
            state.distance_at = self._step
            state.target_rows = target_rows(self._moved, self._step)
        self._page.redraw()

    def _put(self, x: str, y: str) -> None:
        """Move the target to a place in mm."""
        page = self._page
        try:
            self._place = number_of("x", str(x)) * 1e-3, number_of("y", str(y)) * 1e-3
        except CoilarrayError as error:
            page.state.target_problem = str(error)
            return
        with page.state as state:
            state.stale = sorted({*state.stale, "target"})
        page.slow.ask(self.steps(page.work.design))

    def _toggle_eddies(self) -> None:
        self._page.state.show_eddies = not self._page.state.show_eddies
        self._page.redraw()

    def _add(self, form: Mapping[str, Any]) -> None:
        self._change(lambda work: with_body(work.opened.document, form))

    def _remove(self, key: str) -> None:
        self._change(lambda work: without_body(work.opened.document, str(key)))

    def _change(self, made: Callable[[Work], Document]) -> None:
        self._page.change(made, partial(setattr, self._page.state, "body_problem"))
