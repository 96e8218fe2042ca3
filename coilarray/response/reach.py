"""How far from the indenter coils and states count, for a stated error of δ.

What is left out is measured on the design itself: how ΔL_aa and the mutual ΔL_ab fall with the distance of a coil from
the dent, and the currents in all other coils of every state, which say how much ΔL_ab counts there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from coilarray.circuit.state_sensitivity import StateSensitivity
from coilarray.elastomer.coil_spectrum import CoilSpectra
from coilarray.elastomer.dent_amplitudes import dent_amplitudes
from coilarray.elastomer.scattering import Scattering

FloatArray = npt.NDArray[np.float64]

_DIRECTIONS, _STEPS_A_RADIUS = 8, 8
_TOLERANCE = 1e-4  # of the amplitudes
_DIPOLE = 3  # power of the distance at which a coil's field falls


@dataclass(frozen=True)
class Reach:
    """Distances from the indenter's axis within which something counts.

    Parameters
    ----------
    states : float
        To the centre of the measured coil in m; states beyond are taken to have no response.
    coils : float
        To the centre of any coil in m; the currents in coils beyond are left out.
    error : float
        Of δ, in parts of its largest value, that follows.
    """

    states: float
    coils: float
    error: float


@dataclass(frozen=True, eq=False)
class Profile:
    """How the inductance changes fall with the distance, in parts of the largest.

    Parameters
    ----------
    radius : ndarray, shape (n,)
        Distances of a coil from the indenter's axis in m, rising from 0.
    own, mutual : ndarray, shape (n,)
        Largest |ΔL_aa| of a coil there in any direction, and |ΔL_ab| of one with another anywhere.
    """

    radius: FloatArray
    own: FloatArray
    mutual: FloatArray

    def mutual_at(self, distance: FloatArray) -> FloatArray:
        """Mutual change at distances in m; that of a dipole where the profile ends."""
        end = self.radius[-1]
        far = np.maximum(distance, end)
        return np.asarray(np.interp(distance, self.radius, self.mutual) * (end / far) ** _DIPOLE)


def coil_profile(scattering: Scattering, spectra: CoilSpectra, farthest: float) -> Profile:
    """Measure how the changes by a dent fall with the distance of a coil.

    Parameters
    ----------
    scattering : Scattering
        The solved dent.
    spectra : CoilSpectra
        Of the coils, at its wavenumbers.
    farthest : float
        Distance in m up to which to go; the wavenumbers must resolve it.

    Returns
    -------
    Profile
        The largest values of all shapes of coils.
    """
    steps = max(int(np.ceil(_STEPS_A_RADIUS * farthest / spectra.radius)), 1)
    radius = np.linspace(0, farthest, steps + 1)
    angle = 2 * np.pi * (np.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS
    offsets = (radius[:, None, None] * np.column_stack((np.cos(angle), np.sin(angle)))).reshape(-1, 2)
    own, mutual = np.zeros((2, len(radius)))
    for shape in range(len(spectra.series)):
        places = [offsets if other == shape else offsets[:0] for other in range(len(spectra.series))]
        dent = dent_amplitudes(scattering, spectra, places, _TOLERANCE)
        amplitudes = dent.amplitudes[shape]
        change = np.abs((amplitudes * dent.strengths) @ amplitudes.T)
        own = np.maximum(own, np.diag(change).reshape(len(radius), -1).max(axis=1))
        mutual = np.maximum(mutual, change.max(axis=0).reshape(len(radius), -1).max(axis=1))
    return Profile(radius, own / own.max(), mutual / own.max())


def reach_for(profile: Profile, states: StateSensitivity, centres: FloatArray, error: float) -> Reach:
    """Choose how far states and coils count.

    Parameters
    ----------
    profile : Profile
        From `coil_profile`.
    states : StateSensitivity
        Of the scan.
    centres : ndarray, shape (coils, 2)
        In m.
    error : float
        Of δ, in parts of its largest value.

    Returns
    -------
    Reach
        `states` is infinite where the profile ends before it falls to the error.

    Notes
    -----
    A state that is left out would have responded by ΔL_aa + 2 i_b ΔL_ab or less, with the dent under a coil b. The
    coils beyond a distance add Σ_b 2 |i_b ΔL_ab| or less to a state with the dent under its own coil; they may be
    nearer to a dent beside it, so half of the error is for them.
    """
    distance = np.hypot(*(centres[:, None] - centres[states.measured]).transpose(2, 0, 1))
    shared = 2 * np.abs(states.currents) * profile.mutual_at(distance)
    shared[states.measured, np.arange(len(states.measured))] = 0
    own = _state_reach(profile, distance, shared, error)
    return Reach(own, max(own, _coil_reach(distance, shared, error / 2)), error)


def _state_reach(profile: Profile, distance: FloatArray, shared: FloatArray, error: float) -> float:
    """Distance beyond which no state responds; infinite where the profile ends before."""
    order = np.argsort(distance, axis=None)
    beyond = np.maximum.accumulate(shared.ravel()[order][::-1])[::-1]
    most_shared = np.append(beyond, 0.0)[np.searchsorted(distance.ravel()[order], profile.radius)]
    own = np.maximum.accumulate(profile.own[::-1])[::-1]
    found = np.flatnonzero(own + most_shared <= error)
    return float(profile.radius[found[0]]) if len(found) else np.inf


def _coil_reach(distance: FloatArray, shared: FloatArray, error: float) -> float:
    """Distance beyond which all coils together add less than the error to any state."""
    order = np.argsort(distance, axis=0)
    beyond = np.cumsum(np.take_along_axis(shared, order, axis=0)[::-1], axis=0)[::-1]
    needed = np.where(beyond > error, np.take_along_axis(distance, order, axis=0), 0.0)
    return float(needed.max()) * (1 + 1e-9)  # the coil there counts
