"""Tab of numbers: couplings and inductances, the coils, the margins to the rules, and the summary."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from matplotlib import colormaps

from coilarray.circuit.coupling import couple_design, design_circuit, design_inductance
from coilarray.circuit.network import checked_network
from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import number_text, true_minus
from coilarray.compute.threads import Progress
from coilarray.design.model import Design, build_design
from coilarray.electromagnetics.inductance import Accuracy, coupling_matrix
from coilarray.geometry.rules import Margin, broken_rules, check_rules
from coilarray.viz.palette import DIVERGING
from coilarray.viz.studio.job import Step
from coilarray.viz.studio.services import Document, Summary
from coilarray.viz.studio.session import Circuit, Panel, Session

if TYPE_CHECKING:
    from coilarray.viz.studio.work import Work


_DARK = 0.42  # luminance below which text on a colour is white
_SHOWN_MARGINS = 40


@dataclass(frozen=True, eq=False)
class Numbers:
    """Inductance matrix of a design."""

    names: tuple[str, ...]  # of the n coils
    inductance: FloatArray  # H, shape (n, n)
    accuracy: Accuracy

    @property
    def k(self) -> FloatArray:
        """Coupling coefficients, shape (n, n)."""
        return coupling_matrix(self.inductance)


@dataclass(frozen=True)
class Cell:
    """Cell of a matrix on the page."""

    text: str  # rounded number
    full: str  # name, number with all digits, and unit
    colour: str = "#FFFFFF"
    ink: str = "#202020"  # colour of the text


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


def coupling_cells(numbers: Numbers) -> tuple[tuple[Cell, ...], ...]:
    """Cells of the coupling matrix."""
    return _cells(numbers.k, numbers.names, lambda a, b, k: (number_text(k, 4, "+"), f"k({a}, {b}) = {k!r}"))


def inductance_cells(numbers: Numbers) -> tuple[tuple[Cell, ...], ...]:
    """Cells of the inductance matrix in µH."""

    def texts(a: str, b: str, L: float) -> tuple[str, str]:
        return true_minus(f"{L * 1e6:.3f}"), f"{'L' if a == b else 'M'}({a}, {b}) = {L!r} H"

    return _cells(numbers.inductance, numbers.names, texts)


def largest_of_two(matrix: FloatArray) -> float:
    """Largest magnitude off the diagonal."""
    return float(np.abs(matrix[~np.eye(len(matrix), dtype=bool)]).max(initial=0.0))


def _cells(
    matrix: FloatArray, names: Sequence[str], texts: Callable[[str, str, float], tuple[str, str]]
) -> tuple[tuple[Cell, ...], ...]:
    """Make the cells of a matrix."""
    colours = _colours(matrix / (largest_of_two(matrix) or 1.0))
    rows = zip(names, matrix.tolist(), colours, strict=True)
    return tuple(
        tuple(
            Cell(*texts(a, b, value), *(() if a == b else colour))
            for b, value, colour in zip(names, row, its_colours, strict=True)
        )
        for a, row, its_colours in rows
    )


def coil_rows(numbers: Numbers, circuit: Circuit | None = None) -> tuple[tuple[str, ...], ...]:
    """Rows of name, L and L_eff in µH, change in %, R in Ω, Q, resonance in MHz and ideal L_eff in µH."""
    rows = []
    for name, own in zip(numbers.names, np.diag(numbers.inductance).tolist(), strict=True):
        seen: tuple[str, ...] = ("…",) * 6
        if circuit is not None:
            one = circuit.coupling.sel(coil=name)
            seen = (
                f"{float(one.effective_inductance) * 1e6:.3f}",
                number_text(float(one.inductance_change) * 100, 2, "+"),
                f"{float(one.resistance):.2f}",
                f"{float(one.quality_factor):.1f}",
                f"{float(one.frequency) * 1e-6:.4f}",
                f"{float(one.ideal_effective_inductance) * 1e6:.3f}",
            )
        rows.append((name, f"{own * 1e6:.3f}", *seen))
    return tuple(rows)


def margin_rows(margins: Sequence[Margin]) -> tuple[tuple[str, str, str, str, str, str, bool], ...]:
    """Rows of rule, layer, feature, value, limit, margin, and whether the rule is kept."""
    return tuple(
        (
            margin.rule,
            margin.layer or "board",
            margin.feature,
            _length(margin.value, margin.unit),
            _length(margin.limit, margin.unit),
            _length(margin.margin, margin.unit, sign="+"),
            margin.kept,
        )
        for margin in margins
    )


def _length(value: float, unit: str, sign: str = "-") -> str:
    text = f"{value * 1e3:{sign}.3f} mm" if unit == "m" else f"{value:{sign}.4g}"
    return true_minus(text)


def _colours(parts: FloatArray) -> list[list[tuple[str, str]]]:
    """Colours of a matrix, and legible inks on them."""
    shades = colormaps[DIVERGING]((parts + 1) / 2)[..., :3]
    dark = shades @ (0.2126, 0.7152, 0.0722) < _DARK
    inks = np.where(dark, "#FFFFFF", Cell.ink).tolist()
    codes = np.rint(255 * shades).astype(int).tolist()
    return [
        [(f"#{red:02X}{green:02X}{blue:02X}", ink) for (red, green, blue), ink in zip(*row, strict=True)]
        for row in zip(codes, inks, strict=True)
    ]


_REST = 0.4  # s without a change before the numbers are computed with full accuracy
_MOST_IN_DIGITS = 8  # largest number of coils whose matrix has numbers in its cells from the start


class NumbersPanel(Panel):
    """Panel with the numbers of the design."""

    def __init__(self, session: Session, solved: Callable[[], None], unsolved: Callable[[str], None]) -> None:
        self._solved, self._unsolved = solved, unsolved  # called at the end of the circuit
        self._numbers: tuple[Design, Numbers] | None = None
        self._circuit: tuple[Design, Circuit] | None = None
        values = {
            "matrix_of": "k", "matrix": {"names": [], "of": "k", "cells": [], "most": "", "dense": False},
            "matrix_digits": False, "coil_rows": [],
            "margins": [], "broken": [], "saved_rows": [], "saved_line": "", "can_compare": True,
        }  # fmt: skip
        super().__init__(session, values, compare=self._compare)

    @property
    def numbers(self) -> Numbers | None:
        """Numbers of the current design, or None if unknown."""
        if self._numbers is None or not self._session.is_current(self._numbers[0]):
            return None
        return self._numbers[1]

    @property
    def circuit(self) -> Circuit | None:
        """Circuit of the current design, or None if unknown."""
        if self._circuit is None or not self._session.is_current(self._circuit[0]):
            return None
        return self._circuit[1]

    def _compare(self) -> None:
        """Compute the numbers of the design as in its file."""
        work = self._session.work
        if not work.kept:  # a new design has no file
            return
        self._session.state.saved_line = f"{work.file} as saved: …"

        def compute() -> tuple[tuple[str, ...], ...]:
            saved = build_design(work.kept, work.design.name)
            return coil_rows(numbers_of(saved), circuit_of(saved))

        def show(rows: tuple[tuple[str, ...], ...], line: str = f"{work.file} as saved") -> None:
            if self._session.work.kept is work.kept:  # still
                with self._session.state as state:
                    state.saved_line, state.saved_rows = line, [list(row) for row in rows]

        def fail(problem: str) -> None:
            show((), problem)

        self._session.slow.ask([Step("saved", compute, show, fail)])

    def forget_saved(self, work: Work) -> None:
        """Remove the numbers of the saved design."""
        state = self._session.state
        state.saved_rows = []
        state.can_compare = bool(work.kept)
        state.saved_line = "" if work.kept else f"{work.file} is not saved yet"

    def rough(self, design: Design) -> Step:
        """Make the quick step after every change."""
        return Step("rough", lambda: (design, numbers_of(design, "screen")), self._show, partial(self._fail, design))

    def full(self, design: Design) -> Step:
        """Make the accurate step after the last change."""
        return Step("full", lambda: (design, numbers_of(design)), self._show, partial(self._fail, design), rest=_REST)

    def _solve(self, design: Design) -> None:
        """Solve the circuit."""
        if self._session.is_current(design):
            fail = partial(self._fail_circuit, design)
            self._session.slow.ask([Step("circuit", lambda: (design, circuit_of(design)), self._show_circuit, fail)])

    def rules(self, design: Design) -> Step:
        """Make the step that computes the margins."""
        fail = partial(self._session.failed, "rules", design)
        return Step("rules", lambda: (design, margins_of(design)), self._show_margins, fail, rest=_REST)

    def _show(self, found: tuple[Design, Numbers]) -> None:
        """Show numbers of the design."""
        design, numbers = found
        present = self.numbers
        if numbers.accuracy == "screen" and present is not None and present.accuracy == "full":
            return
        self._numbers = found
        with self._session.state as state:
            self.draw()
            state.accuracy = numbers.accuracy if self._session.is_current(design) else "screen"
            state.coil_rows = [list(row) for row in coil_rows(numbers, self.circuit)]
            self._session.arrived("numbers", design)
        if numbers.accuracy == "full":
            self._solve(design)

    def draw(self) -> None:
        """Show the matrix that the page requests, as both take twice the time."""
        if self._numbers is None:
            return
        numbers, state = self._numbers[1], self._session.state
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
        with self._session.state as state:
            if self.numbers is not None:
                state.coil_rows = [list(row) for row in coil_rows(self.numbers, self.circuit)]
            self._session.arrived("circuit", found[0])
        self._solved()

    def _fail_circuit(self, design: Design, problem: str) -> None:
        if self._session.is_current(design):
            self._unsolved(problem)
        for name in ("circuit", "summary"):  # it depends on the circuit
            self._session.failed(name, design, problem)

    def _fail(self, design: Design, problem: str) -> None:
        with self._session.state as state:
            if self._session.is_current(design):
                state.accuracy = "none"
            self._session.failed("numbers", design, problem)
        self._solve(design)

    def _show_margins(self, found: tuple[Design, tuple[Margin, ...]]) -> None:
        design, margins = found
        with self._session.state as state:
            self._session.arrived("rules", design)
            state.margins, state.broken = [list(row) for row in margin_rows(margins)], broken_rules(margins)


def _plain(cells: Any) -> list[list[dict[str, str]]]:
    return [[dict(vars(cell)) for cell in row] for row in cells]


class SummaryPanel(Panel):
    """Table above the numbers."""

    def __init__(self, session: Session, circuit: Callable[[], Circuit | None]) -> None:
        self._circuit = circuit
        self._response: tuple[str, xr.Dataset] | None = None  # response of the design with this hash
        values = {
            "summary": {"headers": [], "rows": [], "verdicts": [], "converter": True}, "summary_lacks": False,
            "can_summarize": session.setup.services.summarize is not None,
        }  # fmt: skip
        super().__init__(session, values, respond=self._respond)

    def steps(self, design: Design, coupling: xr.Dataset) -> list[Step]:
        """Make the step that summarizes a design."""
        summarize = self._session.setup.services.summarize
        if summarize is None:
            return []
        known = self._response is not None and self._response[0] == design.digest
        response = self._response[1] if self._response is not None and known else None

        def show(summary: Summary) -> None:
            """Show a summary."""
            with self._session.state as state:
                if self._session.is_current(design):
                    state.summary = {
                        "headers": summary.table.headers, "rows": summary.table.cells(),
                        "verdicts": list(summary.verdicts), "converter": summary.converter,
                    }  # fmt: skip
                    state.summary_lacks = response is None and design.indentation is not None
                self._session.arrived("summary", design)

        fail = partial(self._session.failed, "summary", design)
        return [Step("summary", lambda: summarize(design, coupling, response), show, fail)]

    def _respond(self) -> None:
        """Compute the response map for the summary."""
        session = self._session
        design = session.work.design

        def done(response: xr.Dataset) -> None:
            self._response = design.digest, response
            circuit = self._circuit()
            if circuit is not None:
                session.slow.ask(self.steps(session.work.design, circuit.coupling))

        document, text = session.work.opened.document, f"response of {design.name}"
        session.start_bar("response", text, map_of, document, design.name, done=done)


def map_of(document: Document, name: str, progress: Progress) -> xr.Dataset:
    """Compute the response map of a design on the board."""
    from coilarray.response.dataset import on_board
    from coilarray.response.map import response_map

    return on_board(response_map(build_design(document, name), accuracy="auto", progress=progress))
