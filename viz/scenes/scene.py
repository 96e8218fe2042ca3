"""Contents of a scene: meshes, texts, scales, and cameras."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt

from coilarray.viz.palette import INK, SEQUENTIAL, UNKNOWN, signed_colours

if TYPE_CHECKING:
    import pyvista


Side = Literal["oblique", "low", "top", "front", "right", "cut"]
"""Side of the view: oblique, low, above, front, right, or into the cut of a dent."""

SIDES: tuple[Side, ...] = ("oblique", "top", "front", "right")  # sides that pages offer

ANGLES: dict[Side, tuple[float, float]] = {
    "oblique": (52.0, -102.0),
    "low": (24.0, -106.0),
    "top": (90.0, -90.0),
    "front": (0.0, -90.0),
    "right": (0.0, 0.0),
    "cut": (28.0, -118.0),
}
"""Elevation and azimuth of the camera in degrees; azimuth 0 is +x, and −90° is the front."""

FILLED = 0.88  # share of the picture's height or width that a scene fills


@dataclass(frozen=True)
class Camera:
    """Camera with or without perspective."""

    position: tuple[float, float, float]  # mm
    focus: tuple[float, float, float]  # mm, point in the centre of its picture
    up: tuple[float, float, float]
    scale: float  # half the visible height at the focus in mm
    angle: float = 0.0  # degrees between the lower and the upper edge of the picture, 0 without perspective


def aim(
    bounds: npt.ArrayLike,
    size: tuple[int, int],
    side: Side,
    left: float = 0.0,
    bottom: float = 0.0,
    angle: float = 0.0,
) -> Camera:
    """Aim a camera of an `angle` so that points in mm fill its picture."""
    # `bounds` are x_min, x_max, y_min, y_max, z_min, z_max, or points (n, 3). The shares `left` and `bottom` of the
    # picture stay free for a legend, colour bars and notes.
    elevation, azimuth = np.radians(ANGLES[side])
    along = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])  # from left to right
    out = np.cross(along, [0.0, 0.0, 1.0]) * np.cos(elevation) + [0.0, 0.0, np.sin(elevation)]
    up = np.cross(out, along)
    points = np.asarray(bounds, dtype=np.float64)
    if points.ndim == 1:
        points = np.array(list(itertools.product(*points.reshape(3, 2))))
    axes = np.column_stack((along, up, out))
    low, high = (points @ axes).min(axis=0), (points @ axes).max(axis=0)
    # middle and half the width of the free part of the picture, over half its height
    aspect = size[0] / size[1]
    middle, half = np.array([left * aspect, bottom]), np.array([(1.0 - left) * aspect, 1.0 - bottom])
    half *= FILLED
    if not angle:
        scale = float((np.ptp(points @ axes[:, :2], axis=0) / 2 / half).max())
        across = (low[:2] + high[:2]) / 2 - middle * scale
        depth, distance = float((low[2] + high[2]) / 2), 2.0 * float(np.linalg.norm(np.ptp(points, axis=0)))
    else:
        # The edges of the free part are slopes, and the camera is where the points touch them.
        slope = np.tan(np.radians(angle) / 2)
        lower, upper = slope * (middle - half), slope * (middle + half)
        seen, deep = points @ axes[:, :2], points @ axes[:, 2:]
        least, most = (seen + lower * deep).min(axis=0), (seen + upper * deep).max(axis=0)
        away = float(((most - least) / (upper - lower)).max())
        across = (most - upper * away + least - lower * away) / 2
        depth = float((low[2] + high[2]) / 2)
        distance = away - depth
        scale = distance * float(slope)
    focus = axes @ [*across, depth]
    return Camera(_triple(focus + distance * out), _triple(focus), _triple(up), scale, angle)


def seen_from(camera: Camera, points: npt.ArrayLike, size: tuple[int, int]) -> npt.NDArray[np.float64]:
    """Places (n, 2) of points (n, 3) in mm, from 0 to 1 in a picture."""
    focus, up = np.array(camera.focus), np.array(camera.up)
    out = np.array(camera.position) - focus
    distance = float(np.linalg.norm(out))
    along = np.cross(up, out / distance)
    away = np.asarray(points, dtype=np.float64) - focus
    half = np.array([camera.scale * size[0] / size[1], camera.scale])
    nearer = 1.0 - (away @ out / distance**2)[:, None] if camera.angle else 1.0
    return np.asarray(away @ np.column_stack((along, up)) / half / nearer / 2 + 0.5)


def _triple(vector: npt.NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z


# K. Moreland, "Diverging color maps for scientific visualization", ISVC 2009. It is made for lit
# surfaces on white, on which the white centre of the plots' map would be lost.
_DIVERGING = "coolwarm"
_ROUND = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)  # ends of scales, and steps of their ticks
DECADE = (1.0, 2.0, 5.0, 10.0)  # ends of logarithmic scales, times powers of ten
_EQUAL = 1e-6  # relative rounding of an end or step
_IN_A_SIGN = 3  # colours of a scale in a sign of the legend


@dataclass(frozen=True)
class Scale:
    """Mapping from values of an array to colours.

    The colour bar has the `title` and behind it the SI `unit` without a prefix, or empty. `low` and
    `high` are the values at the ends of the colours, whose colour values beyond them have.
    `colours` is a colour map of Matplotlib. On a `logarithmic` scale equal ratios are equal steps.
    `missing` is the colour of NaN.
    """

    array: str
    title: str
    unit: str
    low: float
    high: float
    colours: str = SEQUENTIAL
    logarithmic: bool = False
    missing: str = UNKNOWN

    def colours_of(self, values: npt.ArrayLike) -> npt.NDArray[np.uint8]:
        """Red, green and blue from 0 to 255 of values, shape (n, 3)."""
        from matplotlib import colormaps
        from matplotlib.colors import LogNorm, Normalize

        norm = (LogNorm if self.logarithmic else Normalize)(self.low, self.high, clip=True)
        map_ = colormaps[self.colours].with_extremes(bad=self.missing)
        numbers = np.ma.masked_invalid(np.asarray(values, dtype=np.float64))
        return np.asarray(map_(norm(numbers), bytes=True)[:, :3])

    @property
    def ticks(self) -> npt.NDArray[np.float64]:
        """Values at equal steps of colour, shape (n,), in the unit of the numbers; round if the ends are."""
        if self.logarithmic:
            return self.values(round(np.log10(self.high / self.low)) + 1)
        for count in (4, 5, 3, 2):
            step = float(f"{(self.high - self.low) / count:.6e}")
            mantissa = step / 10.0 ** np.floor(np.log10(step))
            if np.isclose(_ROUND, mantissa).any() and abs(self.low / step - round(self.low / step)) < _EQUAL:
                return self.values(count + 1)
        return self.values(5)

    def values(self, count: int) -> npt.NDArray[np.float64]:
        """Values (count,) at equal steps of colour, rising, in the unit."""
        share = np.linspace(0.0, 1.0, count)
        if self.logarithmic:
            return np.asarray(self.low * (self.high / self.low) ** share)
        return np.asarray(self.low + share * (self.high - self.low))

    def steps(self, count: int) -> tuple[str, ...]:
        """Colours ``#rrggbb``, `count` at equal steps from the lower end."""
        return tuple(
            f"#{red:02x}{green:02x}{blue:02x}" for red, green, blue in self.colours_of(self.values(count)).tolist()
        )


def rounded_up(value: float, among: Sequence[float] = _ROUND) -> float:
    """Least of the numbers `among` times a power of ten that is not below a positive value.

    >>> rounded_up(0.00146), rounded_up(5.71, (1, 2, 5, 10)), rounded_up(0.3)
    (0.0015, 10.0, 0.3)
    """
    power = math.floor(math.log10(value))
    first = next(one for one in among if one * (1 + _EQUAL) >= value / 10.0**power)
    return float(f"{first}e{power}")


def about_zero(array: str, title: str, unit: str, values: npt.ArrayLike) -> Scale:
    """Scale of values about zero in the colours of `signed_colours`, to round numbers."""
    colours, *ends = signed_colours(values, _DIVERGING)
    low, high = (math.copysign(rounded_up(abs(end)), end) if end else 0.0 for end in ends)
    return Scale(array, title, unit, low, high, colours)


@dataclass(frozen=True, eq=False)
class Part:
    """Mesh of a scene."""

    name: str  # unique in the scene
    mesh: pyvista.DataSet  # in mm, not empty
    group: str = ""  # name in the legend, switched on and off together; empty for a permanent part
    colour: str = INK  # colour without a scale
    scale: Scale | None = None  # colours by an array of the mesh
    opacity: float = 1.0
    line_width: float = 1.5  # pixels of a picture 900 pixels high
    lit: bool = True  # False for a colour that does not depend on the light
    ambient: float = 0.0  # coefficients of the light
    diffuse: float = 1.0
    fade: bool = False  # more translucent towards the lower end of the scale
    shine: float = 0.0  # coefficient of the reflected light of a metal
    smooth: bool = False  # shade flat triangles as a curved surface with sharp edges
    closed: bool = False  # the surface encloses a solid, and its inside is not drawn
    upright: bool = False  # best seen from low
    shadow: bool = False  # cast a soft shadow on the paper below
    sunk: bool = False  # draw it just behind other surfaces in the same place
    step: int | None = None  # position of the slider at which it is shown, None for all


@dataclass(frozen=True)
class Text:
    """Line of text at a place."""

    text: str
    position: tuple[float, float, float]  # of its centre in mm
    height: float = 17.0  # of the letters in pixels of a picture 900 pixels high
    bold: bool = False
    group: str = ""  # as in `Part`
    hidden_from: tuple[Side, ...] = ()  # sides from which it would overlap others, and is left out
    always: bool = False  # always shown; if two other texts overlap, one of them is left out


@dataclass(frozen=True)
class Slider:
    """Positions of a slider."""

    title: str  # name of the moving thing, without the value
    labels: tuple[str, ...]  # value of every position, with its unit
    notes: tuple[tuple[str, ...], ...]  # lines of text of every position
    first: int = 0  # first position, which a picture shows


@dataclass(frozen=True, eq=False)
class Scene:
    """Parts and texts that are shown together.

    The `parts` are in the order of the legend. `notes` are lines of text beside the scene and its
    `texts`, such as assumptions and meanings of numbers. `slider` is None if nothing moves.
    """

    parts: tuple[Part, ...] = ()
    texts: tuple[Text, ...] = ()
    notes: tuple[str, ...] = ()
    slider: Slider | None = None

    def __add__(self, other: Scene) -> Scene:
        """Join two scenes without common part names or sliders."""
        both = {part.name for part in self.parts} & {part.name for part in other.parts}
        if both:
            raise ValueError(f"parts of a scene must have different names; both have {', '.join(sorted(both))}.")
        if self.slider is not None and other.slider is not None:
            raise ValueError(f"a scene has one slider; got {self.slider.title} and {other.slider.title}.")
        notes = tuple(dict.fromkeys((*self.notes, *other.notes)))
        return Scene(self.parts + other.parts, self.texts + other.texts, notes, self.slider or other.slider)

    def still(self, step: int | None = None) -> Scene:
        """Scene at a `step` of the slider, by default the first, without it."""
        if self.slider is None:
            return self
        at = self.slider.first if step is None else step
        parts = tuple(part for part in self.parts if part.step in (None, at))
        return Scene(parts, self.texts, (*self.notes, *self.slider.notes[at]))

    @property
    def groups(self) -> dict[str, tuple[str, ...]]:
        """Colours of every group's sign in the legend, by its first part."""
        colours: dict[str, tuple[str, ...]] = {}
        for part in self.parts:
            if part.group:
                colours.setdefault(part.group, (part.colour,) if part.scale is None else part.scale.steps(_IN_A_SIGN))
        return colours

    @property
    def scales(self) -> tuple[Scale, ...]:
        """Scales of all parts, each once, in order."""
        return tuple(dict.fromkeys(part.scale for part in self.parts if part.scale is not None))

    @property
    def bounds(self) -> tuple[float, float, float, float, float, float]:
        """Bounds x_min, x_max, y_min, … of parts and texts in mm, or ValueError."""
        if not self.parts:
            raise ValueError("a scene must have at least one part; got none.")
        places = [np.repeat(text.position, 2) for text in self.texts]
        boxes = np.array([part.mesh.bounds for part in self.parts] + places)
        (x_min, y_min, z_min), (x_max, y_max, z_max) = boxes[:, ::2].min(axis=0), boxes[:, 1::2].max(axis=0)
        return float(x_min), float(x_max), float(y_min), float(y_max), float(z_min), float(z_max)
