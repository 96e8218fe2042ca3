"""Small results of known numbers for the tests of the plots: of every kind one, made up but of the real shape."""

import functools

import numpy as np
import pytest
import xarray as xr

import coilarray.studies.calibrate.calibration as calibration_module
from coilarray import calibrate, load_design
from coilarray.circuit.coupling import couple
from coilarray.hardware.record.stability import stability
from coilarray.localize.forward import forward_model
from coilarray.localize.identifiability import identifiability
from coilarray.paper.ellipse import fit_ellipses
from coilarray.paper.ellipse_model import ellipse_model, published_model
from coilarray.studies.calibrate.plan import PLANS, Plan
from support.localize_boards import ROW
from support.localize_boards import board as row_of_bells

NAMES = ["coil1", "coil2", "coil3"]


def curves(ax):
    """Lines that have a label, by it."""
    return {line.get_label(): line for line in ax.lines if not line.get_label().startswith("_")}


def legend(ax):
    """Texts of the legend."""
    return [text.get_text() for text in ax.get_legend().get_texts()]


@functools.cache
def board():
    """Return the board of a design with a few coils."""
    return load_design("starter").array


def coupling(terminations=None):
    """Three coils of 20 µH, coupled by −1 and 0.2 µH."""
    L = np.array([[20.0, -1.0, 0.2], [-1.0, 20.0, -1.0], [0.2, -1.0, 20.0]]) * 1e-6
    return couple(NAMES, L, 5.0, 330e-12, terminations)


def field(x, y, current=1.0, peak=2e-3):
    """B_z = peak · exp(−(x² + y²)/(5 mm)²) per ampere, on a grid in m, 1 mm above the board."""
    across, along = np.meshgrid(x, y, indexing="ij")
    B = np.zeros((len(x), len(y), 1, 3))
    B[:, :, 0, 2] = current * peak * np.exp(-(across**2 + along**2) / 5e-3**2)
    return xr.Dataset(
        {"B": (("x", "y", "z", "component"), B, {"units": "T"})},
        {"x": np.asarray(x), "y": np.asarray(y), "z": [1e-3], "component": ["x", "y", "z"]},
        {"active_coil": "coil1", "other_coils": "open", "active_current_A": current},
    )


def frequency_sweep():
    """Two states: one inductance that stays, and one with a pole."""
    f = np.geomspace(1e5, 1e7, 7)
    L = np.column_stack((np.full(7, 50e-6), np.linspace(60e-6, 900e-6, 7)))
    dims = ("frequency", "state")
    return xr.Dataset(
        {
            "apparent_inductance": (dims, L, {"units": "H"}),
            "impedance_real": (dims, 20.0 + 1e6 * L, {"units": "ohm"}),
            "quality_factor": (dims, 40.0 - 5e4 * L, {"units": "1"}),
        },
        {"frequency": ("frequency", f, {"units": "Hz"}), "state": ["a", "b"]},
    )


def response(delta=None, depths=(0.5e-3, 1e-3), *, x=None, y=None, centre=6e-3, width=8e-3):
    """Map of two coils at x = ±centre: delta(x, y, state, depth) in SI, by default bells of the height of their depth.

    The centres are samples.
    """
    x = np.linspace(-20e-3, 20e-3, 21) if x is None else np.asarray(x)
    y = np.linspace(-6e-3, 6e-3, 7) if y is None else np.asarray(y)
    centres = np.array([-centre, centre])
    depth, Y, X, state = np.meshgrid(depths, y, x, np.arange(2), indexing="ij")
    if delta is None:
        values = depth * np.exp(-((X - centres[state]) ** 2 + Y**2) / width**2)
    else:
        values = delta(X, Y, state, depth)
    return xr.Dataset(
        {"delta": (("depth", "y", "x", "state"), values)},
        {
            "depth": np.array(depths), "y": y, "x": x, "state": NAMES[:2], "coil": NAMES[:2],
            "coil_x": ("coil", centres), "coil_y": ("coil", [0.0, 0.0]),
        },
    )  # fmt: skip


def target(distances=(1e-3, 2e-3, 4e-3, 60e-3)):
    """Two coils of 20 µH over a plate: δ falls with e from 0.1 every 2 mm, and the other quantities go with it."""
    d = np.array(distances)
    share = 0.1 * np.exp(-d / 2e-3)[:, None, None, None] * np.array([1.0, 0.8])
    values = {
        "delta": (-share, "1"), "effective_inductance": (20e-6 * (1 - share), "H"),
        "quality_factor": (30.0 - 20 * share, "1"), "frequency": (1e6 * (1 + share / 2), "Hz"),
    }  # fmt: skip
    dims = ("distance", "y", "x", "state")
    return xr.Dataset(
        {
            **{name: (dims, numbers, {"units": unit}) for name, (numbers, unit) in values.items()},
            "base_inductance": ("state", [20e-6, 20e-6]), "base_quality_factor": ("state", [30.0, 30.0]),
            "base_frequency": ("state", [1e6, 1e6]), "best_x": ("state", [0.0, 0.0]), "best_y": ("state", [0.0, 0.0]),
        },
        {
            "distance": d, "y": [0.0], "x": [0.0], "state": NAMES[:2], "coil": NAMES[:2],
            "coil_x": ("coil", [-6e-3, 6e-3]), "coil_y": ("coil", [0.0, 0.0]),
        },
        {"noise": 1e-5, "material": "aluminium", "target": "plate"},
    )  # fmt: skip


def flat(r):
    return np.zeros_like(r)


DENT = 3e-3  # m; width of a dent


def bell(r):
    return -np.exp(-((r / DENT) ** 2))


def dents(depths=(0.5e-3, 1e-3), rise=bell, stretch=flat, symmetry="axial", end=80e-3):
    """Dents whose interfaces are displaced in proportion to their height, by rise(r) and stretch(r) times the depth."""
    r = np.r_[0.0, np.geomspace(2e-5, end, 400)]
    depth, height = np.array(depths), np.array([0.0, 6e-3, 8e-3])
    share = depth[:, None, None] * (height / height[-1])[None, :, None]
    return xr.Dataset(
        {
            "displacement_r": (("depth", "interface", "r"), share * stretch(r)),
            "displacement_z": (("depth", "interface", "r"), share * rise(r)),
            "force": ("depth", 5e3 * depth**1.5, {"units": "N" if symmetry == "axial" else "N/m"}),
            "contact_radius": ("depth", np.sqrt(2e-3 * depth)),
        },
        {"depth": depth, "r": r, "interface": ["board", "base", "magnetic"], "height": ("interface", height)},
        {"symmetry": symmetry, "base": "bonded"},
    )


def comparison(states=2, y=(-1e-3, 0.0, 1e-3)):
    """Residuals of some 10 millionths, one of them missing; x0 of the first state: 0 measured, 1 mm simulated."""
    names, random = [f"coil{k + 1}" for k in range(states)], np.random.default_rng(0)
    x = np.linspace(-4e-3, 4e-3, 5)
    shape = (1, len(y), len(x), states)
    before, after = 1e-5 * random.standard_normal((2, *shape))
    before[0, 0, 0, 0] = after[0, 0, 0, 0] = np.nan
    dims, curves = ("depth", "y", "x", "state"), ("source", "depth", "state", "level")
    x0 = np.array([0.0, 1e-3])[:, None, None, None] + np.zeros((2, 1, states, 4))
    x0[:, :, 1:] = np.nan
    return xr.Dataset(
        {
            "delta": (("source", *dims), 1e-3 * random.standard_normal((2, *shape))),
            "residual_before": (dims, before),
            "residual_after": (dims, after),
            "scale": (("depth", "state"), np.full((1, states), 1.25)),
            "scale_std": (("depth", "state"), np.full((1, states), 0.125)),
            "x0": (curves, x0),
            "x0_std": (curves, np.stack([0.1e-3 + 0 * x0[0], np.full_like(x0[0], np.nan)])),
            "undetermined": (curves, np.zeros(x0.shape, dtype=bool)),
        },
        {
            "depth": [1e-3], "y": np.asarray(y), "x": x, "state": names, "source": ["measured", "simulated"],
            "level": [1e-4, 2e-4, 3e-4, 4e-4], "coil": names, "coil_x": ("coil", np.arange(states) * 2e-3),
        },
    )  # fmt: skip


def distortion():
    """x0 of two coils over three δ, the second one not published, and four causes of it."""
    causes = ["all neighbours", "neighbour coil2", "neighbour coil6", "noise"]
    x0 = np.array([[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], [[1.5, 2.5, 3.5], [4.5, 5.5, 6.5]]]) * 1e-3
    effect = np.array([0.2, 0.1, 0.001, 0.4])[:, None, None] * np.ones((4, 2, 3)) * 1e-3
    return xr.Dataset(
        {
            "x0": (("neighbours", "state", "delta"), x0),
            "published_x0": (("state", "delta"), [[0.5e-3, 1e-3, 1.5e-3], [np.nan] * 3]),
            "undetermined": (("neighbours", "state", "delta"), np.zeros(x0.shape, dtype=bool)),
            "published_undetermined": (("state", "delta"), np.zeros((2, 3), dtype=bool)),
            "effect": (("cause", "state", "delta"), effect), "rms": (("cause", "state"), effect[..., 0]),
            "centre": ("state", [0.0, 4e-3]),
        },
        {
            "neighbours": ["grounded", "open"], "state": NAMES[:2], "delta": [1e-4, 5e-4, 1e-3], "cause": causes,
        },
    )  # fmt: skip


@functools.cache
def ellipses():
    """Fits of a row of bells, and the model of them."""
    fits = fit_ellipses(row_of_bells(ROW, 2e-3, [1e-3]), refinement=5, step=2e-4)
    return fits, ellipse_model(fits)


def noise():
    """The Allan deviation of 200 scans of two coils with white noise of 1e-6, beside what was expected."""
    readings = 1e-6 * np.random.default_rng(0).standard_normal((200, 2))
    return stability(0.3 * np.arange(200), readings, ["coil1", "coil2"], expected=[1e-6, 1e-6])


def x_error():
    """An error of a tenth of x, in m, without a value at one corner."""
    x, y = np.linspace(-4e-3, 4e-3, 5), np.linspace(-1e-3, 1e-3, 3)
    error = xr.DataArray(np.add.outer(0 * y, x / 10), {"y": y, "x": x}, ("y", "x")).copy()
    error[0, 0] = np.nan
    return error


@functools.cache
def bounds():
    """Cramér–Rao bounds of a row of bells."""
    return identifiability(forward_model(row_of_bells(ROW)), 1e-3)


def pitch_sweep(entry="array.pitch_mm", values=(12.0, 13.0, 14.0, 15.0)):
    """k of two pairs over one entry: 0.01 · (13.5 − value) and −0.002; and a quantity that is no k."""
    at = np.asarray(values)
    return xr.Dataset(
        {
            "k[coil1,coil2]": (entry, 0.01 * (13.5 - at), {"units": "1"}),
            "k[coil1,coil3]": (entry, np.full(at.size, -0.002), {"units": "1"}),
            "worst_k": (entry, np.abs(0.01 * (13.5 - at)), {"units": "1"}),
            "reason": (entry, np.full(at.size, "", dtype=object)),
        },
        {entry: (entry, at, {"units": "mm", "design_value": 13.28})},
    )


def grid_sweep():
    """One quantity over two entries."""
    span = np.arange(12.0).reshape(4, 3)
    return xr.Dataset(
        {"span_mm": (("array.pitch_mm", "array.columns"), span, {"units": "mm"})},
        {
            "array.pitch_mm": ("array.pitch_mm", [10.0, 12.0, 14.0, 16.0], {"units": "mm"}),
            "array.columns": ("array.columns", [2, 3, 6], {"units": "1"}),
        },
    )


def tolerances():
    """Shares and drawn values of one output."""
    return xr.Dataset(
        {
            "share": (("contributor", "output"), [[0.75], [0.25]]),
            "nominal": ("output", [0.05]),
            "linear_deviation": ("output", [0.001]),
            "value": (("sample", "output"), 0.05 + 0.001 * np.linspace(-2, 2, 9)[:, None]),
        },
        {
            "output": ["worst_k"], "contributor": ["etch, board", "registration, layers"],
            "table": ("contributor", ["etch", "registration"]), "part": ("contributor", ["board", "layers"]),
        },
    )  # fmt: skip


@functools.cache
def calibration(kind="ellipses"):
    """Two combinations of a calibration to made-up numbers: a gap in mm widens ellipses, μr raises δ."""

    def evaluate(item):
        request, document = item["request"], item["document"]
        gain = document["elastomer"][1]["relative_permeability"] / 2.7
        width = document["coils"]["hexagon"]["gap_mm"] / 0.1
        if request["kind"] == "response":
            x, y = np.meshgrid(request["x"], request["y"])
            hill = 1e-3 * gain * np.exp(-(x**2 + y**2) / (8e-3 * width) ** 2)
            values = np.stack([hill, 0.5 * hill], axis=-1).ravel()
        else:
            coils = [published_model()[state] for state in request["states"]]
            rows = []
            for coil in coils:
                x0, A, B = coil.curves(request["levels"])
                rows += [width * A, width * B, x0, [gain * coil.highest]]
            values = np.concatenate(rows)
        return {str(k): value for k, value in enumerate(values.tolist())}

    unknowns = [
        {"entry": "coils.hexagon.gap_mm", "low": 0.05, "high": 0.2, "start": 0.12},
        {"entry": "elastomer.1.relative_permeability", "low": 1.5, "high": 4.0, "start": 2.0},
    ]
    fixed = {"name": "2.5", "set": {"elastomer.1.relative_permeability": 2.5}}
    choices = [{"name": "free", "unknown": unknowns[1:]}, fixed]
    document = {"unknown": unknowns[:1], "alternative": [{"name": "permeability", "choice": choices}]}
    data = None
    if kind == "response":
        x, y = np.linspace(-8e-3, 8e-3, 5), np.linspace(-4e-3, 4e-3, 3)
        hill = 1e-3 * np.exp(-(x**2 + y[:, None] ** 2) / (8e-3) ** 2)
        delta = np.stack([hill, 0.5 * hill], axis=-1)[None]
        delta = delta + 1e-5 * np.random.default_rng(0).standard_normal(delta.shape)
        coords = {"depth": [1e-3], "y": y, "x": x, "state": NAMES[:2]}
        data = xr.Dataset({"delta": (("depth", "y", "x", "state"), delta)}, coords)
        document["data"] = {"delta_std": 1e-5}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(calibration_module, "evaluate_model", evaluate)
        return calibrate(load_design("gast2020"), data, PLANS.check(Plan, document, "plan")).dataset
