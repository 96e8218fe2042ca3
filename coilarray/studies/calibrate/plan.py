"""Calibration plans, measured data as numbers with deviations, and the model's numbers.

The bundled ``table_a1`` is an example of the TOML files. The cost of a model evaluation depends on
the changed entries. In the store of results, contacts are kept by sheets and indenter, inductances
by coils and sheets, and inductance changes by coils and dents. Losses and strays are always
computed for the coils under the sheets of the design with which the fit began, because the effect
of a sheet on them is too small to show in δ.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import xarray as xr
from pydantic import BeforeValidator, Field, field_validator, model_validator

from coilarray.circuit.coupling import design_circuit, design_inductance
from coilarray.circuit.network import Network
from coilarray.compute.arrays import FloatArray
from coilarray.compute.store import Store, not_kept
from coilarray.design.keys import Table
from coilarray.design.model import Design, build_design
from coilarray.design.toml_file import TomlFiles
from coilarray.elastomer.scattering import LayerMesh
from coilarray.errors import GoalError, listed, shown
from coilarray.geometry.arcs import place_in_mm
from coilarray.paper.distortion import ellipse_curves
from coilarray.paper.ellipse import PARAMETERS
from coilarray.paper.ellipse_model import DEGREE, EllipseModel, undetermined_levels
from coilarray.response.dataset import RESPONSE, map_origin
from coilarray.response.map import MapAccuracy, response_map
from coilarray.response.setup import Imperfections, indentation_of
from coilarray.studies.comparison import own_noise

PLANS = TomlFiles("calibration plan", GoalError, "coilarray.studies.calibrate.plans")
"""Files of calibration plans, and the bundled plans."""
Parameter = Literal["A", "B", "x0", "peak"]  # parameters of ellipses that may be fitted
MOST_COMBINATIONS = 200  # largest number of combinations of choices that are fitted
FITTED: tuple[Parameter, ...] = ("A", "B", "peak")  # parameters of ellipses that are fitted by default
LEVELS = tuple(k * 1e-4 for k in range(1, 11))  # δ of the ellipses that are fitted by default
IMPERFECTIONS = {  # unknowns ``imperfections.…`` of the experiment, with their units in SI
    "depth_error_mm": 1e-3,
    "tilt_x_mrad": 1e-3,
    "tilt_y_mrad": 1e-3,
    "offset_x_mm": 1e-3,
    "offset_y_mm": 1e-3,
    "drift": 1.0,
    "column_drift": 1.0,
}
IMPERFECTION = "imperfections."  # prefix of unknowns of the experiment
_DIMS = ("depth", "y", "x", "state")
_FEW = 30.0  # degrees of freedom, with which a standard deviation is known to 13 %
_SAME = 1e-3  # m: largest distance of a coil in the design from the same coil in the data
_BEYOND = 1.5  # of the highest level: a polynomial that ends further beyond does not determine the peak
COARSE = LayerMesh(harmonics=6, decays=6.0, width=0.4, rows=4)  # mesh accurate to 1e-3 of δ, and twice as fast


def separated(values: Mapping[str, float]) -> tuple[dict[str, float], dict[str, float]]:
    """Values of the design, and of the experiment without prefix."""
    entries = {key: value for key, value in values.items() if not key.startswith(IMPERFECTION)}
    return entries, {key.removeprefix(IMPERFECTION): value for key, value in values.items() if key not in entries}


class Unknown(Table):
    """``[[unknown]]``: one or several entries with one value, between bounds.

    The prior is flat. With `prior_mean` and `prior_std` it is normal and cut off at the bounds.
    """

    entry: Annotated[
        list[str], Field(min_length=1), BeforeValidator(lambda value: [value] if isinstance(value, str) else value)
    ]
    """Dotted key of the design, or several that share one value."""
    low: float
    """Least value, in the unit of the entry, as all of this table."""
    high: float
    """Largest value."""
    start: float | None = None
    """Value to start from. By default the design's own."""
    prior_mean: float | None = None
    """Mean of a normal prior, by default flat between the bounds."""
    prior_std: Annotated[float, Field(gt=0)] | None = None
    """Its standard deviation."""

    @model_validator(mode="after")
    def _consistent(self) -> Unknown:
        if not self.low < self.high:
            raise ValueError(f"needs low below high; got {self.low:g} and {self.high:g}")
        if self.start is not None and not self.low <= self.start <= self.high:
            raise ValueError(f"needs start from low to high; got {self.start:g}")
        if (self.prior_mean is None) != (self.prior_std is None):
            raise ValueError("needs both prior_mean and prior_std, or neither")
        if self.prior_mean is not None and not self.low <= self.prior_mean <= self.high:
            raise ValueError(f"needs prior_mean from low to high; got {self.prior_mean:g}")
        known = [f"{IMPERFECTION}{name}" for name in IMPERFECTIONS]
        for entry in self.entry:
            if entry.startswith(IMPERFECTION) and entry not in known:
                raise ValueError(f"needs an imperfection of {', '.join(known)}; got {entry}")
        return self

    @property
    def name(self) -> str:
        """First entry of the unknown."""
        return self.entry[0]


class Choice(Table):
    """``[[alternative.choice]]``: entries to set and remove, and own unknowns."""

    name: Annotated[str, Field(min_length=1)]
    """Name of the answer."""
    set: dict[str, Any] = Field(default_factory=dict)
    """Values of the design by their dotted keys."""
    without: list[str] = Field(default_factory=list)
    """Keys of the design that it removes."""
    unknowns: list[Unknown] = Field(alias="unknown", default_factory=list)

    @field_validator("set")
    @classmethod
    def _finite(cls, values: dict[str, Any]) -> dict[str, Any]:
        for key, value in values.items():
            try:
                json.dumps(value, allow_nan=False, default=str)
            except ValueError:
                raise ValueError(f"must have finite numbers for {key}; got {shown(value)}") from None
        return values


class Alternative(Table):
    """``[[alternative]]``: a question with a few answers, each fitted."""

    name: Annotated[str, Field(min_length=1)]
    """Name of the question."""
    choices: list[Choice] = Field(alias="choice", min_length=1)

    @model_validator(mode="after")
    def _different(self) -> Alternative:
        names = [choice.name for choice in self.choices]
        if len(set(names)) != len(names):
            raise ValueError(f"needs choices with different names; got {listed(names)}")
        return self


class DataTable(Table):
    """``[data]``: the fitted part of the measurement, and its noise.

    By default all ``states`` are fitted, and of ellipses A, B and the peak. ``noise = "estimated"``
    takes the deviations as relative, by default for ellipses and for a response without deviations.
    ``noise = "given"`` trusts them. A recording's noise is known as well as its repeats or
    baselines determine it.
    """

    states: Annotated[list[str], Field(min_length=1)] | None = None
    """States whose readings are fitted. By default all."""
    tested: list[str] = Field(default_factory=list)
    """States that are only predicted, to test the fit."""
    parameters: Annotated[list[Parameter], Field(min_length=1)] = Field(default_factory=lambda: list(FITTED))
    """Of ellipses: the parameters that are fitted."""
    levels: Annotated[list[Annotated[float, Field(gt=0)]], Field(min_length=1)] = Field(
        default_factory=lambda: list(LEVELS)
    )
    """Of ellipses: levels of δ."""
    semiaxis_std_mm: Annotated[float, Field(gt=0)] = 0.5
    """Standard deviation of the semiaxes A and B."""
    peak_std: Annotated[float, Field(gt=0)] = 5e-5
    """Standard deviation of the peak of δ."""
    delta_std: Annotated[float, Field(gt=0)] | None = None
    """Standard deviation of δ, if the response has none."""
    noise: Literal["given", "estimated"] | None = None
    """Whether standard deviations are trusted, or their scale is estimated from residuals."""


class Plan(Table):
    """Calibration plan, read by `load_plan`."""

    schema_: Annotated[int, Field(ge=1, le=1)] = Field(alias="schema", default=1)
    """Version of the file format."""
    title: str = ""
    """Title in reports."""
    data: DataTable = DataTable()
    unknowns: list[Unknown] = Field(alias="unknown", default_factory=list)
    alternatives: list[Alternative] = Field(alias="alternative", default_factory=list)

    @model_validator(mode="after")
    def _consistent(self) -> Plan:
        names = [one.name for one in self.alternatives]
        if len(set(names)) != len(names):
            raise ValueError(f"needs every [[alternative]] to have a name of its own; got {', '.join(names)}")
        count = 1
        for one in self.alternatives:
            count *= len(one.choices)
        if count > MOST_COMBINATIONS:
            raise ValueError(f"needs at most {MOST_COMBINATIONS} combinations of choices; got {count}")
        for choices in self.combinations():
            unknowns = self.unknowns_of(choices)
            if not unknowns:
                raise ValueError("needs at least one [[unknown]] in every combination of choices")
            entries = [entry for unknown in unknowns for entry in unknown.entry]
            twice = next((entry for entry in entries if entries.count(entry) > 1), None)
            if twice is not None:
                raise ValueError(f"names {twice} in more than one [[unknown]]")
            fixed = [key for choice in choices for key in (*choice.set, *choice.without)]
            for key in fixed:
                if key in entries or fixed.count(key) > 1:
                    raise ValueError(f"sets {key} twice: by two choices, or by a choice and an unknown")
        return self

    def combinations(self) -> list[tuple[Choice, ...]]:
        """Return every combination of one choice per alternative."""
        return list(itertools.product(*(one.choices for one in self.alternatives)))

    def unknowns_of(self, choices: tuple[Choice, ...]) -> list[Unknown]:
        """Return the unknowns of the plan, then of the choices."""
        return [*self.unknowns, *(unknown for choice in choices for unknown in choice.unknowns)]


def load_plan(name_or_path: str | Path) -> Plan:
    """Read the calibration plan `name_or_path`, bundled or a file.

    Raises GoalError for an unreadable file, wrong TOML, an unknown key or a value that is not
    allowed, in one line.

    >>> [unknown.name for unknown in load_plan("table_a1").unknowns][:2]
    ['stackup.dielectric_thickness_mm.1', 'elastomer.1.relative_permeability']
    """
    return PLANS.check(Plan, PLANS.parse(PLANS.text(name_or_path), str(name_or_path)), str(name_or_path))


def simple_plan(unknowns: Mapping[str, Any]) -> Plan:
    """Return a plan of entries with (low, high) or (low, high, start)."""
    tables = []
    for entry, values in unknowns.items():
        numbers = [float(value) for value in values]
        if len(numbers) not in (2, 3):
            raise GoalError(f"the unknown {entry} must have low and high, or low, high and start; got {values}.")
        tables.append({"entry": entry, **dict(zip(("low", "high", "start"), numbers, strict=False))})
    return PLANS.check(Plan, {"unknown": tables}, "unknowns")


@dataclass(frozen=True, eq=False)
class Measurement:
    """Measured numbers (n,) in SI, and the request for a model's numbers."""

    values: FloatArray  # NaN if unknown, as `std`
    std: FloatArray
    weight: FloatArray  # number of independent numbers for which each stands, 0 if only predicted
    coords: Mapping[str, Sequence[object]]  # quantity, state; of a response depth, y and x in m, of ellipses level
    request: Mapping[str, Any]
    noise_freedom: float  # of the scale of `std`: infinite if given, 0 if from the residuals


def measurement(data: xr.Dataset | EllipseModel, table: DataTable, design: Design) -> Measurement:
    """Select the measured data of a plan."""
    # GoalError if data or design lack a state or nothing could be fitted, LocalizeError if the data are no response
    if not isinstance(data, EllipseModel):
        data = RESPONSE.checked(data, "the measured response")
    known = list(data.names) if isinstance(data, EllipseModel) else [str(name) for name in data["state"].values]
    states = known if table.states is None else table.states
    planned = [state.name for state in design.plan]
    for name in states:
        for where, names in (("data have", known), (f"scan of {design.name} has", planned)):
            if name not in names:
                raise GoalError(f"the {where} no state {name!r}; there are {', '.join(names)}.")
    if len(set(states)) != len(states):
        raise GoalError(f"states must be named once each; got {', '.join(states)}.")
    for name in table.tested:
        if name not in states:
            raise GoalError(f"tested names the state {name!r}; there are {', '.join(states)}.")
    found = (_ellipses if isinstance(data, EllipseModel) else _response)(data, table, design, states)  # type: ignore[arg-type]
    found = replace(found, weight=np.where([name in table.tested for name in found.coords["state"]], 0.0, found.weight))
    if not found.weight.any():
        raise GoalError("the data have nothing to fit: none of the chosen numbers is known and determined.")
    return found


def model_values(response: xr.Dataset, request: Mapping[str, Any]) -> FloatArray:
    """Reduce a response to a request's numbers, NaN if missing."""
    # Semi-axes of a level above the peak are 0. If too little of a level is in the window to determine its
    # ellipse, they are the length of the map, which is larger.
    states = list(request["states"])
    if request["kind"] == "response":
        return np.asarray(response.delta.transpose(*_DIMS).sel(state=states).values.ravel())
    levels = np.array(request["levels"])
    curves = ellipse_curves(response, states, levels)
    length = float(np.ptp(response.x.values))
    peaks = response.delta.isel(depth=0).max(("x", "y")).sel(state=states).values
    rows = []
    for j in range(len(states)):
        hidden = curves.undetermined[j]
        A, B = (np.where(hidden, length, np.nan_to_num(axis[j])) for axis in (curves.A, curves.B))
        rows += [A, B, curves.determined_x0[j], peaks[j : j + 1]]
    return np.concatenate(rows)


def _check_places(data: xr.Dataset, design: Design) -> None:
    if not {"coil", "coil_x", "coil_y"} <= set(data.coords):
        return
    centres = dict(zip(design.array.names, design.array.centres[:, :2] - map_origin(design.indentation), strict=True))
    places = np.column_stack((data.coil_x.values, data.coil_y.values))
    for name, place in zip(data["coil"].values.tolist(), places, strict=True):
        if name in centres and np.hypot(*(place - centres[name])) > _SAME:
            at, here = (place_in_mm(x, y) for x, y in (place, centres[name]))
            raise GoalError(
                f"the data are of another board than {design.name}, or from another origin: their {name} is at {at} "
                f"from the origin of the map, that of the design at {here}."
            )


def _response(data: xr.Dataset, table: DataTable, design: Design, states: Sequence[str]) -> Measurement:
    _check_places(data, design)
    data = data.transpose(*_DIMS, ...).sel(state=list(states))
    noise = None if table.delta_std is not None else own_noise(data)
    values = data.delta.values.astype(np.float64)
    known = np.isfinite(values)
    if noise is None:
        if table.noise == "given" and table.delta_std is None:
            raise GoalError('the data do not state their noise; give data.delta_std or noise = "estimated".')
        level = np.full(len(states), 1.0 if table.delta_std is None else table.delta_std)
        freedom = 0.0 if table.delta_std is None else np.inf
    else:  # of a state one number: the deviations of single positions, from a few repeats, would be misleading weights
        level = np.sqrt(np.mean(noise**2, axis=(0, 1, 2)))
        positions = known.sum(axis=(0, 1, 2)).astype(np.float64)
        match data["delta_std"].attrs.get("found_from"):  # the degrees of freedom of all states together
            case "repeats":
                freedom = float(positions.sum() * (int(data.attrs.get("repeats", 1)) - 1))
            case "baselines":  # differences of N of them (J. von Neumann, Ann. Math. Stat. 12, 367, 1941)
                freedom = float(sum(2 * (n - 1) ** 2 / (3 * n - 4) for n in positions.tolist() if n > 1))
            case _:  # as given
                freedom = np.inf
        if freedom < _FEW * len(states):  # nor are differences between states significant with so few numbers
            level = np.full(len(states), np.sqrt(np.mean(level**2)))
    if table.noise is not None:
        freedom = 0.0 if table.noise == "estimated" else np.inf
    if not (np.isfinite(level) & (level > 0)).all():
        raise GoalError("the noise of the data must be positive; give data.delta_std.")
    index = np.meshgrid(*(np.arange(n) for n in values.shape), indexing="ij")
    axes = {name: data[name].values for name in _DIMS}
    coords: dict[str, Sequence[object]] = {"quantity": ["delta"] * values.size}
    coords |= {name: axes[name][k.ravel()].tolist() for name, k in zip(_DIMS, index, strict=True)}
    request = {"kind": "response", "states": list(states)}
    request |= {name: axes[name].tolist() for name in _DIMS[:3]}
    std = np.broadcast_to(level, values.shape).ravel()
    return Measurement(values.ravel(), std, known.ravel().astype(np.float64), coords, request, freedom)


def _ellipses(data: EllipseModel, table: DataTable, design: Design, states: Sequence[str]) -> Measurement:
    # x0 is always predicted. The levels of a polynomial of five coefficients are at most five independent numbers.
    setup, levels = indentation_of(design).in_ellipse_window(), np.array(sorted(table.levels))
    share = min(1.0, (DEGREE + 1) / len(levels))
    window = (min(setup.x), max(setup.x)), (min(setup.y), max(setup.y))
    rows: list[tuple[float, float, float, str, str, float]] = []
    for name in states:
        coil = data[name]
        within = (levels >= coil.lowest) & (levels <= coil.highest) & ~undetermined_levels(coil, levels, *window)
        axes = dict(zip(PARAMETERS, coil.curves(levels), strict=True))
        for key in ("A", "B", "x0"):
            for level, value, there in zip(levels.tolist(), axes[key].tolist(), within.tolist(), strict=True):
                weight = share if there and key in table.parameters else 0.0
                shown = value if there else np.nan
                rows.append((shown, table.semiaxis_std_mm * 1e-3, weight, key, name, level))
        known = coil.highest <= _BEYOND * levels[-1]
        weight = 1.0 if known and "peak" in table.parameters else 0.0
        rows.append((coil.highest if known else np.nan, table.peak_std, weight, "peak", name, np.nan))
    values, std, weights, quantity, state, of_level = zip(*rows, strict=True)
    freedom = np.inf if table.noise == "given" else 0.0
    coords = {"quantity": quantity, "state": state, "level": of_level}
    request = {"kind": "ellipses", "states": list(states), "levels": levels.tolist()}
    return Measurement(np.array(values), np.array(std), np.array(weights), coords, request, freedom)


def evaluate_model(item: Mapping[str, Any]) -> dict[str, float]:
    """Evaluate one point of a fit, on a worker.

    The item has the ``document`` of the changed design, the fit's ``start`` document,
    ``imperfections``, the ``request``, and the folder of ``parts``, or "". Ellipses have ideal
    circuits and a coarse mesh.
    """
    document, request = item["document"], item["request"]
    whole = build_design(document, document["name"])
    wanted = set(request["states"])
    plan = tuple(state for state in whole.plan if state.name in wanted)
    design = replace(whole, circuit=replace(whole.circuit, scan=plan))
    ellipses, setup = request["kind"] == "ellipses", indentation_of(design).in_ellipse_window()
    network: Network | Literal["ideal"] = "ideal"
    if not ellipses:  # with all losses and strays under the first sheets
        first = build_design(item["start"], item["start"]["name"]).sheets
        circuit = design_circuit(replace(design, sheets=first, indentation=None))
        network = replace(circuit, inductance=design_inductance(design)[0])
    response = response_map(
        design,
        depths=setup.depths[:1] if ellipses else request["depth"],
        x=setup.x if ellipses else request["x"],
        y=setup.y if ellipses else request["y"],
        imperfections=replace(imperfections_of(item["imperfections"]), network=network),
        accuracy=MapAccuracy(mesh=COARSE) if ellipses else None,
        keep=Store(Path(item["parts"])).dataset if item["parts"] else not_kept,
    )
    return {str(k): value for k, value in enumerate(model_values(response, request).tolist())}


def imperfections_of(values: Mapping[str, float]) -> Imperfections:
    """Return imperfections from values with a plan's names and units."""
    si = {name: values.get(name, 0.0) * scale for name, scale in IMPERFECTIONS.items()}
    return Imperfections(
        tilt=(si["tilt_x_mrad"], si["tilt_y_mrad"]),
        offset=(si["offset_x_mm"], si["offset_y_mm"]),
        depth_error=si["depth_error_mm"],
        drift=si["drift"],
        column_drift=si["column_drift"],
    )
