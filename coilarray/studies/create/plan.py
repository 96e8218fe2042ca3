"""Choices for a new design, decisions about it, and its file."""

from __future__ import annotations

import math
import re
from bisect import bisect_left
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
from scipy.optimize import brentq

from coilarray.design.fabs import load_profile
from coilarray.design.model import Design, build_design
from coilarray.design.scan_states import PARTS, PartName
from coilarray.design.tables import SCHEMA
from coilarray.errors import DesignError
from coilarray.geometry import FabRules
from coilarray.geometry.arcs import SIDES, Side
from coilarray.geometry.array import LatticeKind

_RINGS = {7: 1, 19: 2, 37: 3}
_TRIANGLE = 3
_MOST = 1000
_COILS = "coils must be as 1, 6 (a row), 4x4 (columns by rows), 3-hex, 7-hex, 19-hex or 37-hex; got {!r}."
Shape = Literal["hexagon", "square", "circle", "rectangle", "racetrack"]
SHAPES: tuple[Shape, ...] = get_args(Shape)
LONG_SHAPES: tuple[Shape, ...] = ("rectangle", "racetrack")  # shapes with a width and a height
Overlap = Literal["none", "decoupled"]
_FROM_TO = {  # range of each choice in SI, with its option's unit
    "size": (0.5e-3, 1.0, 1e3, "mm"),
    "pitch": (0.5e-3, 1.0, 1e3, "mm"),
    "inductance": (1e-9, 0.1, 1e6, "µH"),
    "frequency": (1e3, 1e9, 1e-6, "MHz"),
    "capacitance": (1e-12, 1e-3, 1e12, "pF"),
}
MOST_LAYERS = 32  # largest number of copper layers that board houses make
_TRACE_STEP = 1e-6  # m, to which a trace is drawn
_MOST_COUNTS = 8  # numbers of turns that are tried, of all that are possible
_COPPER, _BOARD, _PREPREG = 35e-6, 1.6e-3, 0.2e-3
_DRILL, _WIDEST_DRILL, _RING = 0.25e-3, 0.6e-3, 0.125e-3  # of vias, in m: coarser than most houses need
_TERMINAL, _TERMINAL_RING, _TERMINALS_APART = 0.5e-3, 0.25e-3, 1.5e-3
_PAD_STEP = 50e-6
_SIDES = tuple({"first_side": side} for side in ("top", "bottom", "right", "left"))
_ROUGHLY = {"circle": "twelve sides", "racetrack": "rectangle"}
_BOARD_ASSUMED = {
    "stackup.dielectric_thickness_mm": "usual of a board of 1.6 mm; ask the board house for its own",
    "stackup.dielectric_epsilon_r": "usual of FR-4",
}
_ELASTOMER: Mapping[str, Any] = {
    "elastomer": [
        {"name": "base", "thickness_mm": 3.0, "relative_permeability": 1.0, "youngs_modulus_kPa": 60.0},
        {"name": "magnetic", "thickness_mm": 1.0, "relative_permeability": 2.5, "youngs_modulus_kPa": 180.0},
    ],
    "indenter": {"shape": "hemisphere", "radius_mm": 2.0},
    "indentation": {"depths_mm": [0.3, 0.6]},
}
_ELASTOMER_ASSUMED = {
    "elastomer.0.youngs_modulus_kPa": "typical of a soft silicone rubber",
    "elastomer.1.youngs_modulus_kPa": "three times the pure rubber, as 30 % of powder makes it (Guth-Gold)",
    "elastomer.1.relative_permeability": "typical of 30 % of iron powder",
    "circuit.elastomer_permittivity": "about 3 for silicone rubber; iron powder raises it",
}


@dataclass(frozen=True)
class Arrangement:
    """Lattice of the coils and its repetitions."""

    lattice: LatticeKind
    columns: int = 1
    rows: int = 1

    @property
    def keys(self) -> dict[str, Any]:
        """Entries of ``[array]``."""
        if self.lattice == "single":
            return {"lattice": "single"}
        if self.lattice == "rings":
            return {"lattice": "rings", "rings": self.columns}
        rows = {"rows": self.rows} if self.lattice not in ("linear", "triangle") else {}
        return {"lattice": self.lattice, "columns": self.columns, **rows}

    @property
    def few(self) -> Arrangement:
        """The same arrangement, reduced to coils with different neighbours."""
        return replace(self, columns=min(self.columns, 1 if self.lattice == "rings" else 3), rows=min(self.rows, 3))

    @property
    def fewest(self) -> Arrangement:
        """A few coils with neighbours in every direction."""
        if self.lattice == "rings":
            return Arrangement("hexagonal", 2, 2)
        return replace(self, columns=min(self.columns, 2), rows=min(self.rows, 2))


def read_arrangement(coils: str | int, shape: str = "square") -> Arrangement:
    """Read the number and arrangement of the coils.

    The text is 1, 6 for a row, 4x4, 3-hex (a triangle), or 7-hex (rings about a centre). Hexagons
    and circles in 4x4 lie on a hexagonal lattice with equally far neighbours.
    """
    found = re.fullmatch(r"(\d{1,9})(?:x(\d{1,9})|(-hex))?", str(coils).strip().lower().replace("×", "x"))
    count, rows, ring = found.groups() if found else ("0", None, None)
    first, second = int(count), int(rows or 1)
    if ring and first == _TRIANGLE:
        return Arrangement("triangle", 2)
    if ring and first in _RINGS:
        return Arrangement("rings", _RINGS[first])
    if first * second < 1 or ring:
        raise DesignError(_COILS.format(coils))
    if first * second > _MOST:
        raise DesignError(f"coils must be at most {_MOST}; got {first * second} in {coils!r}.")
    if first == second == 1:
        return Arrangement("single")
    if second == 1:
        return Arrangement("linear", first)
    if first == 1:  # a column, which a hexagonal lattice would make a zigzag
        return Arrangement("square", 1, second)
    return Arrangement("hexagonal" if shape in ("hexagon", "circle") else "square", first, second)


def read_size(text: str) -> float | tuple[float, float]:
    """Read a size in mm, 16 or 20x12, in m."""
    try:
        sides = [float(side) * 1e-3 for side in text.lower().replace("×", "x").split("x")]
    except ValueError:
        sides = []
    if len(sides) not in (1, 2):
        raise DesignError(f"size must be a width, as 16, or width and height, as 20x12; got {text[:40]!r}.")
    return sides[0] if len(sides) == 1 else (sides[0], sides[1])


@dataclass(frozen=True)
class Choices:
    """Checked choices for a new design in SI."""

    coils: str | int = "3"
    shape: Shape = "hexagon"
    size: float | tuple[float, float] | None = None
    inductance: float | None = None
    layers: int | None = None
    fab: str | None = None
    pitch: float | None = None
    overlap: Overlap = "none"
    elastomer: bool = True
    frequency: float | None = None
    capacitance: float | None = None
    connector: Side | None = None
    switches: PartName | None = None
    title: str = ""

    def __post_init__(self) -> None:
        for what, allowed in (
            ("shape", SHAPES),
            ("overlap", get_args(Overlap)),
            ("connector", (None, *SIDES)),
            ("switches", (None, *PARTS)),
        ):
            if getattr(self, what) not in allowed:
                listed = ", ".join(word for word in allowed if word is not None)
                raise DesignError(f"{what} must be one of {listed}; got {getattr(self, what)!r}.")
        if isinstance(self.size, tuple) and self.shape not in LONG_SHAPES:
            sides = " × ".join(f"{side * 1e3:g}" for side in self.size)
            raise DesignError(f"size must be one number for a {self.shape}; got {sides} mm.")
        for one, other, why in (
            ("pitch", "overlap", "the overlap is that of the pitch"),
            ("frequency", "capacitance", "the frequency is that of the capacitance"),
        ):
            if getattr(self, one) is not None and getattr(self, other) not in (None, "none"):
                raise DesignError(f"{one} and {other} cannot both be given: {why}.")
        given = [("size", side) for side in self.sides]
        given += [(what, number) for what in _FROM_TO if what != "size" and (number := getattr(self, what)) is not None]
        for what, number in given:
            least, most, scale, unit = _FROM_TO[what]
            if not (math.isfinite(number) and number > 0):
                raise DesignError(f"{what} must be positive and finite; got {number * scale:g} {unit}.")
            if not least <= number <= most:
                raise DesignError(
                    f"{what} must be {least * scale:g} to {most * scale:g} {unit}; got {number * scale:g} {unit}."
                )
        if self.layers is not None and not 1 <= self.layers <= MOST_LAYERS:
            raise DesignError(f"layers must be 1 to {MOST_LAYERS}; got {self.layers}.")
        if self.arrangement.lattice == "single" and (self.pitch is not None or self.overlap != "none"):
            raise DesignError("one coil has no neighbours: pitch and overlap are for several.")

    @property
    def sides(self) -> tuple[float, float]:
        """Width and height of a coil in m."""
        usual = (20e-3, 12e-3) if self.shape in LONG_SHAPES else 16e-3
        size = usual if self.size is None else self.size
        return size if isinstance(size, tuple) else (size, size)

    @property
    def layers_of_fab(self) -> int | None:
        """Layers of the named service's boards, None for any number."""
        return None if self.fab is None else load_profile(self.fab).rules.max_layers

    @cached_property
    def arrangement(self) -> Arrangement:
        """Arrangement of the coils."""
        return read_arrangement(self.coils, self.shape)


@dataclass(frozen=True)
class Winding:
    """Turns per layer, trace width and gap in m."""

    turns: int
    trace_width: float
    gap: float


@dataclass(frozen=True)
class Room:
    """Limits for a winding in m."""

    radius: float  # from the centre to the outer edge of the nearest side
    hole: float  # to the inner edge of the innermost turn; a circle's inner end lies a pitch further in
    trace_width: float
    gap: float
    widest_trace: float = math.inf

    def widest(self, turns: int) -> float:
        """Widest trace in m, negative if not even gaps fit."""
        return min((self.radius - self.hole - turns * self.gap) / (turns + 1), self.widest_trace)

    @property
    def most_turns(self) -> int:
        """Most turns that fit, with the narrowest trace."""
        pitch = self.trace_width + self.gap
        return max(math.floor((self.radius - self.hole - self.trace_width) / pitch * (1 + 1e-9)), 0)

    @property
    def fullest(self) -> Winding:
        """Winding of the most turns, which has the most inductance."""
        return Winding(self.most_turns, self.trace_width, self.gap)


def wind(
    inductance: float,
    room: Room,
    inductance_of: Callable[[Winding], float],
    resistance_of: Callable[[Winding], float],
    keeping: int | None = None,
) -> Winding:
    """Find the winding of an inductance with least resistance.

    Narrower traces of equally many turns lie further out and have more inductance. The width for
    each number of turns is solved for and rounded to 1 µm. A possible number of turns `keeping` is
    kept.
    """
    if room.most_turns < 1:
        raise DesignError(
            f"there is no room for a turn of {room.trace_width * 1e3:g} mm trace between {room.hole * 1e3:.3g} and "
            f"{room.radius * 1e3:.3g} mm from the centre."
        )

    def of(turns: int, width: float) -> float:
        return inductance_of(Winding(turns, width, room.gap))

    what_can, fewest, last = "", 1, 1
    if (reached := inductance_of(room.fullest)) < inductance:
        what_can = f"at most {reached * 1e6:.4g} µH can, with {room.most_turns} turns a layer"
    else:
        fewest = _first(lambda turns: of(turns, room.trace_width) >= inductance, room.most_turns)
        last = _first(lambda turns: of(turns, room.widest(turns)) > inductance, room.most_turns) - 1
        if last < 1 and fewest == 1:
            what_can = f"at least {of(1, room.widest(1)) * 1e6:.3g} µH can, with 1 turn a layer"
    if what_can:
        raise DesignError(
            f"an inductance of {inductance * 1e6:.4g} µH cannot be reached: {what_can}, traces of at least "
            f"{room.trace_width * 1e3:g} mm and gaps of {room.gap * 1e3:g} mm."
        )
    if last < fewest:  # between two numbers of turns: the nearer one
        ends = [(fewest, room.widest(fewest)), (max(last, 1), room.trace_width)]
        turns, width = min(ends, key=lambda end: abs(of(*end) - inductance))
        return Winding(turns, _drawn(width, room.widest(turns)), room.gap)
    counts = np.unique(np.linspace(fewest, last, _MOST_COUNTS).round().astype(int)).tolist()
    found = []
    for turns in [keeping] if keeping is not None and fewest <= keeping <= last else counts:
        narrowest, widest = room.trace_width, room.widest(turns)

        def missing(width: float, turns: int = turns) -> float:
            return of(turns, width) - inductance

        width = float(brentq(missing, narrowest, widest, xtol=_TRACE_STEP / 4))
        found.append(Winding(turns, max(_drawn(width, widest), narrowest), room.gap))
    return found[0] if len(found) == 1 else min(found, key=resistance_of)


def _drawn(width: float, widest: float) -> float:
    """Return the nearest width in m that can be drawn."""
    return min(round(width / _TRACE_STEP), math.floor(widest / _TRACE_STEP * (1 + 1e-9))) * _TRACE_STEP


def _first(holds: Callable[[int], bool], most: int) -> int:
    """Least number from 1 that fulfils a monotonic condition, or `most` + 1."""
    return 1 + bisect_left(range(1, most + 1), True, key=holds)


_UNDECIDED = Winding(1, 0.15e-3, 0.15e-3)


_CORNERS: Mapping[Shape, tuple[float, ...]] = {
    "hexagon": (90, 270, 30, 150, 210, 330),
    "square": (45, 135, 225, 315),
    "circle": (90, 270, 0, 180, 45, 135, 225, 315),
}
_TURNED = (0, 180, 60, 120, 240, 300)  # corners of a hexagon that face its neighbours


@dataclass(frozen=True)
class Plan:
    """Decisions about a design so far, in m and F."""

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
        """Possible starts of the winding and its leads."""
        degrees = _TURNED if self.turned else _CORNERS.get(self.shape, ())
        return tuple({"first_corner_deg": degree} for degree in degrees) or _SIDES

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
            document |= _ELASTOMER
        return document | {
            "circuit": {
                "capacitance_pF": float(f"{self.capacitance * 1e12:.6g}"),
                **({} if self.switches is None else {"switches": self.switches}),
                **({"elastomer_permittivity": 3.0} if self.elastomer else {}),
            },
            "field": {"height_mm": 3.0},
            "fab": {"profile": self.fab},
            "assumed": _BOARD_ASSUMED | (_ELASTOMER_ASSUMED if self.elastomer else {}),
        }

    def _title(self) -> str:
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
        """Diameter of the vias' holes in m, from the trace."""
        wide = math.floor(min(self.winding.trace_width / 2, _WIDEST_DRILL) / _PAD_STEP) * _PAD_STEP
        return max(_DRILL, wide, self.rules.min_drill)

    @property
    def via_pad(self) -> float:
        """Diameter of the vias' pads in m, to 0.05 mm."""
        pad = self.via_drill + 2 * max(_RING, self.rules.min_annular_ring)
        return math.ceil(pad / _PAD_STEP * (1 - 1e-9)) * _PAD_STEP

    def _coil(self) -> dict[str, Any]:
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


def _mm(length: float) -> float:
    return round(length * 1e3, 6)
