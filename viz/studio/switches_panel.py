"""Tab of switches: measure, ground or open for each coil, the readings of the converter, and the field."""

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
    """Panel with a state of the switches that is chosen by hand."""

    def __init__(self, page: Page) -> None:
        self._result: Resonance | None = None
        self._fields: tuple[Design, UnitFields] | None = None
        values = {"settings": {}, "switched": [], "currents": [], "switch_problem": ""}
        super().__init__(page, values, switch=self._switch)

    def show(self, design: Design, *, anew: bool) -> None:
        """Show another design, with the same settings for coils that still exist; `anew` where it is another file."""
        self._page.state.settings = kept_settings(design.array, {} if anew else self._page.state.settings)
        self._result = None

    def solve(self) -> None:
        """Solve the state with the current circuit, which takes some milliseconds."""
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
        """Show why there is nothing that the converter sees."""
        self._result = None
        with self._page.state as state:
            state.switched, state.currents, state.switch_problem = [], [], problem

    def scene(self, design: Design, board: BoardParts) -> Scene | None:
        """Return the scene of the state, or None without a solution; runs in a thread."""
        result = self._result
        if result is None or len(result.currents) != len(design.array.names):
            return None
        if design.plates:
            return switched_scene(board, None, result)
        if self._fields is None or self._fields[0] is not design:
            self._fields = design, unit_fields(design)
        return switched_scene(board, self._fields[1], result)

    def _switch(self, name: str, setting: Setting) -> None:
        state = self._page.state
        if name not in state.settings or setting not in SETTINGS:
            return
        state.settings = {**state.settings, name: setting}
        self.solve()
        self._page.redraw()


def _rows(result: Resonance) -> list[list[str]]:
    """Return label, number, unit and all digits of the readings of the converter."""
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
    """Return the magnitude and phase of every coil's current relative to that of the first measured coil."""
    rows = []
    for name, current in zip(design.array.names, result.currents.tolist(), strict=True):
        angle = math.degrees(cmath.phase(current)) if abs(current) > 1e-9 else 0.0
        rows.append({"name": name, "amount": f"{abs(current):.4f}", "phase": true_minus(f"{angle:+.0f}°")})
    return rows
