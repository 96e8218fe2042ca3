"""The paper's campaign: its sequence, what it does when something fails, and the response that comes out of it."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from support.recorded_boards import (
    QuickWorld,
    configured,
    dent,
    quick_board,
    session_of,
    two_coil_wiring,
    two_coils,
)
from support.refusals import refused

from coilarray import load_design
from coilarray.circuit.converter_limits import drive_for
from coilarray.circuit.network import loaded_quality, resonate
from coilarray.errors import HardwareError, OutputError
from coilarray.hardware.board.connect import open_board
from coilarray.hardware.emulator.board import Conditions
from coilarray.hardware.record.campaign import TRIES, Campaign, EmulatedStage, design_campaign, run_campaign
from coilarray.hardware.record.recorded_response import recorded_response, recorded_series
from coilarray.hardware.record.recorder import open_recorder
from coilarray.hardware.record.recording import open_recording
from coilarray.hardware.scan.readings import RawSample, SampleFault
from coilarray.hardware.scan.settings import board_network, design_settings
from coilarray.hardware.wire.buses import BoardRestarted, BusFault, DeviceLost, NoAnswer
from coilarray.response.map import Imperfections, response_map

DESIGN = two_coils()
SMALL = Campaign(x=(-2e-3, 0.0, 3e-3), y=(0.0, 2e-3), depths=(0.5e-3, 1e-3))
CODE = 8e-8  # of L: a code is 4e-8 of a frequency near 2 MHz


def run(path, plan, board=None, *, settings=None, resume=False, reader=lambda own: own, stage=EmulatedStage, **more):
    """Run a campaign on a board that is closed afterwards; its reader and its stage may be wrapped."""
    with open_recorder(path, resume=resume) as recorder, board or quick_board() as board:
        recorder.start(session_of(board, settings or configured(board), DESIGN), plan.to_json())
        run_campaign(plan, reader(board.reader), stage(board.emulator), recorder, board.emulator.clock, **more)
    return path


def response_of(path, **options):
    with open_recording(path) as recording:
        recording.check()
        return recorded_response(recording, **options)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.sqlite"


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Response of the small campaign, measured without a fault."""
    return response_of(run(tmp_path_factory.mktemp("whole") / "run.sqlite", SMALL))


class Wrapped:
    """Passes everything on but what a test replaces."""

    def __init__(self, inner):
        self.inner = inner

    def __getattr__(self, name):
        return getattr(self.inner, name)


def test_the_papers_grid():
    with pytest.raises(HardwareError, match=r"has no \[indenter\] and \[indentation\]"):
        design_campaign(replace(DESIGN, indentation=None))
    campaign = design_campaign(load_design("gast2020"))
    # Table 1 and sect. 3.3: 2 mm apart over ±26 and ±6 mm, 1 mm deep, 1.5 mm/s, 0.5 s
    assert (len(campaign.x), len(campaign.y), campaign.depths) == (27, 7, (1e-3,))
    assert (campaign.speed, campaign.dwell, campaign.repeats, campaign.scans) == (1.5e-3, 0.5, 1, 1)
    assert campaign.size == len(campaign.places) == 189
    assert [place.number for place in campaign.places] == list(range(189))
    assert campaign.seconds == pytest.approx(189 * (4 / 3 + 0.5))  # pressing and lifting take 2/3 s each


@pytest.mark.parametrize(
    ("change", "message"),
    [
        *(({"x": wrong}, "x of a campaign must be finite and rising") for wrong in ((), (1e-3, 0.0))),
        ({"y": (float("nan"),)}, "y of a campaign must be finite and rising"),
        ({"y": (2.0,)}, "y of a campaign must be -1 to 1 m"),
        ({"depths": (0.0, 1e-3)}, "depths of a campaign must be positive"),
        *(({"depths": (wrong,)}, "depths of a campaign must be 0 to 0.1 m") for wrong in (-1e-3, 1.0)),
        *(({"repeats": wrong}, "repeats of a campaign must be 1 to 1000") for wrong in (0, True)),
        ({"scans": 1.5}, "scans of a campaign must be 1 to 1000"),
        ({"scans": "x" * 1000}, "scans of a campaign must be 1 to 1000; got 'x{79}….$"),
        ({"dwell": -1.0}, "dwell of a campaign must be 0 to 3600 s"),
        ({"dwell": float("nan")}, "dwell of a campaign must be"),
        *(({"speed": wrong}, "speed of a campaign must be positive") for wrong in (0.0, float("inf"))),
        ({"x": tuple(1e-6 * np.arange(2000)), "repeats": 1000}, "at most 1000000 positions; got 8000000"),
    ],
)
def test_wrong_plans(change, message):
    refused(HardwareError, message, replace, SMALL, **change)


def test_the_papers_sequence(path):
    """Baseline untouched, press at 1.5 mm/s, 0.5 s, peak at full depth, relax: by the board's clock."""
    board = quick_board()
    clock, log = board.emulator.clock, []

    class Logged(Wrapped):
        def __getattr__(self, name):
            call = getattr(self.inner, name)

            def logged(*given):
                start, depth = clock.now(), board.emulator.place().depth
                result = call(*given)
                log.append((name, start, clock.now(), depth))
                return result

            return logged if name in ("move", "indent", "relax", "scan") else call

    campaign = Campaign(x=(0.0,), y=(0.0,), depths=(1e-3,), scans=2)
    run(path, campaign, board, reader=Logged, stage=lambda emulator: Logged(EmulatedStage(emulator)))
    names, starts, ends, depths = zip(*log, strict=True)
    assert names == ("move", "scan", "scan", "indent", "scan", "scan", "relax")
    assert starts[4] - starts[3] == pytest.approx(1e-3 / 1.5e-3 + 0.5)
    assert ends[6] - starts[6] == pytest.approx(1e-3 / 1.5e-3)
    assert [depth for name, depth in zip(names, depths, strict=True) if name == "scan"] == [0.0, 0.0, 1e-3, 1e-3]
    with open_recording(path) as recording:
        scans = list(recording.scans())
    assert [(scan.stage, scan.depth) for scan in scans] == [("baseline", 0.0)] * 2 + [("peak", 1e-3)] * 2
    assert all(scan.place == campaign.places[0] for scan in scans)


def test_the_response_is_the_boards(path):
    reported = []
    response = response_of(run(path, SMALL, progress=lambda *now: reported.append(now)))
    assert reported == [(k, SMALL.size) for k in range(SMALL.size + 1)]
    assert response.delta.dims == ("depth", "y", "x", "state")
    coils, h = ("coil1", "coil2"), SMALL.depths
    expected = [[[[dent(coil, x, y, depth) for coil in coils] for x in SMALL.x] for y in SMALL.y] for depth in h]
    # the losses, which L alone does not know, have R²C/L = 9e-4 of δ
    np.testing.assert_allclose(response.delta, expected, rtol=1e-3, atol=2 * CODE)
    np.testing.assert_allclose(response.base_inductance, 52e-6, rtol=2e-3)
    assert not response.doubtful.any()
    assert response.coil_x.values.tolist() == pytest.approx([0.0, 13.28e-3])  # from the map's origin, coil1
    assert (response.attrs["emulated"], response.attrs["design_hash"]) == (1, DESIGN.digest)
    assert (response.attrs["origin"], response.attrs["indenter"]) == ("coil1", "hemisphere")


def test_repeats(path, tmp_path):
    """The deviation of a repeat is that of two readings of L, each twice as noisy as a frequency."""
    noise, repeats = 1e-6, 8
    campaign = Campaign(x=(0.0, 2e-3, 4e-3), y=(0.0, 2e-3), depths=(1e-3,), repeats=repeats)
    response = response_of(run(path, campaign, quick_board(noise=noise, seed=5)))
    assert response.delta_std.attrs["found_from"] == "repeats"
    expected = np.sqrt(2) * 2 * noise
    # 12 deviations of 7 degrees of freedom each: the mean square to sqrt(2/84) = 15 %, its root to 8 %; three times it
    assert np.sqrt((response.delta_std**2).mean()) == pytest.approx(expected, rel=0.24)
    true = response_of(run(tmp_path / "true.sqlite", replace(campaign, repeats=1)))
    error = (response.delta - true.delta).values
    assert np.abs(error).max() < 4 * expected / np.sqrt(repeats)  # 4 deviations of a mean, 12 of them
    assert np.sqrt((error**2).mean()) > 0.3 * expected / np.sqrt(repeats)  # the noise is there


@pytest.mark.slow
def test_deviation_from_baselines(path, tmp_path):
    """Without repeats the steps between baselines tell the noise; a drift of a hundred times that does not count."""
    noise = 1e-6
    campaign = Campaign(x=tuple(1e-3 * np.arange(20)), y=(0.0, 1e-3, 2e-3), depths=(1e-3,))
    # -13e-6/K of the clock over 0.02 K/s and 2.5 s a position: 6.5e-7 from one to the next, 4e-5 in all
    board = quick_board(noise=noise, seed=2, drift=0.02)
    response = response_of(run(path, campaign, board))
    assert response.delta_std.attrs["found_from"] == "baselines"
    # 59 steps give it to 13 %; the drift adds 10 %
    np.testing.assert_allclose(response.delta_std, np.sqrt(2) * 2 * noise, rtol=0.45)
    # and the drift does not enter δ: from baseline to peak it is 7e-7
    still = response_of(run(tmp_path / "still.sqlite", campaign))
    difference = (response.delta - still.delta).values
    assert np.abs(difference.mean()) < 2e-6


@pytest.mark.slow
def test_simulated_response_of_the_design(path):
    """The whole way: physics, chips, scans, file, δ; beside the map that is computed directly."""
    campaign = design_campaign(DESIGN, x=[-4e-3, 1e-3, 6e-3], y=[-3e-3], depths=[0.6e-3, 1e-3])
    wiring = two_coil_wiring()
    settings = design_settings(DESIGN, wiring)
    noise = 1e-7
    board = open_board(design=DESIGN, wiring=wiring, seed=4, conditions=Conditions(noise=noise))
    board.reader.configure(settings)
    measured = response_of(run(path, campaign, board, settings=settings))
    network = board_network(DESIGN)
    computed = response_map(
        DESIGN, depths=campaign.depths, x=campaign.x, y=campaign.y, imperfections=Imperfections(network=network)
    )
    for name in ("depth", "y", "x", "state", "coil"):
        assert measured[name].values.tolist() == computed[name].values.tolist()
    np.testing.assert_allclose(measured.coil_x, computed.coil_x)
    # 4.5 deviations of noise (12 values), the rounding of two codes, and 3e-6 of the emulator's table
    allowed = 4.5 * np.sqrt(2) * 2 * noise + 2 * CODE + 3e-6
    np.testing.assert_allclose(measured.delta, computed.delta, atol=allowed, rtol=0)
    assert np.abs(computed.delta).max() > 100 * allowed
    # the clock is the nominal one; the losses of the tank are in both
    np.testing.assert_allclose(measured.base_inductance, computed.base_inductance, rtol=1e-6)
    for name in ("indenter", "base", "origin", "design", "design_hash"):
        assert measured.attrs[name] == computed.attrs[name]
    assert not measured.doubtful.any()  # the drive currents fit the coils


def scanning(scan):
    """A reader whose scans are made by a function of the reader that it wraps and of their number, from 1."""

    class Reader(Wrapped):
        count = 0

        def scan(self):
            self.count += 1
            return scan(self.inner, self.count)

    return Reader


def raising(error):
    raise error


def stopped_after(scans):
    """A reader that is lost after some scans."""
    gone = DeviceLost("the port is gone.")
    return scanning(lambda reader, count: reader.scan() if count <= scans else raising(gone))


@pytest.mark.parametrize("scans", [0, 7, 23])
def test_resume_measures_what_is_missing(path, whole, scans):
    refused(DeviceLost, "the port is gone", run, path, SMALL, reader=stopped_after(scans))
    reported = []
    run(path, SMALL, resume=True, progress=lambda *now: reported.append(now))
    assert reported[0] == (scans // 2, SMALL.size)  # two scans a position: what was finished is not measured again
    xr.testing.assert_equal(response_of(path), whole)
    with open_recording(path) as recording:
        assert recording.count() == 2 * SMALL.size + scans % 2
        assert recorded_series(recording).sizes["scan"] == recording.count()  # nothing is thrown away
    run(path, SMALL, resume=True, reader=stopped_after(0))  # nothing is left to be measured


def test_not_whole(path, tmp_path):
    refused(DeviceLost, "the port is gone", run, path, SMALL, reader=stopped_after(9))
    refused(HardwareError, "is not complete: 8 of 12 positions are not measured yet", response_of, path)
    part = response_of(path, partial=True)
    assert int(part.delta.notnull().all("state").sum()) == 4
    assert np.isfinite(part.base_inductance).all()
    # the first repeat is enough
    twice = replace(SMALL, repeats=2)
    path = tmp_path / "twice.sqlite"
    refused(DeviceLost, "the port is gone", run, path, twice, reader=stopped_after(2 * SMALL.size + 4))
    response = response_of(path)
    assert response.delta.notnull().all()
    assert int(response.delta_std.notnull().all("state").sum()) == 2


def failing(name, times):
    """A reader in which the third scan and those after it fail in a way."""
    return scanning(lambda reader, count: FAULTS[name](reader) if 3 <= count < 3 + times else reader.scan())


def dead_sample(reader):
    scan = reader.scan()
    return replace(scan, samples=(scan.samples[0], RawSample(0, 0, 0, SampleFault.NO_RESULT)))


def restarted(reader):
    """The microcontroller restarts: its next session has another number."""
    reader._identity = replace(reader._identity, boot=reader._identity.boot ^ 1)
    return reader.scan()


FAULTS = {
    "no answer": lambda reader: raising(NoAnswer("the board did not answer.")),
    "bus": lambda reader: raising(BusFault("the converter did not answer.")),
    "dead sample": dead_sample,
    "restart": restarted,
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_failed_position_is_measured_again(path, whole, name):
    run(path, SMALL, reader=failing(name, TRIES - 1))
    xr.testing.assert_equal(response_of(path), whole)
    with open_recording(path) as recording:
        assert len(recording.sessions) == (TRIES if name == "restart" else 1)
        assert len(recording.positions()) == SMALL.size


class Over(Wrapped):
    """A session that is over at a scan, because the board restarted: nothing of it answers any more."""

    def __init__(self, inner, at):
        super().__init__(inner)
        self.at, self.count = at, 0

    def __getattr__(self, name):
        self.count += name == "scan"
        if name in ("scan", "configure") and self.count >= self.at:
            raise BoardRestarted("this session has ended: the board restarted.")
        return super().__getattr__(name)


def run_reconnecting(path, first, again=None):
    """Run a campaign whose reader is over at a scan; `again` gives the scans at which those after it are."""
    made = []
    with open_recorder(path) as recorder, quick_board() as board:
        recorder.start(session_of(board, configured(board), DESIGN), SMALL.to_json())

        def reconnect():
            board.reader._identity = replace(board.reader._identity, boot=len(made))
            made.append(Over(board.reader, again[len(made)]))
            return made[-1]

        reader, stage = Over(board.reader, first), EmulatedStage(board.emulator)
        options = {} if again is None else {"reconnect": reconnect}
        run_campaign(SMALL, reader, stage, recorder, board.emulator.clock, **options)
    return made


def test_a_board_that_restarted_is_opened_again(path, whole):
    assert len(run_reconnecting(path, 6, [1, 3, 10, 10**9])) == 4  # at once again, then in two later positions
    xr.testing.assert_equal(response_of(path), whole)
    with open_recording(path) as recording:
        assert [one.identity.boot for one in recording.sessions[1:]] == [0, 1, 2, 3]
        assert len(recording.positions()) == SMALL.size


def test_a_board_that_restarts_for_ever_or_cannot_be_opened_again(path, tmp_path):
    ever = tmp_path / "ever.sqlite"
    refused(HardwareError, f"a scan failed {TRIES} times: .*restarted", run_reconnecting, ever, 6, [1] * 100)
    refused(BoardRestarted, "the board restarted; run again to continue the recording", run_reconnecting, path, 6)
    run(path, SMALL, resume=True)


def test_a_dead_coil(path):
    world = QuickWorld()
    world.dead = {"coil2"}
    refused(HardwareError, r"coil2 gave no value: .*does not oscillate", run, path, SMALL, quick_board(world=world))


@pytest.mark.parametrize("error", [KeyboardInterrupt, SystemExit, OutputError("full"), DeviceLost("gone")])
def test_the_indenter_is_lifted_on_every_way_out(path, error):
    board = quick_board()

    def pressed():
        return board.emulator.place().depth > 0

    with pytest.raises(error if isinstance(error, type) else type(error)):
        run(path, SMALL, board, reader=scanning(lambda reader, _: raising(error) if pressed() else reader.scan()))
    assert not pressed()


def test_places_out_of_reach_are_refused_before_anything_moves(path):
    class Stage(EmulatedStage):
        def check(self, places):
            raise HardwareError("out of reach")

        def move(self, x, y):
            pytest.fail("moved")

    refused(HardwareError, "out of reach", run, path, SMALL, stage=Stage)


@pytest.mark.slow
def test_settings_fit_the_coils():
    settings = design_settings(DESIGN, two_coil_wiring())
    network = board_network(DESIGN)
    for state, plan in zip(settings.states, DESIGN.plan, strict=True):
        result = resonate(network, plan)
        assert state.drive == drive_for(result.parallel_resistance).code
        # settling by the data sheet: Q periods of the sensor in 16 periods of the reference each
        periods = loaded_quality(network, result) * settings.reference / (16 * result.frequency)
        assert periods <= settings.settle_count <= 2 * periods
    assert design_settings(DESIGN, two_coil_wiring(), drives=3).states[1].drive == 3
    mixed = design_settings(DESIGN, two_coil_wiring(), drives={"coil2": 3}).states
    assert (mixed[0].drive, mixed[1].drive) == (settings.states[0].drive, 3)
    assert [state.name for state in design_settings(DESIGN, two_coil_wiring(), states=["coil2"]).states] == ["coil2"]
