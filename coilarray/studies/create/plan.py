"""Decisions about a new design, and the design file made from them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from coilarray.design.fab_limits import load_profile
from coilarray.design.model import Design, build_design
from coilarray.design.switch_parts import PartName
from coilarray.design.tables import SCHEMA
from coilarray.geometry import FabRules
from coilarray.studies.create.arrangement import Arrangement
from coilarray.studies.create.choices import Shape
from coilarray.studies.create.winding import Winding

_COPPER, _BOARD, _PREPREG = 35e-6, 1.6e-3, 0.2e-3
_DRILL, _WIDEST_DRILL, _RING = 0.25e-3, 0.6e-3, 0.125e-3  # of vias, in m: coarser than most houses need
_TERMINAL, _TERMINAL_RING, _TERMINALS_APART = 0.5e-3, 0.25e-3, 1.5e-3
_PAD_STEP = 50e-6


_UNDECIDED = Winding(1, 0.15e-3, 0.15e-3)


def _corners(*degrees: float) -> tuple[dict[str, Any], ...]:
    return tuple({"first_corner_deg": degree} for degree in degrees)


_SIDES = tuple({"first_side": side} for side in ("top", "bottom", "right", "left"))
_STARTS: Mapping[Shape, tuple[dict[str, Any], ...]] = {
    "hexagon": _corners(90, 270, 30, 150, 210, 330), "square": _corners(45, 135, 225, 315),
    "circle": _corners(90, 270, 0, 180, 45, 135, 225, 315), "rectangle": _SIDES, "racetrack": _SIDES,
}  # fmt: skip
_ROUGHLY = {"circle": "twelve sides", "racetrack": "rectangle"}
# corners of a hexagon that face its neighbours
_TURNED = _corners(0, 180, 60, 120, 240, 300)


@dataclass(frozen=True)
class Plan:
    """Decisions about a design so far.

    Lengths are in m and the capacitance is in F. `document` makes the design file.
    """

    name: str
    title: str
    arrangement: Arrangement
    shape: Shape
    size: tuple[float, float]
    elastomer: bool
    fab: str = ""
    sets: int = 1
    turned: bool = False  # hexagons with corners towards their neighbours
    hole: float = 0.25  # of half the coil's width: the smallest hole of its winding
    winding_layers: int = 2
    winding: Winding = _UNDECIDED
    pitch: float = 0.0
    start: int = 0  # corner or side at which the winding begins
    lead: float = 2e-3
    capacitance: float = 330e-12
    rough: bool = False  # arcs and round ends as few straight sides, for quick estimates
    connector: Mapping[str, Any] | None = None  # keys of its table
    switches: PartName | None = None

    @property
    def width(self) -> float:
        """Width in m of a coil along its longer side."""
        return max(self.size)

    @property
    def one(self) -> Plan:
        """The same board with one coil."""
        return replace(self, arrangement=Arrangement("single"))

    @property
    def starts(self) -> tuple[dict[str, Any], ...]:
        """Possible starts of the winding and its leads.

        Hexagons and squares face neighbours along x with a side.
        """
        return _TURNED if self.turned else _STARTS[self.shape]

    @property
    def layers(self) -> int:
        """Number of copper layers."""
        return self.sets * self.winding_layers

    @cached_property
    def rules(self) -> FabRules:
        """Limits of the board house."""
        return load_profile(self.fab).rules

    @cached_property
    def design(self) -> Design:
        """The design as far as it is decided."""
        return build_design(self.document, self.name)

    @property
    def document(self) -> dict[str, Any]:
        """Tables of the design file."""
        names = [f"L{k + 1}" for k in range(self.layers)]
        own = [names[k : k + self.winding_layers] for k in range(0, self.layers, self.winding_layers)]
        alone = self.arrangement.lattice == "single"
        pitch = {} if alone else {"pitch_mm": _mm(self.pitch)}
        document = {
            "schema": SCHEMA,
            "name": self.name,
            "title": self.title or self._title(),
            "stackup": self._stackup(names),
            "coils": {self.shape: self._coil()},
            "array": {**self.arrangement.keys, "coil": self.shape, **pitch, "layers": own[:1] if alone else own},
            "board": {"margin_mm": max(2.0, math.ceil(self.rules.min_edge_clearance * 1e3))},
        }
        if self.connector is not None:
            document["connector"] = dict(self.connector)
        if self.elastomer:
            document |= self._elastomer()
        return document | {
            "circuit": {
                "capacitance_pF": float(f"{self.capacitance * 1e12:.6g}"),
                **({} if self.switches is None else {"switches": self.switches}),
                **({"elastomer_permittivity": 3.0} if self.elastomer else {}),
            },
            "field": {"height_mm": 3.0},
            "fab": {"profile": self.fab},
            "assumed": self._assumed(),
        }

    def _title(self) -> str:
        """Describe the coils, for the title."""
        count = self.arrangement
        shape = {"hexagon": "hexagonal", "circle": "circular", "rectangle": "rectangular"}.get(self.shape, self.shape)
        if count.lattice == "single":
            return f"One {shape} coil"
        if count.lattice == "rings":
            rings = f"{count.columns} rings" if count.columns > 1 else "a ring"
            return f"{shape.capitalize()} coils in {rings} about a centre"
        if count.lattice == "triangle":
            return f"{shape.capitalize()} coils in a triangle"
        return f"{shape.capitalize()} coils, {count.columns}" + (f" × {count.rows}" if count.rows > 1 else " in a row")

    def _stackup(self, names: list[str]) -> dict[str, Any]:
        """Make the stack-up table of a board with usual thicknesses."""
        n = len(names)
        copper = [min(_COPPER, self.rules.most_copper(k, n) or _COPPER) for k in range(n)]
        thin = n // 2 if n > 2 and n % 2 == 0 else 0  # each between the two layers of a pair
        even = (_BOARD - sum(copper)) / max(n - 1, 1)
        rest = (_BOARD - sum(copper) - thin * _PREPREG) / max(n - 1 - thin, 1)
        pair, rest = (_PREPREG, rest) if rest > _PREPREG / 2 else (even, even)  # many layers: all of them thin
        dielectric = [pair if thin and k % 2 == 0 else rest for k in range(n - 1)]
        return {
            "layers": names,
            "copper_thickness_um": [float(f"{value * 1e6:.6g}") for value in copper],
            "dielectric_thickness_mm": [float(f"{value * 1e3:.3g}") for value in dielectric],
            "dielectric_epsilon_r": [4.5] * (n - 1),
        }

    @property
    def via_drill(self) -> float:
        """Diameter of the vias' holes in m.

        It is half a wide trace, up to a limit.
        """
        wide = math.floor(min(self.winding.trace_width / 2, _WIDEST_DRILL) / _PAD_STEP) * _PAD_STEP
        return max(_DRILL, wide, self.rules.min_drill)

    @property
    def via_pad(self) -> float:
        """Diameter of the vias' pads in m.

        It is rounded up to a twentieth of a millimetre.
        """
        pad = self.via_drill + 2 * max(_RING, self.rules.min_annular_ring)
        return math.ceil(pad / _PAD_STEP * (1 - 1e-9)) * _PAD_STEP

    def _coil(self) -> dict[str, Any]:
        """Make the coil's table."""
        width, height = (_mm(side) for side in self.size)
        sizes: Mapping[str, dict[str, Any]] = {
            "twelve sides": {"shape": "polygon", "sides": 12, "outer_across_flats_mm": width, "winding_rule": "corner"},
            "hexagon": {"shape": "polygon", "sides": 6, "outer_across_flats_mm": width},
            "square": {"shape": "polygon", "sides": 4, "outer_across_flats_mm": width},
            "circle": {"shape": "circle", "outer_diameter_mm": width},
            "rectangle": {"shape": "rectangle", "outer_width_mm": width, "outer_height_mm": height},
            "racetrack": {"shape": "racetrack", "outer_width_mm": width, "outer_height_mm": height},
        }
        trace = self.winding.trace_width
        # the outer vias of four layers and more lie between the leads, which part at 45 degrees
        outer, gap = max(self.winding_layers // 2 - 1, 1), self.winding.gap
        places = outer + 1 if outer == 2 else outer  # two of them are beside the middle, where the leads are nearer
        apart = max(_TERMINALS_APART, places * (self.via_pad + gap) + gap + trace + _PAD_STEP)
        apart = max(apart, 2 * trace) if self.winding_layers > 2 else apart
        shape = _ROUGHLY.get(self.shape, self.shape) if self.rough else self.shape
        terminal = max(_TERMINAL, self.rules.min_drill)
        terminal_pad = max(terminal + 2 * max(_TERMINAL_RING, self.rules.min_annular_ring), trace)
        return {
            **sizes[shape],
            "turns_per_layer": self.winding.turns,
            "winding_layers": self.winding_layers,
            "trace_width_mm": _mm(trace),
            "gap_mm": _mm(self.winding.gap),
            **self.starts[self.start],
            "via": {"drill_mm": _mm(self.via_drill), "pad_mm": _mm(self.via_pad), "plating_um": 25},
            "leads": {
                "length_mm": _mm(max(self.lead, apart)),
                "spacing_mm": _mm(apart),
                "pad_mm": _mm(terminal_pad),
                "drill_mm": _mm(terminal),
            },
        }

    def _elastomer(self) -> dict[str, Any]:
        """Make the tables of the elastomer and its indenter."""
        return {
            "elastomer": [
                {"name": "base", "thickness_mm": 3.0, "relative_permeability": 1.0, "youngs_modulus_kPa": 60.0},
                {"name": "magnetic", "thickness_mm": 1.0, "relative_permeability": 2.5, "youngs_modulus_kPa": 180.0},
            ],
            "indenter": {"shape": "hemisphere", "radius_mm": 2.0},
            "indentation": {"depths_mm": [0.3, 0.6]},
        }

    def _assumed(self) -> dict[str, str]:
        """Make the reasons of the assumed values."""
        board = "usual of a board of 1.6 mm; ask the board house for its own"
        reasons = {"stackup.dielectric_thickness_mm": board, "stackup.dielectric_epsilon_r": "usual of FR-4"}
        if self.elastomer:
            reasons |= {
                "elastomer.0.youngs_modulus_kPa": "typical of a soft silicone rubber",
                "elastomer.1.youngs_modulus_kPa": "three times the pure rubber, as 30 % of powder makes it (Guth-Gold)",
                "elastomer.1.relative_permeability": "typical of 30 % of iron powder",
                "circuit.elastomer_permittivity": "about 3 for silicone rubber; iron powder raises it",
            }
        return reasons


def _mm(length: float) -> float:
    """Return a length in mm, to the nanometre."""
    return round(length * 1e3, 6)
