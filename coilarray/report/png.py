"""PNG image of a drawn figure for a page."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from PIL import Image

from coilarray.viz.plots.style import close

_DPI = 130
_RIM = 0.1  # inches of white around a picture
_WHITE = 0xFFFFFFFF  # a pixel of four bytes
_BESIDE = (1.5, 4.0, 1.2, 1.0)  # inches at the left, at the right, below and above a single pair of axes
_AXES_PART = 0.84  # of a figure's width and height


def png_of(drawn: Axes | Figure) -> bytes:
    """Draw a figure without its white rim, and close it.

    Matplotlib's own tight box would draw it twice.
    """
    figure = drawn if isinstance(drawn, Figure) else drawn.figure
    assert isinstance(figure, Figure)  # plots draw on figures, never on sub-figures
    close(figure)
    buffer = io.BytesIO()
    figure.set_dpi(_DPI)
    _lay_out(figure)
    canvas: Any = FigureCanvasAgg(figure)  # its methods have no types
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())
    inked = pixels.view(np.uint32)[..., 0] != _WHITE
    if any(edge.any() for edge in (inked[0], inked[-1], inked[:, 0], inked[:, -1])):  # it may extend beyond the figure
        figure.savefig(buffer, format="png", dpi=_DPI, bbox_inches="tight")
        return buffer.getvalue()
    rim = round(_RIM * _DPI)
    rows, columns = (np.flatnonzero(inked.any(axis=k)) for k in (1, 0))
    cut = tuple(slice(max(0, at[0] - rim), at[-1] + 1 + rim) for at in (rows, columns))
    # Matplotlib's own imsave would first search the pixels for colours, which takes as long
    Image.fromarray(np.ascontiguousarray(pixels[cut][..., :3])).save(
        buffer, format="png", dpi=(_DPI, _DPI), compress_level=3
    )
    return buffer.getvalue()


def _lay_out(figure: Figure) -> None:
    """Lay out single axes with a rim for their labels.

    Matplotlib's layout measures every text first, which takes as long as drawing. Several axes need it.
    """
    if len(figure.axes) != 1 or not isinstance(figure.get_layout_engine(), ConstrainedLayoutEngine):
        return
    (axes,), (width, height) = figure.axes, figure.get_size_inches().tolist()
    left, right, low, high = _BESIDE
    share = _AXES_PART
    figure.set_layout_engine("none")
    figure.set_size_inches(width + left + right, height + low + high)
    whole = figure.get_size_inches()
    axes.set_position((left / whole[0], low / whole[1], share * width / whole[0], share * height / whole[1]))
