"""Scenes of a design: a view's parts, computed and joined, and films."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.circuit.coupling import couple_design, operating_currents, operating_field, require_endless
from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import MM, true_minus
from coilarray.compute.threads import Progress
from coilarray.design.model import Design, Indentation
from coilarray.errors import GeometryError, LocalizeError, MetalError
from coilarray.localize.forward import forward_model
from coilarray.localize.inverse import locate
from coilarray.response.dataset import on_board
from coilarray.response.map import response_map
from coilarray.response.setup import contact_at, indentation_of, target_of
from coilarray.response.target import with_target_as_plate
from coilarray.viz.datasets.results import DELTA, field_grid, require_memory
from coilarray.viz.scenes.board import (
    VEILED,
    CoilColours,
    board_in_pieces,
    board_scene,
    recoloured,
    scene_of_board,
    scene_of_dent,
    scene_of_sheets,
)
from coilarray.viz.scenes.draw import shown_units
from coilarray.viz.scenes.metal import CURRENT, scene_of_metal, target_place
from coilarray.viz.scenes.results import (
    Axes,
    beside_faces,
    colours_of_currents,
    count_of,
    field_box,
    field_planes,
    line_seeds,
    points_of_box,
    scale_of_field,
    scene_of_coupling,
    scene_of_lines,
    scene_of_location,
    scene_of_response,
    scene_of_slices,
    scene_of_surfaces,
)
from coilarray.viz.scenes.scene import Part, Scale, Scene, Text, about_zero

if TYPE_CHECKING:
    import pyvista


Tracker = Callable[[str], Progress | None]
"""Takes the name of a computation and returns its progress function of (done, total)."""

Item = Literal[
    "board",
    "elastomer",
    "dent",
    "plates",
    "target",
    "eddies",
    "field",
    "lines",
    "surfaces",
    "currents",
    "coupling",
    "response",
    "location",
]
ITEMS: tuple[Item, ...] = get_args(Item)
"""Items that a scene of a design may contain."""

_PLANE_SPACING, _BOX_SPACING = 0.5e-3, 1e-3  # default distances of the points of B in m
_LEVELS = (-0.35, -0.85, -1.35)  # surfaces of equal |B|, as powers of ten of its maximum
_ALONE: frozenset[Item] = frozenset({"board", "elastomer"})
_IN_BOX: frozenset[Item] = frozenset({"lines", "surfaces"})
_METAL: frozenset[Item] = frozenset({"plates", "target", "eddies"})
_OF_B: frozenset[Item] = frozenset({"field", *_IN_BOX})
_WITHIN: frozenset[Item] = frozenset({"field", "lines", "surfaces", "response", "location", "coupling", *_METAL})


@dataclass(frozen=True, eq=False)
class View:
    """Selection of a design's shown parts, and their computation.

    Parameters
    ----------
    show : tuple of str
        Items of `ITEMS`. Sheets are lifted off a bare board, and a dent replaces them. Currents
        colour the copper.
    layers : tuple of str, optional
        Copper layers, all by default.
    coil : str, optional
        Measured coil, for field, lines, surfaces, currents and response. The default is the middle
        coil.
    others_open : bool
        Leave the other coils open, instead of terminated as in the design.
    spacing : float, optional
        Distance between points of B in m. The default is 0.5 mm on planes and 1 mm in a box.
    at : tuple of float, optional
        Place of the indenter or target on the board in m. The default is off the map's centre.
    distance : float, optional
        Distance of the target in m. The default is the least distance. If B is not shown, a slider
        stands at this distance first.
    depth : float, optional
        Depth of the indentation in m. The default is the deepest of the design.
    table : xarray.Dataset, optional
        Table of `coilarray.localize.forward.table_for`, which a location needs. The readings at
        `at` are located.
    """

    show: tuple[Item, ...] = ("board",)
    layers: tuple[str, ...] | None = None
    coil: str | None = None
    others_open: bool = False
    spacing: float | None = None
    at: tuple[float, float] | None = None
    distance: float | None = None
    depth: float | None = None
    table: xr.Dataset | None = None


def board_and_metal(design: Design) -> tuple[Item, ...]:
    """Default items of a design, with metal also the sheets."""
    plates: tuple[Item, ...] = ("plates",) if design.plates else ()
    target: tuple[Item, ...] = ("target",) if design.target is not None else ()
    sheets: tuple[Item, ...] = ("elastomer",) if design.sheets and (plates or target) else ()
    return ("board", *sheets, *plates, *target)


def scene_of_design(design: Design, view: View | None = None, track: Tracker | None = None) -> Scene:
    """Compute the scene of a view, by default the board.

    `track` gives the progress function of each computation. An unknown coil or layer, an indenter
    off the board, or a field that needs too much memory raises a GeometryError. An impossible
    indentation, map or reading raises an ElastomerError or LocalizeError. Metal that the design
    does not have or that is not computed raises a MetalError.
    """
    return _Making(design, view or View(), track or (lambda text: None)).scene()


@dataclass(frozen=True, eq=False)
class _Making:
    """Scene during its computation."""

    design: Design
    view: View
    track: Tracker

    def scene(self) -> Scene:
        """Make the scene."""
        shown = set(self.view.show)
        for item in shown:
            if item not in ITEMS:
                raise GeometryError(f"items to show must be of {', '.join(ITEMS)}; got {item!r}.")
        if self.view.coil not in (None, *self.design.array.names):
            raise GeometryError(f"there is no coil {self.view.coil!r}; there are {', '.join(self.design.array.names)}.")
        self._require_field()
        if shown <= _ALONE and {"board"} <= shown and self.view.layers is None:
            return board_scene(self.design.array, self.design.sheets if "elastomer" in shown else ())
        array, sheets = self.design.array, self.design.sheets
        makers: dict[str, Callable[[], Scene]] = {
            "dent": self._dent,
            "elastomer": lambda: scene_of_sheets(array, sheets),
            "metal": self._metal,
            "currents": self._currents,
            "board": lambda: scene_of_board(array, layers=self.view.layers, name_heights=self._name_heights),
            "coupling": lambda: scene_of_coupling(self._coupling),
            "response": self._response,
            "location": self._location,
        }
        left_out = ({"elastomer"} if "dent" in shown else set()) | ({"board"} if "currents" in shown else set())
        made = (shown - left_out) | ({"metal"} if shown & _METAL else set())
        scene = Scene()
        for name, make in makers.items():
            if name in made:
                scene += make()
        scene += self._field(shown)
        if not scene.parts:
            reason = f" {' '.join(scene.notes)}" if scene.notes else ""
            raise GeometryError(f"nothing to show for {', '.join(self.view.show) or 'no items'}.{reason}")
        return scene

    def _metal(self) -> Scene:
        """Make the scene of plates, target and eddy currents."""
        view = self.view
        return scene_of_metal(
            self.design, frozenset(_METAL & set(view.show)), self._coil, lambda: self._coupling,
            terminated=not view.others_open, distance=view.distance, at=view.at, still=bool(_OF_B & set(view.show)),
            progress=self.track("target"),
        )  # fmt: skip

    def _currents(self) -> Scene:
        """Make the board coloured by the coils' currents."""
        design, view = self.design, self.view
        currents = operating_currents(design, self._coupling, self._coil, terminated=not view.others_open)
        colours = colours_of_currents(currents, design.array.names.index(self._coil))
        copper, rest = board_in_pieces(design.array, view.layers, self._name_heights)
        note = f"Black: {self._coil} is measured, the others {self._others}; current per its ampere."
        return Scene(recoloured(copper, colours), notes=(note,)) + rest

    @property
    def _others(self) -> str:
        return "open" if self.view.others_open else "as terminated"

    @property
    def _coil(self) -> str:
        return self.design.array.middle_coil if self.view.coil is None else self.view.coil

    @cached_property
    def _coupling(self) -> xr.Dataset:
        return couple_design(self.design, progress=self.track("inductances"))

    @cached_property
    def _with_target(self) -> Design:
        """Design whose field is shown."""
        shown = set(self.view.show)
        if "target" not in shown or not shown & _OF_B:
            return self.design
        place = target_place(self.design, self._coil, self.view.at)
        return with_target_as_plate(self.design, place, self._distance)

    @cached_property
    def _coupling_with_target(self) -> xr.Dataset:
        design = self._with_target
        same = design is self.design
        return self._coupling if same else couple_design(design, progress=self.track("inductances beside the target"))

    @property
    def _distance(self) -> float:
        """Distance of the target in m."""
        return min(target_of(self.design).distances) if self.view.distance is None else self.view.distance

    @property
    def _setup(self) -> Indentation:
        return indentation_of(self.design)

    @property
    def _depth(self) -> float:
        return max(self._setup.depths) if self.view.depth is None else self.view.depth

    @property
    def _at(self) -> tuple[float, float]:
        """Position of the indenter on the board in m."""
        return off_middle(self._setup) if self.view.at is None else self.view.at

    def _dent(self) -> Scene:
        design, where, opacity = self.design, self._on_board, 1.0 if self._covered else VEILED
        dent, indenter = dent_of_design(design, self._depth), self._setup.indenter
        return scene_of_dent(design.array, design.sheets, dent, indenter, where, opacity=opacity)

    @property
    def _on_board(self) -> tuple[float, float]:
        """Position of the indenter in m, or GeometryError off the board."""
        x, y = self._at
        x_min, y_min, x_max, y_max = self.design.array.bounds
        if not (x_min < x < x_max and y_min < y < y_max):
            raise GeometryError(
                f"the indenter must be over the board, from ({x_min * 1e3:.4g}, {y_min * 1e3:.4g}) to "
                f"({x_max * 1e3:.4g}, {y_max * 1e3:.4g}) mm; got ({x * 1e3:.4g}, {y * 1e3:.4g}) mm."
            )
        return x, y

    @property
    def _covered(self) -> bool:
        """True if the sheets hide the board."""
        return "dent" in self.view.show and not set(self.view.show) & _WITHIN

    @property
    def _name_heights(self) -> npt.NDArray[np.float64] | float:
        if not self._covered:
            return 0.0
        # those in the open quarter lie on the board
        return np.where((self.design.array.centres < self._on_board).all(axis=1), 0.0, self.design.top)

    def _response(self) -> Scene:
        """Make the scene of a draped response."""
        for name, positions in (("x", self._setup.x), ("y", self._setup.y)):  # before a map is computed
            if len(positions) < 2:
                raise LocalizeError(f"a draped map needs at least 2 positions along {name}; got 1.")
        depths = [self._depth]
        response = response_map(self.design, depths=depths, accuracy="auto", progress=self.track("response"))
        state = first_states(self.design).get(self._coil)
        if state is None:
            names = ", ".join(first_states(self.design))
            raise LocalizeError(f"the scan has no state that measures {self._coil}; it measures {names}.")
        outlines = [place.to_board(place.coil.outline) for place in self.design.array.placements]
        return scene_of_response(response, state, outlines=outlines)

    def _location(self) -> Scene:
        """Make the scene of a located indentation."""
        if self.view.table is None:
            raise LocalizeError("a location needs the response table of the design.")
        model = forward_model(on_board(self.view.table))
        found = locate(model, model.delta([*self._at, self._depth]))
        return scene_of_location(found, self.design.array.bounds, self.design.top, self._at)

    def _require_field(self) -> None:
        """Refuse a field that cannot be computed."""
        shown = set(self.view.show)
        if shown & _OF_B:
            require_endless(self._with_target)
            indentation = self.design.indentation
            if "dent" in shown and indentation is not None and indentation.material is not None:
                raise MetalError("B beside an indenter of metal or ferrite is not computed: leave out the dent, or B.")
        grids = [field_box(self.design, self._coil, self.view.spacing or _BOX_SPACING)] if shown & _IN_BOX else []
        if "field" in shown:
            grids += field_planes(self.design, self._coil, self.view.spacing or _PLANE_SPACING)
        if grids:
            require_memory(count_of(grids), f"a spacing of {max(axis.spacing for axis in grids[0]) * 1e3:g} mm")

    def _b_on(self, axes: Axes, what: str) -> pyvista.RectilinearGrid:
        """Compute B on a grid."""
        view, design, coupling, (x, y, z) = self.view, self._with_target, self._coupling_with_target, axes
        if len(z) > 1:
            z = beside_faces(design, z, float(coupling.frequency.sel(coil=self._coil)))
        field = operating_field(
            design, coupling, self._coil, x, y, z,
            current=CURRENT, terminated=not view.others_open, progress=self.track(what),
        )  # fmt: skip
        return field_grid(field.x.values, field.y.values, field.z.values, field.B.values)

    def _field(self, shown: set[Item]) -> Scene:
        """Make the scene of planes, lines and surfaces of B."""
        design, coil, spacing = self._with_target, self._coil, self.view.spacing
        planes, boxes = [], []
        if "field" in shown:
            for x, y, z in field_planes(design, coil, spacing or _PLANE_SPACING):
                planes.append(self._b_on((x.points, y.points, z.points), "field on a plane"))
        if shown & _IN_BOX:
            spans = field_box(design, coil, spacing or _BOX_SPACING)
            boxes.append(self._b_on(points_of_box(design, spans), "field in a box"))
        if not planes and not boxes:
            return Scene()
        scale = scale_of_field([*planes, *boxes])
        scene = scene_of_slices(planes, scale)
        for box in boxes:
            if "lines" in shown:
                scene += scene_of_lines(box, line_seeds(design, coil), scale)
            if "surfaces" in shown:
                scene += scene_of_surfaces(box, [scale.high * 10**level for level in _LEVELS], scale)
        others = f", the others {self._others}" if len(self.design.array.names) > 1 else ""
        carried = f"{coil} carries {CURRENT * 1e3:g} mA{others}"
        return scene + Scene(notes=(f"B in phase, {self._surroundings}; {carried}.",))

    @property
    def _surroundings(self) -> str:
        """Describe the surroundings that B includes."""
        design, metal = self._with_target, []
        if design.target is None and self.design.target is not None:
            metal.append(f"the target at {MM.text(self._distance, '.3')}")
        if self.design.plates:
            metal.insert(0, "the plates")
        left_out = (["the target"] if design.target is not None else []) + (["elastomer"] if design.sheets else [])
        parts = [f"beside {' and '.join(metal)}"] if metal else []
        parts += [f"without {' and '.join(left_out)}"] if left_out else []
        return ", ".join(parts) or "in air"


_STEPS = 5  # positions of the response per thickness of all sheets, as `coilarray.localize.forward` needs them
_BELOW = 0.17  # distance from a coil's name down to its number, over the coil's length along y


@dataclass(frozen=True, eq=False)
class Touch:
    """Path of the indenter with δ of every coil."""

    design: Design
    depth: float  # m
    places: FloatArray  # shape (n, 2), m on the board
    delta: FloatArray  # shape (n, coils), of the first state that measures each coil, or NaN

    @cached_property
    def _board(self) -> tuple[tuple[Part, ...], Scene]:
        """Copper of the board, and the rest."""
        return board_in_pieces(self.design.array)

    @property
    def scale(self) -> Scale:
        """Scale of δ for the whole path."""
        return about_zero(DELTA, "δ", "", self.delta)

    def board(self) -> Scene:
        """Board without its copper, which does not change."""
        return self._board[1]

    def scenes(self) -> Iterator[Scene]:
        """Make one scene per place."""
        array, setup, scale = self.design.array, indentation_of(self.design), self.scale
        dent = dent_of_design(self.design, self.depth)
        factor, _ = shown_units(scale)
        below = _BELOW * float(np.ptp(array.placements[0].coil.outline[:, 1]))
        for (x, y), delta in zip(self.places.tolist(), self.delta, strict=True):
            where = true_minus(f"x = {x * 1e3:+.1f} mm, y = {y * 1e3:+.1f} mm, {self.depth * 1e3:g} mm deep")
            numbers = tuple(
                Text(true_minus(f"{round(value * factor):+d}"), (across * 1e3, (along - below) * 1e3, 0.0), 16.0)
                for value, (across, along) in zip(delta.tolist(), array.centres.tolist(), strict=True)
                if math.isfinite(value)
            )
            coils = recoloured(self._board[0], CoilColours(delta, scale))
            scene = Scene(coils, numbers, (f"The indenter is at {where}.",))
            yield scene + scene_of_dent(array, self.design.sheets, dent, setup.indenter, (x, y), opacity=VEILED)


def touch_along(
    design: Design, *, count: int = 48, depth: float | None = None, progress: Progress | None = None
) -> Touch:
    """Compute δ along a path of the indenter.

    The path has `count` places at equal steps along x over all coils through the middle coil.
    `depth` in m is by default the deepest of the design.
    """
    setup, array = indentation_of(design), design.array
    outlines = np.concatenate([place.to_board(place.coil.outline) for place in array.placements])
    low, high = (end + setup.origin_point[1] for end in (setup.y[0], setup.y[-1]))
    line = float(np.clip(array.centres[array.names.index(array.middle_coil), 1], low, high))
    along = np.linspace(outlines[:, 0].min(), outlines[:, 0].max(), count)
    places = np.column_stack((along, np.full(count, line)))
    deep = max(setup.depths) if depth is None else depth
    # the spline of the model needs four positions along y too
    step = sum(sheet.thickness for sheet in design.sheets) / _STEPS
    x = np.linspace(along[0], along[-1], max(math.ceil(float(np.ptp(along)) / step - 1e-9) + 1, 4))
    y = line + step * np.linspace(-1.5, 1.5, 4)
    x, y = x - setup.origin_point[0], y - setup.origin_point[1]
    response = response_map(design, depths=[deep], x=x, y=y, accuracy="auto", progress=progress)
    model = forward_model(on_board(response))
    by_state = dict(zip(model.states, model.delta(np.column_stack((places, np.full(count, deep)))).T, strict=True))
    first, nothing = first_states(design), np.full(count, np.nan)
    delta = [by_state[first[coil]] if coil in first else nothing for coil in array.names]
    return Touch(design, deep, places, np.column_stack(delta))


def first_states(design: Design) -> dict[str, str]:
    """First state of the plan that measures each coil."""
    return {state.measured[0][0]: state.name for state in reversed(design.plan)}


def off_middle(setup: Indentation) -> tuple[float, float]:
    """Place on the board off the map's centre in m.

    On a symmetric board's middle line δ has no first-order dependence and so no ellipse.
    """
    x, y = (np.add(axis, origin) for axis, origin in zip((setup.x, setup.y), setup.origin_point, strict=True))
    return float(x.mean() + np.ptp(x) / 8), float(y.mean() + np.ptp(y) / 4)


def dent_of_design(design: Design, depth: float) -> xr.Dataset:
    """Press into a design's sheets to a depth in m, see `indent`."""
    return contact_at(indentation_of(design), design.sheets, np.array([depth])).isel(depth=0)
