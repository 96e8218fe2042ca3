"""Every kind of file that is written and read back, a bit flipped, cut, or lines lost: no result changes in silence."""

from collections import Counter
from dataclasses import asdict

import numpy as np
import pytest
from support.recorded_boards import campaign_file, stream_file

from coilarray.errors import CoilarrayError, LocalizeError
from coilarray.hardware.record.calibration import calibrate_board, load_calibration, save_calibration
from coilarray.hardware.record.campaign import Campaign
from coilarray.hardware.record.recorded_response import recorded_response, recorded_series, series_csv
from coilarray.hardware.record.recording import open_recording, summarize_recording
from coilarray.paper.ellipse_model import model_to_json, published_model

PLAN = Campaign(x=(0.0, 4e-3), y=(0.0, 2e-3), depths=(1e-3,), scans=2)


def content(dataset):
    """Everything of a dataset that enters a result, exactly; None where there is none."""
    if dataset is None:
        return None
    parts = {
        name: (one.dims, str(one.dtype), one.values.tobytes() if one.dtype != object else tuple(one.values.tolist()),
               sorted((key, repr(value)) for key, value in one.attrs.items()))
        for name, one in dataset.variables.items()
    }  # fmt: skip
    return parts, sorted(map(str, dataset.coords)), sorted((key, repr(value)) for key, value in dataset.attrs.items())


def recording_content(path):
    """Summary, sessions, scans and datasets of a recording."""
    with open_recording(path) as recording:
        summary = summarize_recording(recording)
        held = [asdict(one) for one in recording.sessions], recording.campaign
        scans, places = list(recording.scans()), recording.positions()
        series = content(recorded_series(recording))
        response = None if recording.campaign is None else content(recorded_response(recording))
    return repr((summary, held, scans, places)), series, response


def stream(folder):
    path = stream_file(folder / "stream.sqlite", 40, noise=1e-6)
    return path, lambda: recording_content(path)


def campaign(folder):
    path = campaign_file(folder / "campaign.sqlite", PLAN, noise=1e-6)
    return path, lambda: recording_content(path)


def board_calibration(folder):
    recording, path = stream_file(folder / "stream.sqlite", 40, noise=1e-6), folder / "board.toml"
    with open_recording(recording) as opened:
        save_calibration(calibrate_board(opened, inductances={"coil1": 52e-6}, made="2025-01-01"), path)
    return path, lambda: repr(load_calibration(path))


def ellipses(folder):
    from coilarray.cli.shared import read_ellipses

    path = folder / "model.json"
    path.write_text(model_to_json(published_model(), "a test"), encoding="utf-8")
    return path, lambda: repr(read_ellipses(path))


def csv_of_a_stream(folder):
    from coilarray.cli.position import read_readings

    path = folder / "stream.csv"
    with open_recording(stream_file(folder / "stream.sqlite", 12, noise=1e-6)) as recording:
        path.write_text(series_csv(recorded_series(recording)), encoding="utf-8", newline="")

    def read():
        found = read_readings(str(path))
        if any(isinstance(one, LocalizeError) for one in found):
            raise next(one for one in found if isinstance(one, LocalizeError))
        return found

    return path, read


KINDS = {
    "recording of a stream": stream, "recording of a campaign": campaign, "calibration of a board": board_calibration,
    "ellipse model": ellipses, "CSV of a stream": csv_of_a_stream,
}  # fmt: skip


def cuts(data, most):
    """Cut a file at places spread over it and at each of the last twenty bytes."""
    places = set(np.linspace(0, len(data) - 1, most).astype(int).tolist()) | set(range(len(data))[-20:])
    for place in sorted(places):
        yield f"cut at {place}", data[:place]


def flips(data, count):
    """Flip one bit at a time, spread over all of a file."""
    bounds = np.linspace(0, 8 * len(data), count + 1)
    for bit in np.random.default_rng(0).uniform(bounds[:-1], bounds[1:]).astype(int).tolist():
        changed = bytearray(data)
        changed[bit // 8] ^= 1 << bit % 8
        yield f"bit {bit}", bytes(changed)


def wrong_lines(data):
    """Drop each line of a file and double it, and swap it with the next other one and with another one further on."""
    lines = data.splitlines(keepends=True)
    for k, line in enumerate(lines):
        yield f"without line {k + 1}", b"".join(lines[:k] + lines[k + 1 :])
        yield f"line {k + 1} twice", b"".join([*lines[:k], line, *lines[k:]])
        for other in (k + 1, k + len(lines) // 2):
            if other < len(lines) and lines[other] != line:
                swapped = [*lines[:k], lines[other], *lines[k + 1 : other], line, *lines[other + 1 :]]
                yield f"lines {k + 1} and {other + 1} swapped", b"".join(swapped)


def damaged(path, read, changes):
    """Change a file in one way after the other; it is refused, or reads as before. Count both."""
    before = {one: one.read_bytes() for one in path.parent.iterdir() if one.is_file()}
    expected, counts = read(), Counter()

    def restore():
        for one in set(path.parent.iterdir()) - before.keys():
            one.unlink()
        for one, whole in before.items():
            one.write_bytes(whole)

    for name, data in changes:
        restore()
        path.write_bytes(data)
        try:
            assert read() == expected, f"{name} gives another result in silence"
        except CoilarrayError:
            counts["refused"] += 1
        else:
            counts["same"] += 1
    restore()
    return counts


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_no_flipped_bit_and_no_cut_changes_a_result_in_silence(tmp_path, name):
    path, read = KINDS[name](tmp_path)
    data = path.read_bytes()
    counts = damaged(path, read, [*flips(data, 50), *cuts(data, 20)])
    assert counts["refused"] > 10


@pytest.mark.slow
@pytest.mark.parametrize("name", ["calibration of a board", "CSV of a stream"])
def test_every_line_that_is_lost_doubled_or_swapped_and_every_cut_is_refused(tmp_path, name):
    path, read = KINDS[name](tmp_path)
    data = path.read_bytes()
    counts = damaged(path, read, wrong_lines(data))
    assert counts.keys() == {"refused"}
    assert counts.total() > 3 * data.count(b"\n") - 12
    assert damaged(path, read, cuts(data, 300)).keys() == {"refused"}


def test_lines_of_an_ellipse_model(tmp_path):
    path, read = ellipses(tmp_path)
    assert damaged(path, read, wrong_lines(path.read_bytes()))["refused"] > 100  # a key may stand there twice
