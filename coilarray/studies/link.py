"""Links between boards over the poses of some of them.

Boards move as wholes. Only the mutual inductances between boards that move against each other are
computed anew at every pose.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.circuit import ports
from coilarray.circuit.board_circuit import board_circuit
from coilarray.circuit.coupling import provenance
from coilarray.compute.arrays import FloatArray
from coilarray.compute.memory import require_memory
from coilarray.compute.netcdf import Entry, Schema, variables
from coilarray.compute.store import Store, content_key, store_to_keep
from coilarray.compute.threads import Progress, ranges
from coilarray.design.boards import pose_words
from coilarray.design.model import Board, Design, DesignFile, design_of
from coilarray.electromagnetics.motion import moved_inductance
from coilarray.errors import DesignError, require_positive
from coilarray.geometry import Conductor, Pose
from coilarray.geometry.board_clearance import cut_through

AXES = ("x", "y", "z", "turn_x", "turn_y", "turn_z")
"""Coordinates of a pose: its shift in m and its turns in rad."""
MOST_POSES = 100_000  # largest number of poses of a link
_POSES_A_BLOCK = 128  # that are computed and kept together
_BYTES_A_PAIR, _BYTES_A_COIL_PAIR = 200.0, 100.0  # peak memory per pose and pair that moves, and of all coils


_OVER = ("pose", *AXES, "pair")
LINK = Schema(  # requirements on a file of a link
    DesignError, "mutual inductances and couplings over poses and pairs",
    {
        "mutual_inductance": Entry("H", _OVER, needed=True, fewer_dims=True),
        "coupling": Entry("1", _OVER, needed=True, fewer_dims=True),
        "pair": Entry(None, ("pair",), needed=True),
    },
)  # fmt: skip


def pose_grid(
    x: npt.ArrayLike = 0.0,
    y: npt.ArrayLike = 0.0,
    z: npt.ArrayLike = 0.0,
    turn_x: npt.ArrayLike = 0.0,
    turn_y: npt.ArrayLike = 0.0,
    turn_z: npt.ArrayLike = 0.0,
) -> xr.DataArray:
    """Return the poses of all combinations of values.

    Shifts `x`, `y` and `z` are in m, the angles `turn_x`, `turn_y` and `turn_z` about the axes in
    rad, as in `coilarray.geometry.Pose`: a number or a row (n,) each. The poses are over the axes
    that have several values, or over z if none has. Raises DesignError for values of an axis that
    are not different and finite, or more than `MOST_POSES` poses.

    >>> dict(pose_grid(z=[5e-3, 10e-3], x=[0.0, 2e-3, 4e-3]).sizes)
    {'x': 3, 'z': 2}
    """
    values = {}
    for name, given in zip(AXES, (x, y, z, turn_x, turn_y, turn_z), strict=True):
        row = np.atleast_1d(np.asarray(given, dtype=np.float64))
        if row.ndim != 1 or not np.isfinite(row).all() or not 0 < len(np.unique(row)) == len(row):
            raise DesignError(
                f"{name} of a grid of poses must be a row of different finite numbers, at least one; got {given!r:.60}."
            )
        values[name] = xr.Variable(name, row, {"units": "m" if len(name) == 1 else "rad"})
    shape = [row.size for row in values.values()]
    _require_few(math.prod(shape))
    poses = np.empty(shape, dtype=object)
    for place in np.ndindex(*shape):
        a, b, c, *turn = (float(row.values[k]) for row, k in zip(values.values(), place, strict=True))
        poses[place] = Pose(a, b, c, (turn[0], turn[1], turn[2]))
    single = [name for name, size in zip(AXES, shape, strict=True) if size == 1]
    return xr.DataArray(poses, values, dims=AXES).squeeze([name for name in single if name != "z" or len(single) < 6])


def pose_of(design: Design, name: str) -> Pose:
    """Return the pose of a board by its name in a design.

    A DesignError names the boards of the `design` if none has the `name`.
    """
    boards = _boards(design)
    if name not in boards or not name:
        there = f"there are {', '.join(filter(None, boards))}" if any(boards) else f"{design.name} places no boards"
        raise DesignError(f"no board of the design can move by the name {name!r}; {there}.")
    return boards[name].pose


def together(design: Design, names: Sequence[str], poses: xr.DataArray) -> dict[str, xr.DataArray]:
    """Return the poses of boards that move as one, for `link`.

    The `poses` are of the first of the `names`. The other boards of the `design` keep their places
    relative to it.
    """
    places = {name: pose_of(design, name) for name in names}
    first = _back(places[names[0]])
    return {
        name: poses if name == names[0] else poses.copy(
            data=_row(pose.after(first.after(place)) for pose in poses.values.ravel().tolist()).reshape(poses.shape)
        )
        for name, place in places.items()
    }  # fmt: skip


def moved_boards(design: Design, poses: Mapping[str, xr.DataArray], number: int) -> Design:
    """Return a design with its boards at pose `number` of `link`'s `poses`."""
    # Boards that cut through each other raise a DesignError.
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

    The `poses` of each board of the `design` that moves, by its name, take the place of its pose in
    the design, equally many for all. Those of `pose_grid` have coordinates. The `frequency` in Hz
    is by default that of the design's ports. Without any, only M and k are given. `keep` tells
    whether results are kept for later runs: in the user's cache folder, or in the given folder.
    `progress` is called with (done, total).

    In the result, ``mutual_inductance`` in H and ``coupling`` are over the poses and ``pair``, all
    pairs of coils that move against each other. With a frequency also ``induced_voltage`` ωM in V
    per ampere and ``best_efficiency``, which `coilarray.circuit.ports.best_link` describes, of both
    coils alone. With ports the ``efficiency`` and ``available_efficiency`` from ``source_coil`` to
    ``load_coil``, the number of ``resonances``, the lowest and highest of them and their
    ``splitting``, see `coilarray.circuit.ports`. The latter three have no value at poses where no
    port oscillates, and are left out if there is no other.

    The error of M is below 1e-4 of the larger L, see
    `coilarray.electromagnetics.motion.moved_inductance`. Resistances are those of each board alone.
    Raises DesignError for an unknown board, poses that do not fit each other, boards that cut
    through each other at a pose, a frequency that is not positive, or metal or magnetic sheets,
    whose effect on moved boards is not known.

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
    if f is not None:
        require_positive("frequency of a link", f, " Hz", DesignError)
    groups = _groups(design, moves)
    count, n = grid.size, len(design.coil_names)
    pairs = [(a, b) for one, other in combinations(groups, 2) for a in one.coils for b in other.coils]
    needed = count * (_BYTES_A_PAIR * len(pairs) + _BYTES_A_COIL_PAIR * n**2)
    require_memory(needed, f"a link of {n} coils at {count} poses", "take fewer")
    _require_clear(design, groups, count)
    L = board_circuit(design).inductance
    moved = np.broadcast_to(L, (count, n, n)).copy()
    _move(design, groups, moved, store_to_keep(keep), progress)
    i, k = np.sort(np.array(pairs), axis=1).T
    own = np.diag(L)
    between = moved[:, i, k]
    rows: list[tuple[str, tuple[str, ...], Any, str, str]] = [
        ("mutual_inductance", ("pair",), between, "H", "mutual inductance M"),
        ("coupling", ("pair",), between / np.sqrt(own[i] * own[k]), "1", "coupling coefficient k"),
    ]
    names = np.array(design.coil_names)
    coordinates: dict[str, Any] = {
        "pair": [f"{a},{b}" for a, b in zip(names[i], names[k], strict=True)],
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
        rows.append(
            ("best_efficiency", ("pair",), ports.best_link(Z).efficiency, "1", "largest efficiency of the pair")
        )
        if design.circuit.ports:
            circuit = replace(ports.port_circuit(design, board_circuit(design).direct), frequency=f)
            rows += _between_ports(circuit, moved, R)
            if circuit.sources and circuit.loads:
                ends = ("source_coil", circuit.sources), ("load_coil", circuit.loads)
                coordinates |= {end: [circuit.active[place].coil for place in places] for end, places in ends}
    shaped = [
        (name, (*map(str, grid.dims), *dims), value.reshape(*grid.shape, *value.shape[1:]), unit, says)
        for name, dims, value, unit, says in rows
    ]
    attributes = {**provenance(design), "moved": ", ".join(moves), "error_of_larger_inductance": 1e-4}
    if f is not None:
        attributes["frequency_Hz"] = f
    return xr.Dataset(variables(*shaped), {**grid.coords, **coordinates}, attributes)


def columns(result: xr.Dataset) -> xr.Dataset:
    """Return the `result` of `link` with a variable for every pair, for tables and plots.

    Over the poses in mm and degrees, k of each pair is ``k[coil,coil]``, M in µH, voltages and
    efficiencies are named in the same way, and resonances are in MHz.
    """
    names = {
        "coupling": ("k", 1.0, "1"), "mutual_inductance": ("M_uH", 1e6, "µH"),
        "induced_voltage": ("voltage_V_per_A", 1.0, "V/A"),
        **{f"{name}_resonance": (f"{name}_resonance_MHz", 1e-6, "MHz") for name in ("lowest", "highest")},
        "splitting": ("splitting_MHz", 1e-6, "MHz"),
    }  # fmt: skip
    found = {}
    for variable, values in result.data_vars.items():
        name, factor, unit = names.get(str(variable), (str(variable), 1.0, "1"))
        ends = [dim for dim in ("pair", "source_coil", "load_coil") if dim in values.dims]
        for place in product(*(values[dim].values.tolist() for dim in ends)):
            one = factor * values.sel(dict(zip(ends, place, strict=True)), drop=True).reset_coords(drop=True)
            label = f"{name}[{','.join(place)}]" if place else name
            found[label] = one.assign_attrs(units=unit, long_name=values.attrs.get("long_name", ""))
    flat = xr.Dataset(found)
    for name in map(str, flat.dims):
        unit, factor = ("", 1.0) if name not in AXES else ("mm", 1e3) if len(name) == 1 else ("deg", math.degrees(1.0))
        numbers = (flat[name].values * factor).round(9) if name in flat.coords else np.arange(1, flat.sizes[name] + 1)
        label = f"{name}_{unit}" if unit else name
        flat = flat.rename({name: label} if unit else {})
        words = {"long_name": name.replace("turn_", "turn about ")} | ({"units": unit} if unit else {})
        flat = flat.assign_coords({label: (label, numbers, words)})
    return flat


@dataclass(frozen=True, eq=False)
class _Group:
    """Boards that keep their places, and their paths, in a frame with `poses`; numbers of their coils."""

    coils: tuple[int, ...]
    boards: tuple[Board, ...]
    paths: tuple[Conductor, ...]
    poses: tuple[Pose, ...]


def _boards(design: Design) -> dict[str, Board]:
    """Boards that a design places, by name, and those it moves along."""
    return {f"board{k}" if b.name is None else b.name: b for k, b in enumerate(design.boards, start=2)}


def _row(poses: Iterable[Any]) -> npt.NDArray[np.object_]:
    return np.fromiter(poses, dtype=object)


def _require_few(count: int) -> None:
    if count > MOST_POSES:
        raise DesignError(f"a link must have at most {MOST_POSES} poses; got {count}.")


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
        pose_of(design, name)
        array = given if isinstance(given, xr.DataArray) else xr.DataArray(_row(given), dims=("pose",))
        moves[name] = tuple(array.values.ravel().tolist())
        wrong = [pose for pose in moves[name] if not isinstance(pose, Pose)]
        if wrong or not array.size:
            raise DesignError(
                f"poses of {name} must be one Pose or more; got {f'{wrong[0]!r:.60}' if wrong else 'none'}."
            )
        _require_few(array.size)
        grid = array if grid is None else grid
        if array.shape != grid.shape:
            raise DesignError(f"boards must have equally many poses; {name} has {array.shape}, and not {grid.shape}.")
    assert grid is not None
    return grid, moves


def _groups(design: Design, moves: Mapping[str, tuple[Pose, ...]]) -> list[_Group]:
    """Cut a design into what does not move, and each board that does."""
    placed = design.placed
    of = ["", *(name for name, board in _boards(design).items() for _ in board.design.placed)]
    first = np.cumsum([0, *(len(board.coil_names) for board in placed)]).tolist()
    groups = []
    for name in ("", *moves):
        back = _back(pose_of(design, name)) if name else Pose()
        mine = [k for k, whose in enumerate(of) if (whose if whose in moves else "") == name]
        boards = tuple(Board(placed[k].of, back.after(placed[k].pose), placed[k].name) for k in mine)
        paths = tuple(path for board in boards for path in board.conductors())
        coils = tuple(coil for k in mine for coil in range(first[k], first[k + 1]))
        groups.append(_Group(coils, boards, paths, moves.get(name, (Pose(),) * len(next(iter(moves.values()))))))
    return groups


def _relative(one: _Group, other: _Group, start: int, stop: int) -> list[Pose]:
    """Poses of a group in the frame of another."""
    return [_back(a).after(b) for a, b in zip(one.poses[start:stop], other.poses[start:stop], strict=True)]


def _require_clear(design: Design, groups: Sequence[_Group], count: int) -> None:
    """Refuse a pose at which boards cut through each other."""
    for one, other in combinations(groups, 2):
        for number, pose in enumerate(_relative(one, other, 0, count)):
            for a in one.boards:
                for b in other.boards:
                    if cut_through(a.pieces, pose.apply(b.pieces)) is not None:
                        raise DesignError(
                            f"boards {a.name or design.name} and {b.name} cut through each other at "
                            f"pose {number + 1}, {b.name} {pose_words(other.poses[number])}."
                        )


def _move(
    design: Design, groups: Sequence[_Group], moved: FloatArray, store: Store | None, progress: Progress | None
) -> None:
    """Set the inductances in H (poses, coils, coils) between coils that move against each other."""
    for start, stop in ranges(len(moved), _POSES_A_BLOCK):
        for one, other in combinations(groups, 2):
            poses, i, k = _relative(one, other, start, stop), np.array(one.coils), np.array(other.coils)
            places = [[*pose.shift.tolist(), *pose.rotation.ravel().tolist()] for pose in poses]
            key = content_key("link", design.digest, i.tolist(), k.tolist(), places)
            known = None if store is None else store.get(key)
            found = np.asarray(known, dtype=np.float64) if isinstance(known, list) else np.zeros(0)
            if found.shape != (len(poses), len(i), len(k)):
                found = moved_inductance(one.paths, other.paths, poses)
                if store is not None:
                    store.put(key, found.tolist())
            moved[start:stop, i[:, None], k], moved[start:stop, k[:, None], i] = found, found.swapaxes(1, 2)
        if progress is not None:
            progress(stop, len(moved))


def _between_ports(
    circuit: ports.PortCircuit, inductance: FloatArray, resistance: FloatArray
) -> list[tuple[str, tuple[str, ...], Any, str, str]]:
    rows: list[tuple[str, tuple[str, ...], Any, str, str]] = []
    if circuit.sources and circuit.loads:
        Z = resistance + 2j * math.pi * circuit.frequency * inductance
        transfer = ports.power_transfer(circuit, ports.port_impedance(circuit, Z, circuit.frequency))
        ends = ("source_coil", "load_coil")
        rows += [
            ("efficiency", ends, transfer.efficiency, "1", "power in the load over power into the terminals"),
            ("available_efficiency", ends, transfer.available_efficiency, "1", "power in the load over available"),
        ]  # fmt: skip
    found = [ports.port_resonances(circuit, L, resistance)[0] for L in inductance]
    number = np.array([len(modes) for modes in found])
    rows.append(("resonances", (), number, "1", "number of resonances of the ports"))
    extremes = np.array([(modes[0], modes[-1]) if len(modes) else (np.nan, np.nan) for modes in found])
    if number.any():
        low, high = extremes.T
        rows += [
            ("lowest_resonance", (), low, "Hz", "lowest resonance of the ports"),
            ("highest_resonance", (), high, "Hz", "highest resonance of the ports"),
            ("splitting", (), high - low, "Hz", "splitting of the resonances"),
        ]  # fmt: skip
    return rows
