"""The response of large arrays: at every position only the coils and states within reach of the dent.

A dent changes the inductances of few coils: ΔL_aa falls as the sixth power of the distance, so that far states have no
response to speak of. In a state a that has one, the current of a far coil b meets the dent too, in 2 i_b ΔL_ab, which
falls as the third power; so the coils whose field counts reach further than the states that respond. What a position
costs depends on how many lie within reach, not on the size of the array.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt
import xarray as xr
from scipy.spatial import KDTree

from coilarray.circuit.coupling import design_inductance, provenance
from coilarray.circuit.state_sensitivity import StateSensitivity, state_sensitivity
from coilarray.compute.memory import require_memory
from coilarray.compute.threads import Progress, ranges, run_blocks
from coilarray.design.model import Design
from coilarray.elastomer.coil_spectrum import CoilSpectra, coil_centres, coil_spectra
from coilarray.elastomer.dent import Dent, dent_of
from coilarray.elastomer.dent_amplitudes import amplitude_table, dent_amplitudes, offset_grid
from coilarray.elastomer.flat_layer import magnetic_slab
from coilarray.elastomer.scattering import LayerMesh, Scattering, scatter, wavenumber_rule
from coilarray.electromagnetics.resistance import dc_resistance
from coilarray.errors import ElastomerError
from coilarray.geometry import Conductor
from coilarray.response.reach import Reach, coil_profile, reach_for
from coilarray.response.setup import contact_at, indentation_of, map_axis, require_inside

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_ERRORS = (1e-4, 0.1)  # of the peak; to be linear leaves out up to 4e-5 (tests/response/test_local_response.py)
_TOLERANCE = 0.3  # of the amplitudes, in parts of the error; δ errs by about a tenth of it
_FIRST_REACH, _WIDER = 6.0, 1.5  # of the profile, in radii of a coil, and of the next one where it ends too early
_POSITIONS = 32  # at a time, which bounds the memory


def local_response(
    design: Design,
    *,
    error: float = 1e-3,
    depths: npt.ArrayLike | None = None,
    x: npt.ArrayLike | None = None,
    y: npt.ArrayLike | None = None,
    inductance: Callable[[], FloatArray] | None = None,
    mesh: LayerMesh | None = None,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Compute the response of the states near the indenter, at a cost a position that does not grow with the array.

    Parameters
    ----------
    design : Design
        With the tables ``[indenter]`` and ``[indentation]``. Every state of its plan measures one coil, the others
        grounded or open; its switches have no stray capacitances.
    error : float
        Largest error of δ in parts of the peak, 1e-4 to 0.1; it decides how far coils and states count.
    depths, x, y : array_like, shape (n,), optional
        As in `coilarray.response.map.response_map`.
    inductance : callable, optional
        Returns the inductance matrix under the flat sheets, shape (coils, coils) in H, where that is known; computed
        here by default.
    mesh : LayerMesh, optional
        Accuracy of the magnetic problem.
    progress : callable, optional
        Called with (done, total) as the positions are done.

    Returns
    -------
    xarray.Dataset
        ``delta`` (depth, y, x, near) as in `response_map`, of the states whose numbers are ``near_state`` (y, x, near);
        −1 and a δ of 0 where fewer are near. All other states have a δ of 0 within the error; `dense_response` fills
        them in. ``base_inductance`` (state) in H, ``inductance`` (coil, other) in H, ``force`` in N and
        ``contact_radius`` in m (depth). The attributes ``state_reach_m`` and ``coil_reach_m`` are how far was counted.

    Raises
    ------
    ElastomerError
        As `response_map`, and an error outside of its limits.
    NetworkError
        A plan or switches that `coilarray.circuit.state_sensitivity` does not treat.
    MemoryLimitError
        More positions than there is memory for.

    Notes
    -----
    δ_a = Re(w_a i_aᵀ ΔL i_a) with the currents of the flat board, to first order in ΔL, see
    `coilarray.circuit.state_sensitivity`. What this leaves out is 1.4e-5 of the peak for 1 mm in the sheets of gast2020
    and 4e-5 for 2 mm; the circuit is counted in full. With the default error of 1e-3, δ differs from `response_map` by
    8e-4 of the peak on that board and by 3e-4 on 4 × 4 of its coils in a hexagonal lattice
    (tests/response/test_local_response.py), and by 9e-4 from the currents and inductance changes of all coils on 16 ×
    16, where 38 states and 110 coils are within reach (benchmarks/large_response.py). Tilted samples, noise and
    dielectrics are left to `response_map`.

    Examples
    --------
    >>> from coilarray import load_design
    >>> local = local_response(load_design("gast2020"), x=[-13.28e-3, 0], y=[0])
    >>> local.delta.dims, dense_response(local).delta.shape
    (('depth', 'y', 'x', 'near'), (1, 1, 2, 6))
    """
    if not _ERRORS[0] <= error <= _ERRORS[1]:
        raise ElastomerError(f"error must be {_ERRORS[0]:g} to {_ERRORS[1]:g} of the peak; got {error:g}.")
    setup = indentation_of(design)
    depth, along, across = (
        map_axis(name, default if given is None else given)
        for name, given, default in (("depths", depths, setup.depths), ("x", x, setup.x), ("y", y, setup.y))
    )
    magnetic_slab(design.sheets)  # more than one magnetic region is refused before the work begins
    contact = contact_at(setup, design.sheets, depth)
    dents = [dent_of(contact.isel(depth=k), design.sheets) for k in range(len(depth))]
    places = np.stack(np.meshgrid(along, across), axis=-1).reshape(-1, 2)
    require_inside(setup, places, float(contact.contact_radius.max()))
    conductors = design.array.conductors()
    L0 = design_inductance(design)[0] if inductance is None else inductance()
    R = dc_resistance(conductors, design.circuit.resistivity)
    states = state_sensitivity(design.array.names, L0, R, design.circuit.switches, design.plan)
    dented = _solve(dents, conductors, states, places + setup.origin_point, error, mesh or LayerMesh())
    near, delta = _respond(dented, states, places + setup.origin_point, progress)
    shape = (len(across), len(along))
    centres = design.array.centres - setup.origin_point
    return xr.Dataset(
        {
            "delta": (
                ("depth", "y", "x", "near"), delta.reshape(len(depth), *shape, -1),
                {"units": "1", "long_name": "relative change of inductance"},
            ),
            "near_state": (
                ("y", "x", "near"), near.reshape(*shape, -1),
                {"units": "1", "long_name": "number of the state, -1 for none"},
            ),
            "base_inductance": (
                "state", states.base_inductance, {"units": "H", "long_name": "L_0 as the converter sees it"}
            ),
            "inductance": (("coil", "other"), L0, {"units": "H", "long_name": "inductance matrix, flat sheets"}),
            "force": ("depth", contact.force.values, {"units": "N"}),
            "contact_radius": ("depth", contact.contact_radius.values, {"units": "m"}),
        },
        coords={
            "depth": ("depth", depth, {"units": "m", "long_name": "depth of the indentation"}),
            "y": ("y", across, {"units": "m"}),
            "x": ("x", along, {"units": "m"}),
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
            "error_of_peak": error,
            "state_reach_m": dented.reach.states,
            "coil_reach_m": dented.reach.coils,
        },
    )  # fmt: skip


def dense_response(local: xr.Dataset) -> xr.Dataset:
    """Fill in the states that are not near: a map like that of `coilarray.response.map.response_map`.

    Parameters
    ----------
    local : xarray.Dataset
        As `local_response` returns it.

    Returns
    -------
    xarray.Dataset
        ``delta`` (depth, y, x, state), zero where a state is out of reach, in place of ``delta`` and ``near_state``;
        everything else as it is.

    Raises
    ------
    MemoryLimitError
        More values than there is memory for; select part of the positions first.
    """
    sparse, near = local.delta, local.near_state
    shape = (*sparse.shape[:3], local.sizes["state"])
    require_memory(8.0 * np.prod(shape), f"a map of {' × '.join(map(str, shape))} values", "select fewer positions")
    delta = np.zeros((shape[0], shape[1] * shape[2], shape[3] + 1))  # the last column takes what is no state
    np.put_along_axis(
        delta,
        np.broadcast_to(
            near.values.reshape(1, -1, local.sizes["near"]), (shape[0], delta.shape[1], local.sizes["near"])
        ),
        sparse.values.reshape(shape[0], delta.shape[1], -1),
        axis=2,
    )
    dense = local.drop_dims("near")
    dense["delta"] = (("depth", "y", "x", "state"), delta[..., :-1].reshape(shape), sparse.attrs)
    return dense


@dataclass(frozen=True, eq=False)
class _Dented:
    """The solved dents, in the order of the depths, None where nothing moves, and the spectra of the coils."""

    scatterings: tuple[Scattering | None, ...]
    spectra: CoilSpectra
    clearance: float
    reach: Reach


def _solve(
    dents: Sequence[Dent],
    conductors: Sequence[Conductor],
    states: StateSensitivity,
    points: FloatArray,
    error: float,
    mesh: LayerMesh,
) -> _Dented:
    """Solve the dents for coils as far away as they count."""
    centres, radius = coil_centres(conductors)
    corners = np.array([points.min(axis=0), points.max(axis=0)])
    farthest = float(np.hypot(*np.abs(corners[:, None] - centres).max(axis=0).T).max())
    moving = [k for k, dent in enumerate(dents) if np.isfinite(dent.clearance)]
    if not moving:
        nothing = coil_spectra(conductors, np.ones(1) / radius)
        return _Dented((None,) * len(dents), nothing, radius, Reach(radius, radius, error))
    clearance = min(dents[k].clearance for k in moving)
    width = max(dents[k].width for k in moving)
    deepest = [float(np.abs(dent.displacement).max()) for dent in dents]
    worst = int(np.argmax(deepest))
    tried = min(_FIRST_REACH * radius, farthest)
    while True:
        wavenumbers, weights = wavenumber_rule(clearance, tried + radius + width, mesh)
        solved = scatter(dents[worst], wavenumbers, weights, mesh, deepest[worst])
        spectra = coil_spectra(conductors, wavenumbers)
        reach = reach_for(coil_profile(solved, spectra, tried), states, centres, error)
        if reach.coils <= tried or tried == farthest:
            break
        tried = min(max(_WIDER * tried, reach.coils if np.isfinite(reach.coils) else 0.0), farthest)
    scatterings = tuple(
        solved if k == worst else scatter(dent, wavenumbers, weights, mesh, deepest[worst]) if k in moving else None
        for k, dent in enumerate(dents)
    )
    return _Dented(scatterings, spectra, clearance, Reach(min(reach.states, tried), min(reach.coils, tried), error))


def _respond(
    dented: _Dented, states: StateSensitivity, points: FloatArray, progress: Progress | None
) -> tuple[IntArray, FloatArray]:
    """Numbers of the near states, (positions, near), and their δ, (depths, positions, near)."""
    centres, reach = dented.spectra.centres, dented.reach
    near = _within(centres[states.measured], points, reach.states, 8.0 * (len(dented.scatterings) + 1))
    coils = _within(centres, points, reach.coils, 16.0)
    delta = np.zeros((len(dented.scatterings), *near.shape))
    moving = [(k, one) for k, one in enumerate(dented.scatterings) if one is not None]
    for turn, (k, scattering) in enumerate(moving):
        strengths, fields = _fields(dented, scattering, points, coils)
        respond = partial(_delta, _padded(states), near, coils, strengths, fields)
        blocks = [slice(*block) for block in ranges(len(points), _POSITIONS)]
        delta[k] = np.concatenate(run_blocks(respond, blocks, progress and _part(progress, turn, len(moving))))
    return np.where(near < len(states.measured), near, -1), delta


def _within(places: FloatArray, points: FloatArray, reach: float, size: float) -> IntArray:
    """Numbers of the places within reach of every point, shape (points, most), the number of places for none.

    `size` is the memory in bytes that each of them will take, checked here.
    """
    tree = KDTree(places)
    most = max(int(tree.query_ball_point(points, reach, return_length=True).max()), 1)
    require_memory(size * len(points) * most, f"the response at {len(points)} positions", "compute it in pieces")
    _, numbers = tree.query(points, k=list(range(1, most + 1)), distance_upper_bound=np.nextafter(reach, np.inf))
    return np.asarray(numbers, dtype=np.int64)


def _fields(
    dented: _Dented, scattering: Scattering, points: FloatArray, coils: IntArray
) -> tuple[FloatArray, Callable[[slice], FloatArray]]:
    """Strengths of a dent, (n,), and what gives the amplitudes of the coils near some points, (points, coils, n)."""
    spectra = dented.spectra
    shapes = range(len(spectra.series))
    shape_of = np.append(spectra.shape_of, -1)[coils]
    centres = np.vstack((spectra.centres, np.zeros(2)))
    tolerance = _TOLERANCE * dented.reach.error
    axis, grid = offset_grid(dented.reach.coils, dented.clearance)
    if np.count_nonzero(shape_of >= 0) <= len(shapes) * len(grid):
        offsets = points[:, None] - centres[coils]
        dent = dent_amplitudes(scattering, spectra, [offsets[shape_of == s] for s in shapes], tolerance)
        known = _spread(shape_of, dent.amplitudes)
        return dent.strengths, lambda rows: known[rows]
    dent = dent_amplitudes(scattering, spectra, [grid for _ in shapes], tolerance)
    tables = [amplitude_table(axis, amplitudes) for amplitudes in dent.amplitudes]

    def from_table(rows: slice) -> FloatArray:
        offsets = points[rows, None] - centres[coils[rows]]
        return _spread(shape_of[rows], [table(offsets[shape_of[rows] == s]) for s, table in enumerate(tables)])

    return dent.strengths, from_table


def _spread(shape_of: IntArray, amplitudes: Sequence[FloatArray]) -> FloatArray:
    """Put the amplitudes of every shape where its coils stand, shape (points, coils, n)."""
    spread = np.zeros((*shape_of.shape, amplitudes[0].shape[1]))
    for shape, values in enumerate(amplitudes):
        spread[shape_of == shape] = values
    return spread


def _padded(states: StateSensitivity) -> StateSensitivity:
    """Add a coil without a current and a state without a response, which stand for those that are not there."""
    return replace(states, currents=np.pad(states.currents, ((0, 1), (0, 1))), weights=np.append(states.weights, 0))


def _delta(
    states: StateSensitivity,
    near: IntArray,
    coils: IntArray,
    strengths: FloatArray,
    fields: Callable[[slice], FloatArray],
    rows: slice,
) -> FloatArray:
    """δ of the near states at some points, shape (points, near): the fields of all near coils together, squared."""
    currents = states.currents[coils[rows, :, None], near[rows, None, :]]
    total = fields(rows).transpose(0, 2, 1) @ np.concatenate((currents.real, currents.imag), axis=2)
    real, imaginary = np.split(total, 2, axis=2)
    return np.asarray((states.weights[near[rows]] * (strengths @ (real + 1j * imaginary) ** 2)).real)


def _part(progress: Progress, turn: int, turns: int) -> Progress:
    """Count one of several equal passes."""
    return lambda done, total: progress(turn * total + done, turns * total)
