"""Scenes of metal.

Plates over and under a board, a target at its distances, and eddy currents as arrows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from coilarray.geometry import Ball, CoilArray, FinitePlate, Plate
from coilarray.geometry.target import Body
from coilarray.viz.datasets.metal import EDDY_AMOUNT, Eddies, body_mesh, eddy_arrows, plate_mesh
from coilarray.viz.datasets.triangles import surface_of
from coilarray.viz.palette import METAL, METALS, cycled
from coilarray.viz.scenes.board import Box
from coilarray.viz.scenes.scene import Part, Scale, Scene, Slider

if TYPE_CHECKING:
    import pyvista

_GLASS, _DENSER = 0.22, 0.45  # opacities of bodies that cover the whole board, and a part of it
_BEYOND = 0.06  # length of an infinite plate beyond the board, over the board's longer side
_DECADES = 1.5  # range of current densities that the colours resolve, in powers of ten
_ARROWS, _MOST_ARROWS = 20, 32  # arrows along the longest side of a body, and of the whole picture
_STRONG = 0.98  # quantile of the current densities with the last colour; at rims they diverge
_SHARP = 30.0  # angle in degrees of an edge that is drawn


@dataclass(frozen=True, eq=False)
class Position:
    """One position of a target.

    It has its distance and place in m, its eddy currents if they are shown, and lines about it. `place` is the place of
    its centre, or of the lower face of an infinite plate.
    """

    distance: float
    place: tuple[float, float, float]
    eddies: Eddies | None = None
    lines: tuple[str, ...] = ()


def around_board(array: CoilArray) -> Box:
    """Rectangle in m to which pictures cut infinite plates."""
    x_min, y_min, x_max, y_max = array.bounds
    rim = _BEYOND * max(x_max - x_min, y_max - y_min)
    return x_min - rim, y_min - rim, x_max + rim, y_max + rim


def scene_of_plates(plates: Sequence[Plate | FinitePlate], within: Box) -> Scene:
    """Scene of the plates of a design.

    Infinite plates are cut to `within` in m.
    """
    colours = cycled(METALS, [plate.name for plate in plates])
    parts: list[Part] = []
    for plate in plates:
        mesh, group = plate_mesh(plate, within), f"{plate.name}: {_body_words(plate)}"
        parts += _glass(f"plate {plate.name}", mesh, group, colours[plate.name], isinstance(plate, Plate))
    return Scene(tuple(parts), notes=_cut_note(plates))


def scene_of_target(body: Body, positions: Sequence[Position], within: Box, scale: Scale | None, first: int) -> Scene:
    """Scene of a target with a slider of its distance.

    Infinite plates are cut to `within` in m. `scale` belongs to the eddy currents if they are shown. `first` is the
    first position of the slider.
    """
    group = f"target: {_body_words(body)}"
    parts: list[Part] = []
    for step, position in enumerate(positions):
        mesh = body_mesh(body, position.place, within)
        for part in _glass(f"target {step}", mesh, group, METAL, isinstance(body, Plate)):
            parts.append(_at(part, step))
        if position.eddies is not None and scale is not None:
            parts += [_at(part, step) for part in eddy_parts(f"eddies {step}", position.eddies, scale, within)]
    labels = tuple(f"{position.distance * 1e3:g} mm" for position in positions)
    slider = Slider("distance of the target", labels, tuple(position.lines for position in positions), first)
    return Scene(tuple(parts), notes=_cut_note([body]), slider=slider)


def eddy_parts(name: str, eddies: Eddies, scale: Scale, within: Box) -> tuple[Part, ...]:
    """Eddy currents of a body as coloured arrows.

    `within` is the rectangle in m that is shown, and its size limits how small an arrow may be.
    """
    x_min, y_min, x_max, y_max = within
    least = max(x_max - x_min, y_max - y_min) / _MOST_ARROWS
    spacing = max(float(np.ptp(eddies.points, axis=0).max()) / _ARROWS, least)
    arrows = eddy_arrows(eddies, spacing, scale.high).threshold(scale.low, scalars=EDDY_AMOUNT)
    if not arrows.n_cells:
        return ()
    return (Part(name, surface_of(arrows), "eddy currents", scale=scale, ambient=0.5, diffuse=0.55),)


def scale_of_eddies(all_eddies: Sequence[Eddies]) -> Scale:
    """Logarithmic scale of current densities."""
    amounts = [np.linalg.norm(one.density, axis=1) for one in all_eddies]
    largest = max((float(np.quantile(amount, _STRONG)) for amount in amounts if amount.size), default=0.0)
    high = largest if largest > 0 else 1.0
    return Scale(EDDY_AMOUNT, "eddy current", "A/m", high / 10**_DECADES, high, logarithmic=True)


def _glass(name: str, mesh: pyvista.PolyData, group: str, colour: str, covers: bool) -> list[Part]:
    """Translucent body, with its edges if it has any."""
    parts = [Part(name, mesh, group, colour, opacity=_GLASS if covers else _DENSER, ambient=0.35, smooth=True)]
    edges = mesh.clean().extract_feature_edges(_SHARP, manifold_edges=False, non_manifold_edges=False)
    if edges.n_cells:
        parts.append(Part(f"edges of {name}", edges, group, colour, line_width=2.0, lit=False))
    return parts


def _at(part: Part, step: int) -> Part:
    return replace(part, step=step)


def _body_words(body: Body) -> str:
    """Material and size of a body for a legend."""
    if isinstance(body, Ball):
        return f"sphere of {body.material.words}, {body.radius * 2e3:g} mm"
    kind = "infinite plate of " if isinstance(body, Plate) else ""
    return f"{kind}{body.material.words}, {body.thickness * 1e3:g} mm"


def _cut_note(bodies: Sequence[Body]) -> tuple[str, ...]:
    endless = [body.name for body in bodies if isinstance(body, Plate)]
    if not endless:
        return ()
    return (f"Infinite plates, drawn as far as the board: {', '.join(endless)}.",)
