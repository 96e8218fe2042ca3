"""Designs drawn from the posterior of a calibration."""

from __future__ import annotations

import numpy as np
import xarray as xr

from coilarray.compute.netcdf import Entry, Schema
from coilarray.design.model import Design, DesignFile, build_design
from coilarray.design.vary import vary_document
from coilarray.design.write import as_file
from coilarray.errors import GoalError
from coilarray.response.setup import Imperfections
from coilarray.studies.calibrate.model import imperfections_of
from coilarray.studies.calibrate.plan import separated

CALIBRATION = Schema(
    GoalError, "value, posterior and entries over combination, draw and unknown",
    {
        "value": Entry("", ("combination", "unknown"), needed=True, gaps=True),
        "posterior": Entry("", ("combination", "draw", "unknown"), needed=True, gaps=True),
        "unknown": Entry(None, ("unknown",), needed=True),
        "entries": Entry(None, ("unknown",), needed=True, longest=100_000),
    },
)  # fmt: skip
"""Variables of a dataset of `coilarray.studies.calibrate.calibrate` that are needed for draws."""


def calibrated_imperfections(calibration: xr.Dataset) -> Imperfections:
    """Return the fitted imperfections of the best combination."""
    best = _best(calibration)
    values = dict(zip(best.unknown.values.tolist(), best["value"].values.tolist(), strict=True))
    return imperfections_of(separated(values)[1])


def posterior_draws(
    design: Design | DesignFile, calibration: xr.Dataset, count: int
) -> list[tuple[Design, Imperfections]]:
    """Draw designs and imperfections from a posterior.

    It is the posterior of the best combination of a calibration.

    Parameters
    ----------
    design : Design or DesignFile
        The calibrated design, or another design. Its entries that were unknown take the drawn values.
    calibration : xarray.Dataset
        Dataset of `coilarray.studies.calibrate.calibrate`.
    count : int
        Number of draws, at most the number in the dataset.

    Raises
    ------
    GoalError
        If the dataset is not a calibration, or has fewer draws.
    DesignError
        If the design lacks an entry.
    """
    best = _best(calibration)
    if not 1 <= count <= best.sizes["draw"]:
        raise GoalError(f"the number of draws must be from 1 to {best.sizes['draw']}; got {count}.")
    file = as_file(design)
    keys = [str(entries).split() for entries in best.entries.values]
    rows = best.posterior.values[np.linspace(0, best.sizes["draw"] - 1, count).astype(int)]
    drawn = []
    for row in rows.tolist():
        values = {key: value for entries, value in zip(keys, row, strict=True) for key in entries}
        changes, errors = separated(values)
        built = build_design(vary_document(file.document, changes), file.design.name)
        drawn.append((built, imperfections_of(errors)))
    return drawn


def _best(calibration: xr.Dataset) -> xr.Dataset:
    """Return the best combination with its unknowns."""
    best = CALIBRATION.checked(calibration, "the dataset").isel(combination=0)
    own = np.flatnonzero(np.isfinite(best["value"].values))
    return best[list(CALIBRATION.variables)].isel(unknown=own)
