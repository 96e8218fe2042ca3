"""Exact effect of a flat magnetic sheet on inductance.

The sheet is one slab of relative permeability μr and thickness t, whose lower face lies above all
paths. With β = (μr − 1)/(μr + 1) and F(h) the mutual inductance in free space of path i and the
mirror image of path j, lifted by h,

    ΔM = Σ_n β^(2n+1) [F(2nt) − F(2(n+1)t)] = β F(0) − (1 − β²) Σ_{n>0} β^(2n−1) F(2nt).

The image is the path mirrored at the lower face with its current: horizontal parts keep their
direction, vertical parts turn round. At that face the image's own B has the same part across it as
the path's B, and the opposite part along it. So below, path and β times the image give (1 + β) B_z
and (1 − β) H_t of the path alone. Above, 1 + β times the path's own B matches both since (1 + β)/μr
= 1 − β. The upper face mirrors this back, and so on.

Near images have the cross-section of their bars. The rest is summed at once in the spectrum of
plane waves (`coilarray.electromagnetics.plane_waves`), Σ_n β^(2n) e^{−2nkt} = 1/(1 − β² e^{−2kt}).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coilarray.compute.arrays import FloatArray
from coilarray.electromagnetics.inductance import Accuracy, mutual_inductance
from coilarray.electromagnetics.plane_waves import (
    DIGITS,
    Board,
    board_below,
    reflected_inductance,
    require_few_waves,
    top_of,
    wavenumbers,
)
from coilarray.electromagnetics.source import Source, as_conductors
from coilarray.errors import ElastomerError
from coilarray.geometry import Conductor, Sheet

_NEAR = 1 / 16  # of the board; beyond it the spectrum takes the images (twice the gap), at a cost of (board/distance)²
_BALANCE = 0.025  # balance of the costs of an image and of the spectrum, for thin sheets with many near images
_WIDTHS = 4.0  # widths up to which images are near; beyond, the series in _mean_wave errs by 1e-11


@dataclass(frozen=True)
class Slab:
    """Magnetic region: height of its lower face and thickness in m, μr > 1."""

    lower: float
    thickness: float
    relative_permeability: float

    @property
    def reflection(self) -> float:
        """Strength of the first image, β = (μr−1)/(μr+1)."""
        return (self.relative_permeability - 1) / (self.relative_permeability + 1)

    @property
    def transmission(self) -> float:
        """Transmission 1 − β² through the lower face and back, without cancellation."""
        return 4 / (self.relative_permeability + 1) * (self.relative_permeability / (self.relative_permeability + 1))


def magnetic_slab(sheets: Sequence[Sheet]) -> Slab | None:
    """Return the magnetic region of sheets from z = 0, or None.

    >>> magnetic_slab([Sheet("base", 6e-3), Sheet("magnetic", 2e-3, 2.7)])
    Slab(lower=0.006, thickness=0.002, relative_permeability=2.7)
    """
    magnetic = [k for k, sheet in enumerate(sheets) if sheet.magnetic]
    if not magnetic:
        return None
    first, last = magnetic[0], magnetic[-1]
    permeability = sheets[first].relative_permeability
    if any(sheet.relative_permeability != permeability for sheet in sheets[first : last + 1]):
        found = ", ".join(
            f"{sheets[k].name!r} (sheet {k + 1}, μr {sheets[k].relative_permeability:g})" for k in magnetic
        )
        raise ElastomerError(
            "magnetic sheets must lie on each other and have one relative permeability, so that they make one slab; "
            f"got {found}."
        )
    heights = [0.0, *itertools.accumulate(sheet.thickness for sheet in sheets)]
    return Slab(heights[first], math.fsum(sheet.thickness for sheet in sheets[first : last + 1]), permeability)


def layer_inductance(source: Source, sheets: Sequence[Sheet], *, accuracy: Accuracy = "full") -> FloatArray:
    """Compute the change of inductance by flat sheets in H.

    The sheets lie above the current paths.

    Parameters
    ----------
    source : Array, Conductor, polyline or sequence of them
        See `coilarray.electromagnetics.source.as_conductors`. The paths lie below the magnetic
        sheet. Thin filaments are allowed.
    sheets : sequence of Sheet
        Sheets upwards from z = 0, wide against the coils. At most one magnetic region, see
        `magnetic_slab`.
    accuracy : {"full", "screen"}
        Accuracy as in `coilarray.inductance_matrix`. ``screen`` errs by up to 1e-3 of the change
        itself.

    Returns
    -------
    ndarray, shape (paths, paths)
        Inductance in H, symmetric, to be added to the matrix without sheets. Zero if no sheet is
        magnetic.

    Raises
    ------
    ElastomerError
        More than one magnetic region, or a path that reaches into it (thin filaments: or touches
        it).

    Notes
    -----
    ΔM = Σ_n β^(2n+1) [M(Z + 2nt) − M(Z + 2(n+1)t)], with β = (μr − 1)/(μr + 1), Z the sum of both
    paths' distances from the sheet's lower face and M their mutual inductance in free space at that
    distance. For circles see Hurley & Duffy, IEEE Trans. Magn. 33, 2282 (1997). The current density
    is uniform in every bar. Vertical bars count as thin. The result is exact to 1e-10 of the
    largest entry. Near images need `mutual_inductance` and are exact to its 1e-6 of L. Closed paths
    with any currents I have IᵀΔM I > 0.

    Paths with open ends are taken as they are, as in `inductance_matrix`, so that the pieces of a
    path add up to the whole. Closing the coils of the reference board by a straight line between
    their terminals, 1.5 mm apart, would change ΔM of a coil with itself by −0.10 % and with its
    neighbour by −0.33 %. This is the effect of leads that are not drawn.

    A sheet much thinner than its distance from the copper costs nothing extra. A sheet that lies on
    the copper costs one `inductance_matrix` for each image within some 1/16 of the board's extent
    (1/50 for ``screen``), or fewer if that makes many.

    Examples
    --------
    A sheet 6 mm above a square loop.

    >>> square = [[0, 0, 0], [2e-2, 0, 0], [2e-2, 2e-2, 0], [0, 2e-2, 0], [0, 0, 0]]
    >>> change = layer_inductance([square], [Sheet("base", 6e-3), Sheet("magnetic", 2e-3, 2.7)])
    >>> round(float(change[0, 0]) * 1e9, 4)
    0.9809
    """
    paths = as_conductors(source)
    slab = magnetic_slab(sheets)
    change = np.zeros((len(paths), len(paths)))
    if slab is None:
        return change
    for path in paths:
        require_below(path, slab.lower)
    board = board_below(paths, slab.lower, accuracy)
    near = _near_images(board, slab)
    k, weights = np.array(_wavenumbers(board, slab, near)).T
    require_few_waves(board, k.tolist())
    for n in range(near):
        change += _weight(slab, n) * mutual_inductance(paths, _images(paths, slab, n), accuracy=accuracy)
    shares = np.array([_remainder(slab, near, one) for one in k.tolist()])
    change += reflected_inductance([board], k.tolist(), (weights * shares)[None, None])[0].real
    return (change + change.T) / 2


def _weight(slab: Slab, n: int) -> float:
    """Weight of F(2nt) in the series."""
    beta = slab.reflection
    return beta if n == 0 else float(-slab.transmission * beta ** (2 * n - 1))


def _images(paths: Sequence[Conductor], slab: Slab, n: int) -> list[Conductor]:
    """Paths mirrored at the lower face and lifted by 2nt."""
    return [mirrored(path, slab.lower + n * slab.thickness) for path in paths]


def mirrored(path: Conductor, height: float) -> Conductor:
    """Return the path and its current mirrored at a height in m."""
    lift = np.array([0.0, 0.0, 2 * height])
    return Conductor(path.vertices * [1, 1, -1] + lift, path.widths, path.thicknesses, name=f"image of {path.name}")


def require_below(path: Conductor, face: float) -> None:
    """Raise ElastomerError unless a path's highest copper is below a face in m."""
    top = top_of(path)
    rounding = 1e-12 * float(np.abs(path.vertices).max())
    if top > face + rounding or (path.is_filament and top > face - rounding):
        raise ElastomerError(
            f"paths must lie below the magnetic sheet, whose lower face is at z = {face:g} m; "
            f"{path.name} reaches z = {top:g} m."
        )


def _near_images(board: Board, slab: Slab) -> int:
    """Count the images that are taken individually."""
    spectrum = board.digits / DIGITS["full"] * board.extent  # fewer digits take fewer waves
    cheapest = float(np.cbrt(_BALANCE * slab.thickness * spectrum**2))
    least = max(min(_NEAR * spectrum, cheapest), _WIDTHS * board.size)
    return max(math.ceil((least - board.gap) / (2 * slab.thickness)), 0)


def _wavenumbers(board: Board, slab: Slab, near: int) -> list[tuple[float, float]]:
    """Nodes and weights in 1/m of the integral over k.

    It reaches up to the k at which e^{−kh} is below the tolerance. Panels that double keep their
    distance from the poles of 1/(1 − β² e^{−2kt}), the nearest of which is at k = ln β/t < 0.
    """
    nearest = board.gap + 2 * near * slab.thickness
    highest = board.digits / nearest
    pole = math.log1p(2 / (slab.relative_permeability - 1)) / slab.thickness
    lowest = min(pole, 0.5 / slab.thickness, highest / 8)
    return wavenumbers(board, lowest, highest, nearest)


def _remainder(slab: Slab, near: int, k: float) -> float:
    """Sum the weights times e^{−2nkt} from n = `near` on."""
    fall = -math.expm1(-2 * k * slab.thickness)
    series = slab.transmission + slab.reflection**2 * fall  # 1 − β² e^{−2kt}
    if near == 0:
        return slab.reflection * fall / series
    return _weight(slab, near) * math.exp(-2 * near * k * slab.thickness) / series
