"""Where an indentation was located, with its uncertainty."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import chdtri

from coilarray.viz.datasets.location import position_pin, uncertainty_ellipse
from coilarray.viz.datasets.triangles import polylines
from coilarray.viz.palette import INDIGO, INK, WINE
from coilarray.viz.scenes.board import Box, cut_upright
from coilarray.viz.scenes.scene import Part, Scene

if TYPE_CHECKING:
    import pyvista

    from coilarray.localize.inverse import Location, Mode

_SEEN = 0.04  # semi-axis of the drawn ellipse over the reach of the scene, at least
_CROSS = 0.018  # half the length of a cross over the reach
_CONFIDENCE = 0.95


def scene_of_location(
    location: Location,
    *,
    origin: tuple[float, float],
    bounds: Box,
    top: float,
    truth: tuple[float, float] | None = None,
) -> Scene:
    """Return pins where an indentation may be, each with its 95 % ellipse of x and y.

    Parameters
    ----------
    location : Location
        From `coilarray.localize.inverse.locate`.
    origin : tuple of float
        Place of the map's origin on the board in m.
    bounds : tuple of float
        x_min, y_min, x_max, y_max of the board in m: an ellipse ends at its edge, and one that reaches farther than the
        board is long is not drawn. One that is too small to be seen is drawn larger, by the factor that its name in the
        legend says.
    top : float
        Height of the pins in m.
    truth : tuple of float, optional
        x and y in m, from the map's origin, where the indenter is; marked by a cross.

    Returns
    -------
    Scene
        With notes that tell position, standard deviations and verdict.
    """
    parts: list[Part] = []
    reach = max(bounds[2] - bounds[0], bounds[3] - bounds[1])
    notes = [_told(location)]
    magnification = _magnification(location.modes, reach)
    label = "95 % ellipse" + ("" if magnification == 1 else f", drawn {magnification:g} × as large")
    for k, mode in enumerate(location.modes):
        at = (mode.x + origin[0], mode.y + origin[1])
        group = "located" if k == 0 else "may also be"
        parts.append(Part(f"pin {k}", position_pin(at, 0.0, top), group, INK, line_width=4.0, lit=False))
        if not _is_finite(mode):
            notes.append("No ellipse: one direction is not told by this reading to first order.")
            continue
        if _semiaxis(mode) > reach:
            notes.append("No 95 % ellipse where it would be longer than the board.")
            continue
        if not mode.gaussian:
            notes.append("The likelihood is not Gaussian: the ellipse is its shape near the position only.")
        for name, height in (("", 0.0), (" above", top)):
            covariance = mode.covariance[:2, :2]
            ellipse = uncertainty_ellipse(at, covariance, _CONFIDENCE, magnification=magnification, height=height)
            on_board = cut_upright(ellipse, bounds)
            if on_board.n_cells:
                parts.append(Part(f"ellipse {k}{name}", on_board, label, WINE, line_width=4.0, lit=False))
    if truth is not None:
        cross = _cross(truth[0] + origin[0], truth[1] + origin[1], top, _CROSS * reach)
        parts.append(Part("truth", cross, "indenter", INDIGO, line_width=3.0, lit=False))
    return Scene(tuple(parts), notes=tuple(dict.fromkeys(notes)))


def _told(location: Location) -> str:
    """One line about a location."""
    if not location.modes:
        return f"{location.verdict}: {location.reason}"
    best = location.best
    numbers = zip(("x", "y", "depth"), (best.x, best.y, best.depth), best.deviations, strict=False)
    told = ", ".join(
        f"{name} = {round(value * 1e3, 2) + 0.0:.2f} ± {sigma * 1e3:.2g} mm" for name, value, sigma in numbers
    )
    others = len(location.modes) - 1
    also = "" if not others else f"; {others} more position{' fits' if others == 1 else 's fit'}"
    return f"{location.verdict}: {told} (standard deviations){also}".replace("-", "−")


def _magnification(modes: Sequence[Mode], reach: float) -> float:
    """1, 2, 5, 10, 20, …: the least factor by which the largest ellipse is seen."""
    semiaxes = [_semiaxis(mode) for mode in modes if _is_finite(mode)]
    if not semiaxes:
        return 1.0
    wanted = _SEEN * reach / max(semiaxes)
    if wanted <= 1:
        return 1.0
    decade = 10.0 ** math.floor(math.log10(wanted))
    return next(step * decade for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= wanted * (1 - 1e-12))


def _semiaxis(mode: Mode) -> float:
    """Longer semi-axis of an ellipse in m."""
    return math.sqrt(float(chdtri(2, 1 - _CONFIDENCE)) * float(np.linalg.eigvalsh(mode.covariance[:2, :2])[-1]))


def _is_finite(mode: Mode) -> bool:
    return bool(np.isfinite(mode.covariance[:2, :2]).all())


def _cross(x: float, y: float, z: float, half: float) -> pyvista.PolyData:
    """Two lines in a plane of equal height, in mm; arguments in m."""
    return polylines([np.array([[x - half, y, z], [x + half, y, z]]), np.array([[x, y - half, z], [x, y + half, z]])])
