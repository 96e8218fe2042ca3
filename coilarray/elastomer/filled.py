"""Stiffness and permeability of elastomers filled with small spheres."""

from __future__ import annotations

import math

from coilarray.errors import ElastomerError, require_positive

GUTH_GOLD_LIMIT = 0.35  # largest volume fraction that `guth_gold_modulus` accepts


def guth_gold_modulus(matrix_modulus: float, volume_fraction: float) -> float:
    """Young's modulus of a filled elastomer in Pa (Guth and Gold).

    The unfilled elastomer has the `matrix_modulus` in Pa, and the `volume_fraction` of the filler
    is 0 to 0.35. Other values raise an ElastomerError.

    Notes
    -----
    E = E₀ (1 + 2.5 f + 14.1 f²): E. Guth and O. Gold, Phys. Rev. 53, 322 (1938). E. Guth, J. Appl.
    Phys. 16, 20 (1945). The linear term is Einstein's result for single spheres. The square term
    counts pairs. The formula holds for well dispersed, nearly round particles much stiffer than the
    elastomer, small strains and f up to about 0.3. At larger f, or if particles form chains (a
    field during curing) or clusters, the true modulus is higher. Above 0.35 the formula is refused.

    Examples
    --------
    The magnetic layer of the six-coil sensor with 30 % of iron powder is three times as stiff as
    its base.

    >>> round(guth_gold_modulus(1.0, 0.30), 3)
    3.019
    """
    require_positive("the matrix's modulus", matrix_modulus, " Pa", ElastomerError)
    if not 0 <= volume_fraction <= GUTH_GOLD_LIMIT:
        raise ElastomerError(
            f"the volume fraction must be 0 to {GUTH_GOLD_LIMIT}, where Guth and Gold's formula ends; "
            f"got {volume_fraction}."
        )
    f = volume_fraction
    return matrix_modulus * (1 + 2.5 * f + 14.1 * f * f)


def maxwell_garnett_permeability(volume_fraction: float, particle_permeability: float = math.inf) -> float:
    """Relative permeability of spheres in an elastomer (Maxwell Garnett).

    The elastomer is not magnetic. The `volume_fraction` of the spheres is 0 to 1, their relative
    `particle_permeability` at least 1. It is infinite by default: the permeability of iron is so
    large that only the shape counts. Other values raise an ElastomerError. The result is infinite
    only if particles of infinite permeability fill everything.

    Notes
    -----
    μ = (1 + 2fβ)/(1 − fβ), β = (μp − 1)/(μp + 2): J. C. Maxwell Garnett, Phil. Trans. R. Soc. A
    203, 385 (1904). Every sphere lies in the mean field of the others, which holds for dilute
    mixtures, up to f of about 0.2. It is also the lower bound of Hashin and Shtrikman (J. Appl.
    Phys. 33, 3125, 1962) for any isotropic mixture of the two. Since the spheres demagnetise
    themselves, μp hardly counts: 30 in place of infinity lowers μ by 7 % at f = 0.3.

    The six-coil sensor has f = 0.30, which gives 2.286 for infinite μp. The authors' second paper
    takes 2.7 for such a layer, which lies above this bound and below `bruggeman_permeability`.

    Examples
    --------
    >>> round(maxwell_garnett_permeability(0.30), 3)
    2.286
    """
    _check_mixture(volume_fraction, particle_permeability)
    inverse = 1 / particle_permeability  # in 1/μp, so that it may be zero
    above, below = 1 - inverse, 1 + 2 * inverse  # β = above/below
    f = volume_fraction
    rest = below - f * above
    return (below + 2 * f * above) / rest if rest > 0 else math.inf


def bruggeman_permeability(volume_fraction: float, particle_permeability: float = math.inf) -> float:
    """Relative permeability of a mixture of spheres (Bruggeman).

    The `volume_fraction`, the `particle_permeability` and the errors are as in
    `maxwell_garnett_permeability`. The result is infinite if particles of infinite permeability
    fill a third or more.

    Notes
    -----
    f (μp − μ)/(μp + 2μ) + (1 − f)(1 − μ)/(1 + 2μ) = 0: D. A. G. Bruggeman, Ann. Phys. (Leipzig)
    416, 636 (1935). For two phases this is 2μ² − bμ − μp = 0 with b = (3f − 1) μp + 2 − 3f, solved
    here for its positive root. Both phases are treated alike, each sphere in the mixture itself, so
    that the particles percolate at f = 1/3. For infinite μp, μ = 1/(1 − 3f) below 1/3
    and unbounded from there on. Particles that the elastomer separates percolate later. Take the
    result as an upper estimate if f is close to 1/3 and μp is large (10 at f = 0.30 for infinite
    μp).

    Examples
    --------
    >>> round(bruggeman_permeability(0.10), 3), round(bruggeman_permeability(0.30, 100.0), 3)
    (1.429, 5.188)
    """
    _check_mixture(volume_fraction, particle_permeability)
    inverse = 1 / particle_permeability
    # the equation for y = μ/μp: 2y² − by − 1/μp = 0 with b over μp, in the form without
    # cancellation for each sign of b
    b = 3 * volume_fraction - 1 + (2 - 3 * volume_fraction) * inverse
    root = math.hypot(b, math.sqrt(8 * inverse))
    if b < 0:
        return 2 / (root - b)
    return (b + root) / 4 / inverse if inverse > 0 else math.inf


def _check_mixture(volume_fraction: float, particle_permeability: float) -> None:
    """Refuse a volume fraction or permeability out of range."""
    if not 0 <= volume_fraction <= 1:
        raise ElastomerError(f"the volume fraction must be 0 to 1; got {volume_fraction}.")
    if not particle_permeability >= 1:
        raise ElastomerError(
            f"the particles' relative permeability must be at least 1 (infinite allowed); got {particle_permeability}."
        )
