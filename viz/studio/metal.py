"""Metal of a design in the studio.

Bodies are added and removed, and the effect of a target is computed at every distance.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from coilarray.circuit.readability import with_reasons
from coilarray.compute.display_units import MM, true_minus
from coilarray.design.model import Design
from coilarray.design.vary import no_longer_assumed
from coilarray.errors import DesignError, shown
from coilarray.geometry import MATERIALS, Plate
from coilarray.viz.scenes.metal import steps_of, target_at, target_place
from coilarray.viz.studio.entries import number_of
from coilarray.viz.studio.services import Document
from coilarray.viz.studio.structure import without_entry

KINDS = ("plate above", "plate below", "target")
"""Kinds of a new body."""
SIZES: Mapping[str, tuple[str, ...]] = {
    "infinite plate": (), "disc": ("diameter_mm",), "rectangle": ("width_mm", "height_mm"),
    "ring": ("diameter_mm", "inner_diameter_mm"), "sphere": ("diameter_mm",),
}  # fmt: skip
"""Keys of the sizes of each shape of a new body."""
FIRST = {
    "kind": "target", "shape": "disc", "material": "aluminium", "thickness": "1", "distance": "0.5, 1, 2, 5, 10",
    "size": "20", "second": "10",
}  # fmt: skip
"""First texts of the fields of a new body."""


@dataclass(frozen=True, eq=False)
class Moved:
    """Effect of a design's target at several distances.

    The target is at one place on the board, in m.
    """

    design: Design
    place: tuple[float, float]
    numbers: xr.Dataset  # of `coilarray.target_map`, with one x and one y

    @property
    def distances(self) -> list[float]:
        """Distances of the target in m."""
        return [float(one) for one in self.numbers.distance.values]


def moved(design: Design, place: tuple[float, float] | None) -> Moved:
    """Move a design's target through all distances.

    It is over a place on the board in m, by default over its middle coil. A design without a target, or a case that is
    not computed, raises a MetalError.
    """
    at = target_place(design, design.array.middle_coil, place)
    return Moved(design, at, target_at(design, at, steps_of(design)))


def target_rows(moved: Moved, step: int) -> list[list[str]]:
    """Rows of the states at one distance.

    A row has name, δ, L in µH, R in Ω, Q, R_p in kΩ and f in MHz. If the converter cannot read the state, the broken
    limit follows the name.
    """
    at = with_reasons(moved.numbers.isel(distance=step, x=0, y=0))[0]
    return [
        [
            f"{state}{f' (not readable: {one.broken_limit.item()})' if not one.get('readable', True) else ''}",
            true_minus(f"{float(one.delta) * 100:+.4g} %"),
            f"{float(one.effective_inductance) * 1e6:.4f}",
            f"{float(one.effective_resistance):.3f}",
            f"{float(one.quality_factor):.2f}",
            f"{float(one.parallel_resistance) * 1e-3:.3f}" if np.isfinite(one.parallel_resistance) else "∞",
            f"{float(one.frequency) * 1e-6:.5f}",
        ]
        for state, one in ((name, at.sel(state=name)) for name in at.state.values)
    ]


def body_rows(design: Design) -> list[dict[str, str]]:
    """Rows of the bodies of a design.

    A row has a key by which the body is removed, and a description.
    """
    rows = [
        {
            "key": str(number),
            "text": f"plate {plate.name}: {'infinite plate of ' if isinstance(plate, Plate) else ''}"
            f"{plate.material.words}, {MM.text(plate.thickness)}, z = {MM.text(plate.heights[0], '.4')}",
        }
        for number, plate in enumerate(design.plates)
    ]
    if design.target is not None:
        target = design.target
        words = f"target: {target.kind} of {target.body.material.words}"
        rows.append({"key": "target", "text": words})
    return rows


def with_body(document: Document, form: Mapping[str, Any]) -> Document:
    """Add a new body to the document of a design.

    `form` has the texts of the fields, with the keys of `FIRST`. A new target replaces an old target. A text that is
    not a number, or a shape that a plate cannot have, raises a DesignError.

    Examples
    --------
    >>> with_body({}, {**FIRST, "kind": "plate below", "shape": "infinite plate", "distance": "3"})["plate"]
    [{'name': 'plate1', 'material': 'aluminium', 'thickness_mm': 1.0, 'distance_mm': 3.0, 'side': 'below'}]
    """
    given = {key: str(form.get(key, default)).strip() for key, default in FIRST.items()}
    kind, shape = given["kind"], given["shape"]
    if kind not in KINDS or shape not in SIZES or given["material"] not in MATERIALS:
        raise DesignError(f"a new body must be of {', '.join(KINDS)} with a shape and a material that there are.")
    if shape == "sphere" and kind != "target":
        raise DesignError("a sphere must be a target; a plate is flat.")
    sizes = {key: number_of(key, given[field]) for key, field in zip(SIZES[shape], ("size", "second"), strict=False)}
    body: dict[str, Any] = {"material": given["material"], **sizes}
    if shape != "sphere":
        body["thickness_mm"] = number_of("thickness_mm", given["thickness"])
    if kind == "target":
        distances = [number_of("distances_mm", text) for text in re.split(r"[,;\s]+", given["distance"]) if text]
        target = {"shape": "plate" if shape == "infinite plate" else shape, **body, "distances_mm": distances}
        return no_longer_assumed({**document, "target": target}, ["target"])
    if shape != "infinite plate":
        body["shape"] = shape
    plates = list(document.get("plate", []))
    taken = {plate.get("name") for plate in plates}
    name = next(one for one in (f"plate{k + 1}" for k in range(len(plates) + 1)) if one not in taken)
    place = {"distance_mm": number_of("distance_mm", given["distance"]), "side": kind.removeprefix("plate ")}
    return {**document, "plate": [*plates, {"name": name, **body, **place}]}


def without_body(document: Document, key: str) -> Document:
    """Remove a body from the document of a design.

    `key` is a key of `body_rows`.
    """
    if key != "target":
        if not key.isdecimal():
            raise DesignError(f"a body must be target or the number of a plate; got {shown(key)}.")
        return without_entry(document, "plate", int(key))
    return no_longer_assumed({name: table for name, table in document.items() if name != "target"}, ["target"])
