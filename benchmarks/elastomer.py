"""The elastomer: contact, flat and dented sheets against their references, and the speed of response maps."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any

import numpy as np
import xarray as xr
from accuracy import Accuracy, _worst
from dented_layer_3d import SmoothDent
from speed import Speed, _fresh, _median_time
from support.first_assumed import first_assumed
from support.references import polygon, rows

from coilarray import load_design, response_map, vary
from coilarray.design.model import Design
from coilarray.elastomer import contact
from coilarray.elastomer.dent import Dent
from coilarray.elastomer.dented_layer import dent_inductance
from coilarray.electromagnetics.flat_layer import layer_inductance
from coilarray.geometry import FlatPunch, Paraboloid, Sheet
from coilarray.paper.two_dimensional import line_response
from coilarray.response.setup import indentation_of

FEM = Path(__file__).with_name("dented_layer_3d.json")

_HALF_SPACE = 1e3  # m
indent = partial(contact.indent, strain="linear")


def _slabs() -> Iterator[tuple[float, float]]:
    """Polygons of 64, 128 and 256 sides, extrapolated in 1/n²."""
    for row in rows("slab_circular_filament"):
        a, b, z1, z2, t, d = (float(row[f"{key}_mm"]) * 1e-3 for key in ("a", "b", "z1", "z2", "t", "d"))
        sheet = Sheet("magnetic", min(t, _HALF_SPACE), float(row["mu_r"]))
        M = [
            layer_inductance([polygon(n, a, -z1), polygon(n, b, -z2, centre=(d, 0.0))], [sheet])[0, 1]
            for n in (64, 128, 256)
        ]
        first = [(4 * fine - coarse) / 3 for coarse, fine in itertools.pairwise(M)]
        yield (16 * first[1] - first[0]) / 15 * 1e9, float(row["dM_images_nH"])


def _punches() -> Iterator[tuple[float, float]]:
    """Force of a flat punch as κ."""
    for row in rows("indentation_hayes_flat_punch"):
        h, E = 2e-3, 1e5
        a = float(row["a_over_h"]) * h
        for nu in (0.30, 0.40, 0.49, 0.50):
            force = float(indent([Sheet("layer", h, 1.0, E, nu)], FlatPunch(a), 1e-3 * a).force[0])
            yield force * (1 - nu) / (4 * E / (2 * (1 + nu)) * a * 1e-3 * a), float(row[f"nu{nu:.2f}"])


def _layers(column: str) -> Iterator[tuple[float, float]]:
    """Force or contact radius of a paraboloid on one layer, nearly and fully incompressible, both bases."""
    h, R, E = 3e-3, 0.3, 1e5
    groups = itertools.groupby(rows("indentation_layer_sphere"), lambda row: (row["base"], row["nu"]))
    for (base, ratio), group in groups:
        every = list(group)[::3]
        nu = 0.45 if ratio == "any" else float(ratio)
        a, depth, force = (
            np.array([float(row[key]) for row in every]) for key in ("a_over_h", "deltaR_over_h2", "P_dimless")
        )
        found = indent(
            [Sheet("layer", h, 1.0, E, nu)],
            Paraboloid(R),
            depth * h**2 / R,
            base="bonded" if base == "bonded" else "frictionless",
        )
        if column == "force":
            yield from zip(found.force.values, force * E / (1 - nu**2) * (a * h) ** 3 / R, strict=True)
        else:
            yield from zip(found.contact_radius.values, a * h, strict=True)


def _stacks() -> Iterator[tuple[float, float]]:
    """Displacement of the interface on the axis of two layers."""
    groups = itertools.groupby(
        rows("indentation_two_layer_stack"), lambda row: (float(row["E_top_MPa"]), float(row["R_mm"]))
    )
    for (E, R), group in groups:
        axis = [row for row in group if float(row["r_mm"]) == 0]
        sheets = [Sheet("bottom", 6e-3, 1.0, 0.1e6, 0.5), Sheet("top", 2e-3, 1.0, E * 1e6, 0.5)]
        found = indent(sheets, Paraboloid(R * 1e-3), [float(row["delta_mm"]) * 1e-3 for row in axis])
        sunk = -found.displacement_z.sel(interface="bottom").isel(r=0).values * 1e3
        yield from zip(sunk, (float(row["u_interface_mm"]) for row in axis), strict=True)


def _dented() -> Iterator[tuple[float, float]]:
    """Diagonal and off-diagonal against the three-dimensional FEM, at three places."""
    kept = json.loads(FEM.read_text(encoding="utf-8"))
    dent, r = SmoothDent(**kept["dent"]), np.linspace(0, 60e-3, 1201)
    shape = np.column_stack((0 * r, dent.bottom(r), dent.top(r)))
    sheets = Dent((6e-3, 2e-3), (1.0, 2.7), r, shape)
    paths = first_assumed().array.conductors()[1:3]
    for place in kept["places"]:
        fast = dent_inductance(paths, [sheets], [[place["x"], place["y"]]])[0, 0]
        yield from zip(fast.ravel(), np.ravel(place["extrapolated"]), strict=True)


def accuracies() -> list[Accuracy]:
    """Compare with every table of the elastomer; a minute or two."""
    checks = {
        "ΔM of circles by a magnetic slab": (1e-8, "ref_slab_circular_filament.csv", _slabs()),
        "force of a flat punch on a bonded layer": (1e-2, "ref_indentation_hayes_flat_punch.csv", _punches()),
        "force of a sphere on a layer": (1e-2, "ref_indentation_layer_sphere.csv", _layers("force")),
        "its contact radius": (1e-2, "ref_indentation_layer_sphere.csv", _layers("radius")),
        "sinking of the interface of two layers": (1e-2, "ref_indentation_two_layer_stack.csv", _stacks()),
        "ΔL, ΔM of a dent against a 3-D FEM": (1e-2, "dented_layer_3d.json", _dented()),
    }
    found = []
    for what, (limit, table, pairs) in checks.items():
        kept = list(pairs)
        found.append(Accuracy(what, table, len(kept), float(_worst(kept)), limit))
    return found


_MEMORY = f"""
import sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
from speed import peak_memory
from coilarray import load_design, response_map
design = load_design("gast2020")
window = design.indentation.in_ellipse_window()
response_map(design, x=window.x, y=window.y)
print(peak_memory())
"""


def paper_map(design: Design | None = None, **setting: Any) -> xr.Dataset:
    """Compute the response in the window of the paper, by default of gast2020."""
    pressed = load_design("gast2020") if design is None else design
    setup = indentation_of(pressed).in_ellipse_window()
    return response_map(pressed, x=setup.x, y=setup.y, **setting)


def _sample_over_wide() -> Speed:
    """Processor time of the map of a finite sample over that of a wide one, each on seats that were never solved."""
    seats = itertools.count(200)

    def processor_time(sample: dict[str, object]) -> float:
        times = []
        for _ in range(4):  # the first one brings coils and code to memory
            design = vary(
                load_design("gast2020"), {"indentation.seat_stiffness_kPa_per_mm": 4 + next(seats) / 1e3, **sample}
            )
            start = process_time()
            paper_map(design)
            times.append(process_time() - start)
        return median(times[1:])

    wide = processor_time({})
    samples: dict[str, dict[str, object]] = {
        f"{2 * x} × {2 * y} mm": {"indentation.sample_x_mm": [-x, x], "indentation.sample_y_mm": [-y, y]}
        for x, y in ((60, 11.5), (30, 20), (60, 40))
    }
    samples["60 × 40 mm that can lift"] = {**samples["60 × 40 mm"], "indentation.seat_lifts": True}
    ratios = {name: processor_time(sample) / wide for name, sample in samples.items()}
    first, *others = ratios.items()
    note = "; ".join(f"{name}: {ratio:.1f} ×" for name, ratio in others)
    what = f"processor time of the map of a sample of {first[0]} with free sides over that of a wide one"
    return Speed(what, first[1], "×", note, "< 2", first[1] < 2)


def speeds() -> list[Speed]:
    """Take the figures of the paper's map: 27 × 7 positions, six coils."""
    paper_map()
    one = _median_time(paper_map, 3)
    two = _median_time(lambda: paper_map(depths=[0.5e-3, 1e-3]), 3)
    kept = json.loads(FEM.read_text(encoding="utf-8"))
    slow = min(place["levels"][1]["seconds"] for place in kept["places"])
    unknowns = kept["places"][0]["levels"][1]["unknowns"]
    note = f"{one / slow:.2f} × the time of one position by 3-D FEM with {unknowns} unknowns"
    _, memory = _fresh(_MEMORY)
    coil = load_design("gast_fem")
    depth = [0.5e-3, 1e-3, 1.5e-3]
    flat = line_response(coil, depths=depth, x=[0.0]).delta.values[:, 0, 0, 0]
    full = response_map(coil, depths=depth, x=[0.0], y=[0.0]).delta.values[:, 0, 0, 0]
    excess = ", ".join(f"{ratio:.2f}" for ratio in flat / full)
    return [
        Speed("response map, 27 × 7 positions, six coils, one depth, warm", one, "s", note, "< 5 s", one < 5),
        Speed("a further depth", two - one, "s", "", "< 2 s", two - one < 2),
        Speed("peak memory of the map", float(memory), "MB", "", "< 1000 MB", float(memory) < 1000),
        Speed(
            "δ of the two-dimensional model over the full one, gast_fem, centre", float(flat[1] / full[1]), "",
            f"at 0.5, 1, 1.5 mm: {excess}",
        ),
        _sample_over_wide(),
    ]  # fmt: skip
