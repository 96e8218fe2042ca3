"""Curves over frequency, pitch and place: every number at its place, and zeros, peaks and widths where they are."""

import numpy as np
import pytest
import xarray as xr
from hypothesis import example, given
from hypothesis import strategies as st
from support import plot_results as results
from support.plot_results import curves, legend

from coilarray.compute.display_units import DisplayUnit
from coilarray.viz.plots import circuit as circuits
from coilarray.viz.plots import studies as sweeps
from coilarray.viz.plots.response import plot_bell_curve, plot_response, plot_target, response_figure, target_figure
from coilarray.viz.plots.style import axis_unit


@given(st.floats(1e-22, 1e22), st.sampled_from(["H", "ohm", "T", "Hz", "N"]))
def test_a_prefix_brings_the_largest_between_1_and_1000(largest, unit):
    shown = axis_unit([0.0, -largest, np.nan, largest / 7], unit)
    assert 1 - 1e-9 < shown.factor * largest < 1000  # rounding of a value just below a power of 1000
    assert shown.symbol.endswith("Ω" if unit == "ohm" else unit)


@pytest.mark.lowest
def test_units_of_axes_and_a_map_with_gaps():
    assert axis_unit([2.2e-6], "H") == DisplayUnit("µH", 1e6)
    assert axis_unit([2.2e-6], "1").symbol == "10⁻⁶"
    assert axis_unit([2.2], "1") == DisplayUnit()
    assert axis_unit([0.0, np.nan], "H") == DisplayUnit("H")
    response = results.response()
    response.delta[1, 2, 3] = np.nan
    ax = plot_response(response, "coil2", 1)
    ax.figure.draw_without_rendering()
    assert ax.child_axes[0].get_ylabel() == "δ (10⁻³)"


def test_curves_over_frequency_are_the_sweeps():
    sweep = results.frequency_sweep()
    ax = circuits.plot_frequency_sweep(sweep)
    assert list(curves(ax)) == ["a", "b"]
    for name, line in curves(ax).items():
        np.testing.assert_allclose(line.get_xdata(), sweep.frequency * 1e-6)
        np.testing.assert_allclose(line.get_ydata(), sweep.apparent_inductance.sel(state=name) * 1e6)
    assert ax.get_xscale() == "log"


def test_of_many_states_three_curves_stand_out_and_the_range_of_all_is_shown():
    """Sixteen curves of a pad's equal coils lie on each other: those of the least, middle and most inductance tell."""
    one = results.frequency_sweep().isel(state=0, drop=True)
    share = xr.DataArray(1 + np.random.default_rng(0).permutation(16) / 100, dims="state")
    many = (one * share).assign_coords(state=[f"coil{k + 1}" for k in range(16)])
    many.apparent_inductance.attrs = one.apparent_inductance.attrs
    ax = circuits.plot_frequency_sweep(many)
    order = share.values.argsort()
    assert set(curves(ax)) == {f"coil{order[k] + 1}" for k in (0, 8, 15)}
    (band,) = ax.collections
    assert band.get_label() == "all 16 states"
    drawn = band.get_paths()[0].vertices[:, 1]
    inductance = many.apparent_inductance * 1e6
    assert (drawn.min(), drawn.max()) == pytest.approx((float(inductance.min()), float(inductance.max())))


def test_resonances_are_marked_on_every_curve():
    sweep, states = results.frequency_sweep(), ("state", ["a", "b"])
    scan = xr.Dataset(
        {"frequency": ("state", [1e6, 2e6]), "state_self_resonance": ("state", [8e6, 9e7])}, {"state": states}
    )
    inductance, resistance, quality = circuits.frequency_figure(sweep, scan).axes
    for ax in (inductance, resistance, quality):
        drawn = [line for line in ax.lines if len(line.get_xdata())]  # the legend's own have no points
        dots = [line for line in drawn if line.get_marker() == "o"]
        assert [float(line.get_xdata()[0]) for line in dots] == [1.0, 2.0]  # MHz
        (own,) = [line for line in drawn if line.get_linestyle() == ":"]  # that of b lies beyond the sweep
        assert float(own.get_xdata()[0]) == 8.0
    labels = [text.get_text() for text in inductance.get_legend().get_texts()]
    assert labels == ["a", "b", "with the tank", "self-resonance"]
    assert (resistance.get_legend(), quality.get_legend()) == (None, None)  # they would say the same
    assert float(next(line for line in inductance.lines if line.get_marker() == "o").get_ydata()[0]) == 50.0  # µH
    assert resistance.get_yscale() == "log"
    far = circuits.plot_frequency_sweep(sweep, scan=scan.assign(state_self_resonance=9 * scan.state_self_resonance))
    labels = [text.get_text() for text in far.get_legend().get_texts()]
    assert labels == ["a", "b", "with the tank"]  # nothing is named that is not drawn


@pytest.mark.lowest
def test_a_pole_is_cut_off_at_four_times_the_first_value():
    sweep = results.frequency_sweep()
    assert circuits.plot_frequency_sweep(sweep).get_ylim() == (0, pytest.approx(4 * 60))  # µH
    assert circuits.plot_frequency_sweep(sweep, "quality_factor").get_ylim() == (0, pytest.approx(1.08 * 37.5))
    beyond = sweep.assign(apparent_inductance=sweep.apparent_inductance * xr.where(sweep.frequency > 1e6, -1, 1))
    line = next(iter(curves(circuits.plot_frequency_sweep(beyond)).values()))
    assert np.isnan(line.get_ydata()).sum() == 1  # no line through zero where the winding resonates by itself
    steep = sweep.copy(deep=True)
    steep.apparent_inductance[-1] *= 0.1  # of b from 760 to 90 µH; the axis ends at 240 µH
    line = curves(circuits.plot_frequency_sweep(steep))["b"]
    assert np.isnan(line.get_ydata()).sum() == 1  # nor one from above the axis to a sample on the steep fall
    flat = sweep.isel(state=[0])
    assert circuits.plot_frequency_sweep(flat).get_ylim() == (0, pytest.approx(1.08 * 50))
    single = circuits.plot_frequency_sweep(sweep.isel(frequency=[0]))
    assert all(line.get_marker() == "o" for line in single.lines)
    with pytest.raises(ValueError, match=r"quantity must be one of apparent_inductance, .*; got 'Q'"):
        circuits.plot_frequency_sweep(sweep, "Q")


def test_coupling_over_pitch_has_its_zeros():
    sweep = results.pitch_sweep()
    ax = sweeps.plot_coupling_sweep(sweep.isel({"array.pitch_mm": [2, 0, 3, 1]}))  # in any order
    assert legend(ax) == ["k[coil1,coil2] = 0 at 13.5 mm", "k[coil1,coil3]"]
    lines = curves(ax)
    for name in ("k[coil1,coil2]", "k[coil1,coil3]"):
        line = next(one for label, one in lines.items() if label.startswith(name))
        np.testing.assert_allclose(line.get_xdata(), [12, 13, 14, 15])
        np.testing.assert_allclose(line.get_ydata(), sweep[name])
    (zeros,) = [line for line in ax.lines if line.get_marker() == "o" and len(line.get_xdata())]
    np.testing.assert_allclose(zeros.get_xydata(), [[13.5, 0.0]])  # on a straight line, which a cubic keeps
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("array.pitch_mm (mm)", "coupling coefficient k")
    own = next(line for line in ax.lines if line.get_linestyle() == "--" and list(line.get_xdata()) == [13.28] * 2)
    assert own.get_color() != zeros.get_markeredgecolor()


@given(st.floats(-0.8, 0.8), st.booleans())
@example(-2.5697465692420288e-17, False)  # found from both sides of a sample
def test_zeros_of_a_smooth_function_are_found(root, falling):
    x = np.linspace(-1, 1, 41)
    values = (x - root) * (2 + np.cos(3 * x)) * (-1 if falling else 1)
    (found,) = sweeps.zero_crossings(x, values)
    # monotone cubics are off by less than the third power of the step of 0.05 where the function has no turning point
    assert found == pytest.approx(root, abs=0.05**3)


def test_zeros_are_between_samples_that_have_values():
    for none in ([1.0, np.nan, -1.0, -2.0], [1.0, 2.0, 1.0], [0.0], []):
        assert sweeps.zero_crossings(range(len(none)), none).size == 0
    assert sweeps.zero_crossings([0, 1, 2, 3, 4], [1.0, -1.0, np.nan, -1.0, 1.0]) == pytest.approx([0.5, 3.5])
    assert sweeps.zero_crossings([0, 1, 2], [1.0, 0.0, -1.0]) == pytest.approx([1.0])
    assert np.isfinite(sweeps.zero_crossings([0, 1, 2, 3], [1.0, 0.0, 0.0, 1.0])).all()


def test_a_bell_curve_has_the_peak_and_width_of_its_bell():
    """exp(−(x/w)²) is half at w √ln 2; cubic splines through samples w/4 apart are off by less than 1e-3 of that."""
    width = 8e-3
    response = results.response(width=width)
    ax = plot_bell_curve(response, "coil2")
    full = 2 * width * np.sqrt(np.log(2)) * 1e3
    assert legend(ax) == [f"{h} mm: {h} × 10⁻³, {full:.1f} mm" for h in ("0.5", "1")]
    bars = [line for line in ax.lines if line.get_marker() == "|"]
    for bar, peak in zip(bars, (0.5, 1.0), strict=True):
        left, right = bar.get_xdata()
        assert (left, right) == pytest.approx((6 - full / 2, 6 + full / 2), abs=1e-3 * full)
        np.testing.assert_allclose(bar.get_ydata(), peak / 2, rtol=1e-3)
    dots = [line for line in ax.lines if line.get_marker() == "."]
    for line, row in zip(dots, response.delta.sel(state="coil2").isel(y=3), strict=True):  # y = 0
        np.testing.assert_allclose(line.get_xdata(), response.x * 1e3)
        np.testing.assert_allclose(line.get_ydata(), row * 1e3)


def test_a_bell_curve_goes_along_y_around_gaps_and_over_the_middle():
    response = results.response(depths=[1e-3])
    along_y = plot_bell_curve(response, "coil1", along="y")
    assert along_y.get_xlabel() == "y (mm)"
    # y ends at ±6 mm, where δ is still above its half: there is no width
    assert legend(along_y) == ["1 mm: 1 × 10⁻³"]
    holed = response.copy(deep=True)
    holed.delta[0, 3, 4] = np.nan
    whole, around = (plot_bell_curve(one, "coil2") for one in (response, holed))
    assert legend(whole) == legend(around)
    nothing = response.copy(deep=True)
    nothing.delta[...] = np.nan
    with pytest.raises(ValueError, match="at least two x with a value; got 0"):
        plot_bell_curve(nothing)
    with pytest.raises(ValueError, match="at least two x with a value; got 1"):
        plot_bell_curve(response.isel(x=[3]))
    with pytest.raises(ValueError, match="state must be one of coil1, coil2; got 'coil9'"):
        plot_bell_curve(response, "coil9")
    shifted = results.response().assign_coords(x=results.response().x + 5e-3)
    shifted["coil_x"] = shifted.coil_x + 5e-3
    right = shifted.isel(x=slice(8, None))  # its middle is over coil2
    assert plot_bell_curve(right).get_title(loc="left") == "Bell curve of coil2"


def test_a_target_is_drawn_against_its_distance():
    drawn = curves(plot_target(results.target()))
    assert drawn["coil1"].get_xdata() == pytest.approx([1, 2, 4, 60])
    assert drawn["coil1"].get_ydata() == pytest.approx(0.1 * np.exp([-0.5, -1, -2, -30]))
    assert drawn["noise"].get_ydata() == pytest.approx([1e-5, 1e-5])
    of_L = plot_target(results.target(), "effective_inductance")
    assert (of_L.get_xscale(), of_L.get_ylabel()) == ("log", "effective inductance (µH)")
    assert curves(of_L)["coil2"].get_ydata()[-1] == pytest.approx(20.0)
    figure = target_figure(results.target())
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["coil1", "coil2", "noise", "without the target"]
    with pytest.raises(ValueError, match="quantity must be one of delta, effective_inductance"):
        plot_target(results.target(), "colour")
    wide = xr.concat([results.target().assign_coords(x=[x]) for x in (-1e-3, 1e-3)], "x", data_vars="minimal")
    assert response_figure(wide.isel(y=0).expand_dims("y")).axes[0].get_title(loc="left").endswith("1 mm away")
