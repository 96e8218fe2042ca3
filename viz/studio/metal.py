"""Tab of metal: plates, and a target with a slider."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import xarray as xr

from coilarray.circuit.converter_limits import with_reasons
from coilarray.compute.display_units import KILOHM, MM, DisplayUnit
from coilarray.compute.table import Table, dataset_table
from coilarray.design.model import Design
from coilarray.design.vary import no_longer_assumed
from coilarray.errors import DesignError
from coilarray.geometry import MATERIALS, Plate
from coilarray.viz.scenes.board import scene_of_sheets
from coilarray.viz.scenes.metal import scene_of_metal, steps_of, target_at, target_place
from coilarray.viz.scenes.scene import Scene
from coilarray.viz.studio.job import Step
from coilarray.viz.studio.services import Document
from coilarray.viz.studio.session import Panel, Session
from coilarray.viz.studio.structure import without_entry
from coilarray.viz.studio.view import BoardParts
from coilarray.viz.studio.words import NO_ROWS, with_changes
from coilarray.viz.studio.work import number_of, place_text

KINDS = ("plate above", "plate below", "target")  # kinds of a new body
SIZES: Mapping[str, tuple[str, ...]] = {  # keys of the sizes of a new body by shape
    "infinite plate": (), "disc": ("diameter_mm",), "rectangle": ("width_mm", "height_mm"),
    "ring": ("diameter_mm", "inner_diameter_mm"), "sphere": ("diameter_mm",),
}  # fmt: skip
FIRST: Mapping[str, str] = {  # first texts of the fields of a new body
    "kind": "target", "shape": "disc", "material": "aluminium", "thickness": "1", "distance": "0.5, 1, 2, 5, 10",
    "size": "20", "second": "10",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Moved:
    """Effect of a target at distances over a place (m)."""

    design: Design
    place: tuple[float, float]
    numbers: xr.Dataset  # of `coilarray.target_map`, with one x and one y

    @property
    def distances(self) -> list[float]:
        """Distances of the target in m."""
        return [float(one) for one in self.numbers.distance.values]


def moved(design: Design, place: tuple[float, float] | None) -> Moved:
    """Move a design's target through all distances, or raise MetalError.

    The default place is at the middle coil.
    """
    at = target_place(design, design.array.middle_coil, place)
    return Moved(design, at, target_at(design, at, steps_of(design)))


def target_table(moved: Moved, step: int) -> Table:
    """Return the readings of every state at one distance."""
    at, read = with_reasons(moved.numbers.isel(distance=step, x=0, y=0))
    names = (
        "state", "delta", "effective_inductance", "effective_resistance", "quality_factor", "parallel_resistance",
        "frequency",
    )  # fmt: skip
    return dataset_table("target", "", at, (*names, *read), {"delta": _DELTA, "parallel_resistance": KILOHM})


def body_rows(design: Design) -> list[dict[str, str]]:
    """Rows of the bodies of a design."""
    rows = []
    for number, plate in enumerate(design.plates):
        shape = "infinite plate of " if isinstance(plate, Plate) else ""
        words = f"{shape}{plate.material.words}, {MM.text(plate.thickness)}, z = {MM.text(plate.heights[0], '.4')}"
        rows.append({"key": str(number), "text": f"plate {plate.name}: {words}"})
    if design.target is not None:
        words = f"target: {design.target.kind} of {design.target.body.material.words}"
        rows.append({"key": "target", "text": words})
    return rows


def with_body(document: Document, form: Mapping[str, Any]) -> Document:
    """Add a body to a document by texts of `FIRST`, or replace its target."""
    given = {key: str(form.get(key, default)).strip() for key, default in FIRST.items()}
    kind, shape = given["kind"], given["shape"]
    if kind not in KINDS or shape not in SIZES or given["material"] not in MATERIALS:
        raise DesignError(f"a new body must be of {', '.join(KINDS)} with a shape and a material that there are.")
    if shape == "sphere" and kind != "target":
        raise DesignError("a sphere must be a target; a plate is flat.")
    sizes = {key: number_of(key, given[field]) for key, field in zip(SIZES[shape], ("size", "second"), strict=False)}
    body: dict[str, Any] = {"material": given["material"], **sizes}
    if shape != "sphere":
        body["thickness_mm"] = number_of("thickness_mm", given["thickness"])
    if kind == "target":
        distances = [number_of("distances_mm", text) for text in re.split(r"[,;\s]+", given["distance"]) if text]
        target = {"shape": "plate" if shape == "infinite plate" else shape, **body, "distances_mm": distances}
        return no_longer_assumed({**document, "target": target}, ["target"])
    if shape != "infinite plate":
        body["shape"] = shape
    plates = list(document.get("plate", []))
    taken = {plate.get("name") for plate in plates}
    name = next(one for one in (f"plate{k + 1}" for k in range(len(plates) + 1)) if one not in taken)
    place = {"distance_mm": number_of("distance_mm", given["distance"]), "side": kind.removeprefix("plate ")}
    return {**document, "plate": [*plates, {"name": name, **body, **place}]}


def without_body(document: Document, key: str) -> Document:
    """Remove a body by its key in `body_rows`."""
    if key.isdecimal():
        return without_entry(document, "plate", int(key))
    return no_longer_assumed({name: table for name, table in document.items() if name != "target"}, ["target"])


_DELTA = DisplayUnit("%", 100.0, 4, significant=True)
_REST = 0.4  # s without a change before a target is computed


class MetalPanel(Panel):
    """Panel with the metal near the coils."""

    def __init__(self, session: Session, numbers: Any) -> None:
        self._numbers = numbers  # panel that keeps the results of the saved design
        self._moved: Moved | None = None
        self._place: tuple[float, float] | None = None  # chosen place
        self._step = 0
        values = {
            "bodies": [], "body_form": FIRST, "body_kinds": list(KINDS), "body_shapes": list(SIZES),
            "body_materials": list(MATERIALS), "body_sizes": dict(SIZES), "body_problem": "", "has_target": False,
            "distances": [], "distance_at": 0, "target_table": NO_ROWS, "target_problem": "", "target_place": ["", ""],
            "show_eddies": False, "target_endless": False,
        }  # fmt: skip
        session.state.client_only("body_form")
        super().__init__(
            session, values, "target_problem", add_body=self._add, remove_body=self._remove, move_target=self._move,
            place_target=self._put,
        )  # fmt: skip

    def show(self, design: Design, *, anew: bool) -> None:
        """Show the bodies of a design."""
        state, target = self._state, design.target
        state.bodies, state.body_problem, state.has_target = body_rows(design), "", target is not None
        state.target_endless = target is not None and isinstance(target.body, Plate)
        if anew:
            self._place, self._step = None, 0
        if target is None:
            self._moved = None
            state.target_table, state.distances, state.target_problem = NO_ROWS, [], ""

    def steps(self, design: Design) -> list[Step]:
        """Make the step that moves the target over its place."""

        def fail(problem: str) -> None:
            self._state.target_problem, self._state.target_table = problem, NO_ROWS
            self._session.failed("target", design, problem)

        step = Step("target", partial(moved, design, self._place), self._show, fail, rest=_REST)
        return [] if design.target is None else [step]

    def scene(self, design: Design, board: BoardParts) -> Scene:
        """Board of a design with metal, made in a thread."""
        moved, circuit, at = self._moved, self._numbers.circuit, dict[str, Any]()
        if moved is not None and moved.design is design:
            at = {"place": moved.place, "numbers": moved.numbers.isel(distance=[self._step])}
        with_eddies = self._state.show_eddies and circuit is not None and (at or design.plates)
        shown = ("plates", "eddies") if with_eddies else ("plates",)
        metal = scene_of_metal(design, shown, design.array.middle_coil, lambda: circuit.coupling, **at)
        metal = replace(metal.still(), notes=metal.notes)  # the page has a table of the numbers
        return scene_of_sheets(design.array, design.sheets) + metal + Scene(board.copper) + board.rest

    def _show(self, found: Moved) -> None:
        if not self._session.is_current(found.design):
            return
        self._moved, state = found, self._state
        state.distances = [f"{distance * 1e3:.3g}" for distance in found.distances]
        self._step = min(self._step, len(found.distances) - 1)
        state.distance_at, state.target_problem = self._step, ""
        state.target_place = [place_text(value) for value in found.place]
        self._numbers.keep("target", found.design, found)
        self.compare()
        self._session.arrived("target", found.design)
        self._session.redraw()

    def at_place(self, design: Design) -> Moved | None:
        """Move the target of another design over the same place."""
        return None if design.target is None else moved(design, self._place)

    def compare(self) -> None:
        """Show the readings, with their changes against the saved design."""
        found, saved = self._moved, self._numbers.saved.get("target")
        if found is not None:
            at, before = found.distances[self._step], None
            if saved is not None and at in saved.distances and self._place in (None, saved.place):
                before = target_table(saved, saved.distances.index(at))
            self._state.target_table = with_changes(target_table(found, self._step), before)

    def _move(self, step: int) -> None:
        if self._moved is not None and 0 <= step < len(self._moved.distances):
            self._state.distance_at = self._step = step
            self.compare()
            self._session.redraw()

    def _put(self, x: str, y: str) -> None:
        session = self._session
        self._place = number_of("x", x) * 1e-3, number_of("y", y) * 1e-3
        session.state.stale = sorted({*session.state.stale, "target"})
        self._numbers.saved.pop("target", None)
        self._numbers.say_changes(session.work, self.at_place)
        session.slow.ask(self.steps(session.work.design))

    def _add(self, form: dict[str, str | None]) -> None:
        self._session.change(lambda work: with_body(work.opened.document, form), "body_problem")

    def _remove(self, key: str) -> None:
        self._session.change(lambda work: without_body(work.opened.document, key), "body_problem")
