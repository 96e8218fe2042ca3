"""Links between boards over the poses of some of them.

Boards move as wholes. Only the mutual inductances between boards that move against each other are
computed anew at every pose.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.circuit.board_circuit import board_circuit
from coilarray.circuit.coupling import provenance
from coilarray.circuit.ports import (
    PortCircuit,
    best_link,
    port_circuit,
    port_impedance,
    port_resonances,
    power_transfer,
)
from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import MM, value_text
from coilarray.compute.memory import require_memory
from coilarray.compute.netcdf import Entry, Schema, variables
from coilarray.compute.store import Store, content_key, store_to_keep
from coilarray.compute.threads import Progress, ranges
from coilarray.design.model import Board, Design, DesignFile, design_of
from coilarray.electromagnetics.motion import moved_inductance
from coilarray.errors import DesignError
from coilarray.geometry import Conductor, Pose
from coilarray.geometry.board_clearance import cut_through

AXES = ("x", "y", "z", "turn_x", "turn_y", "turn_z")
"""Coordinates of a pose: its shift in m and its turns in rad."""
MOST_POSES = 100_000
"""Largest number of poses of a link."""
_POSES_A_BLOCK = 128  # that are computed and kept together
_BYTES_A_PAIR, _BYTES_A_COIL_PAIR = 200.0, 100.0  # peak memory per pose and pair that moves, and of all coils


_OVER = ("pose", "along", *AXES, "pair")
LINK = Schema(
    DesignError, "mutual inductances and couplings over poses and pairs",
    {
        "mutual_inductance": Entry("H", _OVER, needed=True, fewer_dims=True),
        "coupling": Entry("1", _OVER, needed=True, fewer_dims=True),
        "pair": Entry(None, ("pair",), needed=True),
    },
)  # fmt: skip
"""Requirements on a file of a link."""


def pose_grid(
    x: npt.ArrayLike = 0.0,
    y: npt.ArrayLike = 0.0,
    z: npt.ArrayLike = 0.0,
    turn_x: npt.ArrayLike = 0.0,
    turn_y: npt.ArrayLike = 0.0,
    turn_z: npt.ArrayLike = 0.0,
) -> xr.DataArray:
    """Return the poses of all combinations of values.

    Parameters
    ----------
    x, y, z : array_like, shape (n,) or scalar
        Shifts in m.
    turn_x, turn_y, turn_z : array_like, shape (n,) or scalar
        Angles about the axes in rad, as in `coilarray.geometry.Pose`.

    Returns
    -------
    xarray.DataArray
        Poses over the axes that have several values.

    Raises
    ------
    DesignError
        An axis without values, with a value twice or not finite, or more than `MOST_POSES` poses.

    Examples
    --------
    >>> dict(pose_grid(z=[5e-3, 10e-3], x=[0.0, 2e-3, 4e-3]).sizes)
    {'x': 3, 'z': 2}
    """
    values = {}
    for name, given in zip(AXES, (x, y, z, turn_x, turn_y, turn_z), strict=True):
        values[name] = np.atleast_1d(np.asarray(given, dtype=np.float64))
        if values[name].ndim != 1 or not np.isfinite(values[name]).all():
            raise DesignError(f"{name} of a grid of poses must be a row of finite numbers; got {given!r:.60}.")
        if not 0 < len(np.unique(values[name])) == len(values[name]):
            raise DesignError(f"{name} of a grid of poses must have one value or more, each once; got {given!r:.60}.")
    shape = [len(row) for row in values.values()]
    if math.prod(shape) > MOST_POSES:
        raise DesignError(f"a link must have at most {MOST_POSES} poses; got {math.prod(shape)}.")
    poses = np.empty(shape, dtype=object)
    for place in np.ndindex(*shape):
        a, b, c, *turn = (float(row[k]) for row, k in zip(values.values(), place, strict=True))
        poses[place] = Pose(a, b, c, (turn[0], turn[1], turn[2]))
    return xr.DataArray(poses, _described(values), dims=AXES).squeeze()


def pose_path(function: Callable[[float], Pose], along: npt.ArrayLike) -> xr.DataArray:
    """Return the poses that a function gives along a path.

    Parameters
    ----------
    function : callable
        Takes a number and returns a Pose.
    along : array_like, shape (n,)
        Numbers along the path, in any unit.

    Returns
    -------
    xarray.DataArray
        Poses over ``along``.

    Examples
    --------
    >>> swing = pose_path(lambda angle: Pose(z=20e-3, turn=(0.0, angle, 0.0)), [0.0, 0.1, 0.2])
    >>> dict(swing.sizes)
    {'along': 3}
    """
    numbers = np.atleast_1d(np.asarray(along, dtype=np.float64))
    poses = np.empty(len(numbers), dtype=object)
    poses[:] = [function(number) for number in numbers.tolist()]
    return xr.DataArray(poses, {"along": numbers}, dims=("along",))


def pose_of(design: Design, name: str) -> Pose:
    """Return the pose of a board by its name in a design.

    A DesignError names the boards of the `design` if none has the `name`.
    """
    return _boards(design)[_known(design, name)].pose


def together(design: Design, names: Sequence[str], poses: xr.DataArray) -> dict[str, xr.DataArray]:
    """Return the poses of boards that move as one.

    Parameters
    ----------
    design : Design
        Design that places the boards.
    names : sequence of str
        Names of the boards.
    poses : xarray.DataArray
        Poses of the first. The others keep their places relative to it.

    Returns
    -------
    dict of str to xarray.DataArray
        Poses by board, for `link`.
    """
    places = {name: pose_of(design, name) for name in names}
    first = _back(places[names[0]])
    found = {}
    for name, place in places.items():
        there = np.empty(poses.shape, dtype=object)
        for k, pose in np.ndenumerate(poses.values):
            there[k] = pose if name == names[0] else pose.after(first.after(place))
        found[name] = poses.copy(data=there)
    return found


def moved_boards(design: Design, poses: Mapping[str, xr.DataArray], number: int) -> Design:
    """Return a design with its boards at one of many poses.

    The `poses` by board are those of `link`, of which the `number` counts from 0. Boards that cut
    through each other raise a DesignError.
    """
    boards = (
        replace(board, pose=poses[name].values.ravel()[number]) if name in poses else board
        for name, board in _boards(design).items()
    )
    return replace(design, boards=tuple(boards))


def link(
    design: Design | DesignFile,
    poses: Mapping[str, xr.DataArray | Sequence[Pose]],
    *,
    frequency: float | None = None,
    keep: bool | str | Path = False,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Compute the link between boards over poses of some of them.

    Parameters
    ----------
    design : Design or DesignFile
        Design with several boards.
    poses : mapping of str to xarray.DataArray or sequence of Pose
        Poses of each board that moves, by its name, in place of its pose in the design. Those of
        `pose_grid` and `pose_path` have coordinates. All boards have equally many.
    frequency : float, optional
        Frequency in Hz. By default that of the design's ports. Without any, only M and k are given.
    keep : bool, str or Path
        Whether results are kept for later runs: in the user's cache folder, or in the given folder.
    progress : callable, optional
        Called with (done, total).

    Returns
    -------
    xarray.Dataset
        ``mutual_inductance`` in H and ``coupling`` over the poses and ``pair``, all pairs of coils
        that move against each other. With a frequency also ``induced_voltage`` |ωM| in V per ampere
        and ``best_efficiency``, which `coilarray.circuit.ports.best_link` describes, of both coils
        alone. With ports the ``efficiency`` and ``available_efficiency`` from
        ``source_coil`` to ``load_coil``, the lowest and highest resonance and their ``splitting``, see
        `coilarray.circuit.ports`. Poses at which no port oscillates have NaN there.

    Raises
    ------
    DesignError
        An unknown board, poses that do not fit each other, boards that cut through each other at a
        pose, a frequency that is not positive, or metal or magnetic sheets, whose effect on moved
        boards is not known.

    Notes
    -----
    The error of M is below 1e-4 of the larger L, see
    `coilarray.electromagnetics.motion.moved_inductance`. Resistances are those of each board alone.

    Examples
    --------
    >>> import coilarray as ca
    >>> reader, tag = ca.Spiral(4, 40e-3, 5, 0.5e-3, 0.5e-3), ca.Spiral(4, 25e-3, 6, 0.3e-3, 0.3e-3)
    >>> pair = ca.Design(reader.as_array(), boards=(ca.Board(tag.as_array(), ca.Pose(z=10e-3), "tag"),))
    >>> found = link(pair, {"tag": pose_grid(z=[5e-3, 10e-3, 20e-3])})
    >>> found.coupling.values.ravel().round(3).tolist()
    [0.262, 0.177, 0.079]
    """
    design = design_of(design)
    metal = [*design.plates, *(sheet for sheet in design.sheets if sheet.magnetic)]
    if metal:
        raise DesignError(
            f"a link needs a design without metal and magnetic sheets; {design.name} has {metal[0].name}."
        )
    grid, moves = _checked(design, poses)
    f = design.circuit.link_frequency if frequency is None else frequency
    if f is not None and not (math.isfinite(f) and f > 0):
        raise DesignError(f"frequency of a link must be positive and finite; got {f} Hz.")
    groups = _groups(design, moves)
    count, n = grid.size, len(design.coil_names)
    pairs = [pair for one, other in combinations(groups, 2) for pair in _pairs(one, other)]
    ports = f is not None and bool(design.circuit.ports)
    needed = count * (_BYTES_A_PAIR * len(pairs) + _BYTES_A_COIL_PAIR * n**2)
    require_memory(needed, f"a link of {n} coils at {count} poses", "take fewer")
    _require_clear(design, groups, grid)
    M = _moved(design, groups, count, store_to_keep(keep), progress)
    L = board_circuit(design).inductance
    i, k = np.array(pairs).T
    own = np.diag(L)
    between = M[:, i, k]
    rows: list[tuple[str, tuple[str, ...], Any, str, str]] = [
        ("mutual_inductance", ("pair",), between, "H", "mutual inductance M"),
        ("coupling", ("pair",), between / np.sqrt(own[i] * own[k]), "1", "coupling coefficient k"),
    ]
    names = np.array(design.coil_names)
    coordinates: dict[str, Any] = {
        "pair": [f"{names[a]},{names[b]}" for a, b in pairs],
        "coil": ("pair", names[i]), "other": ("pair", names[k]),
    }  # fmt: skip
    if f is not None:
        R = board_circuit(design).windings.resistance(np.array([f]), design.circuit.resistivity).resistance.values[0]
        omega = 2 * math.pi * f
        rows.append(("induced_voltage", ("pair",), omega * np.abs(between), "V/A", "open-circuit voltage per ampere"))
        Z = np.zeros((count, len(pairs), 2, 2), dtype=np.complex128)
        for side, coil in enumerate((i, k)):
            Z[..., side, side] = R[coil, coil] + 1j * omega * own[coil]
            Z[..., side, 1 - side] = 1j * omega * between
        rows.append(("best_efficiency", ("pair",), best_link(Z).efficiency, "1", "largest efficiency of the pair"))
        if ports:
            whole = _whole(L, M, pairs)
            circuit = replace(port_circuit(design, board_circuit(design).direct), frequency=f)
            rows += _between_ports(circuit, whole, R)
            coordinates |= {
                "source_coil": [circuit.active[place].coil for place in circuit.sources],
                "load_coil": [circuit.active[place].coil for place in circuit.loads],
            }
    shaped = [
        (name, (*map(str, grid.dims), *dims), _over(grid, value), unit, says) for name, dims, value, unit, says in rows
    ]
    attributes = {**provenance(design), "moved": ", ".join(moves), "error_of_larger_inductance": 1e-4}
    if f is not None:
        attributes["frequency_Hz"] = f
    used = {dim for _, dims, *_ in rows for dim in dims} | {"coil", "other"}
    coordinates = {name: value for name, value in coordinates.items() if name in used}
    return xr.Dataset(variables(*shaped), {**grid.coords, **coordinates}, attributes)


def columns(result: xr.Dataset) -> xr.Dataset:
    """Return a link with a variable for every pair, for tables and plots.

    Parameters
    ----------
    result : xarray.Dataset
        Result of `link`.

    Returns
    -------
    xarray.Dataset
        k of each pair as ``k[coil,coil]``, M in µH, voltages and efficiencies named in the same
        way, and resonances in MHz, over the poses in mm and degrees.
    """
    names = {
        "coupling": ("k", 1.0, "1"), "mutual_inductance": ("M_uH", 1e6, "µH"),
        "induced_voltage": ("voltage_V_per_A", 1.0, "V/A"), "best_efficiency": ("best_efficiency", 1.0, "1"),
        "efficiency": ("efficiency", 1.0, "1"), "available_efficiency": ("available_efficiency", 1.0, "1"),
        "lowest_resonance": ("lowest_resonance_MHz", 1e-6, "MHz"),
        "highest_resonance": ("highest_resonance_MHz", 1e-6, "MHz"), "splitting": ("splitting_MHz", 1e-6, "MHz"),
    }  # fmt: skip
    found = {}
    for variable, (name, factor, unit) in names.items():
        if variable not in result:
            continue
        values = factor * result[variable]
        attributes = {"units": unit, "long_name": result[variable].attrs["long_name"]}
        if "pair" in values.dims:
            for pair in values.pair.values.tolist():
                found[f"{name}[{pair}]"] = values.sel(pair=pair, drop=True).assign_attrs(attributes)
        elif "load_coil" in values.dims:
            for source in values.source_coil.values.tolist():
                for load in values.load_coil.values.tolist():
                    at = values.sel(source_coil=source, load_coil=load, drop=True)
                    found[f"{name}[{source},{load}]"] = at.assign_attrs(attributes)
        else:
            found[name] = values.assign_attrs(attributes)
    flat = xr.Dataset({name: values.reset_coords(drop=True) for name, values in found.items()})
    shown = {}
    for name in map(str, flat.dims):
        length = name in ("x", "y", "z")
        unit = "mm" if length else "deg" if name in AXES else ""
        factor = 1e3 if length else math.degrees(1.0) if name in AXES else 1.0
        label = f"{name}_{unit}" if unit else name
        numbers = flat[name].values * factor if name in flat.coords else np.arange(1, flat.sizes[name] + 1)
        shown[name] = (label, numbers.round(9), unit)
    renamed = flat.rename({name: label for name, (label, *_) in shown.items()})
    return renamed.assign_coords(
        {label: (label, at, {"units": unit} if unit else {}) for label, at, unit in shown.values()}
    )


@dataclass(frozen=True, eq=False)
class _Group:
    """Boards that keep their places relative to each other.

    `first` is the number of its first coil, `boards` and `paths` are in the frame of the group, and
    `poses` are where it is, None if it does not move.
    """

    coils: tuple[int, ...]
    boards: tuple[Board, ...]
    paths: tuple[Conductor, ...]
    poses: tuple[Pose, ...] | None


def _boards(design: Design) -> dict[str, Board]:
    """Boards that a design places, by name, and those it moves along."""
    return {f"board{k}" if b.name is None else b.name: b for k, b in enumerate(design.boards, start=2)}


def _known(design: Design, name: str) -> str:
    """Refuse a name of no board."""
    names = [known for known in _boards(design) if known]
    if name not in names:
        there = f"there are {', '.join(names)}" if names else f"{design.name} places no boards"
        raise DesignError(f"no board of the design can move by the name {name!r}; {there}.")
    return name


def _back(pose: Pose) -> Pose:
    """Return the inverse of a pose."""
    return Pose.of(pose.rotation.T, -pose.rotation.T @ pose.shift)


def _checked(
    design: Design, poses: Mapping[str, xr.DataArray | Sequence[Pose]]
) -> tuple[xr.DataArray, dict[str, tuple[Pose, ...]]]:
    """Grid of the first board's poses, and the poses of all."""
    if not poses:
        raise DesignError("a link needs the poses of at least one board.")
    grid, moves = None, {}
    for name, given in poses.items():
        _known(design, name)
        if isinstance(given, xr.DataArray):
            array = given
        else:
            row = np.empty(len(given), dtype=object)
            row[:] = list(given)
            array = xr.DataArray(row, dims=("pose",))
        wrong = [pose for pose in array.values.ravel().tolist() if not isinstance(pose, Pose)]
        if wrong or not array.size:
            raise DesignError(
                f"poses of {name} must be one Pose or more; got {f'{wrong[0]!r:.60}' if wrong else 'none'}."
            )
        if array.size > MOST_POSES:
            raise DesignError(f"a link must have at most {MOST_POSES} poses; got {array.size}.")
        grid = array if grid is None else grid
        if array.shape != grid.shape:
            raise DesignError(f"boards must have equally many poses; {name} has {array.shape}, and not {grid.shape}.")
        moves[name] = tuple(array.values.ravel().tolist())
    assert grid is not None
    return grid, moves


def _groups(design: Design, moves: Mapping[str, tuple[Pose, ...]]) -> list[_Group]:
    """Cut a design into what does not move, and each board that does."""
    placed, first, still, groups = list(design.placed), 0, [], []
    sizes = {name: len(board.design.placed) for name, board in _boards(design).items()}
    numbers = []
    for board in placed:
        numbers.append(tuple(range(first, first + len(board.coil_names))))
        first += len(board.coil_names)
    at = 1
    still.append(0)
    for name, size in sizes.items():
        mine = list(range(at, at + size))
        at += size
        if name not in moves:
            still += mine
            continue
        back = _back(pose_of(design, name))
        boards = tuple(Board(placed[k].of, back.after(placed[k].pose), placed[k].name) for k in mine)
        paths = tuple(path for board in boards for path in board.conductors())
        groups.append(_Group(tuple(c for k in mine for c in numbers[k]), boards, paths, moves[name]))
    boards = tuple(placed[k] for k in still)
    paths = tuple(path for board in boards for path in board.conductors())
    return [_Group(tuple(c for k in still for c in numbers[k]), boards, paths, None), *groups]


def _pairs(one: _Group, other: _Group) -> list[tuple[int, int]]:
    return [(min(i, k), max(i, k)) for i in one.coils for k in other.coils]


def _relative(one: _Group, other: _Group, start: int, stop: int) -> list[Pose]:
    """Poses of a group in the frame of another."""
    assert other.poses is not None
    if one.poses is None:
        return list(other.poses[start:stop])
    return [_back(a).after(b) for a, b in zip(one.poses[start:stop], other.poses[start:stop], strict=True)]


def _require_clear(design: Design, groups: Sequence[_Group], grid: xr.DataArray) -> None:
    """Refuse a pose at which boards cut through each other."""
    for one, other in combinations(groups, 2):
        for number, pose in enumerate(_relative(one, other, 0, grid.size)):
            for a in one.boards:
                for b in other.boards:
                    if cut_through(a.pieces, pose.apply(b.pieces)) is not None:
                        raise DesignError(
                            f"boards {a.name or design.name} and {b.name} cut through each other at "
                            f"{_pose_words(other, number)}."
                        )


def _pose_words(group: _Group, number: int) -> str:
    """Name a pose in mm and degrees."""
    assert group.poses is not None
    pose = group.poses[number]
    place = ", ".join(value_text(float(value)) for value in MM.of(pose.shift).round(6))
    turn = ", ".join(value_text(round(math.degrees(angle), 6)) for angle in pose.turn)
    return f"pose {number + 1}: ({place}) mm, turned by ({turn})°"


def _moved(
    design: Design, groups: Sequence[_Group], count: int, store: Store | None, progress: Progress | None
) -> FloatArray:
    """Mutual inductances (poses, coils, coils) in H, zero between coils that do not move apart."""
    n = len(design.coil_names)
    M = np.zeros((count, n, n))
    blocks = ranges(count, _POSES_A_BLOCK)
    for start, stop in blocks:
        for one, other in combinations(groups, 2):
            poses = _relative(one, other, start, stop)
            places = [[*pose.shift.tolist(), *pose.rotation.ravel().tolist()] for pose in poses]
            key = content_key("link", design.digest, list(one.coils), list(other.coils), places)
            known = None if store is None else store.get(key)
            found = np.asarray(known, dtype=np.float64) if isinstance(known, list) else None
            if found is None or found.shape != (len(poses), len(one.coils), len(other.coils)):
                found = moved_inductance(one.paths, other.paths, poses)
                if store is not None:
                    store.put(key, found.tolist())
            M[start:stop, np.array(one.coils)[:, None], np.array(other.coils)] = found
            M[start:stop, np.array(other.coils)[:, None], np.array(one.coils)] = found.swapaxes(1, 2)
        if progress is not None:
            progress(stop, count)
    return M


def _whole(L: FloatArray, M: FloatArray, pairs: Sequence[tuple[int, int]]) -> FloatArray:
    """Inductance matrices (poses, n, n) in H."""
    whole = np.broadcast_to(L, M.shape).copy()
    i, k = np.array(pairs).T
    whole[:, i, k], whole[:, k, i] = M[:, i, k], M[:, k, i]
    return whole


def _between_ports(
    circuit: PortCircuit, inductance: FloatArray, resistance: FloatArray
) -> list[tuple[str, tuple[str, ...], Any, str, str]]:
    """Efficiencies between ports and resonances at every pose."""
    rows: list[tuple[str, tuple[str, ...], Any, str, str]] = []
    if circuit.sources and circuit.loads:
        Z = resistance + 2j * math.pi * circuit.frequency * inductance
        transfer = power_transfer(circuit, port_impedance(circuit, Z, circuit.frequency))
        ends = ("source_coil", "load_coil")
        rows += [
            ("efficiency", ends, transfer.efficiency, "1", "power in the load over power into the terminals"),
            ("available_efficiency", ends, transfer.available_efficiency, "1", "power in the load over available"),
        ]  # fmt: skip
    found = [port_resonances(circuit, L, resistance)[0] for L in inductance]
    extremes = np.array([(modes[0], modes[-1]) if len(modes) else (np.nan, np.nan) for modes in found])
    if np.isfinite(extremes).any():
        low, high = extremes.T
        rows += [
            ("lowest_resonance", (), low, "Hz", "lowest resonance of the ports"),
            ("highest_resonance", (), high, "Hz", "highest resonance of the ports"),
            ("splitting", (), high - low, "Hz", "splitting of the resonances"),
        ]  # fmt: skip
    return rows


def _over(grid: xr.DataArray, values: FloatArray) -> FloatArray:
    return values.reshape(*grid.shape, *values.shape[1:])


def _described(values: Mapping[str, FloatArray]) -> dict[str, xr.Variable]:
    """Coordinates with units."""
    words = {"x": "shift along x", "y": "shift along y", "z": "shift along z"}
    return {
        name: xr.Variable(name, row, {
            "units": "m" if name in words else "rad",
            "long_name": words.get(name, f"turn about {name[-1]}"),
        })
        for name, row in values.items()
    }  # fmt: skip
