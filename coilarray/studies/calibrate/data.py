"""Measured data as numbers with deviations, and the model's numbers.

The cost of a model evaluation depends on the changed entries. In the store of results, contacts are
kept by sheets and indenter, inductances by coils and sheets, and inductance changes by coils and
dents. Losses and strays are always computed for the coils under the sheets of the design with which
the fit began, because the effect of a sheet on them is too small to show in δ.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import xarray as xr

from coilarray.circuit.coupling import design_circuit, design_inductance
from coilarray.circuit.network import Network
from coilarray.compute.arrays import BoolArray, FloatArray
from coilarray.compute.store import Store, not_kept
from coilarray.design.model import Design, build_design
from coilarray.elastomer.scattering import LayerMesh
from coilarray.errors import GoalError
from coilarray.geometry.arcs import place_in_mm
from coilarray.paper.distortion import ellipse_curves
from coilarray.paper.ellipse import PARAMETERS
from coilarray.paper.ellipse_model import DEGREE, EllipseModel, undetermined_levels
from coilarray.response.dataset import RESPONSE, map_origin
from coilarray.response.map import MapAccuracy, response_map
from coilarray.response.setup import Imperfections, indentation_of
from coilarray.studies.calibrate.plan import IMPERFECTIONS, DataTable
from coilarray.studies.comparison import own_noise

_DIMS = ("depth", "y", "x", "state")
_FEW = 30.0  # degrees of freedom, with which a standard deviation is known to 13 %
_SAME = 1e-3  # m: largest distance of a coil in the design from the same coil in the data
_BEYOND = 1.5  # of the highest level: a polynomial that ends further beyond does not determine the peak
COARSE = LayerMesh(harmonics=6, decays=6.0, width=0.4, rows=4)
"""Mesh accurate to 1e-3 of δ, and twice as fast."""


@dataclass(frozen=True, eq=False)
class Measurement:
    """Measured numbers, and the request for a model's numbers.

    `values` and `std` (n,) are in SI, NaN if unknown. `weight` (n,) is the number of independent
    numbers for which each stands, 0 if only predicted. `coords` are ``quantity``, ``state``, for a
    response ``depth``, ``y`` and ``x`` in m, for ellipses ``level``. `noise_freedom` are the
    degrees of freedom of the scale of `std`: infinite if given, 0 if from the residuals.
    """

    values: FloatArray
    std: FloatArray
    weight: FloatArray
    coords: Mapping[str, Sequence[object]]
    request: Mapping[str, Any]
    noise_freedom: float


def measurement(data: xr.Dataset | EllipseModel, table: DataTable, design: Design) -> Measurement:
    """Select the measured data of a plan.

    Raises GoalError if the data or the design lack a state, or nothing could be fitted, and
    LocalizeError if the data are not a response.
    """
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
    """Reduce a computed response to the numbers of a request.

    Missing numbers are NaN. Semi-axes of a level above the peak are 0. If too little of a level is
    in the window to determine its ellipse, they are the length of the map, which is larger.
    """
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
    """Refuse a response with coils elsewhere than the design's."""
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
    """Select the numbers of a response, with their noise."""
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
        freedom = _noise_freedom(data, known)
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


def _noise_freedom(data: xr.Dataset, known: BoolArray) -> float:
    """Degrees of freedom of a recording's ``delta_std``, all states together.

    For repeats it is one less than the repeats at every position. For differences of N successive
    baselines it is 2 (N − 1)²/(3N − 4) (J. von Neumann, Ann. Math. Stat. 12, 367, 1941). Any other
    deviation is taken as given.
    """
    positions = known.sum(axis=(0, 1, 2)).astype(np.float64)
    match data["delta_std"].attrs.get("found_from"):
        case "repeats":
            return float(positions.sum() * (int(data.attrs.get("repeats", 1)) - 1))
        case "baselines":
            return float(sum(2 * (n - 1) ** 2 / (3 * n - 4) for n in positions.tolist() if n > 1))
    return np.inf


def _ellipses(data: EllipseModel, table: DataTable, design: Design, states: Sequence[str]) -> Measurement:
    """Select A, B, x0 and the peak of every state.

    x0 is always predicted. The levels of a polynomial with five coefficients are together no more
    than five independent numbers.
    """
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
    network: Network | Literal["ideal"] = "ideal" if ellipses else _network(design, item["start"])
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


def _network(design: Design, start: Mapping[str, Any]) -> Network:
    """Circuit with all losses and strays, under the first sheets."""
    flat = replace(design, sheets=build_design(start, start["name"]).sheets, indentation=None)
    return replace(design_circuit(flat), inductance=design_inductance(design)[0])
