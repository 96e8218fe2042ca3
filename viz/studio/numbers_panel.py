"""Tab of numbers.

The matrix of couplings or inductances, the coils, and the margins to the rules.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from coilarray.design.model import Design, build_design
from coilarray.geometry.rules import Margin, broken_rules
from coilarray.viz.studio.calculator import Step
from coilarray.viz.studio.numbers import (
    Circuit,
    Numbers,
    circuit_of,
    coil_rows,
    coupling_cells,
    inductance_cells,
    largest_of_two,
    margin_rows,
    margins_of,
    numbers_of,
)
from coilarray.viz.studio.panel import Panel

if TYPE_CHECKING:
    from coilarray.viz.studio.page import Page
    from coilarray.viz.studio.work import Work

_REST = 0.4  # s without a change before the numbers are computed with full accuracy
_MOST_IN_DIGITS = 8  # largest number of coils whose matrix has numbers in its cells from the start
_PATIENCE = 2.0  # s, longest delay of the margins while a slider moves; they take the time of some pictures


class NumbersPanel(Panel):
    """Panel with the numbers of the design."""

    def __init__(self, page: Page) -> None:
        self._numbers: tuple[Design, Numbers] | None = None
        self._circuit: tuple[Design, Circuit] | None = None
        values = {
            "matrix_of": "k", "matrix": {"names": [], "of": "k", "cells": [], "most": "", "dense": False},
            "matrix_digits": False, "accuracy": "", "coil_rows": [],
            "margins": [], "broken": [], "saved_rows": [], "saved_line": "", "can_compare": True,
        }  # fmt: skip
        super().__init__(page, values, compare=self._compare)

    @property
    def numbers(self) -> Numbers | None:
        """Numbers of the current design, or None if unknown."""
        if self._numbers is None or not self._page.is_current(self._numbers[0]):
            return None
        return self._numbers[1]

    @property
    def circuit(self) -> Circuit | None:
        """Circuit of the current design, or None if unknown."""
        if self._circuit is None or not self._page.is_current(self._circuit[0]):
            return None
        return self._circuit[1]

    def _compare(self) -> None:
        """Compute the numbers of the design as in its file.

        The file was given, or saved last.
        """
        work = self._page.work
        if not work.kept:  # a new design has no file
            return
        self._page.state.saved_line = f"{work.file} as saved: …"

        def compute() -> tuple[tuple[str, ...], ...]:
            saved = build_design(work.kept, work.design.name)
            return coil_rows(numbers_of(saved), circuit_of(saved))

        def show(rows: tuple[tuple[str, ...], ...], line: str = f"{work.file} as saved") -> None:
            if self._page.work.kept is work.kept:  # still
                with self._page.state as state:
                    state.saved_line, state.saved_rows = line, [list(row) for row in rows]

        def fail(problem: str) -> None:
            show((), problem)

        self._page.slow.ask([Step("saved", compute, show, fail)])

    def forget_saved(self, work: Work) -> None:
        """Remove the numbers of the saved design.

        The page now has another design. For a new design a line states that it is not saved yet.
        """
        state = self._page.state
        state.saved_rows = []
        state.can_compare = bool(work.kept)
        state.saved_line = "" if work.kept else f"{work.file} is not saved yet"

    def wait(self) -> None:
        """Mark the numbers on the page as out of date."""
        self._page.state.accuracy = "working"

    def rough(self, design: Design) -> Step:
        """Make the quick step after every change."""
        return Step("rough", lambda: (design, numbers_of(design, "screen")), self._show, partial(self._fail, design))

    def full(self, design: Design) -> Step:
        """Make the accurate step after the last change."""
        return Step("full", lambda: (design, numbers_of(design)), self._show, partial(self._fail, design), rest=_REST)

    def _solve(self, design: Design) -> None:
        """Solve the circuit.

        This takes from seconds to minutes. The numbers of a later design do not wait for it.
        """
        if self._page.is_current(design):
            fail = partial(self._fail_circuit, design)
            self._page.slow.ask([Step("circuit", lambda: (design, circuit_of(design)), self._show_circuit, fail)])

    def rules(self, design: Design) -> Step:
        """Make the step that computes the margins."""
        fail = partial(self._page.failed, "rules", design)
        return Step(
            "rules", lambda: (design, margins_of(design)), self._show_margins, fail, rest=_REST, patience=_PATIENCE
        )

    def _show(self, found: tuple[Design, Numbers]) -> None:
        """Show numbers of the design."""
        design, numbers = found
        present = self.numbers
        if numbers.accuracy == "screen" and present is not None and present.accuracy == "full":
            return
        self._numbers = found
        with self._page.state as state:
            self.draw()
            state.accuracy = numbers.accuracy if self._page.is_current(design) else "screen"
            state.coil_rows = [list(row) for row in coil_rows(numbers, self.circuit)]
            self._page.arrived("numbers", design)
        if numbers.accuracy == "full":
            self._solve(design)

    def draw(self) -> None:
        """Show the matrix that the page requests.

        If there are many coils, both matrices together take twice the time.
        """
        if self._numbers is None:
            return
        numbers, state = self._numbers[1], self._page.state
        kind = "L" if state.matrix_of == "L" else "k"
        if kind == "L":
            cells, most = inductance_cells(numbers), f"{largest_of_two(numbers.inductance) * 1e6:.3f} µH"
        else:
            cells, most = coupling_cells(numbers), f"{largest_of_two(numbers.k):.4f}"
        state.matrix = {
            "names": list(numbers.names), "of": kind, "cells": _plain(cells), "most": most,
            "dense": len(numbers.names) > _MOST_IN_DIGITS,
            "beside_q": self._numbers[0].circuit.switches.beside_q,
        }  # fmt: skip

    def _show_circuit(self, found: tuple[Design, Circuit]) -> None:
        """Show numbers of the circuit."""
        self._circuit = found
        if self.numbers is not None:
            with self._page.state as state:
                state.coil_rows = [list(row) for row in coil_rows(self.numbers, self.circuit)]
        self._page.switches.solve()
        with self._page.state:
            self._page.arrived("circuit", found[0])
        if self._page.is_current(found[0]):
            self._page.slow.ask(self._page.summary.steps(found[0], found[1].coupling))
        if self._page.state.tab == "switches" or self._page.state.show_eddies:
            self._page.redraw()

    def _fail_circuit(self, design: Design, problem: str) -> None:
        if self._page.is_current(design):
            self._page.switches.fail(problem)
        for name in ("circuit", "summary"):  # it depends on the circuit
            self._page.failed(name, design, problem)

    def _fail(self, design: Design, problem: str) -> None:
        with self._page.state as state:
            if self._page.is_current(design):
                state.accuracy = "none"
            self._page.failed("numbers", design, problem)
        self._solve(design)

    def _show_margins(self, found: tuple[Design, tuple[Margin, ...]]) -> None:
        design, margins = found
        with self._page.state as state:
            self._page.arrived("rules", design)
            state.margins, state.broken = [list(row) for row in margin_rows(margins)], broken_rules(margins)


def _plain(cells: Any) -> list[list[dict[str, str]]]:
    return [[dict(vars(cell)) for cell in row] for row in cells]
