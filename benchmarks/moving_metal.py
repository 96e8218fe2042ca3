"""What metal parts would do to x0 of the published sensor: an arm that moves with the indenter, a plate below.

    python benchmarks/moving_metal.py

An arm of the positioning stage, above the sheets and to one side of the indenter, comes nearer to the coils by the
depth of the indentation, and takes something from every δ. Its height is the one unknown: it is fitted to the published
x0 of one coil and tried on the others, like every suspect of the plan ``table_a1_asymmetry``. Prints the deviations at
every height and the rows of docs/paper.md. A plate that stays where it is, below one half of coil 2, is shown too.
Takes about six minutes.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar

from coilarray.compute.arrays import FloatArray
from coilarray.design.model import Design, load_design
from coilarray.geometry.bodies import MATERIALS, FinitePlate, Rectangle
from coilarray.metal.finite_plates import moving_plate
from coilarray.paper.ellipse_model import published_model
from coilarray.response.map import Imperfections, MapAccuracy, respond, response_map
from coilarray.response.setup import indentation_of
from coilarray.studies.calibrate.plan import COARSE, load_plan, measurement, model_values

IDEAL = Imperfections(network="ideal")
HEIGHTS = np.geomspace(10e-3, 32e-3, 7)  # of its lower face over the flat sheets, in m
LENGTH, WIDTH, THICKNESS, MATERIAL = 80e-3, 10e-3, 5e-3, "aluminium"
FREQUENCY = 1.4e6  # at which the coils oscillate, in Hz


def arm_changes(design: Design, response: xr.Dataset, side: int) -> FloatArray:
    """Change of the inductance matrix in H as the arm comes down by the depth, (heights, y, x, coils, coils)."""
    depth, face = indentation_of(design).depths[0], sum(sheet.thickness for sheet in design.sheets)
    x, y = response.x.values + response.attrs["origin_x"], response.y.values + response.attrs["origin_y"]
    arm = FinitePlate("arm", Rectangle(LENGTH, WIDTH), (0.0, 0.0, 0.0), THICKNESS, MATERIALS[MATERIAL])
    levels = [face + height - part for height in HEIGHTS for part in (0.0, depth)]
    places = [(a + side * LENGTH / 2, b, level + THICKNESS / 2) for level, b, a in itertools.product(levels, y, x)]
    found = moving_plate(design.array, arm, places, [FREQUENCY], design.sheets).change[:, 0].real
    found = found.reshape(len(HEIGHTS), 2, len(y), len(x), *found.shape[1:])
    return np.asarray(found[:, 1] - found[:, 0])


def show_plate(design: Design) -> None:
    """Print δ on y = 0 with and without a plate below the board, whose right edge is below the centre of coil 2."""
    x, middle = np.array([-20e-3, -16e-3, -10e-3, 0.0, 10e-3, 16e-3, 20e-3]), design.array.centres[1, 0]
    plate = FinitePlate("plate", Rectangle(40e-3, 60e-3), (middle - 20e-3, 0.0, -4e-3), 2e-3, MATERIALS[MATERIAL])
    print("x (mm)".ljust(30), (1e3 * x).round(1))
    for plates in ((), (plate,)):
        changed = replace(design, plates=plates)
        found = response_map(
            changed,
            x=x,
            y=[0.0],
            depths=indentation_of(design).depths[:1],
            imperfections=IDEAL,
            accuracy=MapAccuracy(mesh=COARSE),
        )
        for state, delta in zip(found.state.values, found.delta.values[0, 0].T, strict=True):
            print(f"1e4 δ, {state}, plates: {len(plates)}".ljust(30), (1e4 * delta).round(2), flush=True)


def main() -> None:
    """Fit the height of an arm on either side, show what a plate does, and print."""
    design = load_design("gast2020")
    measured = measurement(published_model(), load_plan("table_a1_asymmetry").data, design)
    states = measured.request["states"]
    plan = tuple(state for state in design.plan if state.name in states)
    design = replace(design, circuit=replace(design.circuit, scan=plan))
    show_plate(design)
    response = response_map(design, depths=indentation_of(design).depths[:1], imperfections=IDEAL)
    numbers = list(zip(measured.coords["quantity"], measured.coords["state"], strict=True))
    of_state = {name: np.array([number == ("x0", name) for number in numbers]) for name in states}

    def deviations(changed: xr.Dataset) -> dict[str, float]:
        """Root mean squares of predicted less published x0 in mm."""
        missed = 1e3 * (model_values(changed, measured.request) - measured.values)
        return {name: float(np.sqrt(np.nanmean(missed[rows] ** 2))) for name, rows in of_state.items()}

    def show(what: str, of: dict[str, float]) -> None:
        print(f"{what:40s}", "  ".join(f"{name} {value:.2f}" for name, value in of.items()), flush=True)

    show("no arm", deviations(response))
    for side, name in ((-1, "left"), (1, "right")):
        changes = arm_changes(design, response, side)
        largest = np.abs(changes).max(axis=(1, 2, 3, 4))  # falls almost exponentially
        size, shape = (CubicSpline(np.log(HEIGHTS), of) for of in (np.log(largest), changes / largest[:, *[None] * 4]))

        def with_arm(place: float, size: CubicSpline = size, shape: CubicSpline = shape) -> dict[str, float]:
            part = np.exp(size(place)) * shape(place)
            return deviations(
                respond(design, response, inductance_change=response.inductance_change.values + part[None], ideal=True)
            )

        for height in HEIGHTS:
            show(f"arm on the {name}, {1e3 * height:.1f} mm over the sheets", with_arm(np.log(height)))
        for fitted in ("coil2", "coil1"):
            best = minimize_scalar(
                lambda place, to=fitted: with_arm(place)[to], bounds=np.log(HEIGHTS[[0, -1]]), options={"xatol": 0.02}
            )
            show(f"{name}, fitted to {fitted}: {1e3 * np.exp(best.x):.1f} mm", with_arm(best.x))


if __name__ == "__main__":
    main()
