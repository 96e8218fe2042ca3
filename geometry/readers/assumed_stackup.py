"""What is taken for the parts of a stack-up that a board's files do not say."""

from __future__ import annotations

from collections.abc import Sequence

COPPER_THICKNESS = 35e-6
EPSILON_R = 4.5
BOARD_THICKNESS = 1.6e-3

Slab = tuple[float | None, float | None]
"""Thickness in m and relative permittivity of a dielectric, None where it is not said."""


def united(parts: Sequence[Slab]) -> Slab:
    """Return one dielectric of the thickness and the capacitance of several in series.

    Parameters
    ----------
    parts : sequence of Slab
        From one copper layer to the next.

    Returns
    -------
    Slab
        Without a thickness where one part has none: then the permittivity is that of equal parts.

    Examples
    --------
    >>> thickness, epsilon_r = united([(0.1e-3, 4.0), (0.3e-3, 3.0)])
    >>> round(thickness, 9), round(epsilon_r, 9)
    (0.0004, 3.2)
    """
    thicknesses = [thickness for thickness, _ in parts if thickness is not None]
    epsilons = [epsilon for _, epsilon in parts if epsilon is not None]
    thickness = sum(thicknesses) if parts and len(thicknesses) == len(parts) else None
    if len(parts) == 1 or not parts or len(epsilons) < len(parts) or min(epsilons) <= 0:
        return thickness, parts[0][1] if len(parts) == 1 else None
    weights = [1.0] * len(parts) if thickness is None else thicknesses
    return thickness, sum(weights) / sum(d / epsilon for d, epsilon in zip(weights, epsilons, strict=True))


def filled_copper(given: Sequence[float | None], files: str, assumed: dict[str, str]) -> tuple[float, ...]:
    """Put the usual thickness of copper where none is given, and say so in `assumed`; `files` is "the files do"."""
    if None in given:
        assumed["stackup.copper_thickness_um"] = f"{files} not say; standard 1 oz copper"
    return tuple(COPPER_THICKNESS if thickness is None else thickness for thickness in given)


def filled_dielectrics(
    slabs: Sequence[Slab], copper: Sequence[float], board: float | None, files: str, assumed: dict[str, str]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Put usual values where a dielectric has none, and say so in `assumed`.

    Parameters
    ----------
    slabs : sequence of Slab
        Top to bottom.
    copper : sequence of float
        Thicknesses in m.
    board : float or None
        Thickness of the whole board in m; None where it is not said.
    files : str
        What does not say it: "the files do", "the board file does".
    assumed : dict of str to str
        As in `BoardCopper`; added to.

    Returns
    -------
    tuple of tuple of float
        Thicknesses in m, not positive where the board is too thin for its copper, and relative permittivities.
    """
    missing = sum(thickness is None for thickness, _ in slabs)
    share = 0.0
    if missing:
        whole = BOARD_THICKNESS if board is None else board
        share = (whole - sum(copper) - sum(thickness or 0.0 for thickness, _ in slabs)) / missing
        assumed["stackup.dielectric_thickness_mm"] = (
            f"{files} not say; equal parts of what is left of the {'usual' if board is None else 'given'} board "
            f"thickness of {whole * 1e3:g} mm"
        )
    if any(epsilon is None for _, epsilon in slabs):
        assumed["stackup.dielectric_epsilon_r"] = f"{files} not say; FR-4, {EPSILON_R:g}"
    return (
        tuple(share if thickness is None else thickness for thickness, _ in slabs),
        tuple(EPSILON_R if epsilon is None else epsilon for _, epsilon in slabs),
    )
