"""Tab of switches.

Each coil can be measured, grounded or open. The readings of the converter and the field are shown.
"""

from __future__ import annotations

import cmath
import math
from typing import TYPE_CHECKING, Any

from coilarray.circuit.network import Resonance, resonate
from coilarray.compute.display_units import true_minus
from coilarray.design.model import Design
from coilarray.errors import NetworkError
from coilarray.viz.scenes.scene import Scene
from coilarray.viz.studio.panel import Panel
from coilarray.viz.studio.scene_making import BoardParts, switched_scene
from coilarray.viz.studio.switching import SETTINGS, Setting, UnitFields, kept_settings, state_of, unit_fields

if TYPE_CHECKING:
    from coilarray.viz.studio.page import Page


class SwitchesPanel(Panel):
    """Panel with a state of the switches chosen by hand."""

    def __init__(self, page: Page) -> None:
        self._result: Resonance | None = None
        self._fields: tuple[Design, UnitFields] | None = None
        values = {"settings": {}, "switched": [], "currents": [], "switch_problem": ""}
        super().__init__(page, values, switch=self._switch)

    def show(self, design: Design, *, anew: bool) -> None:
        """Show another design.

        Coils that still exist keep their settings. `anew` is true for another file.
        """
        self._page.state.settings = kept_settings(design.array, {} if anew else self._page.state.settings)
        self._result = None

    def solve(self) -> None:
        """Solve the state with the current circuit.

        This takes some milliseconds.
        """
        circuit, state = self._page.numbers.circuit, self._page.state
        if circuit is None:
            return
        with state:
            try:
                self._result = resonate(circuit.network, state_of(state.settings))
            except NetworkError as error:
                self.fail(str(error))
            else:
                state.switched, state.switch_problem = _rows(self._result), ""
                state.currents = _currents(self._page.work.design, self._result)

    def fail(self, problem: str) -> None:
        """Show why the converter has no readings."""
        self._result = None
        with self._page.state as state:
            state.switched, state.currents, state.switch_problem = [], [], problem

    def scene(self, design: Design, board: BoardParts) -> Scene | None:
        """Make the scene of the state.

        It is None without a solution. The method runs in a thread.
        """
        result = self._result
        if result is None or len(result.currents) != len(design.array.names):
            return None
        if design.plates:
            return switched_scene(board, None, result)
        if self._fields is None or self._fields[0] is not design:
            self._fields = design, unit_fields(design)
        return switched_scene(board, self._fields[1], result)

    def _switch(self, name: str, setting: Setting) -> None:
        """Set the switch of a coil."""
        state = self._page.state
        if name not in state.settings or setting not in SETTINGS:
            return
        state.settings = {**state.settings, name: setting}
        self.solve()
        self._page.redraw()


def _rows(result: Resonance) -> list[list[str]]:
    """Rows of the readings of the converter.

    A row has label, number, unit and all digits.
    """
    values = (
        ("L_eff", result.effective_inductance, 1e6, "µH", 3),
        ("R_eff", result.effective_resistance, 1.0, "Ω", 2),
        ("resonance", result.frequency, 1e-6, "MHz", 4),
        ("Q", result.quality_factor, 1.0, "", 1),
        ("R_p", result.parallel_resistance, 1e-3, "kΩ", 2),
    )
    return [
        [name, f"{value * factor:.{digits}f}" if math.isfinite(value) else "∞", unit, repr(float(value))]
        for name, value, factor, unit, digits in values
    ]


def _currents(design: Design, result: Resonance) -> list[dict[str, Any]]:
    """Magnitude and phase of every coil's current.

    They are relative to the current of the first measured coil.
    """
    rows = []
    for name, current in zip(design.array.names, result.currents.tolist(), strict=True):
        angle = math.degrees(cmath.phase(current)) if abs(current) > 1e-9 else 0.0
        rows.append({"name": name, "amount": f"{abs(current):.4f}", "phase": true_minus(f"{angle:+.0f}°")})
    return rows
