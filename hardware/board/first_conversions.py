"""Accuracy of the first conversions after sleep.

The comparison gives the number of conversions to discard.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from coilarray.compute.threads import Progress
from coilarray.hardware.board.self_test import RCOUNT
from coilarray.hardware.chips.ldc1614 import MOST_DISCARDED
from coilarray.hardware.scan.reader import Reader
from coilarray.hardware.scan.readings import read_scan
from coilarray.hardware.scan.settings import ScanSettings

DISCARDS = (0, 1, 2, 4, 8, MOST_DISCARDED)
"""Numbers of discarded conversions to try."""
UNSETTLED = 2e-6
"""Least relative offset of a frequency that counts, if the noise is not larger. It is some codes of the shortest scans,
and the change of the clock by 0.15 K in the seconds of the test."""
_SCANS = 3  # of each number of discarded conversions
_SIGMAS = 5.0
_ANY_CAPACITANCE = 120e-12  # F; only frequencies are used


@dataclass(frozen=True)
class FirstConversions:
    """Comparison of first and later conversions after waking.

    The two directions of a scan are compared as well.

    Parameters
    ----------
    offsets : mapping of str to tuple of float
        Relative offsets of the frequency of each state with each of `DISCARDS` discarded, against that with the most.
        States without a result in every scan are missing.
    backwards : mapping of str to float
        Relative change of the frequency of each state where the scan runs in the reversed order, with the recommended
        number discarded.
    noticeable : float
        Least relative offset that counts: five standard errors, and at least `UNSETTLED`.
    recommended : int
        Least number of conversions to discard so that no state has a noticeable offset.
    """

    offsets: Mapping[str, tuple[float, ...]]
    backwards: Mapping[str, float]
    noticeable: float
    recommended: int

    @property
    def settled(self) -> bool:
        """Whether fewer than the most conversions are enough.

        Otherwise it is not known whether even the most are enough.
        """
        return self.recommended < DISCARDS[-1]

    @property
    def order_matters(self) -> bool:
        """Whether a state's frequency depends on the states before it."""
        return any(abs(change) > self.noticeable for change in self.backwards.values())


def first_conversions(reader: Reader, settings: ScanSettings, *, progress: Progress | None = None) -> FirstConversions:
    """Measure the error of the first conversions after sleep.

    Parameters
    ----------
    reader : Reader
        Reader of the board. Afterwards it is not configured and its coils are grounded. Nothing may move near them.
    settings : ScanSettings
        Settings of the scan. Its conversions are used, or shorter conversions of 12 ms, with which the test takes about
        10 s.
    progress : callable, optional
        Function called with (done, total) after each number of conversions.

    Returns
    -------
    FirstConversions
        Nothing is recommended if no state has results.

    Raises
    ------
    HardwareError
        The board refuses the settings, does not answer or cannot scan.

    Notes
    -----
    Users of the FDC2214, which has the same core, report first conversions that are off by tens of thousands of codes,
    1e-3 of the frequency. This is not verified for the LDC1614.
    """
    trying = replace(settings, rcount=min(settings.rcount, RCOUNT))
    runs = []
    for k, discard in enumerate(DISCARDS):
        runs.append(_frequencies(reader, replace(trying, discard=discard)))
        if progress is not None:
            progress(k + 1, len(DISCARDS) + 1)
    forwards = np.stack(runs)  # discard, scan, state
    means, names = forwards.mean(axis=1), [state.name for state in settings.states]
    good = np.isfinite(means).all(axis=0)
    offsets = means / means[-1] - 1
    noticeable = UNSETTLED
    if good.any():
        scatter = math.sqrt(np.mean((forwards.var(axis=1, ddof=1) / means**2)[:, good]))
        noticeable = max(noticeable, _SIGMAS * scatter * math.sqrt(2 / _SCANS))
    off = [discard for discard, row in zip(DISCARDS, offsets, strict=True) if (np.abs(row[good]) > noticeable).any()]
    chosen = DISCARDS.index(off[-1]) + 1 if off else 0
    reversed_settings = replace(trying, states=trying.states[::-1], discard=DISCARDS[chosen])
    backwards = _frequencies(reader, reversed_settings).mean(axis=0)[::-1] / means[chosen] - 1
    good &= np.isfinite(backwards)
    reader.rest()
    if progress is not None:
        progress(len(DISCARDS) + 1, len(DISCARDS) + 1)
    return FirstConversions(
        offsets={name: tuple(offsets[:, k].tolist()) for k, name in enumerate(names) if good[k]},
        backwards={name: float(backwards[k]) for k, name in enumerate(names) if good[k]},
        noticeable=noticeable,
        recommended=DISCARDS[chosen],
    )


def _frequencies(reader: Reader, settings: ScanSettings) -> npt.NDArray[np.float64]:
    """Return the frequencies of some scans in Hz.

    The shape is (scans, states). A state without a result has NaN.
    """
    reader.configure(settings)
    scans = [read_scan(reader.scan(), settings, _ANY_CAPACITANCE).states for _ in range(_SCANS)]
    return np.array([[state.frequency for state in states] for states in scans], dtype=np.float64)
