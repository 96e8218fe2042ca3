"""Tab of switches: each coil is measured, grounded or open."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from coilarray.circuit.network import Resonance, StateResult, resonate
from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import KILOHM, true_minus
from coilarray.compute.table import Column, Table, cell
from coilarray.design.model import Design
from coilarray.design.scan_states import ScanState
from coilarray.electromagnetics.field import grid_points, magnetic_field
from coilarray.errors import NetworkError
from coilarray.geometry.array import Array
from coilarray.viz.datasets.results import AMOUNT, field_grid, require_memory
from coilarray.viz.scenes.results import Span, colours_of_currents, scale_of_field, scene_of_slices
from coilarray.viz.scenes.scene import Scene
from coilarray.viz.studio.session import Circuit, Panel, Session
from coilarray.viz.studio.view import BoardParts

if TYPE_CHECKING:
    import pyvista


SETTINGS = ("measure", "ground", "open")
"""Connections of a coil."""
SPACING = 1e-3
"""Distance in m of the points on the field's plane."""


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


def kept_settings(array: Array, settings: Mapping[str, str]) -> dict[str, str]:
    """Keep settings for other coils."""
    kept = {name: settings.get(name, "ground") for name in array.names}
    return kept if "measure" in kept.values() else {**dict.fromkeys(kept, "ground"), array.middle_coil: "measure"}


def state_of(settings: Mapping[str, str]) -> ScanState:
    """State of the multiplexer, with several measured coils in series.

    >>> state = state_of({"a": "measure", "b": "open", "c": "ground"})
    >>> state.measured, state.others, state.exceptions
    ((('a', 1),), 'ground', {'b': 'open'})
    """
    measured = tuple((name, 1) for name, setting in settings.items() if setting == "measure")
    if not measured:
        raise NetworkError("at least one coil must be measured.")
    opened = [name for name, setting in settings.items() if setting == "open"]
    name = " + ".join(name for name, _ in measured)
    return ScanState(name, measured, others="ground", exceptions=dict.fromkeys(opened, "open"))


def unit_fields(design: Design, spacing: float = SPACING) -> UnitFields:
    """B of every coil on a plane of limited points."""
    x_min, y_min, x_max, y_max = design.array.bounds
    x, y = Span(x_min, x_max, spacing), Span(y_min, y_max, spacing)
    conductors = design.array.conductors()
    require_memory(x.count * y.count * len(conductors), f"a spacing of {spacing * 1e3:g} mm")
    points = grid_points(x.points, y.points, design.field_height)
    fields = np.stack([magnetic_field([conductor], points) for conductor in conductors])
    return UnitFields(x.points, y.points, design.field_height, fields)


def switched_scene(board: BoardParts, fields: UnitFields | None, result: StateResult) -> Scene:
    """Scene of a switch state.

    `fields` are None beside plates, where they differ at every frequency.
    """
    names = board.design.array.names
    first = names.index(result.state.measured[0][0])
    scene = board.coloured(colours_of_currents(result.currents, first))
    if fields is None:
        return scene + Scene(notes=("B beside plates is shown by coilarray view --show board,field.",))
    plane = fields.plane(result.currents.real * 1e-3)
    if np.asarray(plane.point_data[AMOUNT]).max(initial=0.0) > 0:
        scene += scene_of_slices([plane], scale_of_field([plane]))
    note = f"B in phase, {fields.height * 1e3:g} mm above the board, without elastomer; 1 mA."
    return scene + Scene(notes=(note,))


class SwitchesPanel(Panel):
    """Panel with a state of the switches chosen by hand."""

    def __init__(self, session: Session, circuit: Callable[[], Circuit | None]) -> None:
        self._circuit = circuit
        self._result: Resonance | None = None
        self._fields: tuple[Design, UnitFields] | None = None
        values = {"settings": {}, "switched": "", "currents": [], "switch_problem": ""}
        super().__init__(session, values, switch=self._switch)

    def show(self, design: Design, *, anew: bool) -> None:
        """Show another design, `anew` for another file."""
        self._session.state.settings = kept_settings(design.array, {} if anew else self._session.state.settings)
        self._result = None

    def solve(self) -> None:
        """Solve the state with the current circuit."""
        circuit, state = self._circuit(), self._session.state
        if circuit is None:
            return
        with state:
            try:
                self._result = resonate(circuit.network, state_of(state.settings))
            except NetworkError as error:
                self.fail(str(error))
            else:
                state.switched, state.switch_problem = reading_table(self._result).html(), ""
                state.currents = _currents(self._session.work.design, self._result)

    def fail(self, problem: str) -> None:
        """Show why the converter has no readings."""
        self._result = None
        with self._session.state as state:
            state.switched, state.currents, state.switch_problem = "", [], problem

    def scene(self, design: Design, board: BoardParts) -> Scene | None:
        """Scene of the solved state or None, in a thread."""
        result = self._result
        if result is None or len(result.currents) != len(design.array.names):
            return None
        if design.plates:
            return switched_scene(board, None, result)
        if self._fields is None or self._fields[0] is not design:
            self._fields = design, unit_fields(design)
        return switched_scene(board, self._fields[1], result)

    def _switch(self, name: str, setting: str) -> None:
        """Set the switch of a coil."""
        state = self._session.state
        if name in state.settings and setting in SETTINGS:
            state.settings = {**state.settings, name: setting}
            self.solve()
            self._session.redraw()


def reading_table(result: Resonance) -> Table:
    """Return the readings of the converter."""
    columns = (
        Column("effective_inductance", "L_eff", "H"), Column("effective_resistance", "R_eff", "ohm"),
        Column("frequency", "resonance", "Hz"), Column("quality_factor", "Q", "1"),
        Column("parallel_resistance", "R_p", "ohm", KILOHM),
    )  # fmt: skip
    return Table("switched", "", columns, (tuple(cell(getattr(result, column.name)) for column in columns),))


def _currents(design: Design, result: Resonance) -> list[dict[str, Any]]:
    """Magnitude and phase of every coil's current."""
    rows = []
    for name, current in zip(design.array.names, result.currents.tolist(), strict=True):
        angle = math.degrees(cmath.phase(current)) if abs(current) > 1e-9 else 0.0
        rows.append({"name": name, "amount": f"{abs(current):.4f}", "phase": true_minus(f"{angle:+.0f}°")})
    return rows
