"""Pictures of the pages about theory, computed when the pages are built."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from coilarray.geometry import MATERIALS, Material, Plate
from coilarray.metal.ball import polarisabilities
from coilarray.metal.flat_plates import plate_inductance

if TYPE_CHECKING:
    from sphinx.application import Sphinx

_COLOURS = ("#2f6fb5", "#c2410c", "#3f8f4f")
_RADIUS, _DISTANCE = 10e-3, 2e-3  # of the loop from the plates in m
_BALL = 2.5e-3  # radius in m
_FREQUENCIES = np.geomspace(1e2, 1e7, 61)


def _metal() -> Figure:
    """Draw what plates do to a loop, and the polarisability of spheres, over frequency."""
    figure = Figure(figsize=(9, 4.2), layout="constrained")
    plates, balls = figure.subplots(1, 2)
    angle = np.linspace(0, 2 * np.pi, 61)
    loop = np.column_stack((_RADIUS * np.cos(angle), _RADIUS * np.sin(angle), 0 * angle))
    perfect = plate_inductance([loop], [Plate("", _DISTANCE, 1e-3, Material("", np.inf))], [1e6])[0, 0, 0].real
    cases = (("copper, 35 µm", "copper", 35e-6), ("aluminium, 1 mm", "aluminium", 1e-3), ("steel, 1 mm", "steel", 1e-3))
    for (label, name, thickness), colour in zip(cases, _COLOURS, strict=True):
        plate = Plate("", _DISTANCE, thickness, MATERIALS[name])
        change = plate_inductance([loop], [plate], _FREQUENCIES)[:, 0, 0] / abs(perfect)
        plates.plot(_FREQUENCIES, change.real, color=colour, label=label)
        plates.plot(_FREQUENCIES, -change.imag, color=colour, linestyle="--")
    plates.set(title="Infinite plates, over a perfect conductor", ylabel="ΔL (solid) and ΔR/ω (dashed)")
    for name, colour in zip(("aluminium", "steel", "ferrite"), _COLOURS, strict=True):
        dipole = polarisabilities(_BALL, MATERIALS[name], _FREQUENCIES, 1)[:, 0]
        balls.plot(_FREQUENCIES, dipole.real, color=colour, label=name)
        balls.plot(_FREQUENCIES, dipole.imag, color=colour, linestyle="--")
    balls.set(title="Spheres of 5 mm", ylabel="Re α₁ (solid) and Im α₁ (dashed)")
    for ax in (plates, balls):
        ax.set(xscale="log", xlabel="frequency in Hz")
        ax.axhline(0, color="0.6", linewidth=0.8)
        ax.legend()
    return figure


def _write(app: Sphinx) -> None:
    folder = Path(app.srcdir) / "made" / "theory"
    folder.mkdir(parents=True, exist_ok=True)
    _metal().savefig(folder / "metal.png", dpi=110)


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the pictures before Sphinx looks for them."""
    app.connect("builder-inited", _write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
