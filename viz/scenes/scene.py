"""What stands in a scene: meshes with their colours, texts, and what the colours mean. Values, nothing is drawn."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from coilarray.viz.palette import INK, SEQUENTIAL, UNKNOWN
from coilarray.viz.scenes.camera import Side

if TYPE_CHECKING:
    import pyvista

FloatArray = npt.NDArray[np.float64]

# K. Moreland, "Diverging color maps for scientific visualization", ISVC 2009: made for lit surfaces on white, where the
# white middle of the plots' map would be lost
_DIVERGING = "coolwarm"


@dataclass(frozen=True)
class Scale:
    """How the values of an array become colours.

    Parameters
    ----------
    array : str
        Name of the array of points or cells.
    title : str
        Of the colour bar, without the unit.
    unit : str
        SI unit of the values without a prefix; empty for none.
    low, high : float
        Values at the ends of the colours; what lies beyond has the colour of the end.
    colours : str
        Name of a colour map of Matplotlib.
    logarithmic : bool
        Equal ratios are equal steps of colour.
    missing : str
        Colour of values that are NaN.
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
        """Return red, green, blue of values, shape (n, 3)."""
        from matplotlib import colormaps
        from matplotlib.colors import LogNorm, Normalize

        norm = (LogNorm if self.logarithmic else Normalize)(self.low, self.high, clip=True)
        map_ = colormaps[self.colours].with_extremes(bad=self.missing)
        numbers = np.ma.masked_invalid(np.asarray(values, dtype=np.float64))
        return np.asarray(map_(norm(numbers), bytes=True)[:, :3])

    def typical_colour(self, values: npt.ArrayLike) -> str:
        """Return the colour of the median of values, as "#rrggbb": what a legend shows of a part with this scale."""
        numbers = np.asarray(values, dtype=np.float64)
        finite = numbers[np.isfinite(numbers)]
        red, green, blue = self.colours_of([np.median(finite) if finite.size else np.nan])[0].tolist()
        return f"#{red:02x}{green:02x}{blue:02x}"


def symmetric(array: str, title: str, unit: str, values: npt.ArrayLike) -> Scale:
    """Return a scale of both signs whose middle is zero and whose ends are the largest amount."""
    numbers = np.abs(np.asarray(values, dtype=np.float64))
    largest = float(np.nanmax(numbers)) if np.isfinite(numbers).any() else 0.0
    largest = largest or 1.0
    return Scale(array, title, unit, -largest, largest, _DIVERGING)


@dataclass(frozen=True, eq=False)
class Part:
    """One mesh of a scene.

    Parameters
    ----------
    name : str
        Unique in the scene.
    mesh : pyvista.DataSet
        In mm; not empty.
    group : str
        What is switched on and off together, and stands in the legend; empty for what is always there.
    colour : str
        Of all of it, where there is no scale, and in the legend.
    scale : Scale, optional
        Colours by an array of the mesh.
    opacity : float
        From 0 to 1.
    line_width : float
        In pixels of a picture 900 pixels high.
    lit : bool
        False for what has its colour from everywhere.
    ambient, diffuse : float
        Of the light.
    smooth : bool
        Shade flat triangles as a bent surface; edges stay sharp.
    sunk : bool
        Draw it just behind other surfaces in the same place.
    """

    name: str
    mesh: pyvista.DataSet
    group: str = ""
    colour: str = INK
    scale: Scale | None = None
    opacity: float = 1.0
    line_width: float = 1.5
    lit: bool = True
    ambient: float = 0.0
    diffuse: float = 1.0
    smooth: bool = False
    sunk: bool = False


@dataclass(frozen=True)
class Text:
    """A word at a place.

    Parameters
    ----------
    text : str
        One line.
    position : tuple of float
        In mm.
    height : float
        Of the letters in pixels of a picture 900 pixels high.
    bold : bool
        In heavy letters.
    group : str
        As of a `Part`.
    hidden_from : tuple of str
        Sides from which it would lie on others, and is left out.
    always : bool
        Gives way to no text without this mark; where two others meet, one of them is left out.
    """

    text: str
    position: tuple[float, float, float]
    height: float = 17.0
    bold: bool = False
    group: str = ""
    hidden_from: tuple[Side, ...] = ()
    always: bool = False


@dataclass(frozen=True, eq=False)
class Scene:
    """Parts and texts that are seen together.

    Parameters
    ----------
    parts : tuple of Part
        In the order in which the legend tells them.
    texts : tuple of Text
        In the scene.
    notes : tuple of str
        Lines beside it: what was assumed, what a number means.
    """

    parts: tuple[Part, ...] = ()
    texts: tuple[Text, ...] = ()
    notes: tuple[str, ...] = ()

    def __add__(self, other: Scene) -> Scene:
        """Put two scenes together.

        Raises
        ------
        ValueError
            A name that both have.
        """
        both = {part.name for part in self.parts} & {part.name for part in other.parts}
        if both:
            raise ValueError(f"parts of a scene must have different names; both have {', '.join(sorted(both))}.")
        notes = tuple(dict.fromkeys((*self.notes, *other.notes)))
        return Scene(self.parts + other.parts, self.texts + other.texts, notes)

    @property
    def groups(self) -> dict[str, str]:
        """Colour of every group in the legend, in order: that of its first part."""
        colours: dict[str, str] = {}
        for part in self.parts:
            if part.group:
                colours.setdefault(part.group, part.colour)
        return colours

    @property
    def scales(self) -> tuple[Scale, ...]:
        """Scales of all parts, each once, in order."""
        return tuple(dict.fromkeys(part.scale for part in self.parts if part.scale is not None))

    @property
    def bounds(self) -> tuple[float, float, float, float, float, float]:
        """x_min, x_max, y_min, y_max, z_min, z_max of parts and texts in mm; ValueError where there is no part."""
        if not self.parts:
            raise ValueError("a scene must have at least one part; got none.")
        boxes = np.array(
            [part.mesh.bounds for part in self.parts] + [np.repeat(text.position, 2) for text in self.texts]
        )
        low, high = boxes[:, ::2].min(axis=0).tolist(), boxes[:, 1::2].max(axis=0).tolist()
        x_min, x_max, y_min, y_max, z_min, z_max = itertools.chain.from_iterable(zip(low, high, strict=True))
        return x_min, x_max, y_min, y_max, z_min, z_max
