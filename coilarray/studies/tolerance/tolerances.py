"""Fabrication errors of a board: their distributions, TOML files, and the design with them.

An error is named ``kind.part``: ``etch.L1``, ``registration_x.L3``, ``dielectric.L1-L2``,
``elastomer.base``. Kinds without parts have a plain name: ``placement_x``, ``permeability``,
``capacitance``. Values are in SI.

==================  ============  ====  ===========================================================
kind                part          unit  effect of a positive error
==================  ============  ====  ===========================================================
etch                copper layer  m     widens every trace, the centre line stays
registration_x, _y  copper layer  m     shifts the copper against the drilled holes
rotation            copper layer  rad   turns the copper about the board's middle, counterclockwise
dielectric          layer pair    1     thickens the dielectric, all layers below sink
copper              copper layer  1     thickens the copper, all layers below sink
placement_x, _y     none          m     true less believed position of elastomer and indenter
permeability        none          1     raises μr of all magnetic sheets
elastomer           sheet         m     thickens the sheet
capacitance         none          1     raises the capacitance of the tank
plate_distance      plate         m     moves the plate away from the coils, or nearer to contact
plate_thickness     plate         1     thickens the plate, its face near the coils stays
conductivity        none          1     raises the conductivity of all plates and of the target
target_tilt_x, _y   none          rad   tilts a target with an outline, which rises towards x or y
==================  ============  ====  ===========================================================

Plates keep their gap to the sheets, or to the underside of the board, as these become thicker. The
ends of every line stay at the drilled holes that join them. Pads, holes and the outline of the
board have no error.
"""

from __future__ import annotations

import cmath
import difflib
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import resources
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator
from scipy.special import ndtri
from scipy.stats import qmc

from coilarray.compute.arrays import FloatArray
from coilarray.design.keys import Bounds, Millimetres, Position, Table, require_rising
from coilarray.design.model import Design
from coilarray.design.toml_file import TomlFiles
from coilarray.errors import DesignError, GeometryError, GoalError
from coilarray.geometry import Array, Coil, FinitePlate, Material, Placement, Plate, Target

Distribution = Literal["normal", "uniform"]
UNITS: Mapping[str, str] = {  # SI units of the errors by table
    "etch": "m", "registration": "m", "rotation": "rad", "dielectric": "1", "copper": "1", "placement": "m",
    "permeability": "1", "elastomer": "m", "capacitance": "1", "plate_distance": "m", "plate_thickness": "1",
    "conductivity": "1", "target_tilt": "rad",
}  # fmt: skip
KINDS: Mapping[str, tuple[str, ...]] = {
    table: (f"{table}_x", f"{table}_y") if table in ("registration", "placement", "target_tilt") else (table,)
    for table in UNITS
}
"""Errors of `coilarray.studies.tolerance.tolerances` by the tables of a file."""
_OF_BOARD = re.compile(r"(etch|registration_[xy]|rotation|dielectric|copper)\.")  # errors of copper and laminate
SCHEMA = 1  # version of the tolerance file format
_TOLERANCES = TomlFiles("tolerance", GoalError)
# bounds far beyond any board, so that a typo is refused at its place
_Micrometres = Annotated[float, Field(ge=0, le=10_000)]
_UpTo100 = Annotated[float, Field(ge=0, le=100)]
MOST_SAMPLES = 1_000_000
_LEAST_TAIL = 2.0**-40  # a probability of 0 or 1 would lie at infinity
_BLOCK, _MOST_PAIRED = 64, 4096  # boards that are paired at once at first, and from which Sobol's own pairing is good
_WELL_PAIRED = 6  # errors of which 64 Sobol points correlate by 0.2 at the most
_MOST_CLEARED = 0.6  # errors, of the boards of a block, up to which each can be uncorrelated to all before


@dataclass(frozen=True)
class Spread:
    """Spread of one kind of error, of two independent parts in SI."""

    distribution: Distribution = "normal"
    board: float = 0.0  # standard deviation of the part that all layers of a board share
    layer: float = 0.0  # of the part of each layer


@dataclass(frozen=True)
class Positions:
    """Grid of the indenter in m from the map's origin."""

    x: tuple[float, ...]
    y: tuple[float, ...]
    depth: float
    noise: float | None = None  # standard deviation of δ, by default of the design's noise budget


@dataclass(frozen=True)
class Limit:
    """Bounds of a good board's output, in its unit."""

    quantity: str
    at_least: float = -math.inf
    at_most: float = math.inf

    @property
    def text(self) -> str:
        """Limit in one line of text."""
        low = "" if math.isinf(self.at_least) else f"{self.at_least:g} ≤ "
        high = "" if math.isinf(self.at_most) else f" ≤ {self.at_most:g}"
        return f"{low}{self.quantity}{high}"


@dataclass(frozen=True)
class Tolerances:
    """Tolerance file, read and checked.

    A kind of error without a table in `spreads` does not occur. `assumed` are tables that are not
    given, with reasons. The study reports `quantities`, errors of `positions`, and the share of
    boards within `limits`.
    """

    spreads: Mapping[str, Spread]
    assumed: Mapping[str, str] = field(default_factory=dict)
    quantities: tuple[str, ...] = ()
    positions: Positions | None = None
    limits: tuple[Limit, ...] = ()


@dataclass(frozen=True)
class Contributor:
    """Independent error, which moves one or more errors equally."""

    name: str
    table: str
    part: Literal["board", "layer"]  # common to all layers of a board, or of a single layer
    targets: tuple[str, ...]
    distribution: Distribution
    deviation: float  # standard deviation in SI, of mean zero


def contributors(design: Design, tolerances: Tolerances) -> tuple[Contributor, ...]:
    """Independent errors with a spread, or GoalError without any."""
    # Board part and layer part stay separate even for a single layer or sheet.
    names = error_names(design)
    found = []
    for table, kinds in KINDS.items():
        spread = tolerances.spreads.get(table, Spread())
        for kind in kinds:
            for board in dict.fromkeys("".join(name.rpartition("/")[:2]) for name in names):  # made independently
                start, how = f"{board}{kind}", spread.distribution
                targets = tuple(name for name in names if name == start or name.startswith(f"{start}."))
                if spread.board > 0 and targets:
                    found.append(Contributor(f"{start}, board", table, "board", targets, how, spread.board))
                for target in targets if spread.layer > 0 else ():
                    name = f"{start}, layer {target.removeprefix(f'{start}.')}"
                    found.append(Contributor(name, table, "layer", (target,), how, spread.layer))
    if not found:
        raise GoalError(f"no error of {design.name} has a spread; at least one must be above 0.")
    return tuple(found)


def load_tolerances(path: str | Path | None = None) -> Tolerances:
    """Read a tolerance file (TOML), by default typical values.

    Tables that are missing in the file at `path` have typical values and are marked as assumed,
    unless it has ``others = "none"``. Raises GoalError for an unreadable file, wrong TOML, or a key
    or value that is not allowed, in one line.

    >>> load_tolerances().spreads["etch"].board
    4.7e-06
    """
    if path is None:
        return _typical()
    return parse_tolerances(_TOLERANCES.text(path), str(path))


def parse_tolerances(text: str, origin: str = "tolerances") -> Tolerances:
    """Read tolerances from TOML text, which messages call `origin`."""
    file = _TOLERANCES.check(_File, _TOLERANCES.parse(text, origin), origin)
    given = file.spreads()
    for key in file.assumed:
        if key not in given:
            raise GoalError(f"{origin}: assumed.{key} does not name a table of errors of the file.")
    if file.others == "none":
        return file.build(given, file.assumed)
    assumed = {key: reason for key, reason in _typical().assumed.items() if key not in given}
    return file.build({**_typical().spreads, **given}, {**assumed, **file.assumed})


def typical_text() -> str:
    """Return the text of the bundled tolerance file, a template."""
    return resources.files("coilarray.studies.tolerance").joinpath("typical.toml").read_text(encoding="utf-8")


class _Errors(Table):
    """Normal with these standard deviations, or uniform with these half widths."""

    distribution: Distribution = "normal"
    """Normal with these standard deviations, or uniform with these half widths."""

    def spread(self) -> Spread:
        scale = 1.0 if self.distribution == "normal" else 1 / math.sqrt(3)  # half width to standard deviation
        of_board_and_layer = self.in_si(without=("distribution",)).values()
        return Spread(self.distribution, *(value * scale for value in of_board_and_layer))


class _LayerMicrometres(_Errors):
    board_um: _Micrometres = 0.0
    """Error that a whole board shares."""
    layer_um: _Micrometres = 0.0
    """Independent error of each layer."""


class _LayerMilliradians(_Errors):
    board_mrad: _UpTo100 = 0.0
    """Error that a whole board shares."""
    layer_mrad: _UpTo100 = 0.0
    """Independent error of each layer."""


class _LayerPercent(_Errors):
    board_percent: _UpTo100 = 0.0
    """Error that a whole board shares."""
    layer_percent: _UpTo100 = 0.0
    """Independent error of each layer."""


class _LayerMillimetres(_Errors):
    board_mm: _UpTo100 = 0.0
    """Error that a whole board shares."""
    layer_mm: _UpTo100 = 0.0
    """Independent error of each layer."""


class _BoardMillimetres(_Errors):
    board_mm: _UpTo100
    """Error of the board."""


class _BoardPercent(_Errors):
    board_percent: _UpTo100
    """Error of the board."""


class _BoardMilliradians(_Errors):
    board_mrad: _UpTo100
    """Error of the board."""


class _PositionsTable(Table):
    """``[positions]``: positions of the indenter."""

    x_mm: list[Position] = Field(min_length=1, max_length=100)
    """x of the positions, rising."""
    y_mm: list[Position] = Field(min_length=1, max_length=100)
    """y of the positions, rising."""
    depth_mm: Millimetres
    """Depth of the indentation."""
    noise: Annotated[float, Field(gt=0, le=1)] | None = None
    """Standard deviation of δ of a reading."""

    @model_validator(mode="after")
    def _rising(self) -> _PositionsTable:
        require_rising("x_mm", self.x_mm)
        require_rising("y_mm", self.y_mm)
        return self


class _LimitTable(Bounds):
    """Quantity that a good board keeps within the bounds."""

    quantity: str
    """Quantity of the design that a good board keeps within the bounds."""


class _File(Table):
    """Tables of a whole tolerance file."""

    schema_: Annotated[int, Field(ge=SCHEMA, le=SCHEMA)] = Field(alias="schema")
    """Version of the file format."""
    others: Literal["typical", "none"] = "typical"
    """Errors of kinds without a table: typical errors, or none."""
    quantities: list[str] = Field(default_factory=list)
    """Quantities whose spread is found, besides L, f and k."""
    etch: _LayerMicrometres | None = None
    """Width of the traces."""
    registration: _LayerMicrometres | None = None
    """Position of the copper layers."""
    rotation: _LayerMilliradians | None = None
    """Rotation of the copper layers."""
    dielectric: _LayerPercent | None = None
    """Thickness of the dielectrics."""
    copper: _LayerPercent | None = None
    """Thickness of the copper."""
    placement: _BoardMillimetres | None = None
    """Position of the elastomer and indenter, along x and y."""
    permeability: _BoardPercent | None = None
    """Permeability of the magnetic sheets."""
    elastomer: _LayerMillimetres | None = None
    """Thickness of the sheets."""
    capacitance: _BoardPercent | None = None
    """Capacitance of the tank."""
    plate_distance: _LayerMillimetres | None = None
    """Distance of metal plates."""
    plate_thickness: _LayerPercent | None = None
    """Thickness of metal plates."""
    conductivity: _BoardPercent | None = None
    """Conductivity of metal."""
    target_tilt: _BoardMilliradians | None = None
    """Tilt of a target."""
    positions: _PositionsTable | None = None
    limit: list[_LimitTable] = Field(default_factory=list)
    assumed: dict[str, str] = Field(default_factory=dict)
    """Tables of assumed errors, with the reasons."""

    def spreads(self) -> dict[str, Spread]:
        tables: dict[str, _Errors | None] = {name: getattr(self, name) for name in KINDS}
        return {name: table.spread() for name, table in tables.items() if table is not None}

    def build(self, spreads: Mapping[str, Spread], assumed: Mapping[str, str]) -> Tolerances:
        positions = None
        if (at := self.positions) is not None:  # divided for exact decimals
            x, y = (tuple(value / 1e3 for value in values) for values in (at.x_mm, at.y_mm))
            positions = Positions(x, y, at.depth_mm / 1e3, at.noise)
        limits = tuple(Limit(**limit.model_dump(exclude_none=True)) for limit in self.limit)
        return Tolerances(dict(spreads), dict(assumed), tuple(self.quantities), positions, limits)


@cache
def _typical() -> Tolerances:
    file = _TOLERANCES.check(_File, _TOLERANCES.parse(typical_text(), "typical.toml"), "typical.toml")
    return file.build(file.spreads(), file.assumed)


def draw(contributors: Sequence[Contributor], count: int, seed: int = 0) -> FloatArray:
    """Draw the errors of boards (count, contributors) in SI."""
    # Equal seeds begin with equal boards. A power of 2 from 64 on suits Sobol points best.
    if not 0 <= count <= MOST_SAMPLES:
        raise GoalError(f"samples must be 0 to {MOST_SAMPLES}; got {count}.")
    if seed < 0:
        raise GoalError(f"seed must not be negative; got {seed}.")
    dimensions = len(contributors)
    if dimensions > qmc.Sobol.MAXDIM:
        raise GoalError(f"Sobol points have at most {qmc.Sobol.MAXDIM} dimensions; got {dimensions} errors.")
    random = np.random.default_rng(seed)
    sequence = qmc.Sobol(dimensions, scramble=True, seed=random)
    quantiles = _paired(sequence.random_base2(max(count - 1, _BLOCK - 1).bit_length()), random)[:count]
    quantiles = np.clip(quantiles, _LEAST_TAIL, 1 - _LEAST_TAIL)
    uniform = np.array([one.distribution == "uniform" for one in contributors])
    unit = np.where(uniform, np.sqrt(3) * (2 * quantiles - 1), ndtri(quantiles))
    return np.asarray(unit * [one.deviation for one in contributors])


def _paired(points: FloatArray, random: np.random.Generator) -> FloatArray:
    """Pair coordinates of Sobol points (n, dimensions) again, without correlation.

    For some pairs of the first 36 dimensions 64 Sobol points have correlations of 0.7, which made
    the spread of two errors wrong by 20 %. After pairing they are 0.09. Each block of 64, 64, 128,
    … points keeps its values of each coordinate, in the order of random numbers from which the
    correlation with the earlier coordinates is removed (Owen, J. Am. Stat. Assoc. 89, 1517, 1994).
    """
    if points.shape[1] <= _WELL_PAIRED:
        return points
    paired = points.copy()
    low, high = 0, _BLOCK
    while low < min(len(points), _MOST_PAIRED):
        boards, errors = points[low:high].shape
        cleared = errors if errors <= _MOST_CLEARED * boards else boards // 4
        before = np.full((boards, 1), boards**-0.5)  # orthonormal columns
        for k in range(errors):
            order = np.asarray(random.standard_normal(boards))
            order = order - before @ (before.T @ order)
            paired[low:high, k][np.argsort(order, kind="stable")] = np.sort(points[low:high, k])
            if k < cleared:
                score = np.asarray(ndtri(np.clip(paired[low:high, k], _LEAST_TAIL, 1 - _LEAST_TAIL)))
                score = score - before @ (before.T @ score)
                before = np.column_stack((before, score / np.linalg.norm(score)))
        low, high = high, 2 * high
    return paired


def errors_of(contributors: Sequence[Contributor], values: npt.ArrayLike) -> dict[str, float]:
    """Sum contributions in SI to a board's errors by name."""
    errors: dict[str, float] = {}
    for one, value in zip(contributors, np.asarray(values, dtype=np.float64).tolist(), strict=True):
        for target in one.targets:
            errors[target] = errors.get(target, 0.0) + value
    return errors


def error_names(design: Design) -> tuple[str, ...]:
    """Names of all errors that a design can have."""
    # Layers without copper of a coil have neither etch nor registration. Names of other boards' errors begin with
    # the name of the board.
    if "" in design.board_names:
        raise GoalError(f"{design.name} has loops on a surface, whose fabrication errors are not known.")
    layers = design.array.stackup.names
    used = {layer for place in design.array.placements for layer in place.layers}
    names = [
        f"{kind}.{layer}"
        for kind in ("etch", "registration_x", "registration_y", "rotation")
        for layer in layers
        if layer in used
    ]
    names += [f"dielectric.{upper}-{lower}" for upper, lower in pairwise(layers)]
    names += [f"copper.{layer}" for layer in layers]
    if design.indentation is not None:
        names += ["placement_x", "placement_y"]
    if any(sheet.magnetic for sheet in design.sheets):
        names.append("permeability")
    names += [*(f"elastomer.{sheet.name}" for sheet in design.sheets), "capacitance"]
    names += [f"{kind}.{plate.name}" for kind in ("plate_distance", "plate_thickness") for plate in design.plates]
    materials = [plate.material for plate in design.plates]
    materials += [] if design.target is None else [design.target.body.material]
    if any(material.conductivity > 0 for material in materials):
        names.append("conductivity")
    if design.target is not None and isinstance(design.target.body, FinitePlate):
        names += ["target_tilt_x", "target_tilt_y"]
    for start, board in zip(design.board_names, design.boards, strict=True):
        names += [f"{start}/{name}" for name in error_names(board.design) if _OF_BOARD.match(name.rpartition("/")[2])]
    return tuple(names)


def perturb(design: Design, errors: Mapping[str, float]) -> Design:
    """Return a design with fabrication errors in SI by name.

    Raises GoalError for an error that leaves nothing of a trace, gap or layer.

    >>> from coilarray import load_design
    >>> narrow = perturb(load_design("gast2020"), {"etch.L3": -10e-6})
    >>> [round(float(widths[0]) * 1e6, 6) for widths in narrow.array.placements[0].coil.widths]
    [90.0, 100.0]
    """
    known = error_names(design)
    for name, value in errors.items():
        if name not in known:
            close = difflib.get_close_matches(name, known, n=1)
            hint = f"; did you mean {close[0]}?" if close else f"; it has {', '.join(known)}."
            raise GoalError(f"{design.name} has no error {name!r}{hint}")
        if not math.isfinite(value):
            raise GoalError(f"the error {name} must be finite; got {value}.")
    nonzero = {name: float(errors[name]) for name in known if errors.get(name, 0.0) != 0.0}
    if not nonzero:
        return design
    switches = design.circuit.switches
    tank = _scaled(switches.tank_capacitance, nonzero, "capacitance")
    setup, shift = design.indentation, [nonzero.get(f"placement_{axis}", 0.0) for axis in "xy"]
    if setup is not None and any(shift):
        x, y = setup.origin_point
        setup = replace(setup, origin=None, origin_point=(x + shift[0], y + shift[1]))
    try:
        array = _array(design.array, nonzero)
        sheets = tuple(
            replace(
                sheet,
                thickness=sheet.thickness + nonzero.get(f"elastomer.{sheet.name}", 0.0),
                relative_permeability=_scaled(sheet.relative_permeability, nonzero, "permeability")
                if sheet.magnetic else 1.0,
            )
            for sheet in design.sheets
        )  # fmt: skip
        boards = []
        for name, board in zip(design.board_names, design.boards, strict=True):
            own = {key.removeprefix(f"{name}/"): value for key, value in nonzero.items() if key.startswith(f"{name}/")}
            boards.append(replace(board, of=perturb(board.design, own)) if own else board)
        rise = sum(sheet.thickness for sheet in sheets) - design.top
        sink = array.stackup.thickness - design.array.stackup.thickness
        return replace(
            design,
            array=array,
            sheets=sheets,
            indentation=setup,
            circuit=replace(design.circuit, switches=replace(switches, tank_capacitance=tank)),
            plates=tuple(_plate(plate, design, nonzero, rise, sink) for plate in design.plates),
            target=_target(design.target, nonzero),
            boards=tuple(boards),
        )
    except (DesignError, GeometryError) as error:
        raise GoalError(f"no board can be made with these errors: {error}") from None


def _scaled(value: float, errors: Mapping[str, float], name: str) -> float:
    scaled = value * (1 + errors.get(name, 0.0))
    if scaled <= 0:
        raise GoalError(f"the error {name} must be above −1; got {errors[name]:g}.")
    return scaled


def _conducting(material: Material, errors: Mapping[str, float]) -> Material:
    if material.conductivity == 0:
        return material
    return replace(material, conductivity=_scaled(material.conductivity, errors, "conductivity"))


def _plate(
    plate: Plate | FinitePlate, design: Design, errors: Mapping[str, float], rise: float, sink: float
) -> Plate | FinitePlate:
    thickness = _scaled(plate.thickness, errors, f"plate_thickness.{plate.name}")
    changed = replace(plate, thickness=thickness, material=_conducting(plate.material, errors))
    low, high = plate.heights
    above = low >= 0
    gap = low - design.top if above else -design.array.stackup.thickness - high
    away = max(errors.get(f"plate_distance.{plate.name}", 0.0), -max(gap, 0.0))  # a plate stops where it touches
    if above:
        return changed.lifted(rise + away + low - changed.heights[0])
    return changed.lifted(high - sink - away - changed.heights[1])


def _target(target: Target | None, errors: Mapping[str, float]) -> Target | None:
    if target is None:
        return None
    body = replace(target.body, material=_conducting(target.body.material, errors))
    turn = complex(*(errors.get(f"target_tilt_{axis}", 0.0) for axis in "xy"))
    if isinstance(body, FinitePlate) and turn:
        tilt = cmath.rect(body.tilt, body.tilt_direction) + turn
        body = replace(body, tilt=abs(tilt), tilt_direction=cmath.phase(tilt))
    return replace(target, body=body)


def _array(array: Array, errors: Mapping[str, float]) -> Array:
    def thickened(kind: str, parts: Iterable[str], thickness: Sequence[float]) -> tuple[float, ...]:
        names = (f"{kind}.{part}" for part in parts)
        return tuple(value * (1 + errors.get(name, 0.0)) for name, value in zip(names, thickness, strict=True))

    layers = array.stackup.names
    stackup = replace(
        array.stackup,
        copper_thickness=thickened("copper", layers, array.stackup.copper_thickness),
        dielectric_thickness=thickened(
            "dielectric", map("-".join, pairwise(layers)), array.stackup.dielectric_thickness
        ),
    )
    x_min, y_min, x_max, y_max = array.bounds
    middle = np.array([x_min + x_max, y_min + y_max]) / 2
    made: dict[tuple[object, ...], Coil] = {}
    placements = []
    for place in array.placements:
        # coils with equal errors stay one object, so that their inductance is computed once
        turned = any(f"rotation.{layer}" in errors for layer in place.layers)
        key = (id(place.coil), place.layers, place.rotation, (place.x, place.y) if turned else None)
        if key not in made:
            made[key] = _coil(place, errors, middle)
        placements.append(replace(place, coil=made[key]))
    return replace(array, stackup=stackup, placements=tuple(placements))


def _coil(place: Placement, errors: Mapping[str, float], middle: FloatArray) -> Coil:
    coil = place.coil
    wider = [errors.get(f"etch.{layer}", 0.0) for layer in place.layers]
    lines = []
    for line, layer in zip(coil.lines, place.layers, strict=True):  # shifted and turned, but not at their ends
        shift = np.array([errors.get(f"registration_{axis}.{layer}", 0.0) for axis in "xy"])
        if angle := errors.get(f"rotation.{layer}", 0.0):
            shift = shift + (place.to_board(line) - middle) @ (_turn(angle) - np.eye(2)).T
        moved = line
        if shift.any():
            moved = line.copy()
            # v @ R(φ) turns v back by φ
            moved[1:-1] += np.broadcast_to(shift @ _turn(place.rotation), line.shape)[1:-1]
        lines.append(moved)
    return replace(
        coil,
        lines=tuple(lines),
        widths=tuple(widths + change for widths, change in zip(coil.widths, wider, strict=True)),
        # one gap per coil: the pitch of its turns stays, on the mean over its layers
        gap=coil.gap - sum(wider) / len(wider),
    )


def _turn(angle: float) -> FloatArray:
    """Matrix that turns a column by an angle in rad."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])
