"""Boards as the studio draws them: from above as plain values, and in pieces for scenes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from coilarray.compute.display_units import number_text
from coilarray.design.model import Design
from coilarray.localize.inverse import Location
from coilarray.viz.datasets.results import semi_axis_factor
from coilarray.viz.palette import INK, coil_colours
from coilarray.viz.scenes.board import CoilColours, recoloured
from coilarray.viz.scenes.results import CONFIDENCE, colours_of_delta
from coilarray.viz.scenes.scene import Part, Scene
from coilarray.viz.scenes.touch import first_states

_RIM = 0.02  # width of the rim over the width of the board
_DIGITS = 3  # of lengths in mm
_LETTER = 0.035  # largest height of letters over the width of the drawing
_LETTER_OF_PITCH = 0.22  # and over the distance of neighbours, so that names of six letters do not overlap
_LEAST = 0.35  # least semi-axis of an ellipse in mm


@dataclass(frozen=True)
class TopView:
    """Rectangle of a drawing in mm, whose y is minus the board's."""

    left: float
    top: float
    width: float
    height: float

    def place(self, across: float, down: float) -> tuple[float, float]:
        """Place on the board in m for a drawn point.

        The point is given as shares of the drawing's sides.

        Examples
        --------
        >>> TopView(-10.0, -5.0, 20.0, 10.0).place(0.75, 0.25)
        (0.005, 0.0025)
        """
        return (self.left + across * self.width) * 1e-3, -(self.top + down * self.height) * 1e-3

    def point(self, x: float, y: float) -> tuple[float, float]:
        """Drawn point in mm for a place in m."""
        return _mm(x), -_mm(y)


def top_view(design: Design) -> TopView:
    """Coordinates of a drawing of a board."""
    x_min, y_min, x_max, y_max = (edge * 1e3 for edge in design.array.bounds)
    rim = _RIM * (x_max - x_min)
    return TopView(x_min - rim, -y_max - rim, x_max - x_min + 2 * rim, y_max - y_min + 2 * rim)


def board_drawing(design: Design, view: TopView) -> dict[str, Any]:
    """Edge and coils of a board in mm."""
    x_min, y_min, x_max, y_max = (edge * 1e3 for edge in design.array.bounds)
    colours = coil_colours(design.array.names, design.array.centres)
    coils = []
    for place in design.array.placements:
        outline = place.to_board(place.coil.outline) * 1e3
        x, y = design.array.centres[design.array.names.index(place.name)] * 1e3
        points = " ".join(f"{round(px, _DIGITS)},{round(-py, _DIGITS)}" for px, py in outline.tolist())
        coils.append(
            {"name": place.name, "points": points, "colour": colours[place.name], "x": float(x), "y": -float(y)}
        )
    return {
        "box": f"{view.left:.3f} {view.top:.3f} {view.width:.3f} {view.height:.3f}",
        "ratio": round(view.width / view.height, 4),
        "board": {"x": x_min, "y": -y_max, "width": x_max - x_min, "height": y_max - y_min},
        "letter": round(min(_LETTER * view.width, _LETTER_OF_PITCH * design.array.least_distance * 1e3), 3),
        "line": round(0.0022 * view.width, 3),
        "coils": coils,
    }


def state_colours(design: Design) -> dict[str, str]:
    """Colour of each state, that of its first coil."""
    colours = coil_colours(design.array.names, design.array.centres)
    return {state.name: colours.get(state.measured[0][0], INK) for state in design.plan}


def pins(view: TopView, location: Location) -> list[dict[str, Any]]:
    """Possible positions of a location with 95 % ellipses."""
    marks = []
    for k, mode in enumerate(location.modes):
        x, y = view.point(mode.x, mode.y)
        mark: dict[str, Any] = {"x": x, "y": y, "best": k == 0, "rx": 0.0, "ry": 0.0, "turn": 0.0}
        covariance = mode.covariance[:2, :2]
        if np.isfinite(covariance).all():
            values, vectors = np.linalg.eigh(covariance)
            half = semi_axis_factor(CONFIDENCE) * np.sqrt(np.maximum(values, 0.0)) * 1e3
            longest = 2 * max(view.width, view.height)
            mark["ry"], mark["rx"] = (float(min(max(axis, _LEAST), longest)) for axis in half)
            mark["turn"] = -math.degrees(math.atan2(vectors[1, 1], vectors[0, 1]))
        marks.append(mark)
    return marks


def delta_fills(design: Design, delta: Mapping[str, float | None], least: float = 0.0) -> dict[str, str]:
    """Colour of each coil by its δ, see `colours_of_delta`."""
    colours = colours_of_delta(delta_by_coil(design, delta), least)
    red_green_blue = colours.scale.colours_of(colours.values).tolist()
    return {name: f"rgb({r}, {g}, {b})" for name, (r, g, b) in zip(design.array.names, red_green_blue, strict=True)}


def delta_by_coil(design: Design, delta: Mapping[str, float | None]) -> npt.NDArray[np.float64]:
    """δ of the first state that measures each coil, or NaN."""
    states = first_states(design)
    return np.array([delta.get(states.get(name, "")) for name in design.array.names], dtype=np.float64)  # None is NaN


LEAST = 1e-4
"""Smallest δ at which bars and colours of a measurement are full."""


def delta_bars(delta: Iterable[tuple[str, float | None]], least: float = 0.0) -> list[dict[str, Any]]:
    """Bars of all δ.

    A bar has its text in 10⁻⁶ and its signed length in per cent of half the width. It is full at the largest δ, or at
    `least` if this is more.
    """
    pairs = list(delta)
    largest = max([least, *(abs(value) for _, value in pairs if value is not None)]) or 1.0
    bars = []
    for name, value in pairs:
        text = "–" if value is None else number_text(value * 1e6, 1, "+")
        bars.append({"name": name, "text": text, "part": 0.0 if value is None else round(50 * value / largest, 2)})
    return bars


def _mm(value: float) -> float:
    return round(value * 1e3, _DIGITS)


@dataclass(frozen=True, eq=False)
class BoardParts:
    """Board in pieces."""

    design: Design
    copper: tuple[Part, ...]  # one part per layer
    rest: Scene  # laminate, barrels, names and rulers

    def coloured(self, colours: CoilColours) -> Scene:
        """Colour the copper by values of the coils."""
        return Scene(recoloured(self.copper, colours)) + self.rest


def coloured_by_delta(board: BoardParts, delta: Mapping[str, float | None], least: float = 0.0) -> Scene:
    """Board with its copper coloured by δ, see `colours_of_delta`."""
    return board.coloured(colours_of_delta(delta_by_coil(board.design, delta), least))
