"""Record a running board for a number of scans or a time."""

from __future__ import annotations

import math
from collections.abc import Generator
from contextlib import closing
from typing import cast

from coilarray.compute.threads import Progress
from coilarray.errors import HardwareError
from coilarray.hardware.record.recorder import Recorder
from coilarray.hardware.scan.reader import RawScan, Reader


def record_stream(
    reader: Reader,
    recorder: Recorder,
    *,
    scans: int | None = None,
    seconds: float | None = None,
    interval: float = 0.0,
    progress: Progress | None = None,
) -> int:
    """Record scans as they come.

    Parameters
    ----------
    reader : Reader
        Configured with the settings of the recorder's session.
    recorder : Recorder
        Started.
    scans : int, optional
        How many.
    seconds : float, optional
        Or how long, by the board's clock from the first scan on.
    interval : float
        From scan to scan in s; as fast as it goes by default.
    progress : callable, optional
        Called with (done, total): scans, or tenths of a second.

    Returns
    -------
    int
        Scans recorded.

    Raises
    ------
    HardwareError
        Neither or both of `scans` and `seconds`, values that are not positive, and what the reader raises; every scan
        that came before is in the recording.
    OutputError
        A recording that cannot be written.
    """
    if (scans is None) == (seconds is None):
        raise HardwareError("a stream must have either a number of scans or a time in s.")
    if scans is not None and scans < 1:
        raise HardwareError(f"a stream must have at least 1 scan; got {scans}.")
    if seconds is not None and not (math.isfinite(seconds) and seconds > 0):
        raise HardwareError(f"a stream must last a positive time; got {seconds} s.")
    count, first = 0, None
    # an iterator of a reader is a generator: closing it stops the board
    with closing(cast("Generator[RawScan]", reader.scans(interval))) as stream:
        for scan in stream:
            first = scan.time if first is None else first
            passed = scan.time - first
            if seconds is not None and passed > seconds:
                break
            recorder.add(scan, "stream")
            count += 1
            if progress is not None and scans is not None:
                progress(count, scans)
            elif progress is not None and seconds is not None:
                progress(round(10 * passed), math.ceil(10 * seconds))
            if count == scans:
                break
    return count
