"""Deformed shape of indented magnetic sheets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from coilarray.compute.arrays import FloatArray
from coilarray.errors import ElastomerError
from coilarray.geometry import Sheet

_STILL = 1e-3  # of the deepest displacement, the dent ends where no face moves by more
_FADE = 8  # points beyond the known radii
_ZONE = 4.0  # extent of the moved air below and above, in depths of the dent


@dataclass(frozen=True)
class Motion:
    """Small rigid motion of all sheets together with their indentation.

    They are lifted by `lift` in m, and rise along x and y by `slope` about the height `pivot`.
    """

    lift: float = 0.0
    slope: tuple[float, float] = (0.0, 0.0)
    pivot: float = 0.0


STILL = Motion()


@dataclass(frozen=True, eq=False)
class Dent:
    """Deformed surfaces of sheets that move vertically around an indenter.

    The flat sheets have `thicknesses` in m and relative `permeabilities`, upwards from z = 0. At
    every `radius` (n,), rising from 0 at the indenter's axis, `displacement` (n, sheets + 1) is
    that of every face from the board to the top, both in m, and negative in the indentation. The
    `symmetry` is "axial" for a body of revolution or "plane" for the same everywhere along y. The
    sheets may be in `motion` together, which the other values do not include: changes by the dent
    are relative to flat sheets with the same motion. Shapes that do not fit, values that are not
    finite, or faces that cross raise an ElastomerError.
    """

    thicknesses: tuple[float, ...]
    permeabilities: tuple[float, ...]
    radius: FloatArray
    displacement: FloatArray
    symmetry: Literal["axial", "plane"] = "axial"
    motion: Motion = STILL

    def __post_init__(self) -> None:
        if self.displacement.shape != (len(self.radius), len(self.thicknesses) + 1):
            raise ElastomerError(
                f"a dent in {len(self.thicknesses)} sheets known at {len(self.radius)} radii needs displacements of "
                f"shape ({len(self.radius)}, {len(self.thicknesses) + 1}); got {self.displacement.shape}."
            )
        if not (np.isfinite(self.radius).all() and np.isfinite(self.displacement).all()):
            raise ElastomerError("radii and displacements of a dent must be finite.")
        if self.radius[0] != 0 or (np.diff(self.radius) <= 0).any():
            raise ElastomerError(f"radii of a dent must rise from 0; they begin with {self.radius[:3]} m.")
        if 0 in self.contrasts and self.displacement[:, 0].any():
            raise ElastomerError(
                "a magnetic sheet cannot lie on a soft seat, where it would move in the plane of the coils by "
                f"{np.abs(self.displacement[:, 0]).max() * 1e3:.3g} mm; put a sheet of permeability 1 below it."
            )
        left = np.array(self.thicknesses) + np.diff(self.displacement, axis=1)
        if (left <= 0).any():
            sheet = int(np.argmin(left.min(axis=0)))
            raise ElastomerError(
                f"the faces of sheet {sheet + 1} cross in the dent: it is left {left.min():.4g} m thick."
            )

    @property
    def heights(self) -> FloatArray:
        """Heights of the flat faces in m from 0, shape (sheets + 1,)."""
        return np.concatenate(([0.0], np.cumsum(self.thicknesses)))

    def moved(self, motion: Motion) -> Dent:
        """Return the dent in sheets moved by a `motion`."""
        return replace(self, motion=motion)

    def faces(self, radius: FloatArray, derivative: int = 0) -> FloatArray:
        """Upward displacement of faces in m, or a radial derivative.

        `radius` (…,) is in m, and the shape is (…, sheets + 1). The displacement is a cubic spline,
        level on the axis and zero beyond `extent`.
        """
        level, straight = (np.zeros(self.displacement.shape[1]) for _ in range(2))
        spline = CubicSpline(self.radius, self.displacement, bc_type=((1, level), (2, straight)))
        values = spline(np.minimum(radius, self.extent), derivative)
        return np.where((radius < self.extent)[..., None], values, 0.0)

    @property
    def shape(self) -> tuple[object, ...]:
        """Values that determine the field apart from the motion."""
        return self.thicknesses, self.permeabilities, self.radius.tobytes(), self.displacement.tobytes()

    @property
    def extent(self) -> float:
        """Radius in m beyond which nothing moves."""
        return float(self.radius[-1])

    @property
    def width(self) -> float:
        """Radius in m beyond which the faces hardly move."""
        moved = np.abs(self.displacement).max(axis=1)
        return float(self.radius[np.flatnonzero(moved >= _STILL * moved.max())[-1]])

    @property
    def contrasts(self) -> tuple[int, ...]:
        """Faces that change the permeability, and alone affect the field."""
        mu = (*self.permeabilities, 1.0)
        before = (1.0, *self.permeabilities)
        return tuple(face for face in range(len(mu)) if mu[face] != before[face])

    @property
    def clearance(self) -> float:
        """Least height in m of a moved magnetic face, or inf."""
        lowest = [
            float((self.heights[face] + self.displacement[:, face]).min())
            for face in self.contrasts
            if np.ptp(self.displacement[:, face]) > 0
        ]
        return min(lowest, default=np.inf)

    def anchors(self, deepest: float | None = None) -> FloatArray:
        """Rising heights in m (n,) between which space moves: the contrasts between fixed heights.

        Nothing moves at the first and the last height. The first is missing if the lowest contrast
        is at z = 0. `deepest` is the largest displacement in m that the anchors must serve, by
        default the largest of this dent.
        """
        faces = list(self.contrasts)
        moved = float(np.abs(self.displacement[:, faces]).max()) if deepest is None else deepest
        zone = max([_ZONE * moved, *(self.thicknesses[face] for face in faces if face < len(self.thicknesses))])
        heights = self.heights[faces]
        low = [max(0.0, heights[0] - zone)] if heights[0] > 0 else []
        return np.array([*low, *heights, heights[-1] + zone])

    def anchored(self, radius: FloatArray, derivative: int = 0) -> FloatArray:
        """Displacement in m of the `anchors` at a `radius` in m, or a radial derivative, shape (…, n)."""
        moved = self.faces(radius, derivative)[..., list(self.contrasts)]
        still = np.zeros((*radius.shape, 1))
        below = [still] if self.heights[self.contrasts[0]] > 0 else []
        return np.concatenate([*below, moved, still], axis=-1)


def dent_of(indentation: xr.Dataset, sheets: Sequence[Sheet]) -> Dent:
    """Deformed shape of the sheets at one depth.

    The indentation is one depth of the result of `coilarray.elastomer.contact.indent`. A face
    passes through its displaced points, (r + u_r, z + u_z) for finite strain and (r, z + u_z) for
    linear elasticity. With u_r the linear result would add volume to the sheets, of the order of
    the strain squared. Between the points the height is a cubic spline. Beyond the last point it
    returns to the flat height within a thickness of the stack, because the field treats the sheets
    as laterally infinite. Raises ElastomerError for a dataset of several depths or of other sheets,
    a face that folds over, or a magnetic sheet on a soft seat.
    """
    if "depth" in indentation.displacement_z.dims:
        raise ElastomerError("a dent is the shape at one depth; select one of the indentation's depths.")
    faces = indentation.interface.values.tolist()
    if faces[1:] != [sheet.name for sheet in sheets]:
        raise ElastomerError(f"the indentation is of the sheets {faces[1:]}; got {[sheet.name for sheet in sheets]}.")
    r = indentation.r.values
    outwards = indentation.displacement_r if indentation.attrs["strain"] == "finite" else 0 * indentation.displacement_r
    displaced = r[:, None] + outwards.transpose("r", "interface").values
    upwards = indentation.displacement_z.transpose("r", "interface").values
    displaced[0] = 0.0
    # beyond the known radii the influence has decayed or the sample ends: level again within a
    # thickness of the stack
    fade = np.linspace(0, 1, _FADE + 1)[1:]
    beyond = max(float(displaced[-1].max()), float(r[-1])) + fade * float(indentation.height[-1])
    r = np.append(r, beyond)
    displaced = np.vstack((displaced, np.repeat(beyond[:, None], len(faces), axis=1)))
    upwards = np.vstack((upwards, np.outer(1 - fade**2 * (3 - 2 * fade), upwards[-1])))
    if (np.diff(displaced, axis=0) <= 0).any():
        face = faces[int(np.argmin(np.diff(displaced, axis=0).min(axis=0)))]
        raise ElastomerError(f"the upper face of {face} folds over at this depth.")
    shape = np.column_stack([CubicSpline(displaced[:, face], upwards[:, face])(r) for face in range(len(faces))])
    return Dent(
        tuple(sheet.thickness for sheet in sheets),
        tuple(sheet.relative_permeability for sheet in sheets),
        r,
        shape,
        indentation.attrs["symmetry"],
    )
