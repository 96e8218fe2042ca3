"""Flat figures over frequency."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.ticker import EngFormatter, LogLocator, NullFormatter

from coilarray.viz.palette import COILS, cycled
from coilarray.viz.plots import new_axes, prefix, styled

_CEILING = 4.0  # of the value at the lowest frequency: what the axis shows of a pole
_HEADROOM = 1.08


@styled
def plot_sweep(
    frequency: npt.ArrayLike,
    values: npt.ArrayLike,
    names: Sequence[str],
    *,
    quantity: str,
    unit: str = "",
    limited: bool = False,
    ax: Axes | None = None,
) -> Axes:
    """Draw a quantity of every state over frequency, one line a state.

    Parameters
    ----------
    frequency : array_like, shape (n,)
        In Hz, rising; the axis is logarithmic.
    values : array_like, shape (n, states)
        In SI.
    names : sequence of str, length states
        Of the states.
    quantity, unit : str
        For the vertical axis.
    limited : bool
        Show from zero to four times the values at the lowest frequency at most: for a quantity with a pole.
    ax : Axes, optional
        Where to draw.

    Raises
    ------
    ValueError
        Shapes that do not fit.
    """
    f = np.asarray(frequency, dtype=np.float64)
    shown = np.asarray(values, dtype=np.float64)
    if shown.shape != (f.size, len(names)):
        raise ValueError(f"{f.size} frequencies and {len(names)} states need that shape; got {shown.shape}.")
    factor, text = prefix(shown[0] if limited else shown, unit)
    ax = ax or new_axes(6.5, 3.6)
    for k, (name, colour) in enumerate(cycled(COILS, names).items()):
        ax.plot(f, shown[:, k] * factor, label=name, color=colour, linestyle=("-", "--", ":")[k % 3])
    if limited and float(shown[0].max()) > 0:
        ax.set_ylim(0, min(_CEILING * float(shown[0].max()), _HEADROOM * float(shown.max())) * factor)
    ax.set_xscale("log")
    ax.set_xlim(f[0], f[-1])
    ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.xaxis.set_major_formatter(EngFormatter(unit="Hz"))
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.grid(color="#E4E4E4")
    ax.set_xlabel("frequency")
    ax.set_ylabel(f"{quantity} ({text})" if text else quantity)
    ax.legend(ncols=2)
    return ax
