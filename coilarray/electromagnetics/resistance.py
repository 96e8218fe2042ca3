"""Resistance of coils at direct and alternating current.

Skin and proximity effect follow from two models, chosen by coil and frequency
(`resistance_matrix`). Traces up to `WIDE` skin depths are computed in the local transverse field of
all coils, wider traces by filaments in the cross-section of the coil's bundle of turns.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.compute.arrays import BoolArray, FloatArray, IntArray
from coilarray.compute.netcdf import variables
from coilarray.compute.threads import Recent, ranges, run_blocks, serial_algebra
from coilarray.constants import MU_0, RESISTIVITY_COPPER
from coilarray.electromagnetics.field import Source, as_conductors, require_level
from coilarray.electromagnetics.kernels import sections
from coilarray.errors import GeometryError, require_positive
from coilarray.geometry import Conductor
from coilarray.geometry.winding import Cut, FlatPath, find_turns

WIDE = 2.0  # skin depths of trace width, from which section filaments apply
MOST_SKIN_DEPTHS = 300.0  # longest trace side in skin depths, beyond which the mesh no longer resolves the skin
SINGLE_MESH = (48, 16)  # cells along the longer side of an isolated trace, and along the shorter side of a thin trace
SECTION_MESH = (30, 8)  # cells along the sides of each trace of a bundle
BASIS_TOLERANCE = 3e-2  # of a trace's basis of currents; the loss errs by about its square
# Gauss points along a segment from a length in widths on, no ratio of round lengths
POINTS = ((0.0, 1), (2 * math.pi, 4), (8 * math.pi, 8))
RAYS = 5, 16, 97.3  # least and most cuts about a pole, and turns cut in all, no multiple of round numbers
MODELS = ("transverse field", "section filaments")
_SAME = 1e-10  # of a coil's size; shapes and offsets that differ by less are equal
HIGHEST = 1e15  # Hz; at optical frequencies copper is no longer a conductor of this kind
_FIELDS: Recent[FloatArray] = Recent(32)  # of one coil on another, independent of frequency and of other coils
_INTERACTIONS: Recent[FloatArray] = Recent(4096)  # of two traces at places of a grid that all sections share
_GRID = 0.04, 0.5  # step relative to the distance, and the distance in widths at which the grid becomes even
_isolated_modes = lru_cache(maxsize=256)(sections.isolated_modes)


def dc_resistance(source: Source, resistivity: float = RESISTIVITY_COPPER) -> FloatArray:
    """Compute the direct-current resistance of every path in Ω.

    A bent board counts as flat, since its middle plane keeps its lengths. Copper on its faces is
    stretched or compressed by half the thickness over the radius, and its resistance changes by
    twice that.

    Parameters
    ----------
    source : Array, Conductor, polyline or sequence of them
        Current paths. Every segment needs a conducting cross-section.
    resistivity : float
        Resistivity in Ω·m. By default copper at 20 °C.

    Returns
    -------
    ndarray, shape (paths,)
        Resistances in Ω: ρ Σ length/area over the segments from vertex to vertex. Corners count by
        the centre line. A segment without a cross-section, or a resistivity that is not positive
        and finite, raises a GeometryError.

    Examples
    --------
    >>> from coilarray.geometry import Conductor
    >>> dc_resistance(Conductor([[0, 0, 0], [1, 0, 0]], 1e-3, 17.24e-6))
    array([1.])
    """
    require_positive("resistivity", resistivity, " Ω·m")
    conductors = as_conductors(source, flat=True)
    for conductor in conductors:
        if not (conductor.areas > 0).all():
            raise GeometryError(f"{conductor.name} has segments without a cross-section; give widths and thicknesses.")
    return np.array([resistivity * float((c.lengths / c.areas).sum()) for c in conductors])


@dataclass(frozen=True, eq=False)
class CrossSection:
    """Losses of one straight isolated trace over frequency.

    `resistance_ratio` is R_ac/R_dc. `normal_field_loss` and `lateral_field_loss` are g in Ω·m: a
    uniform field of peak value H along thickness or width adds ½ g |H|² in W/m.
    """

    resistance_ratio: FloatArray
    normal_field_loss: FloatArray
    lateral_field_loss: FloatArray


def skin_depth(frequency: npt.ArrayLike, resistivity: float = RESISTIVITY_COPPER) -> FloatArray:
    """Compute the skin depth √(ρ/(π f µ0)) of copper in m."""
    f = np.asarray(frequency, dtype=np.float64)
    bad = ~((f > 0) & (f <= HIGHEST))
    if bad.any():
        raise ValueError(f"frequency must be positive and finite; got {f[bad].flat[0]} Hz (at most {HIGHEST:g}).")
    require_positive("resistivity", resistivity, " Ω·m")
    return np.asarray(np.sqrt(resistivity / (np.pi * f * MU_0)))


@serial_algebra()
def cross_section(
    width: float, thickness: float, frequency: npt.ArrayLike, resistivity: float = RESISTIVITY_COPPER
) -> CrossSection:
    """Compute the losses of one straight isolated rectangular trace.

    By filaments in the cross-section (P. Silvester, Proc. IEEE 54, 1147, 1966; W. T. Weeks et al.,
    IBM J. Res. Dev. 23, 652, 1979) with exact mean logarithms on a mesh graded towards the edges.
    Every eddy mode adds β²c/(1 + β²λ²), so that one decomposition per aspect ratio, which is
    cached, serves all frequencies.
    """
    for value, name in ((width, "width"), (thickness, "thickness")):
        require_positive(f"{name} of a trace", value)
    delta = skin_depth(frequency, resistivity)
    if delta.size and max(width, thickness) > MOST_SKIN_DEPTHS * delta.min():
        raise GeometryError(
            f"a trace may be at most {MOST_SKIN_DEPTHS:g} skin depths wide and thick (trace_width_mm, "
            f"copper_thickness_um); got {max(width, thickness):g} m at a skin depth of {delta.min():.3g} m."
        )
    own, normal, lateral = _isolated_modes(1.0, round(thickness / width, 12), *SINGLE_MESH)
    beta = (width / delta) ** 2 / np.pi  # ωµ0 w²/(2πρ) with ωµ0/ρ = 2/δ²
    drive = resistivity * (2 * np.pi) ** 2  # (ωµ0)² w⁴/ρ = ρ (2πβ)²
    return CrossSection(1.0 + _mode_sum(own, beta), drive * _mode_sum(normal, beta), drive * _mode_sum(lateral, beta))


def _mode_sum(modes: FloatArray, beta: FloatArray) -> FloatArray:
    """Sum the eddy modes β²c/(1 + β²λ²), in the shape of beta."""
    values, strength = modes
    b = beta[..., None]
    return np.asarray((b**2 * strength / (1.0 + (b * values) ** 2)).sum(axis=-1))


@lru_cache(maxsize=64)
def _basis(width: float, thickness: float, octaves: int) -> sections.Basis:
    """Basis of currents in a trace of up to 2^octaves skin depths."""
    betas = 4.0 ** np.arange(1, octaves + 1) / (np.pi * max(width, thickness) ** 2)
    return sections.response_basis(width, thickness, *SECTION_MESH, betas.astype(np.float64), BASIS_TOLERANCE)


@lru_cache(maxsize=16)
def _section(traces: tuple[sections.Trace, ...], octaves: int) -> sections.Section:
    def at(first: tuple[float, float], second: tuple[float, float], node: int, z: float) -> FloatArray:
        x = _GRID[1] * math.sinh(_GRID[0] * node)
        return _INTERACTIONS.get(
            (first, second, node, z, octaves),
            lambda: sections.interaction(_basis(*first, octaves), _basis(*second, octaves), x, z),
        )

    def between(first: tuple[float, float], second: tuple[float, float], x: float, z: float) -> FloatArray:
        """Interpolate a pair's interaction, cubic in x so that equal coils stay equal."""
        place = math.asinh(x / _GRID[1]) / _GRID[0]
        node = math.floor(place)
        u = place - node
        outer = -u * (u - 1) * (u - 2) / 6, (u + 1) * u * (u - 1) / 6
        weights = outer[0], (u + 1) * (u - 1) * (u - 2) / 2, -(u + 1) * u * (u - 2) / 2, outer[1]
        return sum((w * at(first, second, node + k - 1, z) for k, w in enumerate(weights)), start=np.zeros(()))

    return sections.section(traces, lambda width, thickness: _basis(width, thickness, octaves), between)


@serial_algebra()
def resistance_matrix(
    source: Source, frequencies: npt.ArrayLike, resistivity: float = RESISTIVITY_COPPER, *, alone: bool = False
) -> xr.Dataset:
    """Compute the resistance matrix R(f) of coils in Ω.

    It contains the losses of the coils and, unless each counts `alone`, their eddy losses in each
    other's copper. ``resistance`` (frequency, coil, other) is symmetric and positive definite: ½
    Re(iᴴ R i) is the loss in W in all copper for peak currents i, open and grounded coils included.
    ``model`` (frequency, coil) is an element of `MODELS`, which docs/theory/conductors.md
    describes:

    *Transverse field* (coils whose widest trace is at most `WIDE` skin depths): a segment of length
    l in the fields h_i of unit currents adds l (ρ/A · R_ac/R_dc) to its own coil and l (g_n h_i·n
    h_j·n + g_w h_i·w h_j·w) to R_ij (`cross_section`). The fields follow from Biot–Savart at Gauss
    points on the segment, without its own field. The field of eddy currents acts on no other
    copper.

    *Section filaments* (wider traces): the same sum, with each part of a turn multiplied by three
    factors, its heat by filaments in radial cuts through the coil
    (`coilarray.geometry.winding.Turns.cuts`) over its heat by transverse field: for the coil's own
    current (with the mean local field where the cut alone has another), and for a uniform field
    along thickness and width, as other coils make it. Factors are linear along the path from cut to
    cut, and 1 on leads. The part of two coils takes √ of both factors, which keeps R positive
    definite. So turns of one coil shield each other, but coils do not. Vias count with their DC
    resistance, eddy currents in pads and planes are left out. A bent board counts as flat.
    """
    # A bar's own field is left out on the whole of a straight run, however many vertices it has.
    conductors = [conductor.straightened() for conductor in as_conductors(source, flat=True)]
    f = np.atleast_1d(np.asarray(frequencies, dtype=np.float64))
    if f.ndim != 1 or not len(f):
        raise ValueError(f"frequencies must have shape (n >= 1,); got {np.shape(frequencies)}.")
    delta = skin_depth(f, resistivity)
    dc = dc_resistance(conductors, resistivity)
    for conductor in conductors:
        if conductor.is_filament:
            raise GeometryError(f"{conductor.name} has segments without a cross-section; give widths and thicknesses.")
        require_level(conductor, "the resistance at alternating current")
    n = len(conductors)
    R = np.zeros((len(f), n, n))
    wide = np.zeros((len(f), n), dtype=bool)
    shapes = [shape_key(conductor) for conductor in conductors]
    horizontal: list[int] = []  # coils that are more than vias
    for c, conductor in enumerate(conductors):
        _, flat = sections.lateral_axes(conductor.vertices)
        R[:, c, c] += resistivity * (conductor.lengths[~flat] / conductor.areas[~flat]).sum()
        if flat.any():
            wide[:, c] = conductor.widths[flat].max() > WIDE * delta
            horizontal.append(c)
    first = {shapes[c]: c for c in reversed(horizontal)}  # one coil of each shape
    prepared = run_blocks(lambda c: _traces(conductors[c], shapes[c], f, resistivity, wide[:, c]), first.values())
    traces = dict(zip(first, prepared, strict=True))
    if alone:
        own = {shape: _trace_losses([conductors[c]], [shape], 0, traces[shape])[:, 0, 0] for shape, c in first.items()}
    for c in horizontal:
        if alone:
            R[:, c, c] += own[shapes[c]]
        else:
            R += _trace_losses(conductors, shapes, c, traces[shapes[c]])
    names = [conductor.name for conductor in conductors]
    model = np.array(MODELS)[wide.astype(int)]
    rows = (
        ("resistance", ("frequency", "coil", "other"), R, "ohm", "AC resistance matrix"),
        ("dc_resistance", ("coil",), dc, "ohm", "DC resistance"),
        ("model", ("frequency", "coil"), model, "", "model of the proximity effect"),
    )
    return xr.Dataset(variables(*rows), {"frequency": ("frequency", f, {"units": "Hz"}), "coil": names, "other": names})


def shape_key(conductor: Conductor) -> bytes:
    """Bytes that identify the shape and cross-section of a path anywhere."""
    grain = _grain(conductor)
    places = np.round((conductor.vertices - conductor.vertices[0]) / grain).astype(np.int64)
    parts = np.array(grain), places, conductor.widths, conductor.thicknesses, conductor.areas
    return b"".join(part.tobytes() for part in parts)


def _grain(conductor: Conductor) -> float:
    """Largest difference in m between equal shapes, also when rounded."""
    return float(_SAME * 2.0 ** np.round(np.log2(np.ptp(conductor.vertices, axis=0).max())))


@dataclass(frozen=True, eq=False)
class _Points:
    """Gauss points on a path's horizontal segments.

    `places` (n, 3) are in m, `lateral` and `normal` (n, 3) the directions of width and thickness,
    `weight` (n,) the length in m that each point stands for.
    """

    places: FloatArray
    lateral: FloatArray
    normal: FloatArray
    segment: IntArray
    weight: FloatArray

    def field(self, key: Hashable, vertices: FloatArray, *, own: bool) -> FloatArray:
        """Field H (n, 2) in 1/m along width and thickness, without the `own` segment, kept by `key`."""
        left_out = self.segment if own else np.full(len(self.segment), -1)

        def compute() -> FloatArray:
            found = np.empty((len(self.places), 2))

            def work(block: tuple[int, int]) -> None:
                rows = slice(*block)
                places = self.places[rows], left_out[rows], self.lateral[rows], self.normal[rows]
                sections.transverse_fields(*places, vertices, found[rows])

            run_blocks(work, ranges(len(self.places), 1024))
            return found

        return _FIELDS.get((key, POINTS), compute)


@dataclass(frozen=True, eq=False)
class _Traces:
    """Losses in the horizontal segments of coils of one shape.

    `resistance` (frequencies,) in Ω leaves out the fields of other segments, whose squares add the
    loss of each of the `groups`, points on traces with equal losses, by index and length in m.
    `own`, `mixed` and `others` (2, frequencies, groups) in Ω·m are for fields along width and
    thickness. The coil's own field enters `own` twice, `mixed` once, `others` not at all.
    """

    points: _Points
    groups: list[tuple[IntArray, FloatArray]]
    resistance: FloatArray
    own: FloatArray
    mixed: FloatArray
    others: FloatArray


def _traces(conductor: Conductor, shape: bytes, f: FloatArray, resistivity: float, wide: BoolArray) -> _Traces:
    vertices = conductor.vertices - conductor.vertices[0]
    lateral, flat = sections.lateral_axes(vertices)
    segments = np.flatnonzero(flat)
    lengths, widths, thicknesses = conductor.lengths, conductor.widths, conductor.thicknesses
    of_point, weight, places = sections.gauss_points(vertices, widths, segments, POINTS)
    normals = np.cross(lateral, np.diff(vertices, axis=0) / lengths[:, None])
    points = _Points(places, lateral[of_point], normals[of_point], of_point, weight)
    point, crossing, share = np.arange(len(of_point)), np.full(len(of_point), -1), np.ones(len(of_point))
    factors = np.ones((3, len(f), 1))
    if wide.any():
        lines = np.where(flat, np.cumsum(~flat), -1)  # from via to via
        turns = find_turns(FlatPath(vertices[:, :2], widths, lines))
        cuts = [] if turns is None else turns.enough_cuts(*RAYS)
        if cuts:
            point, crossing, share = _shared_out(vertices, lines, places, of_point, cuts)
            h = points.field((shape, shape), vertices, own=True)
            first = np.cumsum([0, *(len(cut.piece) for cut in cuts)])
            # the mean field of the points of each crossing, 0 of none
            on = crossing >= 0
            length = share[on] * weight[point[on]]
            sums = [np.bincount(crossing[on], length * part, first[-1]) for part in (1.0, *h[point[on]].T)]
            mean = np.stack(sums[1:], axis=1) / np.where(sums[0] > 0, sums[0], 1.0)[:, None]
            factors, delta = np.ones((3, len(f), len(mean) + 1)), skin_depth(f[wide], resistivity)
            for cut, begin, end in zip(cuts, first[:-1], first[1:], strict=True):
                z = 0.5 * (vertices[cut.piece, 2] + vertices[cut.piece + 1, 2])
                sizes = widths[cut.piece], thicknesses[cut.piece]
                factors[:, wide, begin:end] = _section_factors(cut, z, sizes, mean[begin:end], delta)
    of_trace = of_point[point]
    groups, group = np.unique(
        np.column_stack((crossing, widths[of_trace], thicknesses[of_trace])), axis=0, return_inverse=True
    )  # crossing −1, outside the turns, takes the last factor, 1
    group = group.ravel()
    length = share * weight[point]
    alone, normal, side = factors[:, :, groups[:, 0].astype(np.int64)]
    skin = np.bincount(group, length / conductor.areas[of_trace])
    sizes_of = {(w, t): cross_section(w, t, f, resistivity) for w, t in np.unique(groups[:, 1:], axis=0).tolist()}
    traces = [sizes_of[w, t] for _, w, t in groups.tolist()]
    ratio = np.stack([trace.resistance_ratio for trace in traces], axis=1)
    g = np.stack([np.stack((trace.lateral_field_loss, trace.normal_field_loss)) for trace in traces], axis=2)
    other = np.stack((side, normal))
    members = [np.flatnonzero(group == k) for k in range(len(groups))]
    on_traces = [(point[p], length[p]) for p in members]
    losses = g * alone, g * np.sqrt(alone * other), g * other
    return _Traces(points, on_traces, resistivity * (ratio * alone) @ skin, *losses)


def _shared_out(
    vertices: FloatArray, line: IntArray, places: FloatArray, of_point: IntArray, cuts: Sequence[Cut]
) -> tuple[IntArray, IntArray, FloatArray]:
    """Points that cuts represent, with crossings and shares of equal shape.

    Between two crossings of a line the shares change linearly. Outside the turns the whole share
    has crossing −1. Points occur once or twice.
    """
    along = np.append(0.0, np.cumsum(np.hypot(*np.diff(vertices[:, :2], axis=0).T)))
    s = along[of_point] + np.hypot(*(places - vertices[of_point])[:, :2].T)
    piece = np.concatenate([cut.piece for cut in cuts])
    crossed = np.concatenate([cut.along for cut in cuts])
    found = []
    for number in np.unique(line[of_point]):
        here = np.flatnonzero(line[of_point] == number)
        own = np.flatnonzero(line[piece] == number)
        if not len(own):
            found.append((here, np.full(len(here), -1), np.ones(len(here))))
            continue
        own = own[np.argsort(crossed[own], kind="stable")]
        place = np.interp(s[here], crossed[own], np.arange(len(own)))
        before = np.minimum(place.astype(np.int64), max(len(own) - 2, 0))
        after = np.minimum(before + 1, len(own) - 1)
        part = place - before
        found += [(here, own[before], 1 - part), (here, own[after], part)]
    point, crossing, share = (np.concatenate(parts) for parts in zip(*found, strict=True))
    kept = share > 0
    return point[kept], crossing[kept], share[kept]


def _trace_losses(conductors: Sequence[Conductor], shapes: Sequence[bytes], c: int, traces: _Traces) -> FloatArray:
    """Losses in the horizontal segments of coil c, (frequencies, coils, coils)."""
    points, start, grain = traces.points, conductors[c].vertices[0], _grain(conductors[c])

    fields = []
    for k, conductor in enumerate(conductors):
        vertices = conductor.vertices - start
        steps = [] if k == c else np.round(vertices[0] / grain).astype(np.int64).tolist()
        fields.append(points.field((shapes[c], shapes[k], *steps), vertices, own=k == c))
    h = np.stack(fields, axis=1)
    R = np.zeros((len(traces.resistance), h.shape[1], h.shape[1]))
    for axis in range(2):
        gram = np.array([(h[p, :, axis].T * length) @ h[p, :, axis] for p, length in traces.groups])
        part = np.einsum("fg,gij->fij", traces.others[axis], gram)
        part[:, c, :] = part[:, :, c] = traces.mixed[axis] @ gram[:, c, :]
        part[:, c, c] = traces.own[axis] @ gram[:, c, c]
        R += part
    R[:, c, c] += traces.resistance
    return R


def _section_factors(
    cut: Cut, z: FloatArray, sizes: tuple[FloatArray, FloatArray], mean: FloatArray, delta: FloatArray
) -> FloatArray:
    """Ratio of filament to transverse-field heat in a cut, (3, frequencies, turns)."""
    w, t = sizes
    side = float(max(w.max(), t.max()))
    octaves = max(2, math.ceil(math.log2(side / float(delta.min()))))
    grain = 1e-9 * side  # rounding lets equal coils share their section
    x, z = (grain * np.round((v - v.min()) / grain) for v in (cut.across, z))
    bundle = _section(tuple(zip(*(v.tolist() for v in (x, z, w, t)), strict=True)), octaves)
    alone = [_section(((0.0, 0.0, p, q),), octaves) for p, q in zip(w.tolist(), t.tolist(), strict=True)]
    return sections.bundle_factors(bundle, alone, x, z, cut.sign, mean, delta)
