"""Results in place of those that take half a minute to compute, for tests of what is printed and written of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import xarray as xr

from coilarray.design.model import Design, build_design
from coilarray.paper.ellipse_model import published_model


def made_up_distortion(design: Design, states: Iterable[str] = ("coil1", "coil2", "coil3"), **_: object) -> xr.Dataset:
    """A dataset as of `distortion`: x0 is 1 mm, alone 0.5 mm, published 0.25 mm; a third coil is not published."""
    delta, states = np.array([1e-4, 5e-4, 1e-3]), list(states)
    shape = (len(states), 3)
    both = np.stack([np.full(shape, 1e-3), np.full(shape, 0.5e-3)])
    published = np.full(shape, 0.25e-3)
    published[2:] = np.nan
    effect = np.stack([np.full(shape, 0.3e-3), np.full(shape, -0.1e-3)])
    effect[:, 0, 2] = np.nan
    marks = np.zeros_like(published, dtype=bool)
    marks[0, 0] = True
    both[:, 0, 2] = np.nan
    metres = {"units": "m"}
    data: dict[str, Any] = dict.fromkeys(("x0", "A", "B"), (("neighbours", "state", "delta"), both, metres))
    data |= {f"published_{name}": (("state", "delta"), published, metres) for name in ("x0", "A", "B")}
    data["undetermined"] = (("neighbours", "state", "delta"), np.zeros(both.shape, dtype=bool))
    data["published_undetermined"] = (("state", "delta"), marks)
    data["effect"] = (("cause", "state", "delta"), effect, metres)
    data["rms"] = (("cause", "state"), np.sqrt(np.nanmean(effect**2, axis=-1)), metres)
    residual = both[0] - published
    known = np.maximum((~np.isnan(residual)).sum(axis=-1), 1)
    rms = np.sqrt(np.nansum(residual**2, axis=-1) / known)
    data["rms_residual"] = ("state", np.where(np.isnan(residual).all(axis=-1), np.nan, rms), metres)
    data["centre"] = ("state", np.zeros(len(states)), metres)
    data |= {f"indenter_{name}": (("indenter", "state", "delta"), both[:1], metres) for name in ("x0", "A", "B")}
    data["indenter_peak"] = (("indenter", "state"), np.full((1, len(states)), 1e-3), {"units": "1"})
    coords = {"neighbours": ["grounded", "open"], "state": states, "delta": delta, "cause": ["all neighbours", "noise"]}
    return xr.Dataset(data, coords | {"indenter": ["without"]}, {"design": design.name})


def made_up_ellipses(item: Mapping[str, Any]) -> dict[str, float]:
    """Ellipses of Table A1, as wide as the gap over 0.08 mm, as `evaluate_model` returns them for a calibration."""
    build_design(item["document"], "gast2020")
    width = item["document"]["coils"]["hexagon"]["gap_mm"] / 0.08
    rows = []
    for state in item["request"]["states"]:
        coil = published_model()[state]
        x0, A, B = coil.curves(item["request"]["levels"])
        rows += [width * A, width * B, x0, [coil.highest]]
    return {str(k): value for k, value in enumerate(np.concatenate(rows).tolist())}
