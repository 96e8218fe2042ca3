"""Scenes of a design: a view's parts, computed and joined, and films."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
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
from coilarray.geometry.pose import Pose
from coilarray.localize.forward import forward_model
from coilarray.localize.inverse import locate
from coilarray.response.dataset import on_board
from coilarray.response.map import response_map
from coilarray.response.setup import contact_at, indentation_of, target_of
from coilarray.response.target import target_map, with_target_as_plate
from coilarray.viz.datasets.results import DELTA, field_grid, require_memory
from coilarray.viz.scenes import board as boards
from coilarray.viz.scenes import results
from coilarray.viz.scenes.draw import shown_units
from coilarray.viz.scenes.metal import CURRENT, scene_of_metal, steps_of, target_at, target_parts, target_place
from coilarray.viz.scenes.scene import Part, Scale, Scene, Slider, Text, about_zero

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
    "map",
    "lines",
    "currents",
    "coupling",
    "location",
]
ITEMS: tuple[Item, ...] = get_args(Item)  # items that a scene of a design may contain
_PLANE_SPACING, _BOX_SPACING = 0.5e-3, 1e-3  # default distances of the points of B in m
_CLEAR = 0.99  # of the points of a grid that crosses copper: the nearest to a wire would set the scale
_ALONE: frozenset[Item] = frozenset({"board", "elastomer"})
_METAL: frozenset[Item] = frozenset({"plates", "target", "eddies"})
_PLANES: tuple[Item, Item] = ("map", "field")  # level and upright
_OF_B: frozenset[Item] = frozenset({*_PLANES, "lines"})
_WITHIN: frozenset[Item] = frozenset({*_OF_B, "location", "coupling", *_METAL})


@dataclass(frozen=True, eq=False)
class View:
    """Selection of a design's shown parts, and their computation.

    `show` has items of `ITEMS`. Sheets are lifted off a bare board, and a dent replaces them.
    Currents colour the copper, of which the `layers` are shown, by default all. Field, map, lines
    and currents are of the measured `coil`, by default the middle one, with the others terminated
    as in the design or, with `others_open`, left open. The `spacing` of points of B in m is by
    default 0.5 mm on planes and 1 mm in a box.

    The indenter or target is `at` a place on the board in m, by default off the map's centre, the
    target at a `distance` in m, by default the least, and the indenter at a `depth` in m, by
    default the deepest of the design. If B is not shown, a slider stands at this distance first. A
    location, of the readings `at` this place, needs the `table` of
    `coilarray.localize.forward.table_for`.
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


def scene_of_coils(design: Design, view: View, track: Tracker | None = None) -> Scene:
    """Scenes of a view with every coil measured in turn, for a slider."""
    # The colours are the same for all coils. GeometryError if the view has a slider of its own.
    if "target" in view.show:
        raise GeometryError("a page has one slider: show the target with a single coil.")
    scenes: list[Scene] = []
    known: dict[str, xr.Dataset] = {}
    for coil in design.coil_names:
        making = _Making(design, replace(view, coil=coil), track or (lambda text: None))
        vars(making).update(known)  # the couplings, which are the same for all coils
        scenes.append(making.scene())
        known = {name: value for name, value in vars(making).items() if name == "_coupling"}
    scales = sorted((one for scene in scenes for one in scene.scales), key=lambda scale: scale.high - scale.low)
    widest = {scale.array: scale for scale in scales}
    own = ("arrows", "contours")  # of every coil, though without a scale
    parts = [one for one in scenes[0].parts if one.scale is None and not any(word in one.name for word in own)]
    alike = {part.name for part in parts}
    for step, (coil, scene) in enumerate(zip(design.coil_names, scenes, strict=True)):
        for part in scene.parts:
            if part.name not in alike:
                scale = part.scale and widest[part.scale.array]
                parts.append(replace(part, name=f"{part.name}, {coil}", scale=scale, step=step))
    first = design.coil_names.index(view.coil or design.array.middle_coil)
    slider = Slider("measured coil", tuple(design.coil_names), tuple(scene.notes for scene in scenes), first)
    return Scene(tuple(parts), scenes[0].texts, slider=slider)


def bare_scene(design: Design, *, sheets: bool) -> Scene:
    """Scene of the boards, with sheets lifted off a single board at its own place."""
    if not design.boards and design.pose == Pose():
        return boards.board_scene(design.array, design.sheets if sheets else ())
    scene = boards.sheets_in_space(design.placed) if sheets else Scene()
    return scene + boards.scene_of_boards(design.placed)


class _Making:
    def __init__(self, design: Design, view: View, track: Tracker) -> None:
        self.design, self.view, self.track, self.shown = design, view, track, frozenset(view.show)
        self.coil = design.array.middle_coil if view.coil is None else view.coil
        self.others = "open" if view.others_open else "as terminated"
        # whether the sheets hide the board
        self.covered = "dent" in self.shown and not self.shown & _WITHIN

    def scene(self) -> Scene:
        shown, design, layers = self.shown, self.design, self.view.layers
        for item in shown:
            if item not in ITEMS:
                raise GeometryError(f"items to show must be of {', '.join(ITEMS)}; got {item!r}.")
        if self.coil not in design.coil_names:
            raise GeometryError(f"there is no coil {self.coil!r}; there are {', '.join(design.coil_names)}.")
        self._require_field()
        if shown <= _ALONE and "board" in shown and layers is None:
            return bare_scene(design, sheets="elastomer" in shown)
        makers: dict[str, Callable[[], Scene]] = {
            "dent": self._dent,
            "elastomer": lambda: boards.sheets_in_space(design.placed),
            "metal": self._metal,
            "currents": self._currents,
            "board": lambda: boards.scene_of_boards(design.placed, layers=layers, name_heights=self._name_heights),
            "coupling": lambda: results.scene_of_coupling(self._coupling),
            "location": self._location,
        }
        left_out = ({"elastomer"} if "dent" in shown else set()) | ({"board"} if "currents" in shown else set())
        made = (shown - left_out) | ({"metal"} if shown & _METAL else set())
        scene = Scene()
        for name, make in makers.items():
            if name in made:
                scene += make()
        scene += self._field()
        if not scene.parts:
            reason = f" {' '.join(scene.notes)}" if scene.notes else ""
            raise GeometryError(f"nothing to show for {', '.join(self.view.show) or 'no items'}.{reason}")
        return scene

    def _metal(self) -> Scene:
        view, design, place, numbers, first = self.view, self.design, (0.0, 0.0), None, 0
        if "target" in self.shown:
            place, steps = target_place(design, self.coil, view.at), steps_of(design, view.distance)
            steps = [self._distance] if self.shown & _OF_B else steps
            numbers = target_at(design, place, steps, progress=self.track("target"))
            first = 0 if view.distance is None else steps.index(view.distance)
        return scene_of_metal(
            design, self.shown, self.coil, lambda: self._coupling,
            terminated=not view.others_open, place=place, numbers=numbers, first=first,
        )  # fmt: skip

    def _currents(self) -> Scene:
        design, view = self.design, self.view
        currents = operating_currents(design, self._coupling, self.coil, terminated=not view.others_open)
        active = design.coil_names.index(self.coil)
        copper, rest = boards.board_in_pieces(design.placed, view.layers, self._name_heights)
        parts = boards.recoloured(copper, results.colours_of_currents(currents, active))
        note = f"Black: {self.coil} is measured, the others {self.others}; current per its ampere."
        return Scene(parts, notes=(note,)) + rest + boards.scene_of_currents(design.placed, currents.real, active)

    @cached_property
    def _coupling(self) -> xr.Dataset:
        return couple_design(self.design, progress=self.track("inductances"))

    @cached_property
    def _with_target(self) -> Design:
        if "target" not in self.shown or not self.shown & _OF_B:
            return self.design
        place = target_place(self.design, self.coil, self.view.at)
        return with_target_as_plate(self.design, place, self._distance)

    @cached_property
    def _coupling_with_target(self) -> xr.Dataset:
        design = self._with_target
        same = design is self.design
        return self._coupling if same else couple_design(design, progress=self.track("inductances beside the target"))

    @property
    def _distance(self) -> float:
        return min(target_of(self.design).distances) if self.view.distance is None else self.view.distance

    @cached_property
    def _press(self) -> tuple[Indentation, tuple[float, float], float]:
        """Indentation of the design, with place on the board and depth in m of the indenter."""
        setup, view = indentation_of(self.design), self.view
        at = off_middle(setup) if view.at is None else view.at
        return setup, at, max(setup.depths) if view.depth is None else view.depth

    def _dent(self) -> Scene:
        (setup, _, depth), design, where = self._press, self.design, self._on_board
        opacity, dent = 1.0 if self.covered else boards.VEILED, dent_of_design(design, depth)
        return boards.scene_of_dent(design.array, design.sheets, dent, setup.indenter, where, opacity=opacity)

    @property
    def _on_board(self) -> tuple[float, float]:
        """Position of the indenter in m, or GeometryError off the board."""
        x, y = self._press[1]
        x_min, y_min, x_max, y_max = self.design.array.bounds
        if not (x_min < x < x_max and y_min < y < y_max):
            raise GeometryError(
                f"the indenter must be over the board, from ({x_min * 1e3:.4g}, {y_min * 1e3:.4g}) to "
                f"({x_max * 1e3:.4g}, {y_max * 1e3:.4g}) mm; got ({x * 1e3:.4g}, {y * 1e3:.4g}) mm."
            )
        return x, y

    @property
    def _name_heights(self) -> npt.NDArray[np.float64] | float:
        if not self.covered:
            return 0.0
        # only those in the open quarter are seen
        return np.where((self.design.array.centres < self._on_board).all(axis=1), 0.0, np.nan)

    def _location(self) -> Scene:
        if self.view.table is None:
            raise LocalizeError("a location needs the response table of the design.")
        model, (_, at, depth) = forward_model(on_board(self.view.table)), self._press
        found = locate(model, model.delta([*at, depth]))
        return results.scene_of_location(found, self.design.array.bounds, self.design.top, at)

    @property
    def _grids(self) -> tuple[list[results.Spans], list[results.Spans]]:
        """Planes and box on which B is shown."""
        item, spacing = (self.design, self.coil), self.view.spacing
        both = zip(_PLANES, results.field_planes(*item, spacing or _PLANE_SPACING), strict=True)
        planes = [plane for name, plane in both if name in self.shown]
        return planes, [results.field_box(*item, spacing or _BOX_SPACING)] if "lines" in self.shown else []

    def _require_field(self) -> None:
        if not self.shown & _OF_B:
            return
        require_endless(self._with_target)
        indentation = self.design.indentation
        if "dent" in self.shown and indentation is not None and indentation.material is not None:
            raise MetalError("B beside an indenter of metal or ferrite is not computed: leave out the dent, or B.")
        planes, boxes = self._grids
        widest = max(axis.spacing for axis in (*boxes, *planes)[0])
        require_memory(results.count_of([*boxes, *planes]), f"a spacing of {widest * 1e3:g} mm")

    def _b_on(self, axes: results.Axes, what: str) -> pyvista.RectilinearGrid:
        view, design, coupling, (x, y, z) = self.view, self._with_target, self._coupling_with_target, axes
        if len(z) > 1:
            z = results.beside_faces(design, z, float(coupling.frequency.sel(coil=self.coil)))
        field = operating_field(
            design, coupling, self.coil, x, y, z,
            current=CURRENT, terminated=not view.others_open, progress=self.track(what),
        )  # fmt: skip
        return field_grid(field.x.values, field.y.values, field.z.values, field.B.values)

    def _field(self) -> Scene:
        if not self.shown & _OF_B:
            return Scene()
        planes = [self._b_on((x.points, y.points, z.points), "field on a plane") for x, y, z in self._grids[0]]
        boxes = [self._b_on(results.points_of_box(self.design, spans), "field in a box") for spans in self._grids[1]]
        scale = results.scale_of_field([*planes, *boxes], 1.0 if results.is_flat(self.design) else _CLEAR)
        scene = results.scene_of_slices(planes, scale)
        for box in boxes:
            scene += results.scene_of_lines(box, results.line_seeds(self._with_target, self.coil, box), scale)
        others = f", the others {self.others}" if len(self.design.coil_names) > 1 else ""
        carried = f"{self.coil} carries {CURRENT * 1e3:g} mA{others}"
        design, metal = self._with_target, []  # what B includes, and what it leaves out
        if design.target is None and self.design.target is not None:
            metal.append(f"the target at {MM.text(self._distance, '.3')}")
        if self.design.plates:
            metal.insert(0, "the plates")
        left_out = (["the target"] if design.target is not None else []) + (["elastomer"] if design.sheets else [])
        parts = [f"beside {' and '.join(metal)}"] if metal else []
        parts += [f"without {' and '.join(left_out)}"] if left_out else []
        return scene + Scene(notes=(f"B in phase, {', '.join(parts) or 'in air'}; {carried}.",))


_STEPS = 5  # positions of the response per thickness of all sheets, as `coilarray.localize.forward` needs them
_BELOW = 0.17  # distance from a coil's name down to its number, over the coil's length along y
_BESIDE = 0.04  # its least over the board's length, for letters


@dataclass(frozen=True, eq=False)
class Touch:
    """Path of the indenter or target with δ of every coil."""

    design: Design
    places: FloatArray  # shape (n, 3), x and y on the board, and the depth, or the distance of the target, in m
    delta: FloatArray  # shape (n, coils), of the first state that measures each coil, or NaN
    of_target: bool = False

    @cached_property
    def _board(self) -> tuple[tuple[Part, ...], Scene]:
        return boards.board_in_pieces(self.design.placed)

    @property
    def scale(self) -> Scale:
        """Scale of δ for the whole path."""
        return about_zero(DELTA, "δ", "", self.delta)

    def board(self) -> Scene:
        """Board without its copper, which does not change, and room for a target."""
        if not self.of_target:
            return self._board[1]
        ends = [target_parts(self.design, self.places[k].tolist())[0].mesh.points for k in (0, -1)]
        return self._board[1] + boards.room(np.concatenate(ends) * 1e-3)

    def scenes(self) -> Iterator[Scene]:
        """Make one scene per place."""
        array, scale = self.design.array, self.scale
        factor, _ = shown_units(scale)
        largest = float(np.nanmax(np.abs(self.delta), initial=scale.high * 1e-3)) * factor
        digits = max(2 - math.floor(math.log10(largest)), 0)  # three digits of the largest
        x_min, _, x_max, _ = array.bounds
        below = max(_BELOW * float(np.ptp(array.placements[0].coil.outline[:, 1])), _BESIDE * (x_max - x_min))
        body, words = "indenter", "deep"
        if self.of_target:
            body, words = "target", "from the sheets" if self.design.sheets else "from the board"
        dent = None if self.of_target else dent_of_design(self.design, float(self.places[0, 2]))
        for (x, y, reach), delta in zip(self.places.tolist(), self.delta, strict=True):
            where = true_minus(f"x = {x * 1e3:.1f} mm, y = {y * 1e3:.1f} mm, {reach * 1e3:.3g} mm {words}")
            shown = [round(value, digits) if math.isfinite(value) else value for value in (delta * factor).tolist()]
            numbers = tuple(
                Text(true_minus(f"{value:+.{digits}f}" if value else "0"), (x_c * 1e3, (y_c - below) * 1e3, 0.0), 16.0)
                for value, (x_c, y_c) in zip(shown, array.centres.tolist(), strict=True)
                if math.isfinite(value)
            )
            coils = boards.recoloured(self._board[0], boards.CoilColours(delta, scale))
            scene = Scene(coils, numbers, (f"The {body} is at {where}.",))
            if dent is None:
                yield scene + Scene(tuple(target_parts(self.design, (x, y, reach))))
            else:
                indenter = indentation_of(self.design).indenter
                yield scene + boards.scene_of_dent(
                    array, self.design.sheets, dent, indenter, (x, y), opacity=boards.VEILED
                )


def touch_along(
    design: Design, *, count: int = 48, depth: float | None = None, progress: Progress | None = None
) -> Touch:
    """Compute δ at `count` places along x over all coils, through the middle."""
    # `depth` in m is by default the deepest of the design.
    setup, array = indentation_of(design), design.array
    outlines = np.concatenate([place.to_board(place.coil.outline) for place in array.placements])
    low, high = (end + setup.origin_point[1] for end in (setup.y[0], setup.y[-1]))
    line = float(np.clip(array.centres[array.names.index(array.middle_coil), 1], low, high))
    along = np.linspace(outlines[:, 0].min(), outlines[:, 0].max(), count)
    deep = max(setup.depths) if depth is None else depth
    places = np.column_stack((along, np.full(count, line), np.full(count, deep)))
    # the spline of the model needs four positions along y too
    step = sum(sheet.thickness for sheet in design.sheets) / _STEPS
    x = np.linspace(along[0], along[-1], max(math.ceil(float(np.ptp(along)) / step - 1e-9) + 1, 4))
    y = line + step * np.linspace(-1.5, 1.5, 4)
    x, y = x - setup.origin_point[0], y - setup.origin_point[1]
    response = response_map(design, depths=[deep], x=x, y=y, accuracy="auto", progress=progress)
    model = forward_model(on_board(response))
    return Touch(design, places, _by_coil(design, model.states, model.delta(places)))


def target_along(
    design: Design, *, count: int = 48, distance: float | None = None, progress: Progress | None = None
) -> Touch:
    """Compute δ of a target at `count` places of its map's middle line along x."""
    # A target with one place, as an infinite plate, comes closer instead, to the `distance` in m, by default the least.
    target = target_of(design)
    near, y = target.distances[0] if distance is None else distance, float(np.median(target.y))
    moves = len(target.x) > 1
    x = np.linspace(target.x[0], target.x[-1], count) if moves else np.array([np.median(target.x)])
    far = max(target.distances[-1], near)
    z = np.array([near]) if moves else np.geomspace(near, far, count if far > near else 1)
    found = target_map(design, distances=z, x=x, y=[y], progress=progress)
    delta = _by_coil(design, found.state.values.tolist(), found.delta.values.reshape(-1, found.state.size))
    x_0, y_0 = target.origin_point
    places = np.column_stack(np.broadcast_arrays(x + x_0, y + y_0, z))
    order = slice(None) if moves else slice(None, None, -1)  # from far
    return Touch(design, places[order], delta[order], of_target=True)


def _by_coil(design: Design, states: Sequence[str], delta: FloatArray) -> FloatArray:
    """δ (places, coils) of δ (places, states), by the first state of each coil, or NaN."""
    first, nothing = first_states(design), np.full(len(delta), np.nan)
    by_state = dict(zip(states, delta.T, strict=True))
    return np.column_stack([by_state[first[coil]] if coil in first else nothing for coil in design.array.names])


def first_states(design: Design) -> dict[str, str]:
    """First state of the plan that measures each coil."""
    return {state.measured[0][0]: state.name for state in reversed(design.plan)}


def off_middle(setup: Indentation) -> tuple[float, float]:
    """Place on the board off the map's centre in m."""
    # On a symmetric board's middle line δ has no first-order dependence and so no ellipse.
    x, y = (np.add(axis, origin) for axis, origin in zip((setup.x, setup.y), setup.origin_point, strict=True))
    return float(x.mean() + np.ptp(x) / 8), float(y.mean() + np.ptp(y) / 4)


def dent_of_design(design: Design, depth: float) -> xr.Dataset:
    """Press into a design's sheets to a depth in m, see `indent`."""
    return contact_at(indentation_of(design), design.sheets, np.array([depth])).isel(depth=0)
