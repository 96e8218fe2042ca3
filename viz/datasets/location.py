"""Where an indentation was located, and how surely."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.special import chdtri

from coilarray.viz.datasets.triangles import polylines

if TYPE_CHECKING:
    import pyvista

_POINTS = 145  # of an ellipse: every 2.5°


def uncertainty_ellipse(
    centre: tuple[float, float],
    covariance: npt.ArrayLike,
    confidence: float = 0.95,
    *,
    magnification: float = 1.0,
    height: float = 0.0,
) -> pyvista.PolyData:
    """Return the ellipse that holds the true position with a probability, for Gaussian errors.

    Parameters
    ----------
    centre : tuple of float
        x and y in m.
    covariance : array_like, shape (2, 2)
        Of x and y in m², symmetric and positive definite.
    confidence : float
        The probability, between 0 and 1.
    magnification : float
        Factor by which the ellipse is drawn too large.
    height : float
        In m.

    Returns
    -------
    pyvista.PolyData
        In mm; one closed polyline.

    Raises
    ------
    ValueError
        A covariance of another shape or that is not positive definite, or a confidence outside 0 to 1.

    Notes
    -----
    (r − r̂)ᵀ Σ⁻¹ (r − r̂) = q with q the quantile of χ² for two degrees of freedom, −2 ln(1 − confidence). With the
    Cholesky factor Σ = L Lᵀ it is r̂ + √q L (cos t, sin t).

    Examples
    --------
    >>> ellipse = uncertainty_ellipse((0, 0), [[1e-6, 0], [0, 4e-6]])
    >>> [round(edge, 3) for edge in ellipse.bounds[:4]]
    [-2.448, 2.448, -4.895, 4.895]
    """
    sigma = np.asarray(covariance, dtype=np.float64)
    if sigma.shape != (2, 2) or not np.isfinite(sigma).all():
        raise ValueError(f"covariance must be a finite matrix of shape (2, 2); got {sigma.tolist()}.")
    if not 0 < confidence < 1:
        raise ValueError(f"confidence must be between 0 and 1; got {confidence}.")
    try:
        factor = np.linalg.cholesky(sigma)
    except np.linalg.LinAlgError:
        raise ValueError(f"covariance must be positive definite; got {sigma.tolist()}.") from None
    angle = np.linspace(0.0, 2 * np.pi, _POINTS)
    circle = np.column_stack((np.cos(angle), np.sin(angle)))
    quantile = float(chdtri(2, 1 - confidence))
    points = np.asarray(centre) + magnification * np.sqrt(quantile) * circle @ factor.T
    return polylines([np.column_stack((points, np.full(_POINTS, height)))])


def position_pin(centre: tuple[float, float], bottom: float, top: float) -> pyvista.PolyData:
    """Return an upright line at a position on the board, in mm; all lengths in m."""
    return polylines([np.array([[*centre, bottom], [*centre, top]])])
