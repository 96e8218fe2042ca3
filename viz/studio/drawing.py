"""Boards from above as SVG, and in pieces for scenes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
import numpy.typing as npt

from coilarray.compute.display_units import number_text
from coilarray.design.model import Design
from coilarray.localize.inverse import Location
from coilarray.viz.datasets.results import uncertainty_ellipse
from coilarray.viz.palette import INK, coil_colours
from coilarray.viz.scenes.board import CoilColours, recoloured
from coilarray.viz.scenes.results import CONFIDENCE, colours_of_delta
from coilarray.viz.scenes.scene import Part, Scene
from coilarray.viz.scenes.touch import first_states

LEAST = 1e-4
"""Least δ at which bars and colours are full."""
RED = "#D55E00"
"""Colour of positions that are found."""

_RIM = 0.02  # width of the rim over the width of the board
_LETTER = 0.035  # largest height of letters over the width of the drawing
_LETTER_OF_PITCH = 0.22  # and over the distance of neighbours, so that names of six letters do not overlap
_NAME = 'text-anchor="middle" dominant-baseline="central" fill="#202020" stroke="#fff" paint-order="stroke"'


@dataclass(frozen=True)
class TopView:
    """Board from above in mm, with y reversed."""

    left: float
    top: float
    width: float
    height: float

    @property
    def line(self) -> float:
        """Width of a thin line."""
        return round(0.0022 * self.width, 3)

    def place(self, across: float, down: float) -> tuple[float, float]:
        """Place on the board in m from shares of sides.

        >>> TopView(-10.0, -5.0, 20.0, 10.0).place(0.75, 0.25)
        (0.005, 0.0025)
        """
        return (self.left + across * self.width) * 1e-3, -(self.top + down * self.height) * 1e-3


def top_view(design: Design) -> TopView:
    """Coordinates of a drawing of a board."""
    x_min, y_min, x_max, y_max = (edge * 1e3 for edge in design.array.bounds)
    rim = _RIM * (x_max - x_min)
    return TopView(x_min - rim, -y_max - rim, x_max - x_min + 2 * rim, y_max - y_min + 2 * rim)


def drawing(design: Design, delta: Mapping[str, float | None], marks: str = "", least: float = 0.0) -> dict[str, Any]:
    """SVG of a board with coils coloured by δ."""
    view, array = top_view(design), design.array
    colours = coil_colours(array.names, array.centres)
    edges = [(x, y) for x in array.bounds[::2] for y in array.bounds[1::2]]
    parts = [polygon(np.array(edges)[[0, 1, 3, 2]], f'fill="#eef5ee" stroke="#3F8F4F" stroke-width="{view.line}"')]
    fills = ["none"] * len(array.names)
    if delta:
        of_coils = colours_of_delta(_delta_by_coil(design, delta), least)
        fills = [f"rgb{tuple(one)}" for one in of_coils.scale.colours_of(of_coils.values).tolist()]
    for place, fill in zip(array.placements, fills, strict=True):
        stroke = f'stroke="{colours[place.name]}" stroke-width="{1.5 * view.line:g}"'
        parts.append(polygon(place.to_board(place.coil.outline), f'fill="{fill}" fill-opacity="0.75" {stroke}'))
    letter = min(_LETTER * view.width, _LETTER_OF_PITCH * array.least_distance * 1e3)
    look = f'{_NAME} font-size="{letter:.3f}" stroke-width="{1.5 * view.line:g}" font-weight="600"'
    for name, (x, y) in zip(array.names, array.centres * 1e3, strict=True):
        parts.append(f'<text x="{x:.3f}" y="{-y:.3f}" {look}>{escape(name)}</text>')
    return {
        "box": f"{view.left:.3f} {view.top:.3f} {view.width:.3f} {view.height:.3f}",
        "ratio": round(view.width / view.height, 4),
        "svg": "".join(parts) + marks,
    }


def polygon(points: npt.ArrayLike, look: str, kind: str = "polygon") -> str:
    """Polygon or polyline through points (n, 2) in m."""
    corners = " ".join(f"{x:.3f},{-y:.3f}" for x, y in np.asarray(points) * 1e3)
    return f'<{kind} points="{corners}" {look}/>'


def circle(x: float, y: float, radius: float, look: str) -> str:
    """Circle at a place in m, its radius in mm."""
    return f'<circle cx="{x * 1e3:.3f}" cy="{-y * 1e3:.3f}" r="{radius:.3f}" {look}/>'


def location_marks(view: TopView, location: Location) -> str:
    """Possible positions of a location with 95 % ellipses."""
    marks = []
    stroke = f'stroke="{RED}" stroke-width="{view.line}"'
    for k, mode in enumerate(location.modes):
        covariance = mode.covariance[:2, :2]
        if np.isfinite(covariance).all():
            ellipse = np.asarray(uncertainty_ellipse((mode.x, mode.y), covariance, CONFIDENCE).points) * 1e-3
            marks.append(polygon(ellipse[:, :2], f'class="ellipse" fill="{RED}" fill-opacity="0.15" {stroke}'))
        fill = "#fff" if k else RED
        marks.append(circle(mode.x, mode.y, 4 * view.line, f'class="pin" fill="{fill}" {stroke}'))
    return "".join(marks)


def state_colours(design: Design) -> dict[str, str]:
    """Colour of each state, by its first coil."""
    colours = coil_colours(design.array.names, design.array.centres)
    return {state.name: colours.get(state.measured[0][0], INK) for state in design.plan}


def _delta_by_coil(design: Design, delta: Mapping[str, float | None]) -> npt.NDArray[np.float64]:
    """δ of each coil's first measured state, or NaN."""
    states = first_states(design)
    return np.array([delta.get(states.get(name, "")) for name in design.array.names], dtype=np.float64)  # None is NaN


def delta_bars(delta: Iterable[tuple[str, float | None]], least: float = 0.0) -> list[dict[str, Any]]:
    """Texts of δ in 10⁻⁶, and lengths of their bars.

    Lengths are in per cent of half the width, full at the largest δ or at `least`, whichever is
    larger.
    """
    pairs = list(delta)
    largest = max([least, *(abs(value) for _, value in pairs if value is not None)]) or 1.0
    bars = []
    for name, value in pairs:
        text = "–" if value is None else number_text(value * 1e6, 1, "+")
        bars.append({"name": name, "text": text, "part": 0.0 if value is None else round(50 * value / largest, 2)})
    return bars


@dataclass(frozen=True, eq=False)
class BoardParts:
    """Board in pieces."""

    design: Design
    copper: tuple[Part, ...]  # one part per layer
    rest: Scene  # laminate, barrels, names and rulers

    def coloured(self, colours: CoilColours) -> Scene:
        """Colour the copper by values of the coils."""
        return Scene(recoloured(self.copper, colours)) + self.rest

    def by_delta(self, delta: Mapping[str, float | None], least: float = 0.0) -> Scene:
        """Colour the copper by δ, see `colours_of_delta`."""
        return self.coloured(colours_of_delta(_delta_by_coil(self.design, delta), least))
