"""Evaluation of a calibration: the response of a changed design, reduced to the measured numbers.

The cost of an evaluation depends on the changed entries. In the store of results, contacts are kept by sheets and
indenter, inductances by coils and sheets, and inductance changes by coils and dents. Losses and strays are always
computed for the coils under the sheets of the design with which the fit began, because the effect of a sheet on them is
too small to show in δ.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from coilarray.circuit.coupling import design_circuit
from coilarray.circuit.network import Network
from coilarray.design.model import Design, build_design
from coilarray.elastomer.scattering import LayerMesh
from coilarray.response.map import response_map
from coilarray.response.setup import Imperfections, indentation_of
from coilarray.studies.calibrate.data import model_values
from coilarray.studies.calibrate.plan import IMPERFECTIONS

COARSE = LayerMesh(harmonics=6, decays=6.0, width=0.4, rows=4)
"""Mesh that is accurate to 1e-3 of δ, and twice as fast."""


def evaluate_model(item: Mapping[str, Any]) -> dict[str, float]:
    """Evaluate one point of a fit, on a worker.

    The item has the ``document`` of the changed design, the ``start`` document of the design with which the fit began,
    the values of ``imperfections`` by name, the ``request`` of a measurement, ``circuit`` and ``mesh`` of the plan, and
    the folder of ``parts``, which may be empty. The numbers are returned by their place.
    """
    document, request = item["document"], item["request"]
    whole = build_design(document, document["name"])
    wanted = set(request["states"])
    plan = tuple(state for state in whole.plan if state.name in wanted)
    design = replace(whole, circuit=replace(whole.circuit, scan=plan))
    ideal = item["circuit"] == "ideal"
    ellipses, setup = request["kind"] == "ellipses", indentation_of(design).in_ellipse_window()
    response = response_map(
        design,
        depths=setup.depths[:1] if ellipses else request["depth"],
        x=setup.x if ellipses else request["x"],
        y=setup.y if ellipses else request["y"],
        imperfections=imperfections_of(item["imperfections"]),
        network=None if ideal else _network(design, item["start"]),
        ideal=ideal,
        mesh=COARSE if item["mesh"] == "coarse" else None,
        parts=Path(item["parts"]) if item["parts"] else None,
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
    """Circuit of a design with all losses and strays.

    They are computed under the sheets with which the fit began.
    """
    flat = replace(design, sheets=build_design(start, start["name"]).sheets, indentation=None)
    return design_circuit(flat)
