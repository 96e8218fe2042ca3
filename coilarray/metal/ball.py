"""Response of a ball over flat or dented sheets, and of any target.

The multipoles R^l P_l^m(cos θ) e^{imφ} of the potential about the ball's centre, and its
polarisabilities α_l, are in docs/theory/metal.md, "Spheres". A wave of the plane-wave spectrum has
the multipoles

    e^{−kζ} J_m(kρ) = Σ_l (−1)^(l+m) (kR)^l/(l + m)! P_l^m(cos θ),

and a multipole sends down the waves (−1)^(l+m)/(l − m)! ∫ k^l e^{kζ} J_m(kρ) dk, which the sheets
below reflect to the ball. With the multipoles scaled to the weights w_l(k) = (−1)^(l+m) (ka)^l/√((l
+ m)! (l − m)!), both are integrals of w. The field at the ball is the sum of the coils' field and
all reflections. By reciprocity the same weights lead back to the coils.

In a dent the ball responds to the harmonics P_l of the potential on its sphere. With P̂_l
normalised over sin θ dθ, the harmonics c_l = ∫ U P̂_l sin θ dθ of the coils' dented potential U_d =
U_f + ψ are the harmonics of the flat sheets' U_f, at the places that the mapping of
`coilarray.elastomer.scattering` gives, less pᵀ a_d⁻¹ Δa(U_f, ·), with the load p of P̂_l on the
sphere. A layer of the strength P̂_l' on it makes the harmonics pᵀ a_d⁻¹ p', whose values in air are
known. The reflection by the sheets is the difference to air on the same elements, so that the layer
needs no elements for itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import gammaln

from coilarray.compute.arrays import ComplexArray, FloatArray, IntArray, NumberArray
from coilarray.compute.memory import require_memory
from coilarray.compute.threads import Progress, part_of, ranges, run_blocks
from coilarray.constants import MU_0
from coilarray.elastomer.dent import Dent
from coilarray.elastomer.scattering import DentedSpace, LayerMesh, radial_pattern
from coilarray.electromagnetics.field import Source, as_conductors
from coilarray.electromagnetics.flat_stack import (
    Backing,
    Layer,
    coil_segments,
    flat_profile,
    harmonics_about,
    layer_waves,
    reflection,
    segment_centres,
    segment_spectra,
    wave_count,
    wave_rule,
)
from coilarray.electromagnetics.neumann import Accuracy
from coilarray.errors import MetalError
from coilarray.geometry import Ball, FinitePlate, Material, Plate, Sheet, Target
from coilarray.metal.backing import backings_of, require_below
from coilarray.metal.coupled_plates import SolvedPlates
from coilarray.metal.finite_plates import AnyPlates, PlateError, moving_plate, outlined_inductance
from coilarray.metal.flat_plates import plate_inductances
from coilarray.metal.frequencies import checked_frequencies

_LEFT_OUT = 1e-7  # of the energy, left out with multipoles of higher order
_FEWEST, _MOST = 8, 120  # multipoles
_DECAYS = 16.0  # decay lengths of the shortest wave from the coils to the ball
_DOWN = 8  # steps of the continued fraction, in roots of the radius over the skin depth
_REFLECTED = 160  # nodes of the integral over the reflected waves
_AT_ONCE = 4_000_000  # harmonics of the coils, which bounds the memory to 64 MB
_LOOP = 0.05  # of the radius: width of a loop that replaces the dipole of a ball
_NODES = 48  # of the integral over the sphere, from pole to pole
_SAME = 1e-9  # m, below which two places are the same


def ball_inductance(
    source: Source,
    ball: Ball,
    centres: npt.ArrayLike,
    frequencies: npt.ArrayLike,
    sheets: Sequence[Sheet] = (),
    plates: AnyPlates = (),
    *,
    fineness: float = 1.0,
    progress: Progress | None = None,
) -> ComplexArray:
    """Change of the impedance matrix by a ball above coils.

    The ball conducts or is magnetic. Its centres (positions, 3) are in m on the board. The flat
    `sheets` lie between coils and ball, laterally large against both, the `plates` below the coils.
    The result (positions, f, coils, coils) is ΔZ/(jω) = ΔL − jΔR/ω in H relative to sheets and
    plates alone. Without plates ΔR is positive semidefinite. `fineness` is as in `moving_plate`.

    The result is exact for filaments: every multipole at any skin depth, and all reflections
    between ball, sheets and infinite plates. Multipoles are counted until they add less than 1e-7
    of the whole. Finite plates reflect the coils' field and, unless they are magnetic, once the
    field of the ball's dipole, to within 1 % of the change.

    A ball of 5 mm, perfectly conducting, 20 mm over a loop, in pH, and −2π a³ B²/μ0:

    >>> angle = np.linspace(0, 2 * np.pi, 181)
    >>> loop = np.column_stack((10e-3 * np.cos(angle), 10e-3 * np.sin(angle), 0 * angle))
    >>> ball = Ball(2.5e-3, Material("perfect", np.inf))
    >>> change = ball_inductance([loop], ball, [[0, 0, 20e-3]], [1e6])
    >>> B = MU_0 * (10e-3) ** 2 / 2 / (10e-3**2 + 20e-3**2) ** 1.5
    >>> round(float(change[0, 0, 0, 0].real * 1e12), 2), round(-2 * np.pi * 2.5e-3**3 * B**2 / MU_0 * 1e12, 2)
    (-2.54, -2.47)
    """
    at = np.asarray(centres, dtype=np.float64)
    if at.ndim != 2 or at.shape[1] != 3 or not np.isfinite(at).all():
        raise MetalError(f"centres of a ball must be finite and of shape (n, 3); got shape {at.shape}.")
    top, bottom = math.fsum(sheet.thickness for sheet in sheets), float(at[:, 2].min(initial=math.inf)) - ball.radius
    if bottom < top - _SAME:
        raise MetalError(
            f"a ball must lie above the sheets, at z >= {top * 1e3:.4g} mm; it reaches down to "
            f"z = {bottom * 1e3:.4g} mm."
        )
    lowest = min(float(coil.start[:, 2].min()) for coil in coil_segments(source))
    for plate in plates:
        if plate.heights[1] > lowest:
            raise MetalError(
                f"a ball is computed only beside plates below the coils; the top of {plate.name!r} is at z = "
                f"{plate.heights[1] * 1e3:.4g} mm, the lowest copper at {lowest * 1e3:.4g} mm."
            )
    frequency = checked_frequencies(frequencies)
    backings, outlined = backings_of(source, plates, frequency.tolist(), sheets, fineness=fineness)
    if not backings:
        return ball_over(source, ball, at, frequency, sheets, None, progress=progress)
    returned = None if outlined is None else returned_dipoles(outlined, ball, at, sheets)
    parts = []
    for k, backing in enumerate(backings):
        back = None if returned is None else returned[:, k : k + 1]
        within = part_of(progress, k, len(frequency))
        parts.append(ball_over(source, ball, at, frequency[k : k + 1], sheets, backing, back, progress=within))
    return np.concatenate(parts, axis=1)


def ball_over(
    source: Source,
    ball: Ball,
    at: FloatArray,
    frequencies: FloatArray,
    sheets: Sequence[Sheet],
    backing: Backing | None,
    returned: ComplexArray | None = None,
    *,
    progress: Progress | None = None,
) -> ComplexArray:
    """Compute `ball_inductance` over a backing at its frequency.

    `returned` is the field of `returned_dipoles`. The backing's currents are without the ball.
    """
    thicknesses = [sheet.thickness for sheet in sheets]
    permeabilities = [sheet.relative_permeability for sheet in sheets]
    top = math.fsum(thicknesses)

    def answer(height: float, wavenumbers: FloatArray, alpha: ComplexArray) -> Multipoles:
        orders = alpha.shape[1]
        above = flat_profile(wavenumbers, np.array([top]), thicknesses, permeabilities)[0]
        k, rule = wave_rule(_highest(ball, orders), _REFLECTED)
        back: NumberArray = reflection(k, thicknesses[::-1], permeabilities[::-1])
        if backing is not None and backing.layers:
            downwards = [Layer(*sheet) for sheet in zip(thicknesses[::-1], permeabilities[::-1], strict=True)]
            downwards += [Layer(-backing.face), *backing.layers]
            back = -layer_waves(downwards, k, 2 * np.pi * backing.frequency).reflection
        sent_back = back * rule * ball.radius
        fields, answers = [], []
        for m in range(orders + 1):
            order = np.arange(max(m, 1), orders + 1)
            field = _multipoles(wavenumbers * ball.radius, wavenumbers * (height - top), order, m) * above
            fields.append(with_images(field, backing, wavenumbers, thicknesses, permeabilities))
            sent = _multipoles(k * ball.radius, k * (height - top), order, m)
            answers.append(multipole_response(alpha[:, order[0] - 1 :], (sent * sent_back) @ sent.T))
        return Multipoles(fields, answers)

    return multipole_inductance(source, ball, at, frequencies, answer, backing, returned, progress=progress)


def multipole_inductance(
    source: Source,
    ball: Ball,
    at: FloatArray,
    frequencies: npt.ArrayLike,
    answer: Callable[[float, FloatArray, ComplexArray], Multipoles],
    backing: Backing | None = None,
    returned: ComplexArray | None = None,
    *,
    progress: Progress | None = None,
) -> ComplexArray:
    """Compute `ball_inductance` with any axisymmetric surroundings.

    `answer` takes the height of the ball's centre in m, the wavenumbers (k,) in 1/m and the
    polarisabilities (f, orders). With a `backing` its multipoles are for the waves of the coils,
    then of their mirror images. The field `returned` to dipoles, (positions, f, 3, 3) in T per
    A·m², acts on the ball's dipole once.
    """
    frequency = checked_frequencies(frequencies)
    coils = coil_segments(source)
    middles, radius = segment_centres(coils if backing is None else backing.sources(coils))
    copper = max(float(max(coil.start[:, 2].max(), coil.stop[:, 2].max())) for coil in coils)
    if copper > 0:
        raise MetalError(f"coils must lie at z <= 0, below the sheets; one reaches z = {copper:.4g} m.")
    lowest = float(at[:, 2].min(initial=math.inf))
    if lowest - ball.radius <= copper:
        raise MetalError(
            f"a ball must lie above the copper, at z > {copper * 1e3:.4g} mm; it reaches down to "
            f"z = {(lowest - ball.radius) * 1e3:.4g} mm."
        )
    shape = (len(at), len(frequency), len(coils), len(coils))
    require_memory(16.0 * math.prod(shape), f"a ball at {len(at)} places with {len(coils)} coils", "compute in pieces")
    change = np.zeros(shape, dtype=np.complex128)
    if not len(at):
        return change
    orders = _orders(ball, lowest - copper)
    highest = min(_DECAYS / (lowest - ball.radius - copper), _highest(ball, orders))
    extent = float(np.hypot(*(at[:, None, :2] - middles).T).max()) + radius + ball.radius
    wavenumbers, weights = wave_rule(highest, wave_count(highest, extent))
    heights, height_of = np.unique(np.round(at[:, 2] / _SAME), return_inverse=True)
    places, place_of = np.unique(np.round(at[:, :2] / _SAME), axis=0, return_inverse=True)
    height_of, place_of = height_of.ravel(), place_of.ravel()
    alpha = polarisabilities(ball.radius, ball.material, frequency, orders)
    seen = [answer(height * _SAME, wavenumbers, alpha) for height in heights.tolist()]
    waves = [coils] if backing is None else backing.seen(coils)
    currents = np.eye(len(coils)) if backing is None else backing.currents(len(coils))
    scale = np.tile(weights * wavenumbers / (2 * np.pi), len(waves))
    spectra = [segment_spectra(images, wavenumbers) for images in waves]
    blocks = ranges(len(places), max(1, _AT_ONCE // (len(scale) * len(currents) * (orders + 1))))
    for done, (start, stop) in enumerate(blocks, start=1):
        about = places[start:stop] * _SAME
        incident = np.concatenate([harmonics_about(one, about, orders) for one in spectra])
        incident *= scale[:, None, None, None]
        for number, one in enumerate(seen):
            rows = np.flatnonzero((place_of >= start) & (place_of < stop) & (height_of == number))
            if len(rows):
                waves_here = incident[:, place_of[rows] - start]
                product = one.product(waves_here)
                change[rows] = -4 * np.pi * MU_0 * ball.radius * (currents.T @ product @ currents)
                if returned is not None:
                    dipoles = ball.radius**2 * one.dipoles(waves_here) @ currents
                    change[rows] += dipoles.swapaxes(-1, -2) @ returned[rows] @ dipoles
        if progress is not None:
            progress(done, len(blocks))
    return change


@dataclass(frozen=True, eq=False)
class Multipoles:
    """Multipoles of a ball's exciting field and response, by m.

    l runs from max(m, 1). Each of the `fields` (orders, k) is the field at the ball for the
    incident waves e^{−kz} J_m(kr), scaled so that the waves alone have the weights w_l e^{−kz} of
    the module's text. The `answers` (f, orders, orders) are the ball's own multipoles for these,
    with all reflections.
    """

    fields: Sequence[NumberArray]
    answers: Sequence[ComplexArray]

    def _field(self, incident: ComplexArray, m: int) -> npt.NDArray[Any]:
        """Field of one harmonic at the ball, (orders, positions, coils, real and imaginary part)."""
        wavenumbers, positions, coils, _ = incident.shape
        waves = np.ascontiguousarray(incident[..., m]).reshape(wavenumbers, -1).view(np.float64)
        return np.asarray((self.fields[m] @ waves).reshape(-1, positions, coils, 2))

    def product(self, incident: ComplexArray) -> ComplexArray:
        """Fields times answers times fields, (positions, f, coils, coils)."""

        def of(m: int) -> ComplexArray:
            field = self._field(incident, m).transpose(1, 3, 2, 0)[:, None]  # positions, 1, parts, coils, orders
            product = (field @ self.answers[m][:, None] @ field.swapaxes(-1, -2)).sum(axis=2)
            return np.asarray(product if m == 0 else 2 * product)  # m and −m

        total = np.sum(run_blocks(of, range(len(self.fields))), axis=0)
        return np.asarray((total + total.swapaxes(-1, -2)) / 2)

    def dipoles(self, incident: ComplexArray) -> ComplexArray:
        """Dipole moments along x, y and z over a², (positions, f, 3, coils) in A."""
        (z, _), (x, y) = (  # of m and −m: 2 Re of (x + iy)/√2
            4 * np.pi * np.einsum("fl,lpcr->rpfc", self.answers[m][:, 0], self._field(incident, m)) for m in (0, 1)
        )
        return np.stack((math.sqrt(2) * x, -math.sqrt(2) * y, z), axis=2)


def returned_dipoles(outlined: SolvedPlates, ball: Ball, at: FloatArray, sheets: Sequence[Sheet]) -> ComplexArray:
    """Field in T that finite plates reflect to dipoles of 1 A·m².

    The shape is (positions, f, 3, 3). Centres within flat sheets are moved up to their face.
    """
    size = _LOOP * ball.radius
    z = np.maximum(at[:, 2], math.fsum(sheet.thickness for sheet in sheets) + size)
    found: ComplexArray = np.zeros((len(at), len(outlined.factors), 3, 3), dtype=np.complex128)
    heights, height_of = np.unique(np.round(z / _SAME), return_inverse=True)
    for number, height in enumerate((heights * _SAME).tolist()):
        rows = np.flatnonzero(height_of.ravel() == number)
        where = np.column_stack((np.round(at[rows, :2] / _SAME) * _SAME, np.full(len(rows), height)))
        found[rows] = outlined.returned(where, size)
    return found


def with_images(
    field: FloatArray,
    backing: Backing | None,
    wavenumbers: FloatArray,
    thicknesses: Sequence[float],
    permeabilities: Sequence[float],
) -> NumberArray:
    """Multipoles (orders, k) of the coils' waves beside each `Backing.seen`."""
    if backing is None or not backing.layers:
        return field
    arriving = backing.arriving(wavenumbers, thicknesses, permeabilities)
    return np.concatenate([field * one for one in arriving], axis=1)


def multipole_response(alpha: ComplexArray, returned: NumberArray) -> ComplexArray:
    """Strengths (1 − αS)⁻¹ α of the multipoles with reflections S, (f, orders, orders)."""
    identity = np.eye(alpha.shape[1])
    return np.asarray(np.linalg.solve(identity - alpha[..., None] * returned, alpha[..., None] * identity))


def polarisabilities(radius: float, material: Material, frequencies: FloatArray, orders: int) -> ComplexArray:
    """Polarisabilities α_l of a ball, dimensionless, shape (f, orders).

    The `radius` is in m, the `material` that of the ball, and the `frequencies` (f,) are in Hz. A
    multipole is α_l a^(2l+1) times the field that excites it, for l from 1. r_l follows from the
    downward continued fraction r_l = 2l + 1 + x²/r_(l+1), which overflows at no skin depth.
    """
    order = np.arange(1, orders + 1)
    if math.isinf(material.conductivity):
        return np.tile(order / (order + 1.0), (len(frequencies), 1)).astype(np.complex128)
    mu = material.relative_permeability
    square = 2j * np.pi * frequencies * MU_0 * mu * material.conductivity * radius**2
    start = orders + 20 + math.ceil(_DOWN * float(np.abs(square).max()) ** 0.25)
    r = start + 0.5 + np.sqrt((start + 0.5) ** 2 + square)
    alpha = np.empty((len(frequencies), orders), dtype=np.complex128)
    for below in range(start - 1, 0, -1):
        r = 2 * below + 1 + square / r
        if below <= orders:
            inner = r - below
            alpha[:, below - 1] = below / (below + 1) * (inner - (below + 1) * mu) / (inner + below * mu)
    return alpha


def _multipoles(ka: FloatArray, fall: FloatArray, order: IntArray, m: int) -> FloatArray:
    """w_l(k) e^{−fall} of the module's text, (orders, k), without overflow."""
    size = order[:, None] * np.log(ka) - fall - (gammaln(order + m + 1) + gammaln(order - m + 1))[:, None] / 2
    return np.asarray((-1.0) ** (order + m)[:, None] * np.exp(size))


def _orders(ball: Ball, height: float) -> int:
    """Count the multipoles of a ball over the copper."""
    needed = math.ceil(math.log(_LEFT_OUT) / (2 * math.log(ball.radius / height)))
    if needed > _MOST:
        nearest = ball.radius * (_LEFT_OUT ** (-0.5 / _MOST) - 1)
        raise MetalError(
            f"a ball of {ball.radius * 1e3:.4g} mm radius must be at least {nearest * 1e3:.3g} mm from the copper; "
            f"got {(height - ball.radius) * 1e3:.3g} mm."
        )
    return max(needed, _FEWEST)


def _highest(ball: Ball, orders: int) -> float:
    """Wavenumber in 1/m beyond which (ka)^l e^{−ka} is negligible for all l."""
    return (orders + 8 * math.sqrt(orders) + 20) / ball.radius


def sphere_in_dent(
    dent: Dent, radius: float, height: float, wavenumbers: FloatArray, orders: int, mesh: LayerMesh
) -> Sequence[tuple[FloatArray, FloatArray]]:
    """Harmonics on a sphere in dented sheets, in m, for m from 0, k in 1/m.

    l runs from max(m, 1) to the orders. The first array (orders, k) of each m is of the dented
    potential for the incident e^{−kz} J_m(kr), the second (orders, orders) in 1/m the harmonics
    that sheets add for a layer of unit strength.
    """
    space = DentedSpace(dent, mesh)
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    r, z = radius * np.sqrt(1 - nodes**2), height + radius * nodes
    # heights of the points in flat sheets
    anchors = dent.anchors()
    heights = anchors + dent.anchored(r)
    inside = [np.interp(height, row, anchors) for height, row in zip(z, heights, strict=True)]
    unmoved = np.where((z > anchors[0]) & (z < anchors[-1]), inside, z)
    at = space.basis.probes(np.array([r, unmoved]))
    profile = space.background(z, wavenumbers) + space.reaction(unmoved, wavenumbers)
    air = space.air()

    def solve(m: int) -> tuple[FloatArray, FloatArray]:
        harmonics = _normalised(orders, m, nodes) * weights
        layers = np.asarray(at.T @ harmonics.T)
        count = layers.shape[1]
        solved = space.energies(m, np.hstack((layers, space.force(m, space.waves(m, wavenumbers)))))
        seen = harmonics @ (radial_pattern("axial", m, r, wavenumbers) * profile)
        return seen - solved[:count, count:], solved[:count, :count] - space.energies(m, layers, air)

    return run_blocks(solve, range(orders + 1))


def _normalised(orders: int, m: int, x: FloatArray) -> FloatArray:
    """Normalised associated Legendre functions P_l^m(x), l from max(m, 1).

    With ∫ P² dx = 1, without the sign of Condon and Shortley. The recurrence in l stays within the
    range of numbers at any order, unlike factorials and P_l^m themselves (Holmes and Featherstone,
    J. Geodesy 76, 279 (2002), Eqs. 11 to 13).
    """
    odd = np.arange(1, 2 * m, 2)
    found = [np.sqrt((m + 0.5) * np.prod(odd / (odd + 1))) * (1 - x**2) ** (m / 2)]
    before = np.zeros_like(x)
    for order in range(m + 1, orders + 1):
        a = math.sqrt((4 * order**2 - 1) / (order**2 - m**2))
        b = math.sqrt(((order - 1) ** 2 - m**2) / (4 * (order - 1) ** 2 - 1))
        found.append(a * (x * found[-1] - b * before))
        before = found[-2]
    return np.array(found[max(1 - m, 0) :])


def indenter_inductance(
    source: Source,
    ball: Ball,
    dents: Sequence[Dent],
    places: FloatArray,
    frequency: float,
    distances: Sequence[float] | None = None,
    backing: Backing | None = None,
    outlined: SolvedPlates | None = None,
    *,
    mesh: LayerMesh | None = None,
) -> ComplexArray:
    """Change of the impedance matrix by a ball in its dents.

    The result (dents, places, coils, coils) is ΔL − jΔR/ω in H relative to the dented sheets
    without the ball. The `dents` are of the same sheets, for example one for each depth.
    `distances` are heights in m of the ball's lowest point over the sheets of each dent, above zero
    if they are not dented, inf without the ball. `backing` has plates below the coils, and
    `outlined` the finite plates there, which also reflect the field of the ball's dipole.

    In its dent the ball is solved together with the dented sheets. Over a backing the reflected
    field of the coils is included completely. The reflected field of ball and dent is left out,
    except for a ball over flat sheets and layers, and for the reflection of the ball's dipole by
    finite plates, as if the sheets were flat.
    """
    coils = len(as_conductors(source))
    change = np.zeros((len(dents), len(places), coils, coils), dtype=np.complex128)
    lowest = np.array([dent.heights[-1] + dent.displacement[0, -1] for dent in dents])
    heights = lowest + (0.0 if distances is None else np.array(distances)) + ball.radius
    level = np.array([not np.isfinite(dent.clearance) for dent in dents])  # the magnetic faces are flat
    flat, pressed = (np.flatnonzero(np.isfinite(heights) & kind) for kind in (level, ~level))

    def centres(numbers: IntArray) -> FloatArray:
        return np.column_stack((np.tile(places, (len(numbers), 1)), np.repeat(heights[numbers], len(places))))

    def returned(at: FloatArray, dent: Dent) -> ComplexArray | None:
        return None if outlined is None else returned_dipoles(outlined, ball, at, _flat_sheets(dent))

    if len(flat):
        first = dents[flat[0]]
        sheets = _flat_sheets(first)
        at, f = centres(flat), np.array([frequency])
        found = ball_over(source, ball, at, f, sheets, backing, returned(at, first))
        change[flat] = found.reshape(len(flat), *change.shape[1:])

    def answer(height: float, wavenumbers: FloatArray, alpha: ComplexArray) -> Multipoles:
        dent, orders = dents[pressed[np.abs(heights[pressed] - height).argmin()]], alpha.shape[1]
        harmonics = sphere_in_dent(dent, ball.radius, height, wavenumbers, orders, mesh or LayerMesh())
        fields, answers = [], []
        for field, returned in harmonics:
            order = np.arange(orders - len(field) + 1, orders + 1)
            scale = np.sqrt(order + 0.5)
            scaled = scale[:, None] * field
            fields.append(with_images(scaled, backing, wavenumbers, dent.thicknesses, dent.permeabilities))
            answers.append(
                multipole_response(alpha[:, order[0] - 1 :], 2 * ball.radius * np.outer(scale, scale) * returned)
            )
        return Multipoles(fields, answers)

    if len(pressed):
        at = centres(pressed)
        back = returned(at, dents[pressed[0]])
        found = multipole_inductance(source, ball, at, [frequency], answer, backing, back)
        change[pressed] = found.reshape(len(pressed), *change.shape[1:])
    return change


def _flat_sheets(dent: Dent) -> list[Sheet]:
    return [
        Sheet(f"sheet {k + 1}", thickness, mu)
        for k, (thickness, mu) in enumerate(zip(dent.thicknesses, dent.permeabilities, strict=True))
    ]


def target_inductance(
    source: Source,
    target: Target,
    places: FloatArray,
    distances: Sequence[float],
    frequencies: FloatArray,
    sheets: Sequence[Sheet] = (),
    plates: AnyPlates = (),
    *,
    accuracy: Accuracy = "full",
    fineness: float = 1.0,
    progress: Progress | None = None,
) -> tuple[ComplexArray, PlateError | None]:
    """Change of the impedance matrix by a target, in H.

    The change (d, p, f, n, n) is ΔZ/(jω) = ΔL − jΔR/ω, with the target minus without. The second
    result are the errors of a finite plate, else None. The target's centre is at `places` (p, 2) in
    m on the board, its nearest point at `distances` in m from the upper face of the sheets, or from
    the board without sheets. `plates` are fixed metal. `accuracy` is of an infinite target,
    `fineness` of the mesh of a finite plate.
    """
    face, body = sum(sheet.thickness for sheet in sheets), target.body
    heights = [target.height(face, distance) for distance in distances]
    if isinstance(body, Ball):
        require_below(plates, "a sphere")
    if isinstance(body, Plate):
        moved = [replace(body, z=z) for z in heights]
        endless = [plate for plate in plates if isinstance(plate, Plate)]
        cases = [endless, *([*endless, one] for one in moved)]
        every = plate_inductances(source, cases, frequencies, sheets, accuracy=accuracy, progress=progress)
        if len(endless) < len(plates):
            outlined = ([*plates], *([*plates, one] for one in moved))
            every = every + [outlined_inductance(source, c, frequencies, sheets, fineness=fineness) for c in outlined]
        return np.repeat((every[1:] - every[0])[:, None], len(places), axis=1), None
    positions = np.array([[x, y, z] for z in heights for x, y in places.tolist()])
    error = None
    if isinstance(body, FinitePlate):
        error = moving_plate(source, body, positions, frequencies, sheets, plates, fineness=fineness, progress=progress)
        change = error.change
    else:
        change = ball_inductance(
            source, body, positions, frequencies, sheets, plates, fineness=fineness, progress=progress
        )
    return change.reshape(len(heights), len(places), *change.shape[1:]), error
