"""What stands beside a scene on the page: its groups, its colour bars and its notes, as plain values."""

from __future__ import annotations

from typing import Any

import numpy as np

from coilarray.viz.scenes.draw import shown_units
from coilarray.viz.scenes.scene import Scale, Scene

_STOPS = 24  # colours of a bar
_TICKS = 5


def legend_of(scene: Scene) -> dict[str, Any]:
    """Return groups with their colours, bars with title, colours and numbers, and notes."""
    return {
        "groups": [{"name": name, "colour": colour} for name, colour in scene.groups.items()],
        "bars": [_bar(scale) for scale in scene.scales],
        "notes": list(scene.notes),
    }


def _bar(scale: Scale) -> dict[str, Any]:
    """Title with the unit, colours from left to right, and numbers from end to end."""
    factor, title = shown_units(scale)
    colours = scale.colours_of(_values(scale, _STOPS))
    stops = ", ".join(f"#{red:02x}{green:02x}{blue:02x}" for red, green, blue in colours.tolist())
    ticks = [f"{value * factor:.3g}".replace("-", "−") for value in _values(scale, _TICKS).tolist()]
    return {"title": title, "colours": f"linear-gradient(to right, {stops})", "ticks": ticks}


def _values(scale: Scale, count: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Values at equal steps of a scale's length."""
    share = np.linspace(0.0, 1.0, count)
    if scale.logarithmic:
        return np.asarray(scale.low * (scale.high / scale.low) ** share)
    return np.asarray(scale.low + share * (scale.high - scale.low))
