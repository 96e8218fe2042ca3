"""Plates, the target, and eddy currents in them."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.circuit.coupling import operating_currents
from coilarray.compute.arrays import ComplexArray
from coilarray.compute.display_units import MM, true_minus
from coilarray.compute.threads import Progress
from coilarray.design.model import Design
from coilarray.errors import MetalError
from coilarray.geometry import Array, Ball, FinitePlate, Plate
from coilarray.geometry.bodies import Body
from coilarray.metal.finite_plates import eddy_currents
from coilarray.metal.flat_plates import plate_currents
from coilarray.response.setup import target_of
from coilarray.response.target import target_map
from coilarray.viz.datasets.meshes import body_mesh, plate_mesh, surface_of
from coilarray.viz.datasets.results import EDDY_AMOUNT, Eddies, eddy_arrows
from coilarray.viz.palette import METAL, METALS, cycled
from coilarray.viz.scenes.board import Box
from coilarray.viz.scenes.scene import DECADE, Part, Scale, Scene, Slider, rounded_up

if TYPE_CHECKING:
    import pyvista


_GLASS, _DENSER = 0.22, 0.45  # opacities of bodies that cover the whole board, and a part of it
_BEYOND = 0.06  # length of an infinite plate beyond the board, over the board's longer side
_DECADES = 2  # range of current densities that the colours resolve, in powers of ten
_ARROWS, _MOST_ARROWS = 20, 32  # arrows along the longest side of a body, and of the whole picture
_STRONG = 0.98  # quantile of the current densities with the last colour; at rims they diverge
_SHARP = 30.0  # angle in degrees of an edge that is drawn
CURRENT = 1e-3  # current in the measured coil in A


def around_board(array: Array) -> Box:
    """Rectangle in m to which pictures cut infinite plates."""
    x_min, y_min, x_max, y_max = array.bounds
    rim = _BEYOND * max(x_max - x_min, y_max - y_min)
    return x_min - rim, y_min - rim, x_max + rim, y_max + rim


def _eddy_parts(name: str, eddies: Eddies, scale: Scale, within: Box) -> tuple[Part, ...]:
    """Eddy currents of a body as coloured arrows within a rectangle."""
    x_min, y_min, x_max, y_max = within
    least = max(x_max - x_min, y_max - y_min) / _MOST_ARROWS
    spacing = max(float(np.ptp(eddies.points, axis=0).max()) / _ARROWS, least)
    arrows = eddy_arrows(eddies, spacing, scale.high).threshold(scale.low, scalars=EDDY_AMOUNT)
    if not arrows.n_cells:
        return ()
    return (Part(name, surface_of(arrows), "eddy currents", scale=scale, ambient=0.5, diffuse=0.55),)


def _glass(name: str, body: Body, mesh: pyvista.PolyData, group: str, colour: str) -> list[Part]:
    """Translucent body, with its edges if it has any."""
    opacity = _GLASS if isinstance(body, Plate) else _DENSER
    parts = [Part(name, mesh, group, colour, opacity=opacity, ambient=0.35, smooth=True)]
    edges = mesh.clean().extract_feature_edges(_SHARP, manifold_edges=False, non_manifold_edges=False)
    if edges.n_cells:
        parts.append(Part(f"edges of {name}", edges, group, colour, line_width=2.0, lit=False))
    return parts


def _body_words(body: Body) -> str:
    if isinstance(body, Ball):
        return f"sphere of {body.material.words}, {body.radius * 2e3:g} mm"
    kind = "infinite plate of " if isinstance(body, Plate) else ""
    return f"{kind}{body.material.words}, {body.thickness * 1e3:g} mm"


def _cut_note(bodies: Sequence[Body]) -> tuple[str, ...]:
    endless = ", ".join(body.name for body in bodies if isinstance(body, Plate))
    return (f"Infinite plates, drawn as far as the board: {endless}.",) if endless else ()


Phasors = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], ComplexArray]
"""Points (n, 3) in m, normals (n, 3) and complex current densities (n, 3) in A/m of one body."""

_ALONG = 20  # number of arrows along the longest side of an infinite plate
_FLAT = 0.9  # least cosine of the angle between face and triangle; other triangles are the rim
_BLURRED = 0.4  # width over which the current of an arrow is averaged, over their distance


class WorkingPoint(NamedTuple):
    """Currents of all coils in A, shape (n,), at a frequency in Hz."""

    currents: ComplexArray
    frequency: float


def eddies_of_plates(
    design: Design, plates: Sequence[Plate | FinitePlate], operation: WorkingPoint, within: Box
) -> list[Phasors]:
    """Eddy currents of plates, over `within` in m if infinite."""
    endless = [plate for plate in plates if isinstance(plate, Plate)]
    if endless and len(endless) < len(plates):
        raise MetalError(
            "eddy currents of infinite plates are not computed beside plates with an outline; got "
            f"{', '.join(plate.name for plate in plates)}."
        )
    return [*_endless(design, endless, operation, within), *_outlined(design, plates, operation)]


def _eddies_of_target(
    design: Design, place: tuple[float, float], distance: float, operation: WorkingPoint, within: Box
) -> Phasors | None:
    """Eddy currents of a target at a distance in m, None of a ball."""
    body, height = target_of(design).body, target_of(design).height(design.top, distance)
    if isinstance(body, Plate):
        return eddies_of_plates(design, [replace(body, z=height), *design.plates], operation, within)[0]
    if isinstance(body, FinitePlate):
        return _outlined(design, [*design.plates, replace(body, centre=(*place, height))], operation)[-1]
    return None


def _outlined(design: Design, plates: Sequence[Plate | FinitePlate], operation: WorkingPoint) -> list[Phasors]:
    """Eddy currents through outlined plates, at their upper faces' triangles."""
    outlined = [plate for plate in plates if isinstance(plate, FinitePlate)]
    if not outlined:
        return []
    found: list[Phasors] = []
    (currents,) = eddy_currents(design.array, plates, [operation.frequency], design.sheets)
    for plate, one in zip(outlined, currents, strict=True):
        density = np.tensordot(operation.currents, one.density, axes=1)
        half = len(density) // 2  # the upper half, then its mirror image in the same order
        upper, through = one.corners[:half], density[:half] + density[half:]
        first, second, third = np.moveaxis(upper, 1, 0)
        normals = np.cross(second - first, third - first)
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        face = normals @ plate.axes[2] > _FLAT
        found.append((upper.mean(axis=1)[face], normals[face], through[face]))
    return found


def _endless(design: Design, plates: Sequence[Plate], operation: WorkingPoint, within: Box) -> list[Phasors]:
    """Eddy currents of infinite plates, on a grid."""
    if not plates:
        return []
    x_min, y_min, x_max, y_max = within
    step = max(x_max - x_min, y_max - y_min) / _ALONG
    x, y = (np.linspace(low, high, round((high - low) / step) + 1) for low, high in ((x_min, x_max), (y_min, y_max)))
    array, sheets = design.array, design.sheets
    density = plate_currents(array, operation.currents, plates, operation.frequency, x, y, sheets, blur=_BLURRED * step)
    found = []
    for plate, K in zip(plates, density, strict=True):
        flat = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
        points = np.column_stack((flat, np.full(len(flat), plate.heights[1])))
        normals = np.broadcast_to([0.0, 0.0, 1.0], points.shape)
        found.append((points, normals, np.column_stack((K.reshape(-1, 2), np.zeros(len(flat))))))
    return found


_STEPS = 9  # least number of positions of the slider of a distance
_NEAR = 0.05  # least relative distance of a position in between from the design's own positions
_SHOWN_STATES = 8  # largest number of states whose δ stand in a line


def scene_of_metal(
    design: Design,
    shown: Container[str],
    coil: str,
    coupling: Callable[[], xr.Dataset],
    *,
    terminated: bool = True,
    place: tuple[float, float] = (0.0, 0.0),
    numbers: xr.Dataset | None = None,
    first: int = 0,
) -> Scene:
    """Scene of plates, target and eddy currents of a design."""
    # Eddy currents flow in the `shown` bodies, with 1 mA in a `coil` and the others `terminated` or open. `numbers`
    # of `target_at` show the target at a `place` in m, with a slider of distances that stands `first` at one.
    within = around_board(design.array)
    plates = design.plates if "plates" in shown else ()
    distances: list[float] = [] if numbers is None else numbers.distance.values.tolist()
    colours = cycled(METALS, [plate.name for plate in plates])
    parts: list[Part] = []
    for plate in plates:
        group = f"{plate.name}: {_body_words(plate)}"
        parts += _glass(f"plate {plate.name}", plate, plate_mesh(plate, within), group, colours[plate.name])
    scene = Scene(tuple(parts), notes=_cut_note(plates))
    of_target: list[tuple[Part, ...]] = [()] * len(distances)
    if "eddies" in shown:
        if not plates and not distances:
            raise MetalError(f"eddy currents need plates or a target in the picture of {design.name}.")
        currents = CURRENT * operating_currents(design, coupling(), coil, terminated=terminated)
        operation = WorkingPoint(currents, float(coupling().frequency.sel(coil=coil)))
        phasors = {
            f"eddies of plate {k}": one for k, one in enumerate(eddies_of_plates(design, plates, operation, within))
        }
        in_target = [_eddies_of_target(design, place, distance, operation, within) for distance in distances]
        phasors |= {f"eddies {k}": one for k, one in enumerate(in_target) if one is not None}
        arrows, when = _strongest(phasors, within)
        of_target = [arrows.pop(f"eddies {k}", ()) for k in range(len(distances))]
        carried = f"{operation.frequency * 1e-6:.4g} MHz, {CURRENT * 1e3:g} mA in {coil}"
        notes = [f"Eddy currents {when}, {carried}, the currents of the coils as without a target."]
        notes += ["Those in the target are not drawn."] if None in in_target else []
        scene += Scene(tuple(part for found in arrows.values() for part in found), notes=tuple(notes))
    if numbers is None:
        return scene
    lines: list[tuple[str, ...]] = []
    parts = []
    for step, distance in enumerate(distances):
        moved = [*target_parts(design, (*place, distance), f"target {step}"), *of_target[step]]
        parts += [replace(part, step=step) for part in moved]
        lines.append(target_lines(numbers.isel(distance=step, y=0, x=0), coil))
    labels = tuple(f"{distance * 1e3:g} mm" for distance in distances)
    slider = Slider("distance of the target", labels, tuple(lines), first)
    return scene + Scene(tuple(parts), notes=_cut_note([target_of(design).body]), slider=slider)


def target_parts(design: Design, place: tuple[float, float, float], name: str = "target") -> list[Part]:
    """Target of a design at x and y on the board and a distance in m."""
    body, (x, y, distance) = target_of(design).body, place
    mesh = body_mesh(body, (x, y, target_of(design).height(design.top, distance)), around_board(design.array))
    return _glass(name, body, mesh, f"target: {_body_words(body)}", METAL)


def _strongest(phasors: Mapping[str, Phasors], within: Box) -> tuple[dict[str, tuple[Part, ...]], str]:
    """Arrows of all bodies at the instant of the strongest currents, and the instant."""
    in_phase, before = (sum(float((part(K) ** 2).sum()) for *_, K in phasors.values()) for part in (np.real, np.imag))
    now = in_phase >= before
    found = {name: Eddies(at, normals, K.real if now else K.imag) for name, (at, normals, K) in phasors.items()}
    amounts = [np.linalg.norm(one.density, axis=1) for one in found.values()]
    high = max((float(np.quantile(amount, _STRONG)) for amount in amounts if amount.size), default=0.0) or 1.0
    high = rounded_up(high, DECADE)
    scale = Scale(EDDY_AMOUNT, "eddy current", "A/m", high / 10**_DECADES, high, logarithmic=True)
    when = "while the coil's current is largest" if now else "a quarter of a period before the coil's peak"
    return {name: _eddy_parts(name, one, scale, within) for name, one in found.items()}, when


def target_at(
    design: Design, place: tuple[float, float], distances: Sequence[float], *, progress: Progress | None = None
) -> xr.Dataset:
    """Compute the effect of a target at distances, all in m."""
    x, y = (value - origin for value, origin in zip(place, target_of(design).origin_point, strict=True))
    return target_map(design, distances=distances, x=[x], y=[y], progress=progress)


def target_lines(at: xr.Dataset, coil: str) -> tuple[str, ...]:
    """Describe the effect of a target at one place."""
    states = [str(name) for name in at.state.values]
    first = coil if coil in states else states[0]
    one = at.sel(state=first)
    percent = {name: true_minus(f"{float(at.delta.sel(state=name)) * 100:+.3g} %") for name in states}
    beside_q = str(at.quality_factor.attrs["long_name"]).partition(",")[2]
    line = (
        f"target at {MM.text(at.distance, '.3')}, {first}: δ = {percent.pop(first)}, "
        f"L = {float(one.effective_inductance) * 1e6:.4g} µH, "
        f"R = {float(one.effective_resistance):.3g} Ω, Q = {float(one.quality_factor):.3g}{beside_q}, "
        f"f = {float(one.frequency) * 1e-6:.4f} MHz"
    )
    if not percent:
        return (line,)
    largest = sorted(percent, key=lambda name: -abs(float(at.delta.sel(state=name))))[:_SHOWN_STATES]
    shown = [f"{name} {text}" for name, text in percent.items() if name in largest]
    which = "δ of the others" if len(shown) == len(percent) else f"the {len(shown)} largest δ of the others"
    return line, f"{which}: {', '.join(shown)}"


def steps_of(design: Design, distance: float | None = None) -> list[float]:
    """Distances of the target in m for a slider, with more between few."""
    target = target_of(design)
    given, wanted = target.distances, [] if distance is None else [distance]
    layers = any(sheet.magnetic for sheet in design.sheets) or bool(design.plates)
    slow = isinstance(target.body, FinitePlate) and layers
    between = np.geomspace(given[0], given[-1], _STEPS).tolist() if 1 < len(given) < _STEPS and not slow else []
    near = {one for one in between if min(abs(one / other - 1) for other in (*given, *wanted)) < _NEAR}
    return sorted({*given, *wanted, *(one for one in between if one not in near)})


def target_place(design: Design, coil: str, at: tuple[float, float] | None) -> tuple[float, float]:
    """Position of the target on the board in m."""
    if at is not None:
        return at
    target, centre = target_of(design), design.array.centres[design.array.names.index(coil)].tolist()
    nearest = []
    for values, origin, middle in zip((target.x, target.y), target.origin_point, centre, strict=True):
        places = np.add(values, origin)
        nearest.append(float(places[np.abs(places - middle).argmin()]))
    return nearest[0], nearest[1]
