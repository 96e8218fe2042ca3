"""The response of the sensor: what an indentation anywhere on the board does to every state of the scan."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.circuit.coupling import design_inductance, provenance
from coilarray.circuit.network import Network, resonances_near, resonate
from coilarray.compute.memory import require_memory
from coilarray.compute.netcdf import load_part, save_dataset
from coilarray.compute.threads import Progress, ranges
from coilarray.design.model import Design, Indentation
from coilarray.design.scan_states import ScanState
from coilarray.elastomer.dent import Dent, dent_of
from coilarray.elastomer.dented_layer import dent_inductance
from coilarray.elastomer.dielectric import dent_capacitance
from coilarray.elastomer.flat_layer import layer_inductance, magnetic_slab
from coilarray.elastomer.scattering import LayerMesh
from coilarray.electromagnetics.resistance import dc_resistance
from coilarray.errors import ElastomerError
from coilarray.geometry import Conductor, Sheet
from coilarray.response.setup import contact_at, indentation_of, map_axis, require_inside

FloatArray = npt.NDArray[np.float64]

_POSITIONS = 1000  # in a part of a resumable map, which is of one depth
_FORMAT = "1"  # of parts; to be raised where the numerics change
_STEEPEST = 0.1  # slope of a sample; beyond it the wedge's own slope would count
_MOST_VALUES = 100_000_000  # of the inductance changes: 0.8 GB
_BYTES_A_VALUE = 24.0  # the change, the inductances that the circuit takes, and a copy on the way
_CIRCUIT_VALUES = 5_000_000  # of all circuit matrices solved at once: 80 MB
_LEVEL = 1e-9  # relative difference of heights that is none
_WEDGE_NODES = (
    4  # thicknesses at which a tilted sample is solved; between them a cubic (tests/response/test_response.py)
)


@dataclass(frozen=True)
class Imperfections:
    """How the experiment differs from the design.

    Parameters
    ----------
    tilt : tuple of float
        Rise of the sample's top along x and y in m per m. The lowest sheet takes it up as a wedge. The indenter finds
        the contact at the origin of the map and keeps its height, so the depth grows where the sample rises.
    offset : tuple of float
        Where the indenter truly is less where it is believed to be, along x and y, in m.
    depth_error : float
        True depth less the believed one in m, for example a contact found too late.
    thickness_errors : mapping of str to float
        True thickness less the designed one in m, by the sheet's name.
    noise : float
        Relative standard deviation of every reading of an inductance; L_peak and L_0 are one reading each.
    seed : int
        Of the noise.

    Raises
    ------
    ElastomerError
        A value that is not finite, a tilt above 0.1, or noise or a seed that is negative.
    """

    tilt: tuple[float, float] = (0.0, 0.0)
    offset: tuple[float, float] = (0.0, 0.0)
    depth_error: float = 0.0
    thickness_errors: Mapping[str, float] = field(default_factory=dict)
    noise: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        numbers = [*self.tilt, *self.offset, self.depth_error, *self.thickness_errors.values(), self.noise]
        if not np.isfinite(numbers).all():
            raise ElastomerError(f"tilt, offset, errors and noise must be finite; got {numbers}.")
        if max(map(abs, self.tilt)) > _STEEPEST:
            raise ElastomerError(f"tilt must be at most {_STEEPEST}, for it is taken as small; got {self.tilt}.")
        if self.noise < 0:
            raise ElastomerError(f"noise must not be negative; got {self.noise}.")
        if self.seed < 0:
            raise ElastomerError(f"seed must not be negative; got {self.seed}.")


def response_map(
    design: Design,
    *,
    depths: npt.ArrayLike | None = None,
    x: npt.ArrayLike | None = None,
    y: npt.ArrayLike | None = None,
    imperfections: Imperfections | None = None,
    network: Network | None = None,
    inductance: Callable[[], FloatArray] | None = None,
    dielectric: bool = False,
    mesh: LayerMesh | None = None,
    parts: Path | None = None,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Compute the sensor response matrix of a design.

    Parameters
    ----------
    design : Design
        With the tables ``[indenter]`` and ``[indentation]``.
    depths, x, y : array_like, shape (n,), optional
        Depths and positions of the indenter in m, positions from the map's origin; those of the design by default.
    imperfections : Imperfections, optional
        None by default.
    network : Network, optional
        Coils, switches and strays, as `coilarray.circuit.impedance.design_network` makes them; its inductance matrix is
        replaced.
        By default the design's switches and direct-current resistances without stray capacitances, which change the
        response by less than 1 %.
    inductance : callable, optional
        Returns the first of `coilarray.circuit.coupling.design_inductance`, for the sheets as they truly are but for a
        tilt, where that is known or on its way; it is called after the dents are solved. Computed here by default.
    dielectric : bool
        Count also what the dent does to the coils' capacitance, which the converter takes for a change of L:
        `coilarray.elastomer.dielectric.dent_capacitance` with the design's permittivity. It is about 1e-7 of L.
    mesh : LayerMesh, optional
        Accuracy of the magnetic problem.
    parts : Path, optional
        Folder where finished parts of the map are kept, so that an interrupted run goes on from there.
    progress : callable, optional
        Called with (done, total) as the work goes on.

    Returns
    -------
    xarray.Dataset
        Dimensions ``depth``, ``y``, ``x``, ``state``, ``coil``, ``other``. ``delta`` (depth, y, x, state) is
        (L_peak − L_0)/L_0 as the converter sees it, L = 1/((2πf)² C); ``base_inductance`` (state) L_0 in H;
        ``inductance_change`` (depth, y, x, coil, other) in H, dented less flat, and ``inductance`` (coil, other) with
        flat sheets; ``capacitance_change`` (depth, y, x, coil) in F, zero where it is not asked for; ``force`` in N and
        ``contact_radius`` in m (depth). ``coil_x`` and ``coil_y`` are the centres in m from the map's origin.

    Raises
    ------
    ElastomerError
        A design that says nothing of an indentation, grids that are not finite and rising, a contact that is outside
        the sample or lost on a tilted one, and what `indent` and `dent_inductance` refuse.
    NetworkError
        A state without a resonance.
    MemoryLimitError
        More values than there is memory for.
    OutputError
        A part that cannot be written.

    Notes
    -----
    Eq. 2 of Gast & Zimmermann (2020). Every position is solved: contact, dented sheets, and the resonance of the whole
    circuit with the changed inductance matrix.

    Examples
    --------
    >>> from coilarray import load_design
    >>> response = response_map(load_design("gast2020"), x=[-13.28e-3, 0], y=[0])
    >>> response.delta.dims, response.delta.shape
    (('depth', 'y', 'x', 'state'), (1, 1, 2, 6))
    """
    setup = indentation_of(design)
    faults = imperfections or Imperfections()
    depth, along, across = (
        map_axis(name, default if given is None else given)
        for name, given, default in (("depths", depths, setup.depths), ("x", x, setup.x), ("y", y, setup.y))
    )
    mesh = mesh or LayerMesh()
    sheets = _true_sheets(design.sheets, faults.thickness_errors)
    grid = np.stack(np.meshgrid(along, across), axis=-1).reshape(-1, 2)
    places = grid + faults.offset
    _require_room(len(depth), len(grid), len(design.array.names))
    magnetic_slab(sheets)  # more than one magnetic region is refused before the work begins
    contact = contact_at(setup, sheets, depth + faults.depth_error)
    levels = _levels(setup, sheets, contact, depth + faults.depth_error, places, faults.tilt)
    require_inside(setup, places, max(float(level.contact.contact_radius.max()) for level in levels))
    coils = len(design.array.names)
    change, gained = np.zeros((len(depth), len(grid), coils, coils)), np.zeros((len(depth), len(grid), coils))
    steps = _Steps(progress, len(depth) * len(ranges(len(grid), _POSITIONS)) * len(levels))
    permittivity = design.circuit.elastomer_permittivity if dielectric else None
    for k in range(len(depth)):
        pressed = [replace(level, dents=level.dents[k : k + 1]) for level in levels]
        for start, stop in ranges(len(grid), _POSITIONS):
            on_board = places[start:stop] + setup.origin_point
            shares = [level.shares[start:stop] for level in pressed]
            where = (
                None if parts is None else parts / f"{_key(design, pressed, shares, on_board, permittivity, mesh)}.nc"
            )
            kept = None if where is None else _kept(where, (stop - start, coils))
            if kept is None:
                kept = _computed(design, pressed, shares, on_board, permittivity, mesh, steps)
                if where is not None:
                    save_dataset(kept, where)
            else:
                for _ in levels:
                    steps.next()
            change[k, start:stop], gained[k, start:stop] = kept.change.values, kept.gained.values
    L0 = design_inductance(replace(design, sheets=sheets))[0] if inductance is None else inductance()
    L0 = L0 + _wedge_under_coils(design, setup, sheets, faults.tilt)
    network = _plain_network(design, L0) if network is None else replace(network, inductance=L0)
    delta, base = _through_circuit(network, design.plan, change, gained)
    if faults.noise:
        delta = _noisy(delta, faults)
    return _dataset(design, setup, contact, (depth, along, across), delta, base, change, gained, L0)


def respond(
    design: Design,
    response: xr.Dataset,
    *,
    plan: Sequence[ScanState] | None = None,
    inductance_change: FloatArray | None = None,
) -> xr.Dataset:
    """Put a computed map through the circuit once more, with another scan plan or other inductance changes.

    Parameters
    ----------
    design : Design
        Of the map.
    response : xarray.Dataset
        As `response_map` returns it.
    plan : sequence of ScanState, optional
        The design's by default.
    inductance_change : ndarray, shape (depth, y, x, coil, other), optional
        In H; the map's own by default.

    Returns
    -------
    xarray.Dataset
        As `response_map`, without noise and stray capacitances.

    Raises
    ------
    NetworkError
        A state without a resonance, or one that names a coil that is not there.

    Examples
    --------
    >>> from coilarray import load_design
    >>> from coilarray.design.scan_states import ScanState
    >>> design = load_design("gast2020")
    >>> response = response_map(design, x=[0.0], y=[0.0])
    >>> alone = respond(design, response, plan=[ScanState("coil2", (("coil2", 1),), others="open")])
    >>> alone.delta.shape
    (1, 1, 1, 1)
    """
    states = design.plan if plan is None else tuple(plan)
    change = response.inductance_change.values if inductance_change is None else inductance_change
    n = change.shape[-1]
    flat = change.reshape(change.shape[0], -1, n, n)
    gained = response.capacitance_change.values.reshape(*flat.shape[:3])
    network = _plain_network(design, response.inductance.values)
    delta, base = _through_circuit(network, states, flat, gained)
    others = response.drop_dims("state")
    others["inductance_change"] = (response.inductance_change.dims, change, response.inductance_change.attrs)
    others["delta"] = (("depth", "y", "x", "state"), delta.reshape(*change.shape[:3], -1), response.delta.attrs)
    others["base_inductance"] = ("state", base, response.base_inductance.attrs)
    return others.assign_coords(state=[state.name for state in states])


def inductance_changes(
    design: Design, paths: Sequence[Conductor], response: xr.Dataset, imperfections: Imperfections
) -> FloatArray:
    """Inductance changes of other paths than the design's coils at every depth and place of a map.

    Parameters
    ----------
    design : Design
        Of the map; its sheets and indenter count.
    paths : sequence of Conductor
        In place of its coils.
    response : xarray.Dataset
        As `response_map` returns it, with the same imperfections.
    imperfections : Imperfections
        Of the experiment.

    Returns
    -------
    ndarray, shape (depth, y, x, paths, paths)
        In H, dented less flat.

    Raises
    ------
    ElastomerError
        As `response_map`.
    """
    setup = indentation_of(design)
    sheets = _true_sheets(design.sheets, imperfections.thickness_errors)
    depths = response.depth.values + imperfections.depth_error
    places = np.stack(np.meshgrid(response.x, response.y), axis=-1).reshape(-1, 2) + imperfections.offset
    levels = _levels(setup, sheets, contact_at(setup, sheets, depths), depths, places, imperfections.tilt)
    on_board = places + setup.origin_point
    change = sum(level.shares[:, None, None] * dent_inductance(paths, level.dents, on_board) for level in levels)
    return np.asarray(change).reshape(len(depths), response.sizes["y"], response.sizes["x"], len(paths), len(paths))


def _true_sheets(sheets: Sequence[Sheet], errors: Mapping[str, float]) -> tuple[Sheet, ...]:
    names = [sheet.name for sheet in sheets]
    for name in errors:
        if name not in names:
            raise ElastomerError(f"thickness_errors names the sheet {name!r}; there are {', '.join(names)}.")
    return tuple(replace(sheet, thickness=sheet.thickness + errors.get(sheet.name, 0.0)) for sheet in sheets)


def _raised(sheets: Sequence[Sheet], height: float) -> tuple[Sheet, ...]:
    """Return the sheets with a lowest one that is thicker by a height in m."""
    return (replace(sheets[0], thickness=sheets[0].thickness + height), *sheets[1:])


def _require_room(depths: int, places: int, coils: int) -> None:
    """Refuse a map that is too large before anything of it is computed."""
    values = depths * places * coils**2
    what = f"{depths} depths at {places} positions with {coils} coils"
    if values > _MOST_VALUES:
        raise ElastomerError(
            f"{what} are {values} inductance changes; at most {_MOST_VALUES} are allowed: compute the map in pieces."
        )
    require_memory(_BYTES_A_VALUE * values, f"a map of {what}", "compute it in pieces")


@dataclass(frozen=True, eq=False)
class _Level:
    """One of the level samples that stand in for a tilted one: its indentation, and its share at every place."""

    contact: xr.Dataset
    dents: tuple[Dent, ...]
    shares: FloatArray


def _levels(
    setup: Indentation,
    sheets: Sequence[Sheet],
    contact: xr.Dataset,
    depths: FloatArray,
    places: FloatArray,
    tilt: tuple[float, float],
) -> list[_Level]:
    """Level samples whose weighted sum is the sample at every place; one where it is not tilted."""
    rise = places @ np.array(tilt)
    if not rise.any():
        return [_Level(contact, _dents(contact, sheets), np.ones(len(places)))]
    lowest = float(rise.min())
    if depths[0] + lowest <= 0:
        raise ElastomerError(
            f"the indenter at depth {depths[0] * 1e3:.4g} mm loses contact where the tilted sample is "
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
        levels.append(_Level(indented, _dents(indented, raised), share))
    return levels


def _dents(indentation: xr.Dataset, sheets: Sequence[Sheet]) -> tuple[Dent, ...]:
    return tuple(dent_of(indentation.isel(depth=k), sheets) for k in range(indentation.sizes["depth"]))


def _wedge_under_coils(
    design: Design, setup: Indentation, sheets: Sequence[Sheet], tilt: tuple[float, float]
) -> FloatArray:
    """Change of the matrix in H by the tilt of the flat sample, each pair with the thickness between its coils."""
    centres = design.array.centres - setup.origin_point
    middle = (centres[:, None] + centres) / 2 @ np.array(tilt)
    if not middle.any():
        return np.zeros_like(middle)
    heights = _nodes(float(min(middle.min(), 0.0)), float(max(middle.max(), 0.0)))
    level = np.array([layer_inductance(design.array, _raised(sheets, height)) for height in heights.tolist()])
    shares = _lagrange(heights, middle.ravel()).reshape(*middle.shape, -1)
    return np.asarray(np.einsum("ijh,hij->ij", shares, level) - layer_inductance(design.array, sheets))


def _nodes(low: float, high: float) -> FloatArray:
    """Chebyshev points of an interval."""
    angle = np.pi * (np.arange(_WEDGE_NODES) + 0.5) / _WEDGE_NODES
    return (low + high) / 2 + (high - low) / 2 * np.cos(angle)


def _lagrange(nodes: FloatArray, at: FloatArray) -> FloatArray:
    """Lagrange's polynomials of the nodes at points, shape (points, nodes)."""
    shares = np.ones((len(at), len(nodes)))
    for k, node in enumerate(nodes):
        for other in np.delete(nodes, k):
            shares[:, k] *= (at - other) / (node - other)
    return shares


def _plain_network(design: Design, inductance: FloatArray) -> Network:
    R = np.diag(dc_resistance(design.array.conductors(), design.circuit.resistivity))
    none = np.zeros_like(inductance)
    return Network(design.array.names, inductance, lambda frequency: R, none[0], none, design.circuit.switches)


def _through_circuit(
    network: Network, plan: Sequence[ScanState], change: FloatArray, gained: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """δ of every depth, place and state, and L_0 of every state in H."""
    inductances = network.inductance + change.reshape(-1, *network.inductance.shape)
    capacitances = network.winding_capacitance + gained.reshape(-1, len(network.names))
    nodes_and_branches = 6 * len(network.names) + 5
    at_once = max(1, _CIRCUIT_VALUES // nodes_and_branches**2)
    delta = np.empty((*change.shape[:2], len(plan)))
    base = np.empty(len(plan))
    for k, state in enumerate(plan):
        flat = resonate(network, state)
        dented = np.concatenate(
            [
                resonances_near(network, flat, inductances[start:stop], capacitances[start:stop])
                for start, stop in ranges(len(inductances), at_once)
            ]
        )
        delta[..., k] = ((flat.frequency / dented) ** 2 - 1).reshape(change.shape[:2])
        base[k] = 1 / ((2 * np.pi * flat.frequency) ** 2 * network.switches.tank_capacitance)
    return delta, base


def _noisy(delta: FloatArray, faults: Imperfections) -> FloatArray:
    random = np.random.default_rng(faults.seed)
    peak, base = (1 + faults.noise * random.standard_normal(delta.shape) for _ in range(2))
    return (1 + delta) * peak / base - 1


def _key(
    design: Design,
    levels: Sequence[_Level],
    shares: Sequence[FloatArray],
    points: FloatArray,
    permittivity: float | None,
    mesh: LayerMesh,
) -> str:
    """Name of a part by everything that enters its numbers."""
    digest = hashlib.sha256(repr((_FORMAT, permittivity, mesh)).encode())
    arrays = [points, *shares, *(conductor.vertices for conductor in design.array.conductors())]
    for dent in (level.dents[0] for level in levels):
        digest.update(repr((dent.thicknesses, dent.permeabilities, dent.symmetry)).encode())
        arrays += [dent.radius, dent.displacement]
    for array in arrays:
        digest.update(repr(array.shape).encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:24]


def _kept(where: Path, size: tuple[int, int]) -> xr.Dataset | None:
    """Read a part of an earlier run; None where it is none of ours or damaged."""
    part = load_part(where)
    places, coils = size
    if part is None or not {"change", "gained"} <= set(part):
        return None
    whole = part.change.shape == (places, coils, coils) and part.gained.shape == (places, coils)
    return part if whole and np.isfinite(part.change.values).all() else None


def _computed(
    design: Design,
    levels: Sequence[_Level],
    shares: Sequence[FloatArray],
    points: FloatArray,
    permittivity: float | None,
    mesh: LayerMesh,
    steps: _Steps,
) -> xr.Dataset:
    """Inductance and capacitance changes of one depth at some places."""
    coils = len(design.array.names)
    change, gained = np.zeros((len(points), coils, coils)), np.zeros((len(points), coils))
    for level, share in zip(levels, shares, strict=True):
        part = dent_inductance(design.array, level.dents, points, mesh, progress=steps.within)
        change += share[:, None, None] * part[0]
        if permittivity is not None:
            gained += share[:, None] * dent_capacitance(design.array, level.dents, points, permittivity, mesh)[0]
        steps.next()
    if not (np.isfinite(change).all() and np.isfinite(gained).all()):
        raise ElastomerError("the dented sheets gave numbers that are not finite; please report the design.")
    dims = ("place", "coil", "other")
    return xr.Dataset({"change": (dims, change), "gained": (dims[:2], gained)})


def _dataset(
    design: Design,
    setup: Indentation,
    contact: xr.Dataset,
    axes: tuple[FloatArray, FloatArray, FloatArray],
    delta: FloatArray,
    base: FloatArray,
    change: FloatArray,
    gained: FloatArray,
    L0: FloatArray,
) -> xr.Dataset:
    depth, x, y = axes
    shape = (len(depth), len(y), len(x))
    centres = design.array.centres - setup.origin_point
    return xr.Dataset(
        {
            "delta": (
                ("depth", "y", "x", "state"), delta.reshape(*shape, -1),
                {"units": "1", "long_name": "relative change of inductance"},
            ),
            "base_inductance": ("state", base, {"units": "H", "long_name": "L_0 as the converter sees it"}),
            "inductance_change": (
                ("depth", "y", "x", "coil", "other"), change.reshape(*shape, *L0.shape),
                {"units": "H", "long_name": "inductance matrix, dented less flat"},
            ),
            "capacitance_change": (
                ("depth", "y", "x", "coil"), gained.reshape(*shape, -1),
                {"units": "F", "long_name": "capacitance of each coil, dented less flat"},
            ),
            "inductance": (("coil", "other"), L0, {"units": "H", "long_name": "inductance matrix, flat sheets"}),
            "force": ("depth", contact.force.values, {"units": "N"}),
            "contact_radius": ("depth", contact.contact_radius.values, {"units": "m"}),
        },
        coords={
            "depth": ("depth", depth, {"units": "m", "long_name": "depth of the indentation"}),
            "y": ("y", y, {"units": "m"}),
            "x": ("x", x, {"units": "m"}),
            "state": [state.name for state in design.plan],
            "coil": list(design.array.names),
            "other": list(design.array.names),
            "coil_x": ("coil", centres[:, 0], {"units": "m", "long_name": "centre of the coil, x"}),
            "coil_y": ("coil", centres[:, 1], {"units": "m", "long_name": "centre of the coil, y"}),
        },
        attrs={
            **provenance(design),
            "indenter": setup.indenter.name,
            "base": setup.base,
            "origin": setup.origin or "board",
        },
    )  # fmt: skip


class _Steps:
    """Counts parts of a map for a progress bar, in hundredths."""

    def __init__(self, progress: Progress | None, parts: int) -> None:
        self._progress, self._total, self._done = progress, 100 * parts, 0

    def within(self, done: int, total: int) -> None:
        """Count within a part."""
        self._tell(self._done + 99 * done // total)

    def next(self) -> None:
        """Count a whole part."""
        self._done += 100
        self._tell(self._done)

    def _tell(self, done: int) -> None:
        if self._progress is not None:
            self._progress(done, self._total)
