"""Change of the inductance matrix by an indentation, at every position."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.compute.threads import Progress
from coilarray.constants import MU_0
from coilarray.elastomer.dent import Dent
from coilarray.elastomer.dent_energy import dent_energies
from coilarray.elastomer.scattering import LayerMesh, Scattering, scatter
from coilarray.elastomer.shortcuts import born, first_order
from coilarray.electromagnetics.coil_spectrum import coil_segments
from coilarray.electromagnetics.flat_stack import Backing
from coilarray.electromagnetics.source import Source, as_conductors
from coilarray.errors import ElastomerError

Model: TypeAlias = Literal["full", "first order", "Born"]


def dent_inductance(
    source: Source,
    dents: Sequence[Dent],
    positions: npt.ArrayLike,
    mesh: LayerMesh | None = None,
    model: Model = "full",
    *,
    progress: Progress | None = None,
) -> FloatArray:
    """Change of the inductance matrix in H by dented sheets.

    The change is relative to the flat sheets.

    Parameters
    ----------
    source : CoilArray, Conductor, polyline or sequence of them
        Coils at z ≤ 0. A path whose ends lie apart is closed by a straight line between them.
    dents : sequence of Dent
        Dents in the same sheets, for example one for each depth.
    positions : array_like, shape (positions, 2)
        Positions of the indenter's axis in m.
    mesh : LayerMesh, optional
        Accuracy.
    model : {"full", "first order", "Born"}
        Full solution of the dented sheets, or one of the two approximations of `coilarray.elastomer.shortcuts`, which
        serve for comparison. For 1 mm in a sheet of 2 mm "first order" is 13 to 18 % low. "Born" is right at the centre
        by chance, wrong by a factor of two on the flank, and of the wrong sign in M.
    progress : callable, optional
        Called with (done, total) as the work goes on.

    Returns
    -------
    ndarray, shape (dents, positions, coils, coils)
        Inductance in H, dented minus flat. The matrices are symmetric.

    Raises
    ------
    ElastomerError
        Positions that are not finite, coils that are not below the sheets, dents of different sheets or in plane
        strain, another model, or a magnetic face that comes too close to the coils.

    Notes
    -----
    The coils' field in harmonics about the indenter (`coil_spectrum`) is scattered by the dent (`scattering`): ΔL_ij =
    2π μ0 Σ_m b_i,m* Γ_m b_j,m with b = c_m(k) k dk/2π. Nothing is linearised in the depth. The sheets are taken as
    laterally infinite, and their permeability as unchanged by strain.

    Examples
    --------
    >>> import numpy as np
    >>> r = np.linspace(0, 20e-3, 41)
    >>> shape = -0.5e-3 * np.exp(-((r / 4e-3) ** 2))
    >>> dent = Dent((4e-3, 2e-3), (1.0, 3.0), r, np.column_stack((0 * r, 0.6 * shape, shape)))
    >>> angle = np.linspace(0, 2 * np.pi, 25)
    >>> loop = np.column_stack((8e-3 * np.cos(angle), 8e-3 * np.sin(angle), 0 * angle))
    >>> change = dent_inductance([loop], [dent], [[0, 0], [12e-3, 0]])
    >>> np.round(change[0, :, 0, 0] * 1e12, 2)
    array([25.93,  0.23])
    """
    if model not in get_args(Model):
        raise ElastomerError(f"model must be one of {', '.join(get_args(Model))}; got {model!r}.")
    return np.asarray(_changes(source, dents, positions, mesh or LayerMesh(), model, None, progress))


def dent_inductance_over(
    backing: Backing,
    source: Source,
    dents: Sequence[Dent],
    positions: npt.ArrayLike,
    mesh: LayerMesh | None = None,
    *,
    progress: Progress | None = None,
) -> ComplexArray:
    """Change of the impedance matrix over conducting or magnetic layers.

    The result (dents, positions, coils, coils) is ΔL − jΔR/ω in H, dented minus flat, symmetric. The `backing` has the
    layers below the coils and the currents in other metal there, at one frequency. The rest is as for
    `dent_inductance`.

    The result includes the reflection by the layers of the coils' field and of the dent's own field, see
    `coilarray.elastomer.scattering`. The reflection of the dent's own field is 0.3 % of the change in the sheets of
    gast2020 on a board of 1.6 mm, and 2 % if it comes within 1.4 mm of a plate. Currents in the backing are the
    currents without the dent, so their response to the dent's own field is left out. Under tilted sheets,
    `Dent.motion`, each wave is tilted like the wave of a mirrored coil.

    Aluminium 2 mm below the loop removes two thirds of the change by the dent.

    >>> import numpy as np
    >>> from coilarray.electromagnetics.flat_stack import Layer
    >>> r = np.linspace(0, 20e-3, 41)
    >>> shape = -0.5e-3 * np.exp(-((r / 4e-3) ** 2))
    >>> dent = Dent((4e-3, 2e-3), (1.0, 3.0), r, np.column_stack((0 * r, 0.6 * shape, shape)))
    >>> angle = np.linspace(0, 2 * np.pi, 25)
    >>> loop = np.column_stack((8e-3 * np.cos(angle), 8e-3 * np.sin(angle), 0 * angle))
    >>> plate = Backing(-2e-3, (Layer(1e-3, 1.0, 3.5e7),), 1e6)
    >>> np.round(dent_inductance_over(plate, [loop], [dent], [[0, 0]])[0, 0, 0, 0] * 1e12, 2)
    np.complex128(8.09-0.22j)
    """
    return np.asarray(_changes(source, dents, positions, mesh or LayerMesh(), "full", backing, progress))


def _changes(
    source: Source,
    dents: Sequence[Dent],
    positions: npt.ArrayLike,
    mesh: LayerMesh,
    model: Model,
    backing: Backing | None,
    progress: Progress | None,
) -> FloatArray | ComplexArray:
    """Compute ΔL, or ΔL − jΔR/ω over a backing, in H, dented minus flat."""
    paths = as_conductors(source)
    highest = max(float(path.vertices[:, 2].max()) for path in paths)
    if highest > 0:
        raise ElastomerError(f"coils must lie at z <= 0, below the sheets; one reaches z = {highest:.4g} m.")

    def solve(dent: Dent, wavenumbers: FloatArray, weights: FloatArray, deepest: float) -> Scattering:
        """Scatter the waves of the coils by the chosen model."""
        if model == "full":
            return scatter(dent, wavenumbers, weights, mesh, deepest)
        shortcut = {"first order": first_order, "Born": born}[model]
        return shortcut(dent, wavenumbers, weights, mesh.harmonics)

    return MU_0 * dent_energies(dents, positions, coil_segments(paths), solve, mesh, backing=backing, progress=progress)
