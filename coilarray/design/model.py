"""Designs as frozen values in SI, read from TOML files."""

from __future__ import annotations

import difflib
import hashlib
import json
import os
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cached_property, partial
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import MM, display_unit
from coilarray.compute.table import html_card, html_table
from coilarray.constants import RESISTIVITY_COPPER
from coilarray.design import bundled
from coilarray.design.boards import board_facts, boards_words, named_boards
from coilarray.design.body_tables import Edges, Positions, array_window, check_plates
from coilarray.design.fabs import load_profile
from coilarray.design.ports import Port, check_ports
from coilarray.design.readout import Readout
from coilarray.design.scan_states import PartName, Passive, ScanState, Switches, check_state, terminated_state
from coilarray.design.surface_tables import SurfaceArray
from coilarray.design.tables import Document, passive_of, switch_entries
from coilarray.errors import DesignError, GeometryError, NetworkError, UnusualValueWarning, require_finite
from coilarray.fabrication.drawings import array_picture
from coilarray.geometry import (
    EVEN,
    Array,
    Ball,
    Bend,
    Coil,
    Conductor,
    Connector,
    FabRules,
    FinitePlate,
    Hemisphere,
    Indenter,
    Material,
    Plate,
    Pose,
    RoundedSpiral,
    Sheet,
    Stackup,
    Surface,
    Target,
    Unevenness,
)
from coilarray.geometry.arcs import Arc
from coilarray.geometry.array import array_facts
from coilarray.geometry.board_clearance import board_pieces, cut_through, free_shift
from coilarray.geometry.conductor import CurrentPaths
from coilarray.geometry.connector import route_leads
from coilarray.geometry.elastomer import Base, Strain
from coilarray.geometry.rules import BEND_RATIO_SOURCE, usual_bend_ratio
from coilarray.geometry.spiral import Winding
from coilarray.geometry.usual_values import reading, unusual_values

_OPEN: ContextVar[tuple[str, ...]] = ContextVar("_OPEN", default=())
_KNOWN_BY = {"boards": "name", "ports": "coil"}  # tables in lists whose keys have a name instead of a number
# 13.28 · 1e-3 m and 0.01328 m differ in the last bit, which must not make another design.
# Places and angles, for which zero is not a special value, count to 1 pm and 1 prad.
_DIGITS = 14
_PLACES = 12
_HASH_DIGITS = 12


@dataclass(frozen=True)
class Circuit:
    """Circuit that the coils are connected to.

    Raises DesignError for a resistivity that is not positive and finite, or a permittivity below 1
    or not finite.

    Parameters
    ----------
    switches : Switches
        Multiplexer, bus and tank.
    resistivity : float
        Resistivity of the copper in Ω·m.
    terminations : mapping of str to {"ground", "ground one end", "ground other end", "open", "load"}
        Terminations of coils, by name, that differ from `default_termination` while another coil is
        measured.
    default_termination : such a value
        Termination of every other coil.
    scan : tuple of ScanState
        States of a scan. Empty for each coil in turn, see `Design.plan`.
    elastomer_permittivity : float
        Relative permittivity of all sheets.
    part : {"ADG714", "ADG738", "ADG739"}, optional
        Part of the switches. `switches` holds its values or others.
    ports : tuple of Port
        Coils with a source, tank or load of their own, see `coilarray.circuit.ports`.
    link_frequency : float or None
        Frequency in Hz at which the ports work. None without ports.
    """

    switches: Switches = field(default_factory=Switches)
    resistivity: float = RESISTIVITY_COPPER
    terminations: Mapping[str, Passive] = field(default_factory=dict)
    default_termination: Passive = "ground"
    scan: tuple[ScanState, ...] = ()
    elastomer_permittivity: float = 1.0
    part: PartName | None = None
    ports: tuple[Port, ...] = ()
    link_frequency: float | None = None

    def __post_init__(self) -> None:
        require_finite("resistivity", self.resistivity, error=DesignError)
        require_finite("elastomer_permittivity", self.elastomer_permittivity, error=DesignError)
        if self.resistivity <= 0 or self.elastomer_permittivity < 1:
            raise DesignError(
                "resistivity must be positive and elastomer_permittivity at least 1; "
                f"got {self.resistivity:g} Ω·m and {self.elastomer_permittivity:g}."
            )

    @property
    def capacitance(self) -> float:
        """Capacitance of the tank in F."""
        return self.switches.tank_capacitance

    @property
    def short_resistance(self) -> float:
        """Resistance in Ω of the switches that ground a coil."""
        return 2 * self.switches.on_resistance


@dataclass(frozen=True)
class Indentation:
    """Indenter, depths and positions of an indentation.

    Raises DesignError without a depth, for x without y, depths that do not rise from above zero, a
    value that is not finite, or a material of another indenter than a hemisphere.

    Parameters
    ----------
    indenter : Indenter
        The rigid body.
    depths : tuple of float
        Depths of the indentation in m, rising.
    x, y : tuple of float
        Positions of the map in m, relative to `origin_point`. If both are empty, `Design` sets them
        to an even grid over all coils (`coilarray.design.body_tables.array_window`).
    base : {"bonded", "frictionless"} or Seat
        Contact of the lowest sheet with the board, or the soft seat between them.
    origin : str or None
        Name of the coil whose centre is the origin. None if `origin_point` is given.
    origin_point : tuple of float
        x and y in m of the origin on the board. `Design` sets it if `origin` names a coil.
    sample_radius : float or None
        Radius in m of a finite sample around the indenter, half the width under a cylinder. None
        for a wide sample.
    sample_bounds : tuple of float or None
        Edges (x_min, y_min, x_max, y_max) in m of a rectangular sample with free sides, relative to
        `origin_point`. None if the sample covers everything. With a `sample_radius` they only limit
        the positions of the indenter.
    ellipse_bounds : tuple of float or None
        Window (x_min, y_min, x_max, y_max) in m, relative to `origin_point`, to whose positions the
        ellipse model is fitted. None for all of the map.
    strain : {"finite", "linear"}
        Mechanics of the sheets: large deformations, or linear elasticity. The latter is quicker,
        and its faces move up and down only.
    unevenness : Unevenness
        Difference of the seat under a rectangular sample from an even seat that holds it down.
    step : float or None
        Distance in m of the positions that `Design` sets. It follows from the coils by default.
    over_array : tuple of tuple of float
        The x and y that `Design` has set. Another array gives others.
    material : Material or None
        Material of a hemisphere that carries eddy currents or is magnetic. It is then computed as a
        `ball` of its radius. None for materials without effect on the field, such as plastics.
    """

    indenter: Indenter
    depths: tuple[float, ...]
    x: tuple[float, ...] = ()
    y: tuple[float, ...] = ()
    base: Base = "bonded"
    origin: str | None = None
    origin_point: tuple[float, float] = (0.0, 0.0)
    sample_radius: float | None = None
    sample_bounds: tuple[float, float, float, float] | None = None
    ellipse_bounds: tuple[float, float, float, float] | None = None
    strain: Strain = "finite"
    unevenness: Unevenness = EVEN
    step: float | None = None
    over_array: Positions = ((), ())
    material: Material | None = None

    def __post_init__(self) -> None:
        if self.material is not None and not isinstance(self.indenter, Hemisphere):
            raise DesignError(
                'indenter.material needs shape = "hemisphere", which is computed as a sphere of its radius; '
                f"got a {self.indenter.name} of {self.material.name}."
            )
        if not self.depths or bool(self.x) != bool(self.y):
            raise DesignError(
                "an indentation must have at least one depth, and positions along both x and y or along neither."
            )
        places = (*self.x, *self.y, *self.origin_point)
        require_finite("depths and places of an indentation", *self.depths, *places, error=DesignError)
        if not all(shallow < deep for shallow, deep in pairwise((0.0, *self.depths))):
            raise DesignError(
                f"depths of an indentation must rise from above zero; "
                f"got {', '.join(f'{depth * 1e3:g}' for depth in self.depths)} mm."
            )

    def reachable(self, depth: float) -> tuple[FloatArray, FloatArray]:
        """Least and greatest (x, y) with contact on the sample, each of shape (2,).

        They are in m from the origin, and infinite for a wide sample. The contact is assumed to be
        as wide as the indenter at a height of `depth`.
        """
        if self.sample_bounds is None:
            return np.full(2, -np.inf), np.full(2, np.inf)
        rim = self.indenter.radius_at(depth)
        return np.array(self.sample_bounds[:2]) + rim, np.array(self.sample_bounds[2:]) - rim

    def in_ellipse_window(self) -> Indentation:
        """Return the indentation at its positions within `ellipse_bounds`, if given."""
        if self.ellipse_bounds is None:
            return self
        x_min, y_min, x_max, y_max = self.ellipse_bounds
        x, y = tuple(x for x in self.x if x_min <= x <= x_max), tuple(y for y in self.y if y_min <= y <= y_max)
        return replace(self, x=x, y=y, ellipse_bounds=None)

    @property
    def ball(self) -> Ball | None:
        """Ball that represents an indenter with a material, if any."""
        return None if self.material is None else Ball(self.indenter.radius, self.material)


@dataclass(frozen=True, eq=False)
class Board:
    """A board at its place in space.

    Raises DesignError for anything but an Array or a Design, or no Pose.

    Parameters
    ----------
    of : Array or Design
        Coils of the board, perhaps with the design that they belong to. The design's circuit counts
        only for its resistivity: coils that are placed are connected as the placing design says.
    pose : Pose
        Turn and shift of the board.
    name : str or None
        Name of the board, which starts the names of its coils, as in ``receiver/coil1``. Coils keep
        their names if it is empty. By default board2, board3, … in the design that places it.
    file : str or None
        File, or name of a bundled design, that the board was read from.
    """

    of: Array | Design
    pose: Pose = field(default_factory=Pose)
    name: str | None = None
    file: str | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.of, Array | Design) or not isinstance(self.pose, Pose):
            raise DesignError(
                f"a board must have an Array or a Design, and a Pose; got {self.of!r:.60} and {self.pose!r:.60}."
            )

    @cached_property
    def design(self) -> Design:
        """Design of the board by itself."""
        return self.of if isinstance(self.of, Design) else Design(self.of)

    @property
    def array(self) -> Array:
        """Coils of the board in its own coordinates."""
        return self.design.array

    @property
    def prefix(self) -> str:
        """Start of the names of its coils, with a slash unless empty."""
        return f"{self.name}/" if self.name else ""

    @property
    def coil_names(self) -> tuple[str, ...]:
        """Names of its coils in the design that places it."""
        return tuple(f"{self.prefix}{name}" for name in self.array.names)

    @property
    def centres(self) -> FloatArray:
        """Centres of its coils in space in m, shape (coils, 3)."""
        return self.pose.apply(self.array.places)

    def in_space(self, points: npt.ArrayLike) -> FloatArray:
        """Return points of the flat board where the board has them in space.

        `points`, and the same points of the bent and placed board, have the shape (..., 3) and are
        in m.
        """
        form = self.array.form
        return self.pose.apply(points if form is None else form.surface(points))

    @cached_property
    def pieces(self) -> FloatArray:
        """Convex pieces of the board, with sheets on it, in space in m, shape (pieces, 8, 3)."""
        return board_pieces(self.array, self.pose, self.design.top)

    def conductors(self) -> tuple[Conductor, ...]:
        """Return the current path of every coil in space, in m."""
        if self.pose == Pose() and not self.prefix:
            return self.array.conductors()
        paths = zip(self.array.conductors(), self.coil_names, strict=True)
        return tuple(path.posed(self.pose, name) for path, name in paths)


@dataclass(frozen=True, eq=False)
class Design:
    """A coil array with all inputs of its results.

    Raises DesignError for sheets or plates of one name, plates in the sheets, the coils or each
    other, an indentation that the sheets do not allow, a termination, port, state or origin of an
    unknown coil, two ports at a coil, ports without a frequency, an impossible state, boards of one
    name or that cut through each other, or a moved board with sheets, plates or a target.

    Parameters
    ----------
    array : Array
        The coils on their board.
    sheets : tuple of Sheet
        Elastomer on top of the board, upwards.
    indentation : Indentation or None
        Indentation of the elastomer. None if it is not known.
    circuit : Circuit
        Switches, tank, terminations and scan.
    rules : FabRules
        Limits of the board house.
    field_height : float
        Height in m of the plane on which reports show the field.
    name, title, source, author, revision : str
        Name in results, and what reports say of the design.
    plates : tuple of Plate or FinitePlate
        Fixed metal above or below the board.
    target : Target or None
        Body of metal or ferrite that is moved over the board. None without a target.
    readout : Readout
        Settings of the read-out, for the noise and drift of readings.
    boards : tuple of Board
        Other boards in space, see `placed`.
    pose : Pose
        Place of the array's own board. Sheets, plates, an indentation and a target belong to this
        board and need it unmoved.

    Examples
    --------
    >>> from coilarray.geometry import Spiral
    >>> design = Design(Array.row(Spiral(6, 16e-3, 12, 0.15e-3, 0.15e-3), 3, pitch=20e-3))
    >>> [state.name for state in design.plan]
    ['coil1', 'coil2', 'coil3']
    """

    array: Array
    sheets: tuple[Sheet, ...] = ()
    indentation: Indentation | None = None
    circuit: Circuit = field(default_factory=Circuit)
    rules: FabRules = field(default_factory=FabRules)
    field_height: float = 6e-3
    name: str = "design"
    title: str = ""
    source: str = ""
    author: str = ""
    revision: str = ""
    plates: tuple[Plate | FinitePlate, ...] = ()
    target: Target | None = None
    readout: Readout = field(default_factory=Readout)
    boards: tuple[Board, ...] = ()
    pose: Pose = field(default_factory=Pose)

    def __post_init__(self) -> None:
        require_finite("field_height", self.field_height, error=DesignError)
        _require_boards(self)
        names, known = self.coil_names, ", ".join(self.coil_names)
        sheets = [sheet.name for sheet in self.sheets]
        if len(set(sheets)) != len(sheets):
            raise DesignError(f"elastomer sheets must have different names; got {', '.join(sheets)}.")
        if self.plates:
            stackup = self.array.stackup
            copper = {layer for place in self.array.placements for layer in place.layers}
            check_plates(self.plates, self.top, min(stackup.span(layer)[0] for layer in copper))
        for coil in self.circuit.terminations:
            if coil not in names:
                raise DesignError(f"circuit.terminations.{coil} names no coil; there are {known}.")
        check_ports(self.circuit.ports, self.circuit.link_frequency, names)
        states = [state.name for state in self.plan]
        if len(set(states)) != len(states):
            raise DesignError(f"scan must give each state a different name; got {', '.join(states)}.")
        try:
            for state in self.plan:
                check_state(state, names)
        except NetworkError as error:
            raise DesignError(str(error)) from None
        if self.array.form is not None:
            _require_bent(self)
        if (setup := self.indentation) is not None:
            for k, sheet in enumerate(self.sheets):
                if sheet.youngs_modulus is None:
                    raise DesignError(
                        f"elastomer.{k}.youngs_modulus_kPa is missing; [indentation] needs it for every sheet."
                    )
            if self.sheets and setup.depths[-1] >= self.top:
                raise DesignError(
                    f"indentation.depths_mm must be less than the {self.top * 1e3:g} mm of all sheets; "
                    f"got {setup.depths[-1] * 1e3:g}."
                )
            within = None
            if setup.sample_bounds is not None:  # where contacts are possible
                (x_min, y_min), (x_max, y_max) = (edges.tolist() for edges in setup.reachable(setup.depths[-1]))
                within = x_min, y_min, x_max, y_max
            object.__setattr__(self, "indentation", _over_array(setup, self.array, "indentation", within))
        if self.target is not None:
            endless = isinstance(self.target.body, Plate) and not self.target.x
            target = replace(self.target, x=(0.0,), y=(0.0,)) if endless else self.target
            object.__setattr__(self, "target", _over_array(target, self.array, "target"))
            highest = self.top + target.distances[-1] + target.extent
            for plate in self.plates:
                if self.top <= plate.heights[0] < highest:
                    raise DesignError(
                        f"target.distances_mm must keep the target below the plate {plate.name!r}, whose lower face "
                        f"is {(plate.heights[0] - self.top) * 1e3:g} mm above the sheets or the board; the top of the "
                        f"target is at {(highest - self.top) * 1e3:g} mm."
                    )

    @cached_property
    def placed(self) -> tuple[Board, ...]:
        """All boards in space, the design's own first, without a name.

        Boards of boards follow the board that places them.
        """
        own = self
        if self.boards or self.pose != Pose():  # its circuit may name coils of other boards
            circuit = Circuit(
                resistivity=self.circuit.resistivity, elastomer_permittivity=self.circuit.elastomer_permittivity
            )
            own = replace(self, boards=(), pose=Pose(), circuit=circuit)
        boards = [Board(own, self.pose, "")]
        for name_of, board in zip(self.board_names, self.boards, strict=True):
            for inner in board.design.placed:
                name = f"{name_of}/{inner.name}" if name_of and inner.name else name_of or inner.name
                boards.append(Board(inner.of, board.pose.after(inner.pose), name))
        return tuple(boards)

    @property
    def board_names(self) -> tuple[str, ...]:
        """Names of `boards`, by default board2, board3 and so on."""
        given = enumerate(self.boards, start=2)
        return tuple(f"board{number}" if board.name is None else board.name for number, board in given)

    @property
    def is_tuned(self) -> bool:
        """Whether a converter reads the coils with tanks, or at least no ports take their place."""
        return self.readout.is_judged or not self.circuit.ports

    @cached_property
    def coil_names(self) -> tuple[str, ...]:
        """Names of the coils of all boards, such as receiver/coil1."""
        return tuple(name for board in self.placed for name in board.coil_names)

    @property
    def centres(self) -> FloatArray:
        """Centres of all coils in space in m, shape (coils, 3)."""
        return np.concatenate([board.centres for board in self.placed])

    @cached_property
    def paths(self) -> Array | tuple[Conductor, ...]:
        """All current paths: the array of a single flat board, or else `conductors`."""
        return self.conductors() if self.boards else self.array

    def conductors(self) -> tuple[Conductor, ...]:
        """Return the current path in space of every coil of all boards, in m."""
        return tuple(path for board in self.placed for path in board.conductors())

    def flat_conductors(self) -> tuple[Conductor, ...]:
        """Return the current path of every coil of the flat board, in m."""
        return one_board(self, "the resistance of paths").array.flat_conductors()

    def __repr__(self) -> str:
        return f"<Design {self.name}: {boards_words(self)}; hash {self.digest[:_HASH_DIGITS]}>"

    def _repr_html_(self) -> str:
        return design_html(self)

    @property
    def top(self) -> float:
        """Height in m of the sheets' upper face, or 0."""
        return sum(sheet.thickness for sheet in self.sheets)

    @cached_property
    def terminations(self) -> Mapping[str, Passive]:
        """Termination of each coil that is not measured, by name."""
        circuit = self.circuit
        return {name: circuit.terminations.get(name, circuit.default_termination) for name in self.coil_names}

    @cached_property
    def plan(self) -> tuple[ScanState, ...]:
        """States of a scan, by default each coil in turn."""
        return self.circuit.scan or self.coils_in_turn

    @cached_property
    def coils_in_turn(self) -> tuple[ScanState, ...]:
        """States that measure each coil, the others with terminations."""
        return tuple(terminated_state(name, ((name, 1),), self.terminations) for name in self.coil_names)

    @cached_property
    def digest(self) -> str:
        """Hexadecimal SHA-256 of all values that enter a result, equal for equal designs.

        Words about the design do not count. Numbers count to 14 digits, places to 1 pm and angles
        to 1 prad, so that the rounding of a unit conversion makes no other design.
        """
        circuit, setup = self.circuit, self.indentation
        pressed: tuple[object, ...] = ()
        if setup is not None and self.sheets:  # otherwise there are no sheets to press on
            places = (setup.x, setup.y, setup.origin_point, setup.sample_bounds or ())
            how = (setup.base, setup.strain, setup.sample_radius, setup.unevenness)
            pressed = (setup.indenter, setup.depths, *how, *map(np.array, places))
            pressed += () if setup.material is None else (setup.material,)
            pressed += () if setup.ellipse_bounds is None else ("ellipses", np.array(setup.ellipse_bounds))
        metal: tuple[object, ...] = (("plates", self.plates),) if self.plates else ()
        if (target := self.target) is not None:
            over = map(np.array, (target.x, target.y, target.origin_point))
            metal += ("target", target.body, target.distances, *over)
        readout: tuple[object, ...] = () if self.readout == Readout() else (self.readout,)
        ports = (*circuit.ports, circuit.link_frequency) if circuit.ports else ()
        boards = [(board.name, board.pose, board.design.digest) for board in (self.placed[1:] if self.boards else ())]
        space: tuple[object, ...] = () if self.pose == Pose() else (self.pose,)
        space += ("boards", *boards) if boards else ()
        return digest_of(
            self.array, self.sheets, pressed, circuit.switches, circuit.resistivity, circuit.elastomer_permittivity,
            self.terminations, self.plan, self.rules, self.field_height, *metal, *readout, *ports, *space,
        )  # fmt: skip


def _require_boards(design: Design) -> None:
    if wrong := [board for board in design.boards if not isinstance(board, Board)]:
        raise DesignError(f"boards of a design must be of type Board; got {wrong[0]!r:.60}.")
    if design.pose != Pose() and (design.sheets or design.plates or design.target is not None):
        raise DesignError("a design with sheets, plates or a target must have its own board at Pose().")
    if not design.boards:
        return
    for board in design.placed[1:]:
        magnetic = [sheet for sheet in board.design.sheets if sheet.magnetic]
        for what, there in (("a magnetic sheet", magnetic), ("a plate", board.design.plates)):
            if there:
                raise DesignError(
                    f"boards.{board.name} has {what}, {there[0].name}; only the design that places the boards may "
                    "have bodies that change the field."
                )
    names, seen = [board.name for board in design.placed], set[str]()
    for name in design.coil_names:
        if name in seen:
            raise DesignError(f"boards must have different names; got {', '.join(filter(None, names))} (coil {name}).")
        seen.add(name)
    for one, other in combinations(design.placed, 2):
        if one.name == other.name:  # loops of one surface
            continue
        place = cut_through(one.pieces, other.pieces)
        if place is not None:
            at = ", ".join(f"{value:.4g}" for value in MM.of(place).round(6).tolist())
            lift = MM.of(free_shift(one.pieces, other.pieces))
            raise DesignError(
                f"boards {one.name or design.name} and {other.name} cut through each other at ({at}) mm; "
                f"{other.name} is clear {lift:.3g} mm higher."
            )


_Placed = TypeVar("_Placed", Indentation, Target)


def _over_array(setup: _Placed, array: Array, table: str, within: Edges | None = None) -> _Placed:
    """Find the origin of a map, and positions if needed."""
    if setup.origin is not None:
        if setup.origin not in array.names:
            raise DesignError(
                f"{table}.origin names no coil; there are {', '.join(array.names)}; got {setup.origin!r}."
            )
        place = array.placements[array.names.index(setup.origin)]
        if setup.origin_point != (place.x, place.y):
            setup = replace(setup, origin_point=(place.x, place.y))
    if (setup.x, setup.y) == setup.over_array:
        x, y = array_window(array, setup.origin_point, setup.step, within, table)
        setup = replace(setup, x=x, y=y, over_array=(x, y))
    return setup


def _require_bent(design: Design) -> None:
    """Refuse whatever is computed for flat boards only, and sheets that are thicker than a bend."""
    magnetic = [f"elastomer.{k}.relative_permeability" for k, sheet in enumerate(design.sheets) if sheet.magnetic]
    needs = {
        **dict.fromkeys(magnetic[:1], "above 1"),
        "indentation": design.indentation,
        "plate.0": design.plates or None,
        "target": design.target,
    }
    for key, there in needs.items():
        if there is not None:
            raise DesignError(f"{key} needs a flat board; this board is bent, see [board].")
    x_min, y_min, x_max, y_max = design.array.bounds
    corners = [(x, y, design.top) for x in (x_min, x_max) for y in (y_min, y_max)]
    if design.array.form is not None and design.top:
        try:
            design.array.form.surface(corners)
        except GeometryError as error:
            raise DesignError(f"elastomer is too thick for the board: {error}") from None


@dataclass(frozen=True, eq=False)
class DesignFile:
    """A `design` with the additional content of its file.

    The `document` is the file as TOML reads it, without defaults: plain tables, lists and values,
    which `coilarray.design.vary.vary` changes. `given` are the dotted keys in the file, the others
    have their default. `assumed` are keys whose values are assumed, with the reason. `values` are
    all values by their dotted keys, defaults included, in the units of the keys. `text` is the file
    as it was read, whose layout `coilarray.design.write.save_design` keeps, if any.
    """

    design: Design
    document: Mapping[str, Any]
    given: frozenset[str]
    assumed: Mapping[str, str]
    values: Mapping[str, object]
    text: str = ""

    @cached_property
    def unusual(self) -> tuple[str, ...]:
        """Lines about unusual values, with the likely values."""
        return tuple(unusual_values(self.values))

    def conductors(self) -> tuple[Conductor, ...]:
        """Return the current path of every coil of the design, in m."""
        return self.design.conductors()

    def flat_conductors(self) -> tuple[Conductor, ...]:
        """Return the current path of every coil of the flat board, in m."""
        return self.design.flat_conductors()

    def __repr__(self) -> str:
        return f"<DesignFile of {self.design!r}: values {dict(file_facts(self))['values']}>"

    def _repr_html_(self) -> str:
        return design_html(self.design, file_facts(self))


def one_board(design: Design, what: str) -> Design:
    """Return a design of one board, as `what` needs it, and refuse several."""
    if design.boards:
        names = ", ".join(dict.fromkeys(filter(None, (board.name for board in design.placed))))
        raise DesignError(
            f"{what} needs a design of one flat board; {design.name} also has boards{f' {names}' if names else ''}."
        )
    return design


def design_of(given: Design | DesignFile | CurrentPaths) -> Design:
    """Return the design of a design, its file, or coils."""
    if isinstance(given, DesignFile):
        return given.design
    if isinstance(given, CurrentPaths):
        return Design(given.as_array())
    if not isinstance(given, Design):
        raise DesignError(
            f"design must be a Design, an Array, or the DesignFile that holds it as .design; got {given!r:.60}. A name "
            "or file is read with load_design."
        )
    return given


def load_design(name_or_path: str | Path | None = None) -> Design:
    """Read a design.

    Parameters
    ----------
    name_or_path : str or Path, optional
        A TOML file, or the name of a bundled design. The bundled ``gast2020`` by default.

    Returns
    -------
    Design
        The design, with all checks.

    Raises
    ------
    DesignError
        An unreadable file, wrong TOML, an unknown key, a value that is not allowed, or an
        impossible geometry.

    Examples
    --------
    >>> load_design("gast2020").array.names
    ('coil1', 'coil2', 'coil3', 'coil4', 'coil5', 'coil6')
    """
    return load_design_file(name_or_path).design


def load_design_file(name_or_path: str | Path | None = None) -> DesignFile:
    """Read a design with the additional content of its file.

    `name_or_path` and errors are the same as in `load_design`.

    Returns
    -------
    DesignFile
        The design, its tables and which of its values are assumed.
    """
    given = bundled.STARTER if name_or_path is None else str(name_or_path)
    text = bundled.DESIGNS.text(given)
    with _opened(given):
        return parse_design_file(text, given, Path(given).parent)


@contextmanager
def _opened(given: str) -> Iterator[None]:
    """Refuse a file that is read for one of its own boards."""
    whole = str(Path(given).resolve())
    if whole in _OPEN.get():
        raise DesignError(f"{given} places itself as one of its own boards.")
    token = _OPEN.set((*_OPEN.get(), whole))
    try:
        yield
    finally:
        _OPEN.reset(token)


def parse_design(text: str, origin: str = "design") -> Design:
    """Read a design from the text of a TOML file.

    `origin` names it in messages. Files of other boards are found from the working folder. See
    `load_design`.

    Returns
    -------
    Design
        The design, with all checks.
    """
    return parse_design_file(text, origin).design


def parse_design_file(text: str, origin: str = "design", folder: Path | None = None) -> DesignFile:
    """Read a text that messages call `origin`, with warnings about wrong units.

    Paths in it are relative to a `folder`, by default the working folder.
    """
    document = with_paths(bundled.DESIGNS.parse(text, origin), partial(_whole_path, (folder or Path()).absolute()))
    file = build_design_file(document, origin, text)
    for line in file.unusual:
        warnings.warn(f"{origin}: {line}", UnusualValueWarning, stacklevel=2)
    return file


def with_paths(document: Mapping[str, Any], change: Callable[[str], str]) -> dict[str, Any]:
    """Return a document whose paths of other files are changed."""
    changed = dict(document)
    boards = document.get("boards")
    if isinstance(boards, list):
        changed["boards"] = list(boards)
        for k, table in enumerate(boards):
            match table.get("design") if isinstance(table, Mapping) else None:
                case str(given):
                    changed["boards"][k] = {**table, "design": change(given)}
                case Mapping() as inner:
                    changed["boards"][k] = {**table, "design": with_paths(inner, change)}
    array = document.get("array")
    if isinstance(array, Mapping) and isinstance(array.get("surface"), str):
        changed["array"] = {**array, "surface": change(array["surface"])}
    return changed


def _whole_path(folder: Path, given: str) -> str:
    """Return a file's whole path, or the name of a bundled design or of a surface."""
    path = os.path.normpath(folder / given)
    named = given in (*bundled.names(), "dome") and not os.path.isfile(path)
    return given if named or not given else path


def relative_path(folder: Path, given: str) -> str:
    """Return a whole path relative to a folder."""
    return os.path.relpath(given, folder.absolute()) if os.path.isabs(given) else given


def content_of(given: str) -> str:
    """Return the digest of a design's file, or of a surface's, at a whole path or of a name."""
    if not os.path.isfile(given) and given not in bundled.names():
        return given
    if os.path.isabs(given) and Path(given).suffix.lower() != ".toml":
        return hashlib.sha256(Path(given).read_bytes()).hexdigest()
    return load_design(given).digest


def build_design(document: Mapping[str, Any], origin: str = "design") -> Design:
    """Check a document and make its design."""
    return build_design_file(document, origin).design


def build_design_file(document: Mapping[str, Any], origin: str = "design", text: str = "") -> DesignFile:
    """Check a document, and store it with design and text."""
    parsed = bundled.DESIGNS.check(Document, document, origin)
    try:
        with reading():
            design = _build(parsed)
        values = _flatten(parsed.model_dump(by_alias=True, exclude={"assumed"}, exclude_none=True))
        entries = switch_entries(design.circuit.switches)
        for key in parsed.circuit.of_part:
            values[f"circuit.{key}"] = round(entries[key], 3) if key.endswith("_pF") else entries[key]
        for key in parsed.assumed:
            if key not in values:
                close = difflib.get_close_matches(key, list(values), n=1)
                hint = f"; did you mean {close[0]}?" if close else "."
                raise DesignError(f"assumed.{key!r} names no value of the design{hint}")
    except (DesignError, GeometryError, NetworkError) as error:
        raise DesignError(f"{origin}: {error}") from None
    given = frozenset(_flatten(document))
    profile = {} if parsed.fab.profile is None else load_profile(parsed.fab.profile).assumed
    assumed = {f"fab.{key}": reason for key, reason in profile.items() if f"fab.{key}" not in given}
    if isinstance(design.array.form, Bend) and parsed.fab.min_bend_ratio is None:
        values["fab.min_bend_ratio"] = usual_bend_ratio(len(design.array.stackup.names))
        assumed["fab.min_bend_ratio"] = BEND_RATIO_SOURCE
    assumed |= {f"circuit.{key}": reason for key, reason in parsed.circuit.of_part.items()}
    return DesignFile(design, document, given, assumed | dict(parsed.assumed), values, text)


def _build(parsed: Document) -> Design:
    coils: dict[str, Coil] = {}
    for name, table in parsed.coils.items():
        with _named(f"coils.{name}"):
            coils[name] = table.build(name)
    with _named("stackup"):
        stackup = Stackup(**parsed.stackup.in_si())
    loops: tuple[tuple[Array, Pose], ...] = ()
    with _named("array"):
        if isinstance(parsed.array, SurfaceArray):
            for key, is_given in (("connector", parsed.connector is not None), ("board.bend", parsed.board.is_bent)):
                if is_given:
                    raise DesignError(f'{key} needs one flat board; lattice = "surface" has a board for each coil.')
            loops = parsed.array.build(stackup, coils, parsed.board)
            array = loops[0][0]
        else:
            array = parsed.array.build(stackup, coils, parsed.board)
    if parsed.connector is not None:
        with _named("connector"):
            array = route_leads(array, Connector(**parsed.connector.in_si()))
    array = array if loops else parsed.board.bent(array)
    sheets = tuple(Sheet(**sheet.in_si()) for sheet in parsed.elastomer)
    indenter, pressed = parsed.indenter, parsed.indentation
    if (indenter is None) != (pressed is None):
        there, missing = ("indentation", "indenter") if indenter is None else ("indenter", "indentation")
        raise DesignError(f"[{there}] needs the table [{missing}] too.")
    indentation, target, plates = None, None, []
    if indenter is not None and pressed is not None:
        if not sheets:
            raise DesignError("[indentation] needs at least one [[elastomer]] to press on.")
        with _named("indenter"):
            body = indenter.build()
        indentation = Indentation(body, **pressed.values(), material=indenter.substance("indenter"))
    if parsed.target is not None:
        with _named("target"):
            target = parsed.target.build()
    top = sum(sheet.thickness for sheet in sheets)
    for k, plate in enumerate(parsed.plate):
        with _named(f"plate.{k}"):
            plates.append(plate.build(top, -stackup.thickness))
    circuit = parsed.circuit
    default = passive_of(circuit.default_termination)
    terminations = {coil: passive_of(how) for coil, how in circuit.terminations.items()}
    boards = [Board(loop, pose, "") for loop, pose in loops[1:]]
    for k, placed in enumerate(parsed.boards):
        if isinstance(placed.design, str):
            boards.append(Board(load_design(placed.design), placed.pose, placed.name, placed.design))
        else:
            boards.append(Board(build_design(placed.design, f"boards.{k}.design"), placed.pose, placed.name))
    names = (*array.names, *(f"{board.prefix}{name}" for board in boards for name in board.design.coil_names))
    every = {name: terminations.get(name, default) for name in names}
    return Design(
        boards=tuple(boards),
        pose=loops[0][1] if loops else Pose(),
        name=parsed.name,
        title=parsed.title or parsed.name,
        source=parsed.source,
        author=parsed.author,
        revision=parsed.revision,
        array=array,
        sheets=sheets,
        indentation=indentation,
        target=target,
        circuit=Circuit(
            switches=circuit.build_switches(len(names)),
            part=circuit.switches,
            resistivity=circuit.resistivity_ohm_m,
            terminations=terminations,
            default_termination=default,
            scan=tuple(state.build(every) for state in parsed.scan),
            elastomer_permittivity=circuit.elastomer_permittivity,
            ports=tuple(Port(**port.in_si()) for port in circuit.ports),
            **circuit.in_si("link_frequency_MHz"),
        ),
        rules=FabRules(**parsed.fab.in_si(without=("profile",))),
        field_height=parsed.field.height_mm * 1e-3,
        plates=tuple(plates),
        readout=Readout(**parsed.readout.in_si()),
    )


@contextmanager
def _named(key: str) -> Iterator[None]:
    """Prefix messages about an impossible geometry with its key."""
    try:
        yield
    except GeometryError as error:
        raise DesignError(f"{key}: {error}") from None


def _flatten(table: Mapping[str, Any], prefix: str = "") -> dict[str, object]:
    """Return every value by its dotted key, plain lists whole, boards and ports by their names."""
    flat: dict[str, object] = {}
    for key, value in table.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping):
            flat.update(_flatten(value, f"{name}."))
        elif isinstance(value, list) and value and all(isinstance(item, Mapping) for item in value):
            for index, item in enumerate(value):
                flat.update(_flatten(item, f"{name}.{item.get(_KNOWN_BY.get(key, ''), index)}."))
        else:
            flat[name] = value
    return flat


def digest_of(*values: object) -> str:
    """Return the hexadecimal SHA-256 of values of any structure."""
    return hashlib.sha256(json.dumps([_plain(value) for value in values], sort_keys=True).encode()).hexdigest()


def _plain(value: Any) -> Any:
    """Return a value for JSON, dataclasses with the class's name."""
    match value:
        case bool() | str() | None:
            return value
        case int() | float() | np.number():
            return f"{float(value) + 0.0:.{_DIGITS - 1}e}"  # no minus zero. 1 and 1.0 are equal
        case Mapping():
            return {key: _plain(item) for key, item in value.items()}
        case tuple() | list():
            return [_plain(item) for item in value]
        case np.ndarray():
            return (np.round(value, _PLACES) + 0.0).tolist()
        case Array():
            return _array(value)
        case Material():
            return [_plain(value.conductivity), _plain(value.relative_permeability)]  # its name does not count
        case Pose():
            return _plain(np.array([value.x, value.y, value.z, *value.turn]))
        case Plate():
            return [value.name, _plain(value.material), _plain(value.thickness), _plain(np.array(value.z))]
        case Winding():  # its name and the board of the coil alone do not count
            values = {field.name: getattr(value, field.name) for field in fields(value)}
            if isinstance(value, RoundedSpiral):  # a file has the direction of a corner, degrees away from a flat's
                values["direction"] = np.array(value.direction)
            values["winding_rule"] = "parallel" if value.is_parallel else "corner"  # a circle always has a rule
            return [type(value).__name__, *(_plain(values[key]) for key in values if key not in ("name", "stackup"))]
        case Arc():  # its bulge is computed, and the bulge of a short arc has few digits
            return [value.first, value.last, _plain(np.array(value.bulge))]
        case Bend():  # the apex of a slight cone is far away and little known: its slope counts
            zones = np.array([(zone.radius, zone.at, zone.width) for zone in value.zones])
            slope = 0.0 if value.apex is None else value.zones[0].radius / value.apex
            return ["Bend", _plain(zones), _plain(np.array([value.axis, value.neutral, slope]))]
        case FabRules():
            limits = [_plain(getattr(value, field.name)) for field in fields(value) if field.name != "min_bend_ratio"]
            bend = [] if value.min_bend_ratio is None else [_plain(value.min_bend_ratio)]
            return ["FabRules", *limits, *bend]
        case Surface():
            return value.digest
        case FinitePlate():
            shape = [value.outline, value.material, value.thickness, value.tilt, value.tilt_direction]
            return [value.name, _plain(shape), _plain(np.array(value.centre))]
    if not is_dataclass(value):
        raise TypeError(f"a design must be made of plain values; got {type(value).__name__}.")
    return [type(value).__name__, *(_plain(getattr(value, field.name)) for field in fields(value))]


def _array(array: Array) -> Any:
    """Return each coil's spiral or lines once, without names and lattice."""
    coils: dict[int, str] = {}
    placements: list[Any] = []
    for place in array.placements:
        coil = place.coil
        if id(coil) not in coils:
            lines = (coil.lines, coil.arcs) if coil.arcs else (coil.lines,)
            drawn = (*lines, coil.widths, coil.gap, coil.via, coil.terminal, coil.outline)
            coils[id(coil)] = digest_of(drawn if coil.wound is None else coil.wound)
        where = np.array([place.x, place.y, place.rotation])
        placements.append([place.name, coils[id(coil)], list(place.layers), _plain(where)])
    form = () if array.form is None else (_plain(array.form),)
    return [_plain(array.stackup), placements, _plain(array.board_margin), array.through_holes, *form]


def metal_words(design: Design) -> str:
    """Return the plates and the target in words, if any."""
    found = [f"the plate {plate.name} of {plate.material.words}" for plate in design.plates]
    if design.target is not None:
        material = design.target.body.material.words
        article = "an" if material[0] in "aeiou" else "a"
        found.append(f"{article} {material} {design.target.kind} as target")
    return " and ".join([", ".join(found[:-1]), found[-1]] if len(found) > 1 else found)


def design_facts(design: Design) -> list[tuple[str, str]]:
    """Return a design as rows of names and values."""
    setup, switches = design.indentation, design.circuit.switches
    tank = display_unit("F").text(switches.tank_capacitance, ".4")
    sheets = [f"{sheet.name} {MM.text(sheet.thickness, '.4')}" for sheet in design.sheets]
    depths = [] if setup is None else [f"{depth:g}" for depth in MM.of(setup.depths).round(6)]
    rows = [
        *array_facts(design.array),
        *board_facts(design),
        ("elastomer", ", ".join(sheets)),
        ("pressed by", "" if setup is None else f"{setup.indenter.name}, {', '.join(depths)} mm deep"),
        ("metal", metal_words(design)),
        ("circuit", f"tank of {tank}, states of a scan: {len(design.plan)}"),
        ("source", design.source),
        ("hash", design.digest[:_HASH_DIGITS]),
    ]
    return [(what, text) for what, text in rows if text]


def file_facts(file: DesignFile) -> list[tuple[str, str]]:
    """Return the number of given values, and the assumed values."""
    assumed = [key for key in file.values if key in file.assumed]
    given = sum(key in file.given and key not in file.assumed for key in file.values)
    counts = f"{given} given, {len(file.values) - given - len(assumed)} by default, {len(assumed)} assumed"
    return [("values", counts), *([("assumed", ", ".join(assumed))] if assumed else [])]


def design_html(design: Design, more: list[tuple[str, str]] | None = None) -> str:
    """Return a design, with more rows, for a notebook."""
    title = f"{design.name}: {design.title}" if design.title not in ("", design.name) else design.name
    rows = [*design_facts(design), *(more or [])]
    own, *others = named_boards(design)
    pictures = [f"<p>board {board.name}</p>{array_picture(board.array)}" for board in others]
    return html_card(title, array_picture(own.array, title), *pictures, html_table((), rows))
