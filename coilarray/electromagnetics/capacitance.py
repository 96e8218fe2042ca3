"""Capacitance of coils and the effect of the elastomer.

Leads, and a few ribbons per layer of the winding from ray to ray, are straight wires in the layered
dielectric, solved by the method of moments. A flat strip of width w acts as a round wire of radius
w/4. Green's function of the layers is taken as a sum of images, Σ a/(2π √(ρ² + b²)), fitted in the
spectral domain (Σ a exp(−kb)/k; Chow et al., IEEE Trans. MTT 39, 588 (1991), with fixed real depths
b). The potential of a uniformly charged straight wire is then a logarithm.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.linalg
import shapely
import xarray as xr
from shapely import affinity

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.compute.netcdf import variables
from coilarray.compute.threads import Recent, serial_algebra
from coilarray.electromagnetics.layered_strips import (
    LayeredMedium,
    crossed_grid_capacitance,
    plane_gap,
    strip_capacitance,
)
from coilarray.errors import GeometryError
from coilarray.geometry import Array, Coil, Placement, Sheet, Stackup
from coilarray.geometry.copper import uniform_runs
from coilarray.geometry.winding import Cut, FlatPath, Turns, find_turns

Above = tuple[tuple[float, ...], tuple[float, ...]]  # thicknesses in m and relative permittivities down to the board
_AIR: Above = ((), (1.0,))
# Rays at equal angles. The layers of a spiral shift past each other by whole pitches per turn, so
# these rays take the mean over the shift. The values are the least and most rays about a pole, and
# the number of turns they cut in all, no multiple of whole turns that rounding could decide on.
_RAYS = 5, 32, 59.3
_MOST_PERMITTIVITY = 1e6
_HIGHEST_FACE = 1.0  # m; above it no permittivity changes
_MIRROR_DISTANCE = 2.0  # of the next coil's image in outer radii; 4 instead changes C by 2e-4 (tests)
_PER_AREA: Recent[FloatArray] = Recent(256)
# The leads' part is a difference, which depends little on the fineness of the winding.
_LEAD_RAYS = 16  # from each pole
_RIBBONS = 4, 16  # at most, per layer and on all layers
_GROWTH = 1.15  # of the pieces of a lead, beginning with a pitch at the winding
_MOST_BESIDE = 8  # wires of a wide lead
_GRAIN = 1e-9  # of a length; smaller differences are rounding
_GUIDING = 50.0  # relative permittivity above which layers hold the field beyond the farthest image
_IMAGES = 16  # errors are 1e-4, and 2 % between planes with other copper layers between them
_GAUSS, _WEIGHTS = np.polynomial.legendre.leggauss(5)


@dataclass(frozen=True, eq=False)
class WindingCapacitance:
    """Capacitance of a coil in F, without other coils.

    `interlayer`, `turn_to_turn` and `leads` are parts of the lumped capacitance across the
    terminals. `layers` (lines, lines) is the Maxwell matrix of the lines, one per layer, each at
    one potential. `longest_turns` is for turns as long as the longest, with the leads, and grows
    with every permittivity, by more than `total` does.
    """

    interlayer: float
    turn_to_turn: float
    leads: float
    layers: FloatArray
    longest_turns: float

    @property
    def total(self) -> float:
        """Lumped capacitance across the terminals in F."""
        return self.interlayer + self.turn_to_turn + self.leads


# Keyed by all inputs, so designs that differ only in the places of their coils share the results.
_WINDINGS: Recent[WindingCapacitance] = Recent(32)


def coil_capacitance(array: Array, sheets: Sequence[Sheet] = (), *, relative_permittivity: float = 1.0) -> xr.Dataset:
    """Compute the lumped and mutual capacitances of coils in F.

    `sheets` are the elastomer on the board, upwards, with air above it. `relative_permittivity`
    belongs to the sheets, or without sheets to the whole half space above the board. This medium
    also fills the gaps of the top copper. A coil without turns beside each other, copper that
    overlaps on a layer, or a permittivity below 1 raises a GeometryError.

    In the result ``coil_capacitance`` (coil) = ``interlayer`` + ``turn_to_turn`` + ``leads``: the
    field's energy between turns of different layers and of one layer, and the contribution of the
    leads. ``capacitance`` (coil, other) is the Maxwell matrix between coils, each at one potential.
    No ground is near the board, so its rows sum to zero.

    For one winding, the voltage rises linearly along the turns from one end to the other, and the
    coil floats. Rays from the poles of the turns cut them (`coilarray.geometry.winding`). The
    traces on a ray, unfolded to perpendicular cuts, are a row of strips on each layer, mirrored at
    the pole. Their Maxwell matrix per length c comes from `strip_capacitance`, with two faces per
    trace. A piece ds of trace i then has the energy e_i ds, e_i = Σ_j (−c_ij)(V_i − V_j)²/4, and C
    = 2 ∫ e ds/V². Leads have the potential of their end of the winding (`lead_capacitance`). Vias
    and pads are left out.

    Between coils, the area counts in which the windings (traces and gaps) lie above each other, for
    every set of coils that overlaps anywhere, times the capacitance per area of crossed grids with
    these fill factors (`crossed_grid_capacitance`). A coil in between shields. Fringing at the
    edges of these areas, pads, and coils side by side without overlap (a few 0.1 pF by estimate)
    are left out.

    >>> from coilarray import load_design
    >>> C = coil_capacitance(load_design("gast2020").array)
    >>> f"{float(C.coil_capacitance[0]) * 1e12:.1f} pF"
    '19.2 pF'
    """
    above = _above(sheets, relative_permittivity)
    _refuse_touching_coils(array)
    windings = _windings(array, above)
    single, pair = ("coil",), ("coil", "other")
    rows = (
        ("coil_capacitance", single, [w.total for w in windings], "F", "lumped capacitance"),
        ("interlayer", single, [w.interlayer for w in windings], "F", "part between layers"),
        ("turn_to_turn", single, [w.turn_to_turn for w in windings], "F", "part within layers"),
        ("leads", single, [w.leads for w in windings], "F", "part of the leads"),
        ("capacitance", pair, _between_coils(array, above), "F", "Maxwell matrix"),
    )
    return xr.Dataset(
        variables(*rows),
        {"coil": list(array.names), "other": list(array.names)},
        {"relative_permittivity": relative_permittivity, "sheet_thickness_m": sum(above[0])},
    )


def self_resonance(inductance: npt.ArrayLike, capacitance: npt.ArrayLike) -> FloatArray:
    """Compute the self-resonance 1/(2π √(LC)) of coils in Hz.

    The `inductance` is in H, the own `capacitance` in F, both scalar or of one shape.

    >>> round(float(self_resonance(57e-6, 18e-12)) / 1e6, 2)
    4.97
    """
    L, C = _positive("inductance", inductance, "H"), _positive("capacitance", capacitance, "F")
    return np.asarray(1 / (2 * math.pi * np.sqrt(L * C)))


def elastomer_effect(
    array: Array,
    relative_permittivity: float,
    tank_capacitance: float,
    sheets: Sequence[Sheet] = (),
    *,
    undisturbed: float = 0.0,
) -> xr.Dataset:
    """Compute the effect of the elastomer's permittivity on coils.

    `tank_capacitance` C_t in F is parallel to the coil. Without `sheets` the elastomer fills the
    half space above the board. `undisturbed` is the height in m above the board below which an
    indentation changes no permittivity. The value 0 is always valid. The result has C_L ``without``
    and ``with_elastomer`` and their ``change`` in F, and for each ``coil`` ``apparent_delta``, the
    apparent relative change of L when the elastomer is laid on, and ``dent_bound``, an upper bound
    of the apparent change by a dent.

    The converter measures f with f² (C_t + C_L) L constant, so δ = ΔC/(C_t + C_L), positive and
    independent of f. C grows with the permittivity at every point (Thomson's principle), and a dent
    changes it only above `undisturbed`, to something between 1 and `relative_permittivity`. So the
    difference of C between full and empty space there is the bound (taken with `longest_turns`).
    The coil floats alone, without the field of its mean voltage against ground or neighbours.
    """
    C_t = float(_positive("tank_capacitance", tank_capacitance, "F", zero=True))
    if not 0 <= undisturbed <= _HIGHEST_FACE:
        raise ValueError(f"undisturbed must be finite, 0 to {_HIGHEST_FACE:g} m; got {undisturbed} m.")
    above = _above(sheets, relative_permittivity)
    _refuse_touching_coils(array)
    without, with_elastomer = (np.array([one.total for one in _windings(array, over)]) for over in (_AIR, above))
    resting: Above = ((undisturbed,), (relative_permittivity,)) if undisturbed > 0 else ((), ())
    most, least = (
        np.array([one.longest_turns for one in _windings(array, (resting[0], (epsilon, *resting[1])))])
        for epsilon in (relative_permittivity, 1.0)
    )
    single, change, spread = ("coil",), with_elastomer - without, most - least
    rows = (
        ("without", single, without, "F", "lumped capacitance in air"),
        ("with_elastomer", single, with_elastomer, "F", "lumped capacitance, elastomer on"),
        ("change", single, change, "F", "capacitance the elastomer adds"),
        ("apparent_delta", single, change / (C_t + without), "1", "apparent relative change of L by it"),
        ("dent_bound", single, spread / (C_t + without), "1", "upper bound of the apparent change by a dent"),
    )
    return xr.Dataset(
        variables(*rows),
        {"coil": list(array.names)},
        {"relative_permittivity": relative_permittivity, "tank_capacitance_F": C_t, "undisturbed_m": undisturbed},
    )


def _positive(name: str, value: npt.ArrayLike, unit: str, *, zero: bool = False) -> FloatArray:
    values = np.asarray(value, dtype=np.float64)
    if not (np.isfinite(values).all() and ((values >= 0) if zero else (values > 0)).all()):
        raise ValueError(
            f"{name} must be finite and {'not negative' if zero else 'positive'}; got {values.tolist()} {unit}."
        )
    return values


def _above(sheets: Sequence[Sheet], relative_permittivity: float) -> Above:
    """Media above the board: elastomer sheets under air, or one half space."""
    if not 1 <= relative_permittivity <= _MOST_PERMITTIVITY:
        raise GeometryError(
            f"relative_permittivity must be at least 1; got {relative_permittivity} (at most {_MOST_PERMITTIVITY:g})."
        )
    if not sheets:
        return (), (relative_permittivity,)
    thickness = sum(sheet.thickness for sheet in sheets)
    return ((thickness,), (1.0, relative_permittivity)) if relative_permittivity > 1 else _AIR


def _board_medium(stackup: Stackup, above: Above) -> LayeredMedium:
    """Medium of copper and dielectrics, copper gaps filled as outside, or with both sides' mean."""
    media = (above[1][-1], *stackup.epsilon_r, 1.0)  # above and below each copper layer
    thicknesses, epsilons = (list(part) for part in above)
    last = len(stackup.copper_thickness) - 1
    for i, copper in enumerate(stackup.copper_thickness):
        over, under = media[i : i + 2]
        thicknesses.append(copper)
        epsilons.append(over if i == 0 else under if i == last else (over + under) / 2)
        if i < last:
            thicknesses.append(stackup.dielectric_thickness[i])
            epsilons.append(under)
    return LayeredMedium(tuple(thicknesses), (*epsilons, 1.0))


def _windings(array: Array, above: Above) -> list[WindingCapacitance]:
    windings = []
    for placement in array.placements:
        coil = placement.coil
        shape = tuple(part.tobytes() for part in (*coil.lines, *coil.widths, coil.outline))
        key = array.stackup, placement.layers, coil.gap, shape, above
        windings.append(_WINDINGS.get(key, partial(_winding, array.stackup, placement, above)))
    return windings


def _winding(stackup: Stackup, placement: Placement, above: Above) -> WindingCapacitance:
    medium, first = _board_medium(stackup, above), len(above[0])
    coil = placement.coil
    copper = np.array([stackup.index(layer) for layer in placement.layers])
    turns = find_turns(FlatPath.of_lines(coil.lines, coil.widths))
    if turns is None:
        raise GeometryError(
            f"the winding of {placement.name} must have turns beside each other for a capacitance; its path runs "
            "beside itself nowhere."
        )
    path = turns.path
    cuts = []
    for cut in turns.enough_cuts(*_RAYS):  # those of several turns that are apart on every layer
        layer, width = copper[path.line[cut.piece]], path.widths[cut.piece]
        on_layers = [np.flatnonzero(layer == number) for number in np.unique(layer)]
        near = [np.diff(cut.across[on]) <= 0.5 * (width[on][1:] + width[on][:-1]) for on in on_layers]
        if len(layer) > 1 and not np.concatenate(near).any():
            cuts.append(cut)
    if not cuts:
        raise GeometryError(f"{placement.name}: copper of its turns overlaps, or they cross each other everywhere.")
    lines = np.concatenate([path.line[cut.piece] for cut in cuts])
    lengths = _shares(lines, np.concatenate([cut.along for cut in cuts]), turns)
    interlayer = turn_to_turn = longest = 0.0
    between = np.zeros((len(coil.lines),) * 2)
    done = 0
    for cut in cuts:
        n = len(cut.piece)
        line, width = path.line[cut.piece], path.widths[cut.piece]
        layer = copper[line]
        face = first + 2 * layer
        # Turns up to the centre have their mirror image, the other side of the winding, a gap away.
        across = cut.across + max(0.0, 0.5 * (coil.gap + float((width - 2 * cut.across).max())))
        period = _MIRROR_DISTANCE * float((across + width / 2).max())
        try:
            c = strip_capacitance(
                medium,
                np.concatenate((face, face + 1)).tolist(),
                np.tile(across, 2),
                np.tile(width, 2),
                np.tile(np.arange(n), 2).tolist(),
                period=period,
                mirror=True,
                basis=_basis(stackup, coil),
            )
        except GeometryError as error:
            raise GeometryError(f"{placement.name}: {error}") from None
        V = (cut.along - turns.begin) / (turns.end - turns.begin)
        energy = -c * (V[:, None] - V) ** 2 / 4  # J/m at V = 1, of strip i against strip j
        length = lengths[done : done + n]
        same = layer[:, None] == layer
        turn_to_turn += 2 * float(length @ np.where(same, energy, 0.0).sum(axis=1))
        interlayer += 2 * float(length @ np.where(same, 0.0, energy).sum(axis=1))
        longest += float(length.max() * (V @ c @ V))
        np.add.at(between, (line[:, None], line), c * 0.5 * (length[:, None] + length))
        done += n
    np.fill_diagonal(between, 0.0)
    np.fill_diagonal(between, -between.sum(axis=1))
    flat = LayeredMedium((*above[0], *stackup.dielectric_thickness), (*above[1], *stackup.epsilon_r, 1.0))
    leads = lead_capacitance(flat, first + copper, np.array(stackup.copper_thickness)[copper], turns)
    return WindingCapacitance(interlayer, turn_to_turn, leads, between, longest + leads)


def _basis(stackup: Stackup, coil: Coil) -> int:
    """Count the functions per strip: three up to twice the gap and thinnest dielectric."""
    widest = max(float(widths.max()) for widths in coil.widths)
    nearest = min(coil.gap, *stackup.dielectric_thickness) if stackup.dielectric_thickness else coil.gap
    return max(3, math.ceil(2 * math.sqrt(widest / nearest)))


def _shares(line: IntArray, along: FloatArray, turns: Turns) -> FloatArray:
    """Length in m of its line for each trace of a cut."""
    shares = np.zeros_like(along)
    for i in np.unique(line):
        on = np.flatnonzero(line == i)
        on = on[np.argsort(along[on], kind="stable")]
        piece = np.flatnonzero(turns.path.line == i)
        begin, end = np.clip(turns.path.along[[piece[0], piece[-1] + 1]], turns.begin, turns.end)
        middles = 0.5 * (along[on][1:] + along[on][:-1])
        shares[on] = np.diff(np.concatenate(([begin], middles, [end])))
    return shares


def _between_coils(array: Array, above: Above) -> FloatArray:
    """Maxwell matrix between coils by overlapping winding areas."""
    medium, first = _board_medium(array.stackup, above), len(above[0])
    bands = _bands(array)
    shapes = [band.area for band in bands]
    C = np.zeros((len(array.placements),) * 2)
    edges = shapely.union_all(shapely.boundary(shapes))
    areas: dict[tuple[int, ...], float] = {}
    cells = shapely.get_parts(shapely.polygonize([edges]))
    within, cell = shapely.STRtree(shapes).query(shapely.point_on_surface(cells), predicate="within")[::-1]
    for index in np.unique(cell):
        pattern = tuple(sorted(within[cell == index].tolist()))
        if len({bands[band].coil for band in pattern}) > 1:
            areas[pattern] = areas.get(pattern, 0.0) + float(cells[index].area)
    for pattern, area in areas.items():
        coils = sorted({bands[band].coil for band in pattern})
        faces, basis = [], 3
        for grid, band in enumerate(bands[index] for index in pattern):
            coil = array.placements[band.coil].coil
            basis = max(basis, _basis(array.stackup, coil))
            own = band.width, band.width + coil.gap, grid, coils.index(band.coil)
            faces += [(first + 2 * band.layer + face, *own) for face in (0, 1)]
        columns = tuple(zip(*faces, strict=True))
        work = partial(crossed_grid_capacitance, medium, *columns, basis=basis)
        per_area = _PER_AREA.get((medium, columns, basis), work)
        C[np.ix_(coils, coils)] += area * per_area
    np.fill_diagonal(C, 0.0)
    np.fill_diagonal(C, -C.sum(axis=1))
    return C


@dataclass(frozen=True, eq=False)
class _Band:
    """Traces and gaps of a coil on a layer, mean width in m."""

    coil: int
    layer: int
    width: float
    area: shapely.Geometry


def _bands(array: Array) -> list[_Band]:
    """Find the winding area of every coil on every layer."""
    own: dict[int, list[shapely.Geometry]] = {}
    bands = []
    for index, placement in enumerate(array.placements):
        coil = placement.coil
        if id(coil) not in own:
            own[id(coil)] = [_closed_band(coil, *trace) for trace in zip(coil.lines, coil.widths, strict=True)]
        for layer in dict.fromkeys(placement.layers):
            lines = placement.lines_on(layer)
            shape = own[id(coil)][lines[0]] if len(lines) == 1 else shapely.union_all([own[id(coil)][k] for k in lines])
            turned = affinity.rotate(shape, placement.rotation, origin=(0, 0), use_radians=True)
            area = affinity.translate(turned, placement.x, placement.y)
            widths = np.concatenate([coil.widths[k] for k in lines])
            lengths = np.concatenate([np.hypot(*np.diff(coil.lines[k], axis=0).T) for k in lines])
            width = float(widths[0] + np.average(widths - widths[0], weights=lengths))  # exact if all are the same
            bands.append(_Band(index, array.stackup.index(layer), width, area))
    return bands


def _closed_band(coil: Coil, line: FloatArray, widths: FloatArray) -> shapely.Geometry:
    """Area of a coil's trace and half of the gaps, slits closed."""
    slit = 0.05 * (coil.trace_width + coil.gap) / 2
    corners: dict[str, Any] = {"join_style": "mitre", "mitre_limit": 2.0}
    ribbons = [
        shapely.buffer(shapely.LineString(piece), (width + coil.gap) / 2 + slit, cap_style="flat", **corners)
        for piece, width in uniform_runs(line, widths)
    ]
    wide = ribbons[0] if len(ribbons) == 1 else shapely.union_all(ribbons)
    band: shapely.Geometry = shapely.buffer(wide, -slit, **corners)
    return band


def _refuse_touching_coils(array: Array) -> None:
    for layer in array.stackup.names:
        here = [
            (placement.name, shapely.LineString(placement.to_board(piece)), width)
            for placement in array.placements
            for k in placement.lines_on(layer)
            for piece, width in uniform_runs(placement.coil.lines[k], placement.coil.widths[k])
        ]
        if len({name for name, _, _ in here}) < 2:
            continue
        lines = [line for _, line, _ in here]
        widest = max(width for _, _, width in here)
        for i, j in shapely.STRtree(lines).query(lines, predicate="dwithin", distance=widest).T.tolist():
            (one, line, width), (other, other_line, other_width) = here[i], here[j]
            if i < j and one != other and line.distance(other_line) < (width + other_width) / 2:
                raise GeometryError(f"the copper of {one} and {other} overlaps on {layer}.")


@dataclass(frozen=True, eq=False)
class _Wire:
    """Straight parts of a uniformly charged wire, ends (n, 2) and radius in m."""

    start: FloatArray
    stop: FloatArray
    radius: float
    plane: int
    potential: float


@serial_algebra()
def lead_capacitance(medium: LayeredMedium, planes: IntArray, thicknesses: FloatArray, turns: Turns) -> float:
    """Compute the capacitance in F of leads at a winding.

    Every lead has the potential of its end of the winding, whose potential rises evenly along the
    path. All wires together float without net charge. The result is the capacitance of leads and
    ribbons less the capacitance of the ribbons alone, without vias and pads. Charges that are free
    in more places store more energy, so it grows with the leads.
    """
    near = plane_gap(medium, planes)
    leads = list(_leads(turns, planes, thicknesses, near))
    if not leads:
        return 0.0
    winding = list(_ribbons(turns, planes, near))
    A = _potentials(medium, [*winding, *leads])
    V = np.array([wire.potential for wire in (*winding, *leads)])
    n = len(winding)
    return _floating(A, V) - (_floating(A[:n, :n], V[:n]) if n else 0.0)


def _leads(turns: Turns, planes: IntArray, thicknesses: FloatArray, near: float) -> Iterator[_Wire]:
    """Pieces of both leads, longer from the winding on, side by side for leads wider than `near`."""
    path = turns.path
    along, grain = path.along, _GRAIN * turns.pitch
    for origin, end, potential in ((turns.begin, 0.0, 0.0), (turns.end, float(along[-1]), 1.0)):
        sense, length = math.copysign(1.0, end - origin), abs(end - origin)
        done, step = 0.0, turns.pitch
        while done < length - grain:
            low, high = sorted((origin + sense * done, origin + sense * min(done + step, length)))
            done, step = done + step, step * _GROWTH
            inside = (along > low + grain) & (along < high - grain)
            ends = np.unique(np.concatenate(([low], along[inside], [high])))
            piece = np.searchsorted(along, 0.5 * (ends[1:] + ends[:-1]), side="right") - 1
            for line in np.unique(path.line[piece]):
                on = np.flatnonzero(path.line[piece] == line)
                width = float(np.average(path.widths[piece[on]], weights=np.diff(ends)[on]))
                points = path.at(ends[on[0] : on[-1] + 2])
                steps = np.diff(points, axis=0)
                sideways = np.column_stack((-steps[:, 1], steps[:, 0])) / np.hypot(*steps.T)[:, None]
                thickness = float(thicknesses[line])
                # A width equal to the planes' distance up to rounding is one wire.
                count = min(max(math.ceil(width / near - _GRAIN), 1), _MOST_BESIDE) if math.isfinite(near) else 1
                for k in range(count):
                    shift = ((k + 0.5) / count - 0.5) * width * sideways
                    # The radius of one wire is for a strip. Many wires make up a sheet and have its
                    # mean field near it.
                    radius = (width + thickness) / 4 if count == 1 else (width + thickness) / count / (2 * math.pi)
                    yield _Wire(points[:-1] + shift, points[1:] + shift, radius, int(planes[line]), potential)


def _ribbons(turns: Turns, planes: IntArray, near: float) -> Iterator[_Wire]:
    """Group turns between rays into ribbons thinner than the distance of planes."""
    path = turns.path
    most, total = _RIBBONS
    for pole in turns.poles:
        cuts = turns.about(pole, _LEAD_RAYS)
        on = [planes[path.line[cut.piece]] for cut in cuts]
        used = np.unique(np.concatenate(on))
        for plane in used:
            counts = [int((layer == plane).sum()) for layer in on]
            groups = min(int(np.median(counts)), most, max(1, total // len(used)))
            nodes = [
                [_middle(turns, cut, group) for group in np.array_split(np.flatnonzero(layer == plane), groups)]
                if count >= groups > 0
                else []
                for cut, layer, count in zip(cuts, on, counts, strict=True)
            ]
            for one, other in zip(nodes, nodes[1:] + nodes[:1], strict=True):
                for (a, width_a, V_a), (b, width_b, V_b) in zip(one, other, strict=False):  # a ray may cross nothing
                    radius = min((width_a + width_b) / 8, near / 2)
                    yield _Wire(a[None], b[None], radius, int(plane), (V_a + V_b) / 2)


def _middle(turns: Turns, cut: Cut, group: IntArray) -> tuple[FloatArray, float, float]:
    """Middle (2,) and total width in m, and mean potential, of turns."""
    path, piece, along = turns.path, cut.piece[group], cut.along[group]
    width = float(np.ptp(cut.across[group]) + path.widths[piece].mean())
    V = (along - turns.begin) / (turns.end - turns.begin)
    return path.at(along).mean(axis=0), width, float(V.mean())


def _images(medium: LayeredMedium, p: int, q: int, smallest: float) -> tuple[FloatArray, FloatArray]:
    """Image strengths in V m/C and depths in m of plane p seen on plane q."""
    height = np.cumsum((0.0, *medium.thicknesses))
    apart = abs(float(height[p] - height[q]))
    near, far = apart or min((*medium.thicknesses, smallest)), max(float(height[-1]), smallest)
    far *= max(1.0, max(medium.epsilon_r) / _GUIDING)  # distance that a field runs along a layer
    k = np.geomspace(1e-3 / far, 10 / near, 300)
    green = medium.green(k)[:, p, q] * k
    depth = apart + np.append(0.0, np.geomspace(near / 2, 100 * far, _IMAGES - 1))
    strength = np.linalg.lstsq(np.exp(-np.outer(k, depth)) / green[:, None], np.ones(len(k)), rcond=1e-9)[0]
    return np.asarray(strength, dtype=np.float64), depth


def _potentials(medium: LayeredMedium, wires: Sequence[_Wire]) -> FloatArray:
    """Mean potential per charge of wires in V/C, (n, n)."""
    owner = np.repeat(np.arange(len(wires)), [len(wire.start) for wire in wires])
    start = np.vstack([wire.start for wire in wires])
    step = np.vstack([wire.stop for wire in wires]) - start
    plane = np.array([wire.plane for wire in wires])[owner]
    # Radii add as squares, so that every wire has its own and the matrix stays positive definite.
    spread = np.array([wire.radius for wire in wires])[owner] ** 2 / 2
    length = np.hypot(*step.T)
    places = (start + step / 2)[:, None] + _GAUSS[:, None] / 2 * step[:, None]
    M = np.zeros((len(start),) * 2)
    for p in np.unique(plane):
        one = np.flatnonzero(plane == p)
        for q in np.unique(plane[plane >= p]):
            other = np.flatnonzero(plane == q)
            away = places[other] - start[one][:, None, None]
            span = length[one][:, None, None]
            u = np.einsum("ijgx,ix->ijg", away, step[one] / length[one][:, None])
            v = (away**2).sum(axis=-1) - u**2 + (spread[one][:, None] + spread[other])[..., None]
            potential = np.zeros_like(u)
            for strength, depth in zip(*_images(medium, int(p), int(q), 2 * float(np.sqrt(spread.min()))), strict=True):
                both = np.sqrt(u**2 + v + depth**2) + np.sqrt((span - u) ** 2 + v + depth**2)
                potential += strength * np.log((both + span) / (both - span))
            block = potential @ (_WEIGHTS / 2) / (2 * math.pi) * length[other]
            M[np.ix_(one, other)] = block
            if p != q:
                M[np.ix_(other, one)] = block.T
    M = 0.5 * (M + M.T)
    share = np.zeros((len(start), len(wires)))
    share[np.arange(len(start)), owner] = 1 / np.bincount(owner, length)[owner]
    return np.asarray(share.T @ M @ share)


def _floating(A: FloatArray, V: FloatArray) -> float:
    """Twice the energy in J of wires without net charge at potentials V."""
    charge, raised = scipy.linalg.cho_solve(scipy.linalg.cho_factor(A), np.column_stack((V, np.ones_like(V)))).T
    return float(V @ charge - charge.sum() ** 2 / raised.sum())
