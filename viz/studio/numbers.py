"""Tabs of numbers and of switches: what the circuit of a design gives."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib import colormaps

from coilarray.circuit.coupling import couple_design, design_circuit, design_inductance
from coilarray.circuit.network import Network, Resonance, checked_network, resonate
from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import KILOHM, PERCENT, DisplayUnit, number_text, true_minus
from coilarray.compute.table import Column, Table, cell, dataset_table
from coilarray.compute.threads import Progress
from coilarray.design.boards import check_boards, made_verdict
from coilarray.design.model import Design, build_design
from coilarray.design.scan_states import ScanState
from coilarray.electromagnetics.field import grid_points, magnetic_field
from coilarray.electromagnetics.inductance import Accuracy, coupling_matrix
from coilarray.errors import NetworkError
from coilarray.geometry.rules import Margin, broken_rules
from coilarray.viz.datasets.results import AMOUNT, field_grid, require_memory
from coilarray.viz.palette import DIVERGING
from coilarray.viz.scenes.board import scene_of_currents
from coilarray.viz.scenes.results import colours_of_currents, field_planes, scale_of_field, scene_of_slices
from coilarray.viz.scenes.scene import Scene
from coilarray.viz.studio.job import Step
from coilarray.viz.studio.services import Document, Summary
from coilarray.viz.studio.session import Panel, Session
from coilarray.viz.studio.view import BoardParts
from coilarray.viz.studio.words import NO_ROWS, with_changes
from coilarray.viz.studio.work import Work

if TYPE_CHECKING:
    import pyvista

_DARK = 0.42  # luminance below which text on a colour is white
_SHOWN_MARGINS = 40
_MARKED = 60  # broken places in the picture
_NEAR = 3  # neighbours in the words beside a coil
_LATER = 1.5  # s without a change before the saved design is computed
_REST = 0.4  # s without a change before the numbers are computed with full accuracy
_MOST_IN_DIGITS = 8  # largest number of coils whose matrix has numbers in its cells from the start
_LENGTH, _NUMBER = DisplayUnit("mm", 1e3, 3), DisplayUnit(digits=4, significant=True)


class Circuit(NamedTuple):
    """Circuit of a design as the converter sees it."""

    network: Network  # coils, switches and tank with all losses and strays
    coupling: xr.Dataset  # of `coilarray.circuit.coupling.couple_design`


class Numbers(NamedTuple):
    """Inductance matrix of a design."""

    names: tuple[str, ...]  # of the n coils
    inductance: FloatArray  # H, shape (n, n)
    accuracy: Accuracy


def numbers_of(design: Design, accuracy: Accuracy = "full") -> Numbers:
    """Compute the inductance matrix, or raise NetworkError for impossible coils."""
    inductance = checked_network(design_inductance(design, accuracy=accuracy)[0], 0.0)[0]
    return Numbers(design.coil_names, inductance, accuracy)


def circuit_of(design: Design) -> Circuit:
    """Solve the circuit, or raise NetworkError without a resonance."""
    return Circuit(design_circuit(design), couple_design(design))


def worst_margins(margins: Sequence[Margin]) -> tuple[Margin, ...]:
    """Worst margin of every rule on every layer."""
    worst: dict[tuple[str, str], Margin] = {}
    for margin in margins:
        worst.setdefault((margin.rule, margin.layer), margin)
    return tuple(worst.values())[:_SHOWN_MARGINS]


def marks_of(design: Design, margins: Sequence[Margin]) -> list[dict[str, Any]]:
    """Places of broken limits in mm with their sentences, the worst first."""
    marks: list[dict[str, Any]] = []
    for margin in margins:
        if margin.kept or margin.x is None or margin.y is None or len(marks) == _MARKED:
            continue
        layer = margin.layer
        board = next((one for one in design.placed if one.name and layer.startswith(one.name)), design.placed[0])
        flat = np.array([[margin.x, margin.y, 0.0]])
        bent = flat if board.array.form is None else board.array.form.surface(flat)
        x, y, z = (board.pose.apply(bent)[0] * 1e3).tolist()
        marks.append({"x": x, "y": y, "z": z, "rule": margin.rule, "text": broken_rules([margin])[0]})
    return marks


def matrix_cells(numbers: Numbers, kind: str, before: Numbers | None = None) -> tuple[list[list[dict[str, str]]], str]:
    """Cells of k, or of L and M in µH for "L", and the largest magnitude."""
    # A cell has its rounded `text`, its `change` against `before`, all digits with name and unit (`full`), and
    # colours.
    names, matrix = numbers.names, _matrix(numbers, kind)
    old = matrix if before is None or before.names != names else _matrix(before, kind)
    alone = np.eye(len(matrix), dtype=bool)
    most = float(np.abs(matrix[~alone]).max(initial=0.0))
    shades = colormaps[DIVERGING]((matrix / (most or 1.0) + 1) / 2)[..., :3]
    shades[alone] = 1.0
    dark = shades @ (0.2126, 0.7152, 0.0722) < _DARK
    codes = np.rint(255 * shades).astype(int).tolist()

    def cell(i: int, j: int) -> dict[str, str]:
        value, (red, green, blue) = float(matrix[i, j]), codes[i][j]
        text, name, unit, factor, digits = number_text(value, 4, "+"), "k", "", 1.0, 4
        if kind == "L":
            text, name, unit, factor, digits = number_text(value * 1e6, 3), "L" if i == j else "M", " H", 1e6, 3
        change = number_text((value - float(old[i, j])) * factor, digits, "+")
        return {
            "text": text, "full": f"{name}({names[i]}, {names[j]}) = {value!r}{unit}",
            "change": change if change.strip("+−0.") else "",
            "colour": f"#{red:02X}{green:02X}{blue:02X}", "ink": "#FFFFFF" if dark[i, j] else "#202020",
        }  # fmt: skip

    cells = [[cell(i, j) for j in range(len(names))] for i in range(len(names))]
    return cells, f"{most * 1e6:.3f} µH" if kind == "L" else f"{most:.4f}"


def _matrix(numbers: Numbers, kind: str) -> FloatArray:
    return numbers.inductance if kind == "L" else coupling_matrix(numbers.inductance)


_COILS = {  # quantities of the table of coils, with their signs
    "coil": "coil", "open_inductance": "L", "effective_inductance": "L_eff", "inductance_change": "change",
    "resistance": "R_dc", "quality_factor": "Q", "frequency": "f", "ideal_effective_inductance": "L_eff ideal",
}  # fmt: skip


def coil_table(coupling: xr.Dataset) -> Table:
    """Coils alone, and with their neighbours as terminated."""
    table = dataset_table("coils", "", coupling, tuple(_COILS), {"inductance_change": PERCENT}).brief()
    named = (replace(one, label=_COILS[one.name], meaning=one.label) for one in table.columns)
    return replace(table, columns=tuple(named))


def coil_facts(coupling: xr.Dataset) -> dict[str, list[str]]:
    """Lines about every coil, for a word beside it."""
    facts = {}
    table = coil_table(coupling)
    names = coupling.coil.values.tolist()
    for k, (name, *cells) in enumerate(table.cells()):
        lines = [f"{header}: {text}" for header, text in zip(table.headers[1:], cells, strict=True) if text]
        row = np.where(np.arange(len(names)) == k, 0.0, coupling.coupling.values[k])
        near = [j for j in np.argsort(-np.abs(row))[:_NEAR] if j != k]
        facts[name] = [*lines, *(f"k with {names[j]}: {number_text(float(row[j]), 4, '+')}" for j in near)]
    return facts


def margin_table(margins: Sequence[Margin]) -> Table:
    """Values, limits and margins of the rules."""
    rows = tuple(
        (m.rule, m.layer or "board", m.feature, m.value, m.limit, m.margin, "m" if m.unit else "", m.kept)
        for m in margins
    )
    columns = (
        *map(Column, ("rule", "layer", "of")), *(Column(name, unit="1") for name in ("value", "limit", "margin")),
        Column("unit"), Column("kept"),
    )  # fmt: skip
    units = tuple(_LENGTH if m.unit else _NUMBER for m in margins)
    return Table("margins", "", columns, rows, units, mark="no")


class NumbersPanel(Panel):
    """Panel with the numbers of the design, and their changes against the saved."""

    def __init__(self, session: Session, solved: Callable[[str], None], compared: Callable[[], None]) -> None:
        self._solved = solved  # called with the circuit, with the problem if it cannot be solved
        self._compared = compared  # called when results of the saved design are known
        self._numbers: tuple[Design, Numbers] | None = None
        self._circuit: tuple[Design, Circuit] | None = None
        self._response: tuple[str, xr.Dataset] | None = None  # response of the design with this digest
        self._last: dict[str, tuple[Design, Any]] = {}  # last results by name
        self.saved: dict[str, Any] = {}  # results of the saved design
        values = {
            "matrix_of": "k", "matrix": {"names": [], "of": "k", "cells": [], "most": "", "dense": False},
            "matrix_digits": False, "coil_table": NO_ROWS, "coil_facts": {}, "margins": NO_ROWS, "broken": [],
            "made": {"kind": "", "text": ""},
            "marks": [], "saved_line": "", "can_compare": True, "verdicts": [], "converter": True,
            "summary": NO_ROWS, "summary_lacks": False,
            "can_summarize": session.setup.services.summarize is not None,
        }  # fmt: skip
        super().__init__(session, values, respond=self._respond)

    @property
    def circuit(self) -> Circuit | None:
        """Circuit of the current design, or None if unknown."""
        design, circuit = self._circuit or (None, None)
        return circuit if design is self._session.work.design else None

    def show(self, work: Work) -> None:
        """Compare with another saved design."""
        self._state.can_compare = bool(work.kept)
        known = {name: value for name, (design, value) in self._last.items() if design is work.design}
        self.saved = {} if work.changed else known

    def say_changes(self, work: Work, target: Callable[[Design], Any]) -> None:
        """Say what the changes are counted from, and compute it later if it is not known."""
        services = self._session.setup.services
        given = {"summary": services.summarize, "target": work.design.target}
        lacks = {"numbers", "circuit", "margins", *(name for name, one in given.items() if one)} - set(self.saved)
        if work.changed and work.kept and lacks and not services.alone:
            compute = partial(saved_results, work, services.summarize, target, lacks)
            self._session.slow.ask([Step("saved", compute, self._compare, lambda _: None, _LATER)])
        known = f"small: change against {work.file} as saved" if work.changed else ""
        self._state.saved_line = known if work.kept else f"{work.file} is not saved yet"

    def steps(self, design: Design) -> list[Step]:
        """Compute quick numbers, and at rest margins and full numbers."""

        def numbers(name: str, accuracy: Accuracy, rest: float) -> Step:
            show, fail = partial(self._show, design), partial(self._fail, design)
            return Step(name, lambda: numbers_of(design, accuracy), show, fail, rest)

        def show_margins(margins: Sequence[Margin]) -> None:
            self._session.arrived("rules", design)
            self._state.marks = marks = marks_of(design, margins)
            places = [mark["text"] for mark in marks]
            self._state.broken = [
                {"text": line, "mark": places.index(line) if line in places else None} for line in broken_rules(margins)
            ]
            self._state.made = made_verdict(self._session.work.opened, margins)._asdict()
            self._note("margins", design, margin_table(worst_margins(margins)))

        fail_rules = partial(self._session.failed, "rules", design)
        rules = Step("rules", lambda: check_boards(design), show_margins, fail_rules, rest=_REST)
        return [numbers("rough", "screen", 0.0), rules, numbers("full", "full", _REST)]

    def draw(self) -> None:
        """Draw the requested matrix alone, for speed."""
        if self._numbers is not None:
            names, of = list(self._numbers[1].names), self._state.matrix_of
            cells, most = matrix_cells(self._numbers[1], of, self.saved.get("numbers"))
            dense = len(names) > _MOST_IN_DIGITS
            self._state.matrix = {"names": names, "of": of, "cells": cells, "most": most, "dense": dense}

    def _note(self, name: str, design: Design, value: Any) -> None:
        """Keep a result of a design, and show it with its changes."""
        self._last[name] = design, value
        self.keep(name, design, value)
        self._tell(name)

    def keep(self, name: str, design: Design, value: Any) -> None:
        """Keep a result of the saved design."""
        work = self._session.work
        if design is work.design and not work.changed:
            self.saved[name] = value

    def _tell(self, name: str) -> None:
        if name == "numbers":
            self.draw()
        elif name in self._last:
            now, before, keys = self._last[name][1], self.saved.get(name), 3 if name == "margins" else 1
            if name == "circuit":
                name, now, before = "coil_table", coil_table(now.coupling), before and coil_table(before.coupling)
            self._state[name] = with_changes(now, before, keys)

    def _compare(self, found: Mapping[str, Any]) -> None:
        """Show changes against a saved design that was not on show."""
        if self._session.work.kept is found["kept"]:
            self.saved = {**found, **self.saved}
            for name in found:
                self._tell(name)
            self._compared()

    def _show(self, design: Design, numbers: Numbers) -> None:
        """Show numbers, and after the full numbers solve the circuit."""
        known, shown = self._numbers or (None, None)
        if numbers.accuracy == "screen" and known is design and shown is not None and shown.accuracy == "full":
            return
        self._numbers = design, numbers
        self._state.accuracy = numbers.accuracy if self._session.is_current(design) else "screen"
        self._session.arrived("numbers", design)
        if numbers.accuracy == "full":
            self._note("numbers", design, numbers)
            self._solve(design)
        else:
            self.draw()

    def _fail(self, design: Design, problem: str) -> None:
        if self._session.is_current(design):
            self._state.accuracy = "none"
        self._session.failed("numbers", design, problem)
        self._solve(design)

    def _solve(self, design: Design) -> None:
        def show(circuit: Circuit) -> None:
            self._circuit = design, circuit
            self._state.coil_facts = coil_facts(circuit.coupling)
            self._note("circuit", design, circuit)
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

    def _summarize(self, design: Design, circuit: Circuit) -> None:
        summarize = self._session.setup.services.summarize
        if summarize is None:
            return
        digest, known = self._response or ("", None)
        response = known if digest == design.digest else None

        def show(summary: Summary) -> None:
            if self._session.is_current(design):
                state = self._state
                state.verdicts, state.converter = list(summary.verdicts), summary.converter
                self._note("summary", design, summary.table)
                state.summary_lacks = response is None and design.indentation is not None
            self._session.arrived("summary", design)

        fail = partial(self._session.failed, "summary", design)
        self._session.slow.ask([Step("summary", lambda: summarize(design, circuit.coupling, response), show, fail)])

    def _respond(self) -> None:
        session = self._session
        design = session.work.design

        def done(response: xr.Dataset) -> None:
            self._response = design.digest, response
            if (circuit := self.circuit) is not None:
                self._summarize(session.work.design, circuit)

        document, text = session.work.opened.document, f"response of {design.name}"
        session.start_bar("response", text, map_of, document, design.name, done=done)


def saved_results(
    work: Work,
    summarize: Callable[[Design, xr.Dataset, xr.Dataset | None], Summary] | None,
    target: Callable[[Design], Any],
    names: Collection[str],
) -> dict[str, Any]:
    """Named results of the design as saved, for `NumbersPanel`."""
    design = build_design(work.kept, work.design.name)
    circuit = circuit_of(design)
    found: dict[str, Any] = {"kept": work.kept, "circuit": circuit, "numbers": numbers_of(design)}
    if "margins" in names:
        found["margins"] = margin_table(worst_margins(check_boards(design)))
    if "summary" in names and summarize is not None:
        found["summary"] = summarize(design, circuit.coupling, None).table
    if "target" in names:
        found["target"] = target(design)
    return found


def map_of(document: Document, name: str, progress: Progress) -> xr.Dataset:
    """Compute the response map of a design on the board."""
    from coilarray.response.dataset import on_board
    from coilarray.response.map import response_map

    return on_board(response_map(build_design(document, name), accuracy="auto", progress=progress))


SETTINGS = ("measure", "ground", "open")  # connections of a coil
FIELDS = ("as switched", "of the measured coils alone", "what the neighbours add")
"""Fields that the tab of the field shows."""
SPACING = 1e-3  # distance in m of the points on the field's plane


@dataclass(frozen=True, eq=False)
class UnitFields:
    """B on a plane of 1 A per coil."""

    x: FloatArray  # shape (nx,)
    y: FloatArray  # shape (ny,)
    height: float  # height of the plane above the board
    fields: FloatArray  # T/A, shape (coils, nx, ny, 1, 3)

    def plane(self, currents: npt.ArrayLike) -> pyvista.RectilinearGrid:
        """Field of currents in A, shape (coils,), as of `field_grid`."""
        B = np.tensordot(np.asarray(currents, dtype=np.float64), self.fields, axes=1)
        return field_grid(self.x, self.y, [self.height], B)


def kept_settings(design: Design, settings: Mapping[str, str]) -> dict[str, str]:
    """Keep settings for other coils."""
    kept, middle = {name: settings.get(name, "ground") for name in design.coil_names}, design.array.middle_coil
    return kept if "measure" in kept.values() else {**dict.fromkeys(kept, "ground"), middle: "measure"}


def state_of(settings: Mapping[str, str]) -> ScanState:
    """State of the multiplexer, with several measured coils in series."""
    measured = tuple((name, 1) for name, setting in settings.items() if setting == "measure")
    if not measured:
        raise NetworkError("at least one coil must be measured.")
    opened = [name for name, setting in settings.items() if setting == "open"]
    name = " + ".join(name for name, _ in measured)
    return ScanState(name, measured, others="ground", exceptions=dict.fromkeys(opened, "open"))


def unit_fields(design: Design, spacing: float = SPACING, height: float | None = None) -> UnitFields:
    """B of every coil on a plane of limited points, at the `height` in m or that of the design."""
    x, y, z = field_planes(design, design.array.middle_coil, spacing)[0]
    level = z.low if height is None else height
    conductors = design.conductors()
    require_memory(x.count * y.count * len(conductors), f"a spacing of {spacing * 1e3:g} mm")
    points = grid_points(x.points, y.points, level)
    fields = np.stack([magnetic_field([conductor], points) for conductor in conductors])
    return UnitFields(x.points, y.points, level, fields)


def reading_table(result: Resonance) -> Table:
    """Return the readings of the converter."""
    columns = (
        Column("effective_inductance", "L_eff", "H"), Column("effective_resistance", "R_eff", "ohm"),
        Column("frequency", "resonance", "Hz"), Column("quality_factor", "Q", "1"),
        Column("parallel_resistance", "R_p", "ohm", KILOHM),
    )  # fmt: skip
    return Table("switched", "", columns, (tuple(cell(getattr(result, column.name)) for column in columns),))


class SwitchesPanel(Panel):
    """Panel with a state of the switches chosen by hand."""

    def __init__(self, session: Session, numbers: NumbersPanel) -> None:
        self._numbers = numbers
        self._result: Resonance | None = None
        self._fields: tuple[Design, float, UnitFields] | None = None
        values = {
            "settings": {}, "switched": NO_ROWS, "currents": [], "switch_problem": "", "fields_of": list(FIELDS),
            "field_of": FIELDS[0], "field_height": 0.0, "field_heights": [0.0, 0.0],
        }  # fmt: skip
        super().__init__(session, values, switch=self._switch)

    def show(self, design: Design, *, anew: bool) -> None:
        """Show another design, `anew` for another file."""
        state = self._state
        state.settings = kept_settings(design, {} if anew else state.settings)
        self._result = None
        if anew or not state.field_height:
            height = round(field_planes(design, design.array.middle_coil, SPACING)[0][2].low * 1e3, 2)
            state.field_height, state.field_heights = height, [0.2, max(10.0, 2 * height)]

    def solve(self) -> None:
        """Solve the state with the current circuit."""
        circuit = self._numbers.circuit
        if circuit is None:
            return
        try:
            found = self._result = resonate(circuit.network, state_of(self._state.settings))
        except NetworkError as error:
            self.fail(str(error))
            return
        saved, before = self._numbers.saved.get("circuit"), None
        if saved is not None and saved is not circuit and saved.network.names == circuit.network.names:
            with suppress(NetworkError):  # it has no resonance in this state
                before = resonate(saved.network, state_of(self._state.settings))
        rows = []
        for k, (name, current) in enumerate(zip(self._state.settings, found.currents.tolist(), strict=True)):
            angle = math.degrees(cmath.phase(current)) if abs(current) > 1e-9 else 0.0
            amount, phase = f"{abs(current) * 1e3:.1f}", true_minus(f"{angle:+.0f}°")
            was = abs(current) if before is None else abs(before.currents[k])
            change = number_text((abs(current) - was) * 1e3, 1, "+")
            rows.append({"name": name, "amount": amount, "phase": phase, "change": change.strip("+−0.") and change})
        table = with_changes(reading_table(found), None if before is None else reading_table(before), 0)
        with self._state as state:
            state.switched, state.switch_problem, state.currents = table, "", rows

    def fail(self, problem: str) -> None:
        """Show why the converter has no readings."""
        self._result = None
        with self._state as state:
            state.switched, state.currents, state.switch_problem = NO_ROWS, [], problem

    def scene(self, design: Design, board: BoardParts) -> Scene | None:
        """Scene of the solved state or None, in a thread."""
        result, names = self._result, design.coil_names
        if result is None or len(result.currents) != len(names):
            return None
        active = names.index(result.state.measured[0][0])
        scene = board.coloured(colours_of_currents(result.currents, active))
        scene += scene_of_currents(design.placed, result.currents.real, active)
        if design.plates:  # beside which the fields differ at every frequency
            return scene + Scene(notes=("B beside plates is shown by coilarray view --show board,field.",))
        height, shown = float(self._state.field_height) * 1e-3, str(self._state.field_of)
        if self._fields is None or self._fields[0] is not design or self._fields[1] != height:
            self._fields = design, height, unit_fields(design, height=height)
        fields, alone = self._fields[2], np.zeros(len(names))
        for name, sign in result.state.measured:
            alone[names.index(name)] = sign
        weights = {FIELDS[0]: (1.0, 0.0), FIELDS[1]: (0.0, 1.0), FIELDS[2]: (1.0, -1.0)}
        switched, without = weights.get(shown, weights[FIELDS[0]])
        plane = fields.plane((switched * result.currents.real + without * alone) * 1e-3)
        if np.asarray(plane.point_data[AMOUNT]).max(initial=0.0) > 0:
            scene += scene_of_slices([plane], scale_of_field([plane]))
        note = f"B in phase, {shown}, {fields.height * 1e3:.3g} mm above the board, without elastomer; 1 mA."
        return scene + Scene(notes=(note,))

    def _switch(self, name: str, setting: str) -> None:
        if name in self._state.settings and setting in SETTINGS:
            self._state.settings = {**self._state.settings, name: setting}
            self.solve()
            self._session.redraw()
