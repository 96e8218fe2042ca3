"""A located indentation in words."""

from __future__ import annotations

from coilarray.localize.inverse import Location, Mode
from coilarray.viz.studio.touch import Touched

_TOLD = 0.1  # m; a standard deviation above it says nothing


def told(location: Location) -> list[str]:
    """Return lines that say where an indentation is, the best position first.

    Examples
    --------
    >>> told(Location("nothing pressed", "nothing is pressed."))
    ['nothing pressed: nothing is pressed.']
    """
    first = f"{location.verdict}: {location.reason}" if location.reason else location.verdict
    return [first, *(f"{'located' if k == 0 else 'may also be'}: {_mode(m)}" for k, m in enumerate(location.modes))]


def told_by_ellipses(touch: Touched) -> str:
    """Return a line that says where the paper's ellipses put a touch, or why they do not."""
    if touch.crossing is None:
        return f"ellipses: {touch.problem}"
    x, y = touch.crossing.x * 1e3, touch.crossing.y * 1e3
    first, second = touch.crossing.coils
    return f"ellipses of {first} and {second} meet at x = {x:.2f}, y = ±{y:.2f} mm".replace("-", "−")


def _mode(mode: Mode) -> str:
    values = zip(("x", "y", "depth"), (mode.x, mode.y, mode.depth), strict=True)
    deviations = mode.deviations.tolist()
    parts = []
    for k, (name, value) in enumerate(values):
        known = k < len(deviations) and 0 < deviations[k] < _TOLD
        parts.append(f"{name} = {value * 1e3:.2f}{f' ± {deviations[k] * 1e3:.2g}' if known else ''} mm")
    return ", ".join(parts).replace("-", "−")
