"""``coilarray impedance --noise`` and ``coilarray board info --noise``: budget and board."""

import numpy as np
import pytest
from support.command_line import runner, successes
from support.recorded_boards import stream_file

from coilarray import load_design, noise_budget, response_map
from coilarray.localize.forward import forward_model
from coilarray.localize.identifiability import identifiability

pytestmark = pytest.mark.slow

budget_run, budget_refused = runner("impedance", "--noise")
_, refused = runner("board", "info")
good, budget_of = successes("impedance", "--noise")
_, noise_of = successes("board", "info")
record, _ = successes("board", "measure")


def measured(capsys, folder, design, seconds, *options, shown=()):
    """Record an emulated board at rest for a time in s, and return the noise of the recording."""
    path = folder / "rest.sqlite"
    path.unlink(missing_ok=True)
    record(capsys, design, "--seconds", seconds, "--out", path, *options)
    return noise_of(capsys, path, "--noise", *shown)


def test_the_budget_is_that_of_the_design_in_words_and_numbers(capsys):
    reported = budget_of(capsys, "starter")
    expected = noise_budget(load_design("starter"))
    assert reported["states"] == ["coil1", "coil2", "coil3"]
    assert reported["sigma"] == pytest.approx(expected.sigma.tolist())
    assert [cause["cause"] for cause in reported["causes"]] == [cause.name for cause in expected.causes]
    assert all(cause["source"] for cause in reported["causes"])
    text = good(capsys, "starter")
    assert "assumed, not verified on a board: resolution of the converter" in text
    assert "plain counting would resolve 0.95·10⁻⁶ of f" in text


def test_a_reference_coil_takes_the_drift_out_of_the_budget(capsys):
    alone, less = budget_of(capsys, "starter"), budget_of(capsys, "starter", "--reference", "coil3")
    assert less["states"] == ["coil1", "coil2"]
    assert max(less["drift_per_K"]) < 0.1 * min(alone["drift_per_K"])
    assert less["scan_noise"] == pytest.approx(np.sqrt(2) * np.array(alone["scan_noise"][:2]), rel=0.01)
    assert "a reference coil must be one of" in budget_refused(capsys, "starter", "--reference", "coil9")


def test_the_emulated_board_has_the_noise_of_its_budget(capsys, tmp_path):
    """400 scans tell a standard deviation to 4 %, of three coils the outermost to 10 %."""
    picture = tmp_path / "noise.svg"
    out = measured(capsys, tmp_path, "starter", 60, "--emulate", "seed=3", shown=("--plot", picture))
    assert out["emulated"] is True
    for row in out["stability"]:
        assert row["scan_noise"] == pytest.approx(row["expected"], rel=0.1)
        assert abs(row["drift_1_per_s"]) < 1e-8
    assert picture.read_text().startswith("<?xml")
    first = [row for row in out["allan"] if row["state"] == "coil1"]
    taus = [row["tau_s"] for row in first]
    assert taus == pytest.approx(taus[0] * 2.0 ** np.arange(len(taus)))
    assert first[4]["deviation"] == pytest.approx(first[0]["deviation"] / 4, rel=0.4)  # white


def test_faster_scans_have_more_noise_and_so_has_their_budget(capsys, tmp_path):
    """At twelve times the rate of full resolution: of 400 scans each, told to 4 %."""
    out = measured(capsys, tmp_path, "starter", 5, "--rate", "80", "--emulate", "seed=3")
    slow = budget_of(capsys, "starter")["scan_noise"]
    for row, full in zip(out["stability"], slow, strict=True):
        assert row["scan_noise"] == pytest.approx(row["expected"], rel=0.12)
        assert row["scan_noise"] > 2 * full


def test_drift_of_clock_and_board_is_the_budgets_and_goes_with_a_reference_coil(capsys, tmp_path):
    """36 K/h; the emulator's clock and copper drift, nothing else. Its network is solved anew at every temperature."""
    warming = ("--emulate", "drift=0.01", "--emulate", "noise=1e-9")
    causes = {cause["cause"]: cause["drift_per_K"] for cause in budget_of(capsys, "starter")["causes"]}
    expected = [
        0.01 * (clock + copper)
        for clock, copper in zip(causes["clock with temperature"], causes["resistance of the copper"], strict=True)
    ]
    alone = measured(capsys, tmp_path, "starter", 40, *warming)["stability"]
    # the budget's copper alone leaves out the neighbours' part of the losses, a tenth of its 6 ppm/K
    assert [row["drift_1_per_s"] for row in alone] == pytest.approx(expected, rel=0.05)
    less = noise_of(capsys, tmp_path / "rest.sqlite", "--noise", "--reference", "coil3")["stability"]
    assert [row["state"] for row in less] == ["coil1", "coil2"]
    # what stays is what the coils' losses differ by: one in a row has two neighbours, one at its end has one
    assert max(abs(row["drift_1_per_s"]) for row in less) < 0.1 * abs(expected[0])


def test_a_recording_of_any_design_is_read(capsys, tmp_path):
    run = stream_file(tmp_path / "run.sqlite", 60, noise=5e-7)
    out = noise_of(capsys, run, "--noise")
    assert (out["source"], out["scans"], out["design"]) == (str(run), 60, "two_coils")
    # twice that of the frequency; 60 scans tell it to 11 %
    assert [row["scan_noise"] for row in out["stability"]] == pytest.approx([1e-6, 1e-6], rel=0.35)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["no_such.sqlite", "--noise"], "no_such.sqlite"),
        (["run.sqlite", "--noise", "--out", "c.nc"], "--noise cannot be given with --out"),
        (["run.sqlite", "--reference", "coil1"], "--reference and --plot are for --noise"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(capsys, arguments, message):
    assert message in refused(capsys, *arguments)


def test_every_consumer_has_the_same_number():
    """The response carries it, the model takes it, the bound is proportional to it."""
    design = load_design("starter")
    budget = noise_budget(design)
    grid = np.linspace(-15e-3, 15e-3, 5)
    response = response_map(design, depths=[0.2e-3, 0.4e-3], x=grid, y=grid)
    assert response.attrs["noise"] == pytest.approx(budget.independent.max())
    model = forward_model(response)
    np.testing.assert_allclose(np.hypot(budget.independent, model.common_noise), budget.sigma, rtol=1e-9)
    own, tenfold = (identifiability(model, 0.3e-3, noise=times * model.noise) for times in (1, 10))
    assert identifiability(model, 0.3e-3).attrs["noise"] == [model.noise] * 3
    known = np.isfinite(own.sigma_x.values)
    # 1e-4: where one direction is hardly known, the inverse loses digits
    assert tenfold.sigma_x.values[known] / own.sigma_x.values[known] == pytest.approx(10.0, rel=1e-4)
