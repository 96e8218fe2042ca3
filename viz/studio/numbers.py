"""Tab of numbers: summary, couplings, inductances, coils, and margins."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib import colormaps

from coilarray.circuit.coupling import couple_design, design_circuit, design_inductance
from coilarray.circuit.network import checked_network
from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import PERCENT, DisplayUnit, number_text
from coilarray.compute.table import Column, Table, Value, dataset_table
from coilarray.compute.threads import Progress
from coilarray.design.model import Design, build_design
from coilarray.electromagnetics.inductance import Accuracy, coupling_matrix
from coilarray.geometry.rules import Margin, broken_rules, check_rules
from coilarray.viz.palette import DIVERGING
from coilarray.viz.studio.job import Step
from coilarray.viz.studio.services import Document, Summary
from coilarray.viz.studio.session import Circuit, Panel, Session
from coilarray.viz.studio.work import Work

_DARK = 0.42  # luminance below which text on a colour is white
_SHOWN_MARGINS = 40
_REST = 0.4  # s without a change before the numbers are computed with full accuracy
_MOST_IN_DIGITS = 8  # largest number of coils whose matrix has numbers in its cells from the start
_LENGTH, _NUMBER = DisplayUnit("mm", 1e3, 3), DisplayUnit(digits=4, significant=True)


class Numbers(NamedTuple):
    """Inductance matrix of a design."""

    names: tuple[str, ...]  # of the n coils
    inductance: FloatArray  # H, shape (n, n)
    accuracy: Accuracy


def numbers_of(design: Design, accuracy: Accuracy = "full") -> Numbers:
    """Compute the inductance matrix, or raise NetworkError for impossible coils."""
    inductance = checked_network(design_inductance(design, accuracy=accuracy)[0], 0.0)[0]
    return Numbers(design.array.names, inductance, accuracy)


def circuit_of(design: Design) -> Circuit:
    """Solve the circuit, or raise NetworkError without a resonance."""
    return Circuit(design_circuit(design), couple_design(design))


def margins_of(design: Design) -> tuple[Margin, ...]:
    """Worst margin of every rule on every layer."""
    worst: dict[tuple[str, str], Margin] = {}
    for margin in check_rules(design.array, design.rules):
        worst.setdefault((margin.rule, margin.layer), margin)
    return tuple(worst.values())[:_SHOWN_MARGINS]


def matrix_cells(numbers: Numbers, kind: str) -> tuple[list[list[dict[str, str]]], str]:
    """Cells of k, or of L and M in µH for "L".

    The second result is the largest magnitude of two coils. A cell has its rounded `text`, all
    digits with name and unit, `full`, and the colours of the cell and of its `ink`.
    """
    names, matrix = numbers.names, numbers.inductance if kind == "L" else coupling_matrix(numbers.inductance)
    alone = np.eye(len(matrix), dtype=bool)
    most = float(np.abs(matrix[~alone]).max(initial=0.0))
    shades = colormaps[DIVERGING]((matrix / (most or 1.0) + 1) / 2)[..., :3]
    shades[alone] = 1.0
    dark = shades @ (0.2126, 0.7152, 0.0722) < _DARK
    codes = np.rint(255 * shades).astype(int).tolist()

    def cell(i: int, j: int) -> dict[str, str]:
        value, (red, green, blue) = float(matrix[i, j]), codes[i][j]
        text, name, unit = number_text(value, 4, "+"), "k", ""
        if kind == "L":
            text, name, unit = number_text(value * 1e6, 3), "L" if i == j else "M", " H"
        return {
            "text": text, "full": f"{name}({names[i]}, {names[j]}) = {value!r}{unit}",
            "colour": f"#{red:02X}{green:02X}{blue:02X}", "ink": "#FFFFFF" if dark[i, j] else "#202020",
        }  # fmt: skip

    cells = [[cell(i, j) for j in range(len(names))] for i in range(len(names))]
    return cells, f"{most * 1e6:.3f} µH" if kind == "L" else f"{most:.4f}"


def coil_table(coupling: xr.Dataset) -> Table:
    """Coils alone, and with their neighbours as terminated."""
    names = (
        "coil", "open_inductance", "effective_inductance", "inductance_change", "resistance", "quality_factor",
        "frequency", "ideal_effective_inductance",
    )  # fmt: skip
    return dataset_table("coils", "", coupling, names, {"inductance_change": PERCENT}).brief()


def margin_table(margins: Sequence[Margin]) -> Table:
    """Values, limits and margins of the rules."""
    rows: list[tuple[Value, ...]] = []
    for m in margins:
        unit = _LENGTH if m.unit else _NUMBER
        rows.append((m.rule, m.layer or "board", m.feature, *map(unit.text, (m.value, m.limit, m.margin)), m.kept))
    columns = map(Column, ("rule", "layer", "of", "value", "limit", "margin", "kept"))
    return Table("margins", "", tuple(columns), tuple(rows), mark="no")


class NumbersPanel(Panel):
    """Panel with the numbers of the design."""

    def __init__(self, session: Session, solved: Callable[[str], None]) -> None:
        self._solved = solved  # called with the circuit, with the problem if it cannot be solved
        self._numbers: tuple[Design, Numbers] | None = None
        self._circuit: tuple[Design, Circuit] | None = None
        self._response: tuple[str, xr.Dataset] | None = None  # response of the design with this digest
        values = {
            "matrix_of": "k", "matrix": {"names": [], "of": "k", "cells": [], "most": "", "dense": False},
            "matrix_digits": False, "coil_table": "", "margins": "", "broken": [], "saved_table": "", "saved_line": "",
            "can_compare": True, "summary": {"table": "", "verdicts": [], "converter": True}, "summary_lacks": False,
            "can_summarize": session.setup.services.summarize is not None,
        }  # fmt: skip
        super().__init__(session, values, compare=self._compare, respond=self._respond)

    @property
    def circuit(self) -> Circuit | None:
        """Circuit of the current design, or None if unknown."""
        known = self._circuit is not None and self._session.is_current(self._circuit[0])
        return self._circuit[1] if self._circuit is not None and known else None

    def show(self, work: Work) -> None:
        """Remove the numbers of the saved design."""
        state = self._session.state
        state.can_compare, state.saved_table = bool(work.kept), ""
        state.saved_line = "" if work.kept else f"{work.file} is not saved yet"

    def steps(self, design: Design) -> list[Step]:
        """Compute quick numbers, and at rest margins and full numbers."""

        def numbers(accuracy: Accuracy) -> Callable[[], tuple[Design, Numbers]]:
            return lambda: (design, numbers_of(design, accuracy))

        fail, fail_rules = partial(self._fail, design), partial(self._session.failed, "rules", design)
        return [
            Step("rough", numbers("screen"), self._show, fail),
            Step("rules", lambda: (design, margins_of(design)), self._show_margins, fail_rules, rest=_REST),
            Step("full", numbers("full"), self._show, fail, rest=_REST),
        ]

    def draw(self) -> None:
        """Draw the requested matrix alone, for speed."""
        if self._numbers is None:
            return
        numbers, state = self._numbers[1], self._session.state
        cells, most = matrix_cells(numbers, state.matrix_of)
        state.matrix = {
            "names": list(numbers.names), "of": state.matrix_of, "cells": cells, "most": most,
            "dense": len(numbers.names) > _MOST_IN_DIGITS,
        }  # fmt: skip

    def _show(self, found: tuple[Design, Numbers]) -> None:
        """Show numbers, and after the full numbers solve the circuit."""
        design, numbers = found
        before = self._numbers
        if numbers.accuracy == "screen" and before is not None and before[0] is design and before[1].accuracy == "full":
            return
        self._numbers = found
        with self._session.state as state:
            self.draw()
            state.accuracy = numbers.accuracy if self._session.is_current(design) else "screen"
            self._session.arrived("numbers", design)
        if numbers.accuracy == "full":
            self._solve(design)

    def _fail(self, design: Design, problem: str) -> None:
        if self._session.is_current(design):
            self._session.state.accuracy = "none"
        self._session.failed("numbers", design, problem)
        self._solve(design)

    def _solve(self, design: Design) -> None:
        """Solve the circuit, and summarize the design."""

        def show(circuit: Circuit) -> None:
            self._circuit = design, circuit
            with self._session.state as state:
                state.coil_table = coil_table(circuit.coupling).html()
                self._session.arrived("circuit", design)
            self._solved("")
            self._summarize(design, circuit)

        def fail(problem: str) -> None:
            if self._session.is_current(design):
                self._solved(problem)
            for name in ("circuit", "summary"):  # it depends on the circuit
                self._session.failed(name, design, problem)

        if self._session.is_current(design):
            self._session.slow.ask([Step("circuit", lambda: circuit_of(design), show, fail)])

    def _show_margins(self, found: tuple[Design, tuple[Margin, ...]]) -> None:
        design, margins = found
        with self._session.state as state:
            self._session.arrived("rules", design)
            state.margins, state.broken = margin_table(margins).html(), broken_rules(margins)

    def _compare(self) -> None:
        """Compute the numbers of the design as in its file."""
        work, state = self._session.work, self._session.state
        if not work.kept:  # a new design has no file
            return
        state.saved_line = f"{work.file} as saved: …"

        def show(table: str, line: str = f"{work.file} as saved") -> None:
            if self._session.work.kept is work.kept:  # still
                with state:
                    state.saved_line, state.saved_table = line, table

        def compute() -> str:
            return coil_table(couple_design(build_design(work.kept, work.design.name))).html()

        self._session.slow.ask([Step("saved", compute, show, partial(show, ""))])

    def _summarize(self, design: Design, circuit: Circuit) -> None:
        """Summarize a design, with its response if this is known."""
        summarize = self._session.setup.services.summarize
        if summarize is None:
            return
        known = self._response is not None and self._response[0] == design.digest
        response = self._response[1] if self._response is not None and known else None

        def show(summary: Summary) -> None:
            with self._session.state as state:
                if self._session.is_current(design):
                    state.summary = {
                        "table": summary.table.html(), "verdicts": list(summary.verdicts),
                        "converter": summary.converter,
                    }  # fmt: skip
                    state.summary_lacks = response is None and design.indentation is not None
                self._session.arrived("summary", design)

        fail = partial(self._session.failed, "summary", design)
        self._session.slow.ask([Step("summary", lambda: summarize(design, circuit.coupling, response), show, fail)])

    def _respond(self) -> None:
        """Compute the response map for the summary."""
        session = self._session
        design = session.work.design

        def done(response: xr.Dataset) -> None:
            self._response = design.digest, response
            circuit = self.circuit
            if circuit is not None:
                self._summarize(session.work.design, circuit)

        document, text = session.work.opened.document, f"response of {design.name}"
        session.start_bar("response", text, map_of, document, design.name, done=done)


def map_of(document: Document, name: str, progress: Progress) -> xr.Dataset:
    """Compute the response map of a design on the board."""
    from coilarray.response.dataset import on_board
    from coilarray.response.map import response_map

    return on_board(response_map(build_design(document, name), accuracy="auto", progress=progress))
