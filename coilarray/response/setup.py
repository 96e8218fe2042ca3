"""Setup of a map: axes, true sheets, contacts and dents."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Literal

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.circuit.board_circuit import BoardCircuit
from coilarray.circuit.network import Network
from coilarray.compute.arrays import FloatArray
from coilarray.compute.store import kept_dataset
from coilarray.design.bundled import names_with
from coilarray.design.model import Design, Indentation
from coilarray.elastomer.contact import DEFAULT_MESH, indent
from coilarray.elastomer.contact_grid import ContactMesh
from coilarray.elastomer.dent import Dent, Motion, dent_of
from coilarray.elastomer.finite_sample import Sample, SampleCorrection, sample_correction
from coilarray.electromagnetics.flat_layer import layer_inductance, magnetic_slab
from coilarray.errors import CoilarrayError, ElastomerError, MetalError
from coilarray.geometry import Hemisphere, Indenter, Paraboloid, Sheet, Target
from coilarray.geometry.elastomer import Base, Strain
from coilarray.metal.backing import require_below

_FARTHEST = 1.0  # m
_STEEPEST = 0.1  # slope of a sample. Beyond it the wedge's own slope would count
_LEVEL = 1e-9  # relative difference of heights that counts as zero
# A finite sample's dent is a wide sample's at another depth, lifted and turned: parts of the depth
# that are solved (at 0 there is no dent), and the lift in m and the slope of the derivatives.
_DEPTH_PARTS = (1.0, 0.85)
_LIFT, _SLOPE = 1e-5, 1e-3
_WEDGE_NODES = 4  # thicknesses at which a tilted sample is solved, with a cubic between them


@dataclass(frozen=True)
class Imperfections:
    """Deviations of the experiment from the design.

    Raises ElastomerError for a value that is not finite, a tilt above 0.1, or noise or a seed that
    is negative, and MetalError for a `rest` below 0.

    Parameters
    ----------
    tilt : tuple of float
        Rise of the sample's top along x and y in m per m, as a wedge of the lowest sheet. The
        indenter keeps its height at the origin of the map, so the depth grows where it rises.
    offset : tuple of float
        True minus assumed position of the indenter along x and y in m.
    depth_error : float
        True minus assumed depth in m, for example because the contact was detected too late.
    thickness_errors : mapping of str to float
        True minus designed thickness in m, by the name of the sheet.
    noise : float
        Relative standard deviation of every reading, L_peak and L_0.
    seed : int
        Seed of the noise.
    drift : float
        Change of δ from the first to the last position of the map in the order of a campaign (row
        after row, x rising, all depths at one place): a drift of L since L_0 was read.
    column_drift : float
        The same for a campaign that goes column after column, y rising.
    rest : float
        Height in m of an indenter with a material over the sheets while L_0 is read, 0 as in a
        campaign, inf for far away.
    network : Network or "ideal", optional
        Coils, switches and strays under the flat sheets, in place of the design's own with the
        true thicknesses. "ideal" leaves AC resistance and all strays out.
    """

    tilt: tuple[float, float] = (0.0, 0.0)
    offset: tuple[float, float] = (0.0, 0.0)
    depth_error: float = 0.0
    thickness_errors: Mapping[str, float] = field(default_factory=dict)
    noise: float = 0.0
    seed: int = 0
    drift: float = 0.0
    column_drift: float = 0.0
    rest: float = 0.0
    network: Network | Literal["ideal"] | None = None

    def __post_init__(self) -> None:
        drifts = (self.drift, self.column_drift)
        errors = (self.depth_error, *self.thickness_errors.values(), *drifts, self.noise)
        numbers = [*self.tilt, *self.offset, *errors]
        if not np.isfinite(numbers).all():
            raise ElastomerError(f"tilt, offset, errors, drift and noise must be finite; got {numbers}.")
        if max(map(abs, self.tilt)) > _STEEPEST:
            raise ElastomerError(f"tilt must be at most {_STEEPEST}, as it is taken to be small; got {self.tilt}.")
        for name in ("noise", "seed"):
            if getattr(self, name) < 0:
                raise ElastomerError(f"{name} must not be negative; got {getattr(self, name)}.")
        if not self.rest >= 0:
            raise MetalError(f"rest must be at least 0; got {self.rest} m.")


@dataclass(frozen=True, eq=False)
class MapAxes:
    """Rising depths and positions of a map from its origin."""

    depth: FloatArray
    x: FloatArray
    y: FloatArray

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of depths, of positions along y and along x."""
        return len(self.depth), len(self.y), len(self.x)

    def order(self, along: Literal["rows", "columns"]) -> FloatArray:
        """Order (depth, places) of a campaign, from 0 to 1.

        It goes row after row, x rising, or column after column, y rising, with all depths at one
        place, and has the shape (depth, places).
        """
        depths, rows, columns = self.shape
        shape = (rows, columns, depths) if along == "rows" else (columns, rows, depths)
        number = np.linspace(0.0, 1.0, depths * rows * columns).reshape(shape)
        return np.moveaxis(number if along == "rows" else number.swapaxes(0, 1), -1, 0).reshape(depths, -1)

    @property
    def places(self) -> FloatArray:
        """Positions (n, 2) of the map in m, x fastest."""
        return np.stack(np.meshgrid(self.x, self.y), axis=-1).reshape(-1, 2)


@dataclass(frozen=True, eq=False)
class Level:
    """Level sample with weights.

    The weighted sum of several is a tilted or a finite sample. `shares` (depths, places) is the
    weight. A `coarse` sample is part of a small difference, so a coarser mesh suffices.
    """

    contact: xr.Dataset
    dents: tuple[Dent, ...]
    shares: FloatArray
    coarse: bool = False


@dataclass(frozen=True, eq=False)
class Experiment:
    """Everything that is pressed in a map.

    The `design` has the true thicknesses. `axes` are assumed, and `points` (n, 2) the true
    positions on the board in m, x fastest. `contact` is at the map's origin. `above` (depths,) is
    the height in m over the sheets at depths below 0.
    """

    sheets: tuple[Sheet, ...]
    axes: MapAxes
    origin: tuple[float, float]
    points: FloatArray
    contact: xr.Dataset
    levels: tuple[Level, ...]
    above: FloatArray
    correction: SampleCorrection | None = None


def no_indentation(design: Design) -> str:
    """Return the error line for a design without an indentation."""
    bundled = ", ".join(names_with("indentation"))
    return (
        f"the design {design.name} has no [indenter] and [indentation], which say what presses on the board; "
        f"bundled designs that have them are {bundled}."
    )


def indentation_of(design: Design) -> Indentation:
    """Return the indentation of a design, else raise an ElastomerError."""
    if design.indentation is None:
        raise ElastomerError(no_indentation(design))
    return design.indentation


def target_of(design: Design) -> Target:
    """Return the target of a design, else raise a MetalError."""
    if design.target is None:
        bundled = ", ".join(names_with("target"))
        raise MetalError(
            f'the design {design.name} has no [target]: add one, for example with shape = "disc", diameter_mm = 12, '
            'thickness_mm = 1 and material = "aluminium"; bundled designs '
            f"that have one are {bundled}."
        )
    return design.target


def map_axes(
    design: Design, depths: npt.ArrayLike | None = None, x: npt.ArrayLike | None = None, y: npt.ArrayLike | None = None
) -> MapAxes:
    """Return a map's axes, by default the design's own."""
    setup = indentation_of(design)
    require_below(design.plates)
    given = (("depths", depths, setup.depths), ("x", x, setup.x), ("y", y, setup.y))
    return MapAxes(*(checked_axis(name, default if values is None else values) for name, values, default in given))


def checked_axis(name: str, values: npt.ArrayLike, error: type[CoilarrayError] = ElastomerError) -> FloatArray:
    """Return a finite, rising axis in m within 1 m."""
    array = np.atleast_1d(np.asarray(values, dtype=np.float64))
    if array.ndim != 1 or not array.size or not np.isfinite(array).all() or (np.diff(array) <= 0).any():
        raise error(f"{name} must be finite and rising, in m; got {array}.")
    if np.abs(array).max() > _FARTHEST:
        limit = f"at most {_FARTHEST * 1e3:g} mm from the map's origin"
        raise error(f"{name} must be {limit}; got {array * 1e3} mm.")
    return array


def experiment(
    setup: Indentation, sheets: Sequence[Sheet], axes: MapAxes, imperfections: Imperfections | None = None
) -> Experiment:
    """Solve the contacts and dents of a map.

    There are no dents at depths below 0. More than one magnetic region, and a contact that is
    outside the sample or lost on a tilted sample, raise an ElastomerError.
    """
    true = imperfections or Imperfections()
    names = [sheet.name for sheet in sheets]
    for name in true.thickness_errors:
        if name not in names:
            raise ElastomerError(f"thickness_errors names the sheet {name!r}; there are {', '.join(names)}.")
    sheets = tuple(
        replace(sheet, thickness=sheet.thickness + true.thickness_errors.get(sheet.name, 0.0)) for sheet in sheets
    )
    magnetic_slab(sheets)  # refuses more than one magnetic region before the work begins
    given, places = axes.depth + true.depth_error, axes.places + true.offset
    above = np.maximum(-given, 0.0) if setup.ball is not None else np.zeros_like(given)
    depths = given + above
    bounded = setup.sample_bounds is not None and setup.sample_radius is None
    parts = _DEPTH_PARTS if bounded else (1.0,)
    pressed = contact_at(setup, sheets, np.unique(np.outer(parts, depths)))
    contact = _at_depths(pressed, depths)
    levels = _levels(setup, sheets, contact, depths, places, true.tilt)
    if setup.sample_bounds is not None:
        x_min, y_min, x_max, y_max = setup.sample_bounds
        radius = max(float(level.contact.contact_radius.max()) for level in levels)
        out = (places < [x_min + radius, y_min + radius]) | (places > [x_max - radius, y_max - radius])
        if out.any():
            x, y = places[int(np.flatnonzero(out.any(axis=1))[0])] * 1e3
            raise ElastomerError(
                f"at ({x:.4g}, {y:.4g}) mm the contact of {radius * 1e3:.3g} mm radius is outside the sample, "
                f"which reaches from ({x_min * 1e3:.4g}, {y_min * 1e3:.4g}) to "
                f"({x_max * 1e3:.4g}, {y_max * 1e3:.4g}) mm."
            )
    origin = setup.origin_point
    wide = Experiment(sheets, axes, origin, places + origin, contact, levels, above)
    return _finite(setup, wide, pressed, places, depths) if bounded else wide


def _finite(
    setup: Indentation, wide: Experiment, pressed: xr.Dataset, places: FloatArray, depths: FloatArray
) -> Experiment:
    """Turn a wide sample's experiment into a finite sample's.

    A finite sample's dent is the dent of the wide sample at a depth that follows the rise of the
    top under the indenter. A rise and a slope of everything there move the dent with them, which
    changes its effect on the field. Both are weighted sums of dents, whose weights add up to zero
    beside the weights of the wide sample. A round tip presses equally on a slope, so that the dent
    turns about the tip's centre. Other tips are taken for pivots themselves. The rest,
    `SampleCorrection.moved`, is to first order in `coilarray.elastomer.finite_sample`.
    """
    assert setup.sample_bounds is not None
    sample, sheets, contact = Sample(setup.sample_bounds, setup.unevenness), wide.sheets, wide.contact
    parts = np.array([*_DEPTH_PARTS, 0.0])
    contacts = [contact, *(_at_depths(pressed, depths * part) for part in _DEPTH_PARTS[1:])]
    slope = np.zeros(len(depths))  # F'/F
    loaded = contact.force.values > 0
    force = np.array([one.force.values[loaded] for one in contacts])
    slopes_of_lagrange = np.linalg.inv(np.vander(parts - parts[0], increasing=True))[1]  # at the first part
    slope[loaded] = slopes_of_lagrange[:-1] @ force / force[0] / depths[loaded]
    given = places, contact.r.values, contact.pressure.values, slope
    correction = _kept_correction(_elastic(sheets), setup.base, sample, *(values.tobytes() for values in given))
    relative = 1 + correction.depth / np.where(depths > 0, depths, 1.0)[:, None]
    shares = _lagrange(parts, relative.ravel())[:, :-1].reshape(*relative.shape, -1)
    magnetic = dents_of(contact, sheets)
    rise, slopes = correction.at_indenter(places, magnetic[0].contrasts)
    tip = setup.indenter.radius if isinstance(setup.indenter, Hemisphere | Paraboloid) else 0.0
    pivots = magnetic[0].heights[-1] - depths + tip
    motions = [
        [Motion(lift=_LIFT)] * len(depths),
        *([Motion(slope=slope, pivot=float(pivot)) for pivot in pivots] for slope in ((_SLOPE, 0.0), (0.0, _SLOPE))),
    ]
    moved = [rise / _LIFT, *(np.moveaxis(slopes, -1, 0) / _SLOPE)]
    shares[..., 0] -= 1 + sum(moved)
    levels = [
        Level(contact, tuple(map(Dent.moved, magnetic, motion)), share, coarse=True)
        for motion, share in zip(motions, moved, strict=True)
    ]
    deeper = [
        Level(one, dents_of(one, sheets), share, coarse=True)
        for one, share in zip(contacts, np.moveaxis(shares, -1, 0), strict=True)
    ]
    return replace(wide, levels=(*wide.levels, *deeper, *levels), correction=correction)


def _at_depths(contact: xr.Dataset, depths: FloatArray) -> xr.Dataset:
    return contact.isel(depth=np.abs(contact.depth.values - depths[:, None]).argmin(axis=1))


def contact_at(setup: Indentation, sheets: Sequence[Sheet], depths: npt.ArrayLike) -> xr.Dataset:
    """Return the contact of the indentation at depths in m.

    The last contacts stay in memory, as often only coils vary. Contacts of finite strain are kept
    on disk too (`coilarray.compute.files.keep_results`).
    """
    at = tuple(np.atleast_1d(np.asarray(depths, dtype=np.float64)).tolist())
    return _kept_contact(
        _elastic(sheets), setup.indenter, at, setup.base, setup.sample_radius, setup.strain, DEFAULT_MESH
    )


@lru_cache(maxsize=8)
def _kept_contact(
    sheets: tuple[Sheet, ...],
    indenter: Indenter,
    depths: tuple[float, ...],
    base: Base,
    radius: float | None,
    strain: Strain,
    mesh: ContactMesh,
) -> xr.Dataset:

    def solve() -> xr.Dataset:
        return indent(sheets, indenter, depths, base=base, radius=radius, strain=strain, accuracy=mesh)

    if strain == "linear":
        return solve()
    return kept_dataset(("contact", sheets, indenter, depths, base, radius, strain, mesh), solve)


@lru_cache(maxsize=1)
def _kept_correction(
    sheets: tuple[Sheet, ...], base: Base, sample: Sample, places: bytes, r: bytes, pressure: bytes, slope: bytes
) -> SampleCorrection:
    """Solve a finite sample once, with arrays given as bytes."""
    at, radii, values, slopes = (np.frombuffer(array) for array in (places, r, pressure, slope))
    return sample_correction(sheets, base, sample, at.reshape(-1, 2), radii, values.reshape(-1, len(radii)), slopes)


def _elastic(sheets: Sequence[Sheet]) -> tuple[Sheet, ...]:
    """Sheets without their permeability, which does not affect the contact."""
    return tuple(replace(sheet, relative_permeability=1.0) for sheet in sheets)


def together(levels: Iterable[Level]) -> list[list[Level]]:
    """Group level samples with the same sheets and accuracy."""
    groups: dict[object, list[Level]] = {}
    for level in levels:
        groups.setdefault((level.dents[0].thicknesses, level.coarse), []).append(level)
    return list(groups.values())


def dents_of(contact: xr.Dataset, sheets: Sequence[Sheet]) -> tuple[Dent, ...]:
    """Return the dented sheets at every depth of a contact."""
    return tuple(dent_of(contact.isel(depth=k), sheets) for k in range(contact.sizes["depth"]))


def _raised(sheets: Sequence[Sheet], height: float) -> tuple[Sheet, ...]:
    """Sheets whose lowest sheet is thicker by `height` in m."""
    return (replace(sheets[0], thickness=sheets[0].thickness + height), *sheets[1:])


def _levels(
    setup: Indentation,
    sheets: Sequence[Sheet],
    contact: xr.Dataset,
    depths: FloatArray,
    places: FloatArray,
    tilt: tuple[float, float],
) -> tuple[Level, ...]:
    """Level samples whose weighted sum is the sample everywhere."""
    rise = places @ np.array(tilt)
    if not rise.any():
        return (Level(contact, dents_of(contact, sheets), np.ones((len(depths), len(places)))),)
    lowest = float(rise.min())
    if depths[0] + lowest <= 0:
        raise ElastomerError(
            f"the indenter at a depth of {depths[0] * 1e3:.4g} mm has no contact where the tilted sample is "
            f"{-lowest * 1e3:.4g} mm lower than at the origin."
        )
    if np.ptp(rise) <= _LEVEL * abs(lowest):  # one place, or a line along which nothing rises
        heights, shares = np.array([lowest]), np.ones((len(places), 1))
    else:
        heights = _nodes(lowest, float(rise.max()))
        shares = _lagrange(heights, rise)
    levels = []
    for height, share in zip(heights.tolist(), shares.T, strict=True):
        raised = _raised(sheets, height)
        indented = contact_at(setup, raised, depths + height)
        levels.append(Level(indented, dents_of(indented, raised), np.tile(share, (len(depths), 1))))
    return tuple(levels)


def wedge_inductance(circuit: BoardCircuit, origin: tuple[float, float], tilt: tuple[float, float]) -> FloatArray:
    """Inductance change in H by a flat tilted sample.

    Each pair of coils takes the thickness of the sample in the middle between them. The tilt is
    about `origin`.
    """
    design = circuit.design
    centres = design.centres[:, :2] - origin
    middle = (centres[:, None] + centres) / 2 @ np.array(tilt)
    if not middle.any():
        return np.zeros_like(middle)
    heights = _nodes(float(min(middle.min(), 0.0)), float(max(middle.max(), 0.0)))

    def level(height: float) -> FloatArray:
        """Inductance matrix in H for a sample of one height."""
        sheets = _raised(design.sheets, height)
        change = layer_inductance(design.paths, sheets)
        if circuit.plates is None:
            return change
        working = circuit.plates.working
        return (
            change + replace(circuit.windings, sheets=sheets).plate_effect(design.plates, working, working).inductance
        )

    shares = _lagrange(heights, middle.ravel()).reshape(*middle.shape, -1)
    raised = np.array([level(height) for height in heights.tolist()])
    return np.asarray(np.einsum("ijh,hij->ij", shares, raised) - level(0.0))


def _nodes(low: float, high: float) -> FloatArray:
    """Chebyshev points of an interval."""
    angle = np.pi * (np.arange(_WEDGE_NODES) + 0.5) / _WEDGE_NODES
    return (low + high) / 2 + (high - low) / 2 * np.cos(angle)


def _lagrange(nodes: FloatArray, at: FloatArray) -> FloatArray:
    shares = np.ones((len(at), len(nodes)))
    for k, node in enumerate(nodes):
        for other in np.delete(nodes, k):
            shares[:, k] *= (at - other) / (node - other)
    return shares
