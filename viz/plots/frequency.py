"""Figures over frequency."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from matplotlib.axes import Axes

from coilarray.viz.palette import curve_look
from coilarray.viz.plots.axis_units import PLAIN, axis_unit, logarithmic_ticks
from coilarray.viz.plots.style import faint_grid, legend_beside, new_axes, styled

if TYPE_CHECKING:
    import xarray as xr

_NAMES = {
    "apparent_inductance": "apparent inductance Im Z/ω",
    "impedance_real": "effective resistance Re Z",
    "impedance_imag": "reactance Im Z",
    "quality_factor": "quality factor Im Z/Re Z",
}
_POLES = ("apparent_inductance", "impedance_real", "impedance_imag")  # at the self-resonance
_CEILING = 4.0  # height of the axis for a pole, over the value at the lowest frequency
_HEADROOM = 1.08


@styled
def plot_frequency_sweep(sweep: xr.Dataset, quantity: str = "apparent_inductance", ax: Axes | None = None) -> Axes:
    """Draw a quantity over frequency, one curve per state.

    Parameters
    ----------
    sweep : xarray.Dataset
        Result of `coilarray.circuit.impedance.sweep_design`.
    quantity : str
        Name of a variable: ``apparent_inductance``, ``impedance_real``, ``impedance_imag`` or ``quality_factor``.
    ax : Axes, optional
        Axes to draw into. They start at zero; for a quantity with a pole they end at four times its value at the lowest
        frequency.

    Raises
    ------
    ValueError
        If the sweep has no such quantity.

    Examples
    --------
    >>> from coilarray import load_design
    >>> from coilarray.circuit.impedance import sweep_design
    >>> ax = plot_frequency_sweep(sweep_design(load_design("gast_fem"), [1e5, 1e6]))
    >>> ax.get_xlabel(), ax.get_ylabel()
    ('frequency (MHz)', 'apparent inductance Im Z/ω (µH)')
    """
    there = [name for name in _NAMES if name in sweep]
    if quantity not in there:
        raise ValueError(f"quantity must be one of {', '.join(there)}; got {quantity!r}.")
    values = sweep[quantity].transpose("frequency", "state").values
    top = _HEADROOM * float(values.max())
    if quantity in _POLES:
        top = min(_CEILING * float(values[0].max()), top)
    unit = str(sweep[quantity].attrs["units"])
    shown = PLAIN if unit == "1" else axis_unit(top, unit)
    of_frequency = axis_unit(sweep.frequency)
    f = of_frequency.of(sweep.frequency)
    ax = ax or new_axes(6.5, 3.6)
    for k, name in enumerate(sweep.state.values.tolist()):
        ax.plot(f, shown.of(values[:, k]), label=name, marker="o" if f.size == 1 else "", **curve_look(k))
    if top > 0:
        ax.set_ylim(0.0, float(shown.of(top)))
    ax.set_xscale("log")
    if f.size > 1:
        ax.set_xlim(f[0], f[-1])
    logarithmic_ticks(ax.xaxis, math.log10(f[-1] / f[0]))
    faint_grid(ax)
    ax.set(xlabel=of_frequency.label("frequency"), ylabel=shown.label(_NAMES[quantity]))
    legend_beside(ax, math.ceil(sweep.sizes["state"] / 16))
    return ax
