"""History and drawings of the live display: what was measured stands in them, in the same memory for an hour."""

import re

import numpy as np
import pytest

from coilarray.localize.inverse import Location, Mode
from coilarray.localize.presses import Press
from coilarray.viz.studio import live
from coilarray.viz.studio.live import BINS, SPANS, TAB, History, curves, press_row

NAMES = ("a", "b")


def filled(count, rate=100.0, values=lambda k: (0.0, 0.0)):
    history = History(NAMES)
    for k in range(count):
        history.add(k / rate, dict(zip(NAMES, values(k), strict=True)))
    return history


def points(path):
    """The points of a curve, in the unit of the drawing."""
    return np.array([[float(one) for one in pair.split(",")] for pair in re.findall(r"[-\d.]+,[-\d.]+", path)])


def test_every_span_has_the_least_and_largest_of_each_time():
    random = np.random.default_rng(0)
    values = random.standard_normal((30_00, 2)) * 1e-3
    history = filled(len(values), values=lambda k: values[k])
    time = np.arange(len(values)) / 100
    for span in SPANS:
        found, least, largest = history.values(span)
        edges = np.floor(time / (span / BINS)).astype(int)
        for k, at in enumerate(np.unique(edges)[-len(found) :]):
            np.testing.assert_array_equal(least[:, k], values[edges == at].min(axis=0))
            np.testing.assert_array_equal(largest[:, k], values[edges == at].max(axis=0))
            assert found[k] == pytest.approx((at + 0.5) * span / BINS)
        assert found[-1] - found[0] < span


def test_a_spike_of_one_scan_in_an_hour_is_shown():
    history = filled(3600, rate=1.0, values=lambda k: (1e-3 if k == 1000 else 0.0, 0.0))
    (curve, _) = curves(history, 3600.0, {}, ())["curves"]
    low, high = points(curve["path"])[:, 1].min(), points(curve["path"])[:, 1].max()
    assert low == pytest.approx(16.0 + 240.0 * 0.06 / 1.12, abs=0.2)  # the range is used: 6 % of it are left above
    assert high == pytest.approx(256.0 - 240.0 * 0.06 / 1.12, abs=0.2)  # and below


def test_the_oldest_scans_are_forgotten(monkeypatch):
    monkeypatch.setattr(live, "_KEPT", 40)  # values, of 20 scans
    history = filled(95, rate=10.0, values=lambda k: (1e-3 * k, 0.0))
    times, least, largest = history.values(10.0)
    assert (largest[0].max(), history.end) == pytest.approx((94e-3, 9.4))
    assert 10 <= len(times) <= 20
    assert least[0].min() == pytest.approx(1e-3 * (95 - len(times)))


def test_a_state_without_values_breaks_its_curve_and_a_pause_between_scans_does_not():
    history = filled(30, rate=10.0, values=lambda k: (None if 10 <= k < 20 else 1e-4, 1e-4))
    broken, whole = (one["path"] for one in curves(history, 10.0, {}, ())["curves"])
    assert (broken.count("M"), whole.count("M")) == (2, 1)
    assert len(points(whole)) >= 30


def test_noise_at_rest_does_not_fill_the_picture():
    history = filled(100, values=lambda k: (1e-8 * (-1) ** k, 0.0))
    drawing = curves(history, 10.0, {}, ())
    heights = points(drawing["curves"][0]["path"])[:, 1]
    assert np.ptp(heights) < 0.02 * drawing["axes"]["height"]


def test_ticks_and_presses_are_where_the_curves_are():
    history = filled(2000, values=lambda k: (1e-3 if 1500 <= k < 1700 else 0.0, 0.0))
    presses = [Press(1, 2.0, 3.0, 1e-3, None), Press(2, 15.0, 17.0, 1e-3, None), Press(3, 19.0, None, 1e-3, None)]
    drawing = curves(history, 10.0, {}, presses)
    assert [mark["number"] for mark in drawing["presses"]] == [2, 3]  # the first one has gone by
    raised = points(drawing["curves"][0]["path"])
    top = {tick["text"]: tick["at"] for tick in drawing["y"]}["1000"]
    pressed = raised[raised[:, 1] < top + 1]
    mark = drawing["presses"][0]
    assert mark["x"] == pytest.approx(pressed[:, 0].min(), abs=3.0)  # a thirtieth of a second is 1.5
    assert mark["x"] + mark["width"] == pytest.approx(pressed[:, 0].max(), abs=3.0)
    ticks = {tick["text"]: tick["at"] for tick in drawing["x"]}
    assert ticks["16"] == pytest.approx(64 + (TAB[0] - 74) * (16 - 9.99) / 10, abs=0.1)
    last = drawing["presses"][1]
    assert last["x"] + last["width"] == pytest.approx(TAB[0] - 10, abs=0.1)  # it lasts


def test_a_press_in_words():
    place = Mode(1e-3, -2e-3, 5e-4, np.diag((1e10, 4e10, 1e2)), 0.0)
    press = Press(4, 12.345, 13.0, -2.5e-4, Location("found", modes=(place,)))
    assert press_row(press) == ["4", "12.35", "0.65", "1.00 ± 0.01, −2.00 ± 0.01", "–", "−250"]
    assert press_row(Press(5, 1.0, None, 1e-4, None))[2:5] == ["…", "–", "–"]
