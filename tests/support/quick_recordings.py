"""Recordings of the quick board of two coils, for the tests of calibration, comparison and live display."""

from contextlib import contextmanager

import numpy as np
import xarray as xr

from coilarray.hardware.record.campaign import Campaign, EmulatedStage, run_campaign
from coilarray.hardware.record.recorder import open_recorder, record_stream
from support.quick_coils import series_tank
from support.recorded_boards import QuickWorld, configured, dent, quick_board, session_of, two_coils

DESIGN = two_coils()
GRID = Campaign(
    x=tuple(np.arange(-8e-3, 21.1e-3, 2e-3)), y=tuple(np.arange(-6e-3, 6.1e-3, 2e-3)), depths=(1e-3,)
)  # fmt: skip
"""Over both coils; the largest δ of each is well inside."""


@contextmanager
def _recorded(path, campaign, oscillator, settings, board):
    """A quick board and its recorder, which has begun."""
    with open_recorder(path) as recorder, quick_board(**board) as opened:
        if oscillator is not None:
            opened.emulator.conditions.oscillator = oscillator
        recorder.start(session_of(opened, configured(opened, **(settings or {})), DESIGN), *campaign)
        yield opened, recorder


def campaign_file(path, campaign=GRID, *, oscillator=None, settings=None, **board):
    """Record a campaign on a quick board."""
    with _recorded(path, [campaign.to_json()], oscillator, settings, board) as (opened, recorder):
        run_campaign(campaign, opened.reader, EmulatedStage(opened.emulator), recorder, opened.emulator.clock)
    return path


def stream_file(path, scans, *, oscillator=None, settings=None, path_of_finger=None, **board):
    """Record a stream of a quick board."""
    with _recorded(path, [], oscillator, settings, board) as (opened, recorder):
        if path_of_finger is not None:
            opened.emulator.indenter.follow(path_of_finger)
        record_stream(opened.reader, recorder, scans=scans)
    return path


def quick_map(x, y, depths=(1e-3,)):
    """Response of the quick board as a simulation would give it: (f_0/f)² − 1 of its lossy tanks."""
    world = QuickWorld()

    def frequency(change):
        return series_tank(52e-6 * (1 + change), world.capacitance, world.resistance).frequency

    flat = frequency(0.0)
    delta = [
        [[[(flat / frequency(dent(coil, a, b, h))) ** 2 - 1 for coil in ("coil1", "coil2")] for a in x] for b in y]
        for h in depths
    ]
    coords = {"depth": list(depths), "y": np.asarray(y), "x": np.asarray(x), "state": ["coil1", "coil2"]}
    return xr.Dataset({"delta": (("depth", "y", "x", "state"), np.array(delta))}, coords)
