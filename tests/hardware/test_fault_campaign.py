"""Ten thousand faults between the driver and the compiled firmware, through a pseudo-terminal.

No value is accepted that the converter did not give for this coil, nothing hangs longer than its time, every fault has
a name, and reading goes on.

| faults                                      | truth                                | name                        |
| ------------------------------------------- | ------------------------------------ | --------------------------- |
| of lines from the board                     | every result the chips ever gave     | counters of lines and scans |
| of commands and replies                     | the same                             | counter of repeats          |
| resets, unplugging, stalls, rates, versions | the same                             | classes of hardware.faults  |
| of converter and switches                   | the same                             | faults of samples, reasons  |
| of a switch that grounds another coil       | (no scan shows it)                   | findings of the self-test   |

That the campaign bites is shown by leaving out the checksum, and the check of the settings' hash: it then finds wrong
values. The numbers of the faults stand in `FAULTS`. Chips at register level are in test_fault_campaign_emulated.py.
"""

import functools
import itertools
import sys
import threading
from contextlib import closing, suppress

import pytest
from support.emulated_reader import quick_settings
from support.line_faults import DAMAGES, FaultyLine, at_another_rate
from support.scripted_board import sealed

if sys.platform == "win32":
    pytest.skip("no pseudo-terminals on Windows", allow_module_level=True)

from support.fault_bench import COILS, COMMAND, GAP, LONGEST, OPENING, SETTINGS, Bench, drained, lasting, meets
from support.firmware_host import needs_compiler
from support.patience import PATIENCE

from coilarray.errors import HardwareError
from coilarray.hardware.scan.reader import SampleFault
from coilarray.hardware.scan.readings import Reason
from coilarray.hardware.wire.protocol import lines as protocol_lines
from coilarray.hardware.wire.protocol import scan_stream as protocol_gate
from coilarray.hardware.wire.protocol.lines import command_line, draft_commands

from coilarray.hardware.wire.faults import (  # isort: skip
    BoardRestarted, BusFault, BusTimeout, DeviceLost, NoAnswer, NotABoard, SwitchFault, VersionMismatch,
)  # fmt: skip

pytest.importorskip("serial")
pytestmark = [needs_compiler, pytest.mark.usefixtures("patient_writing")]

REVERSED = quick_settings(coils=COILS[::-1])
FAULTS = {
    # lines of a stream
    "flipped": 700, "digit_changed": 700, "dropped": 700, "repeated": 700, "inserted": 700, "swapped": 700,
    "begun": 400, "ended": 500, "missing": 400, "twice": 500, "late": 500, "noisy": 500, "endless": 200,
    "other_rate": 300,
    # commands and replies
    "command": 50, "reply": 50,
    # converter and switches
    "result": 2000, "transfer": 300, "no result": 100, "brown-out": 20, "stuck switch": 48, "broken chain": 15,
    # board and port
    "restart": 30, "restart heard late": 8, "unplugged": 25, "stalled": 4, "lease": 10, "other version": 10,
    "opened at another rate": 3, "turned to another rate": 2, "other program": 20, "old session": 20,
}  # fmt: skip


def test_there_are_ten_thousand():
    assert sum(FAULTS.values()) >= 10_000


@pytest.fixture
def bench(request):
    bench = Bench(request.node.name)
    yield bench
    bench.close()
    assert bench.witness.wrong == []
    assert bench.witness.accepted > 0


ALTERNATING = (False, True)


def interrupted(bench, kind, *, streams=(True,)):
    """Yield, for each fault of a kind, its number and the call that is to meet it; afterwards reading must go on.

    The call fetches the rest of a stream that is under way, or is a single scan; `streams` says which, in turn.
    """
    for number in range(FAULTS[kind]):
        if not streams[number % len(streams)]:
            yield number, bench.reader.scan
            continue
        stream = bench.reader.scans()
        drained(itertools.islice(stream, bench.noise.randint(1, 4)), bench)
        yield number, functools.partial(drained, stream, bench)
    assert bench.goes_on()


LEAVES_BYTES = {"flipped", "digit_changed", "dropped", "repeated", "inserted", "swapped", "begun", "ended", "noisy"}


def spoil(bench, kind, count):
    """Fetch a stream over a line that damages `count` scans; return the numbers that were fetched, and the line."""
    line = FaultyLine(DAMAGES[kind], count, bench.noise)
    bench.host.to_computer = line
    fetched = []
    stream = bench.reader.scans()
    for scan in stream:
        bench.witness.look(scan)
        fetched.append(scan.sequence)
        if line.done >= count and scan.sequence > line.sound_until + 3:
            break
    stream.close()
    bench.host.to_computer = lambda data: data
    return fetched, line


@pytest.mark.slow
@pytest.mark.parametrize("kind", [kind for kind in FAULTS if kind in DAMAGES])
def test_lines_of_a_stream(bench, kind):
    fetched, line = spoil(bench, kind, FAULTS[kind])
    assert line.done == FAULTS[kind]
    absent = set(range(fetched[-1] + 1)) - set(fetched)
    assert fetched == sorted(set(fetched))
    assert line.lost <= absent <= line.lost | line.perhaps
    counts = bench.reader.counts
    assert counts.scans.lost == len(absent)
    assert counts.scans.repeated == (line.done if kind == "twice" else 0)
    assert counts.scans.stale == (line.done if kind == "late" else 0)
    assert counts.link.lines.too_long >= (line.done if kind == "endless" else 0)
    if kind in LEAVES_BYTES:
        # one fault in 65 536 leaves a line with the right checksum, which then says nothing that can be read
        assert counts.link.lines.dropped + counts.link.bad_messages >= line.done
    assert bench.goes_on()


@pytest.mark.slow
def test_lines_of_a_stream_without_the_checksum(monkeypatch):
    """The campaign bites: without the check it finds wrong values."""
    monkeypatch.setattr(protocol_lines, "intact", lambda line: line[-5:-4] == b"*")
    bench = Bench("no checksum")
    for kind in ("digit_changed", "swapped"):
        with suppress(HardwareError):
            spoil(bench, kind, 100)
        bench.renew()
    bench.close()
    assert len(bench.witness.wrong) > 50


def spoil_once(damage, noise, kind):
    """A hook that damages the next line of a kind and no other, of however many that come at once."""
    left = [1]

    def through(line):
        if left and line.startswith(kind):
            left.clear()
            return damage(line, noise).data
        return line

    return lambda data: b"".join(through(line) for line in data.splitlines(keepends=True))


@pytest.mark.slow
@pytest.mark.parametrize("direction", ["command", "reply"])
def test_commands(bench, direction):
    reader = bench.reader
    damages = [DAMAGES[kind] for kind in ("flipped", "dropped", "inserted", "begun", "missing")]
    for number in range(FAULTS[direction]):
        damage, before = damages[number % len(damages)], reader.counts.link.repeats
        following = (reader._session._number + 1) % 256  # not a repeat of the one before, which may be on its way
        sign, hook = (b">", "to_board") if direction == "command" else (b"<", "to_computer")
        with bench.host.paused():
            setattr(bench.host, hook, spoil_once(damage, bench.noise, b"%b%02X" % (sign, following)))
        with lasting(COMMAND):
            if number % 8:
                assert reader.peek(0x7E) == 0x5449
            else:
                bench.witness.look(reader.scan())
        assert reader.counts.link.repeats > before
    with bench.host.paused():
        bench.host.to_board = bench.host.to_computer = lambda data: data
    assert bench.goes_on()


@pytest.mark.slow
def test_settings_over_a_bad_line(bench):
    """Every third command and reply is damaged: the settings arrive whole all the same."""

    def now_and_then(damage):
        return lambda data: damage(data, bench.noise).data if bench.noise.random() < 0.15 and data != b"\n" else data

    bench.host.to_board = now_and_then(DAMAGES["flipped"])
    bench.host.to_computer = now_and_then(DAMAGES["dropped"])
    arrived = 0
    for _ in range(6):
        with suppress(NoAnswer), lasting(30 * COMMAND):
            bench.reader.configure(SETTINGS)
            arrived += 1
            bench.witness.look(bench.reader.scan())
    bench.host.to_board = bench.host.to_computer = lambda data: data
    assert arrived >= 3
    bench.reader.configure(SETTINGS)
    assert bench.goes_on()


RESULTS = [  # flags of the data, bits of STATUS
    (0x8000, 0x2000, Reason.UNDER_RANGE), (0x8000, 0x0000, Reason.UNDER_RANGE), (0x0000, 0x2000, Reason.UNDER_RANGE),
    (0x4000, 0x1000, Reason.OVER_RANGE), (0x2000, 0x0800, Reason.WATCHDOG), (0x0000, 0x0100, Reason.ZERO_COUNT),
    (0x1000, 0x0400, Reason.AMPLITUDE_HIGH), (0x1000, 0x0200, Reason.AMPLITUDE_LOW), (0x1000, 0, Reason.AMPLITUDE),
    (0x0000, 0x4000, Reason.ANOTHER_CHANNEL), (0x0000, 0x0080, Reason.IMPOSSIBLE),
]  # fmt: skip


@pytest.mark.slow
def test_results_with_errors(bench):
    played = dict.fromkeys((reason for _, _, reason in RESULTS), 0)

    def errors(state):
        if sum(played.values()) >= FAULTS["result"] or bench.noise.random() < 0.3:
            return None
        error = bench.noise.choice(RESULTS)
        played[error[2]] += 1
        return error

    bench.converter.errors = errors
    with closing(bench.reader.scans()) as stream:
        while sum(played.values()) < FAULTS["result"]:
            bench.witness.look(next(stream))
        for scan in itertools.islice(stream, 500):  # those that were under way: a busy system keeps many
            bench.witness.look(scan)
            if all(bench.witness.named[reason] >= count for reason, count in played.items()):
                break
    assert bench.reader.counts.scans.lost == 0
    for reason, count in played.items():
        assert bench.witness.named[reason] >= count > 0, reason
    assert bench.goes_on()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["transfer", "no result"])
def test_transfers_that_fail(bench, kind):
    """Single ones cost a sample; three running in a state end the stream, by name."""
    done = 0

    def fault(verb, register):
        nonlocal done
        if kind == "transfer" and done < FAULTS[kind] and bench.noise.random() < 0.03:
            done += 1
            raise bench.noise.choice([BusFault, BusTimeout])("played")
        starts = kind == "no result" and register == 0x18 and bench.converter.converts
        if starts and done < FAULTS[kind] and bench.noise.random() < 0.2:
            done += 1
            bench.converter.converts = False
        if (verb, register) == ("write", 0x1A):
            bench.converter.converts = True

    bench.converter.fault = fault
    while done < FAULTS[kind]:
        with suppress(BusFault):
            bench.reader.configure(SETTINGS)
            with closing(bench.reader.scans()) as stream:
                drained(itertools.takewhile(lambda _: done < FAULTS[kind], stream), bench)
                drained(itertools.islice(stream, 100), bench)  # those that were under way
    bench.converter.fault = lambda verb, register: None
    bench.converter.converts = True
    named = bench.witness.named
    if kind == "transfer":
        assert min(named[SampleFault.NOT_ACKNOWLEDGED], named[SampleFault.BUS_TIMEOUT]) > 20
    else:
        assert named[SampleFault.NO_RESULT] > FAULTS[kind] / 2  # the others were in a scan that takewhile has taken
    bench.reader.configure(SETTINGS)
    assert bench.goes_on()


@pytest.mark.slow
def test_a_dead_converter_ends_the_stream(bench):
    stream = bench.reader.scans()
    next(stream)
    bench.converter.fault = lambda verb, register: (_ for _ in ()).throw(BusFault("dead"))
    assert meets(BusFault, lambda: drained(stream, bench), 10 * LONGEST + COMMAND)
    assert meets(BusFault, lambda: bench.reader.configure(SETTINGS), OPENING)
    bench.converter.fault = lambda verb, register: None
    bench.reader.configure(SETTINGS)
    assert bench.goes_on()


@pytest.mark.slow
def test_brown_outs(bench):
    for _, call in interrupted(bench, "brown-out"):
        with bench.host.paused():
            at = bench.clock.now() + bench.noise.uniform(0, 5e-3)

        def fault(verb, register, at=at):
            if bench.clock.now() > at:
                bench.converter.fault = lambda verb, register: None
                bench.converter.reset()

        bench.converter.fault = fault
        assert meets(BoardRestarted, call, GAP + COMMAND, "converter was reset")
        bench.reader.configure(SETTINGS)


@pytest.mark.slow
def test_stuck_switches(bench):
    """Each switch, open and closed, as the chain tells and as it does not.

    A state whose own coil is joined otherwise gives no value. Where only another coil is left open or shorted there is
    one, and no scan tells: the self-test does, in test_fault_campaign_emulated.py.
    """
    unseen = 0
    faults = [((device, bit), value) for device in range(6) for bit in (0, 1, 4, 5) for value in (0, 1)]
    assert len(faults) == FAULTS["stuck switch"]
    for number, (place, value) in enumerate(faults):
        with bench.host.paused():
            bench.chain.stuck, bench.chain.in_register = {place: value}, bool(number % 2)
        with suppress(SwitchFault), lasting(GAP + COMMAND):
            for _ in range(2):
                scan = bench.reader.scan()
                bench.witness.look(scan)
                effective = [bench.chain._forced(state.words) for state in SETTINGS.states]
                wrong = {state for state, words in enumerate(effective) if words != SETTINGS.states[state].words}
                own = {state for state in wrong if bench.converter.state_of(effective[state]) != state}
                silent = {state for state, sample in enumerate(scan.samples) if sample.fault or sample.status != 0x48}
                if bench.chain.in_register:  # the read-back tells, of other coils too
                    assert wrong <= silent
                else:
                    assert own == silent
                    unseen += len(wrong - own)
        with bench.host.paused():
            bench.chain.stuck = {}
        bench.reader.configure(SETTINGS)
    assert bench.goes_on()
    assert min(bench.witness.named[Reason.WATCHDOG], unseen) > 0


def test_a_broken_chain_ends_the_stream(bench):
    for _, call in interrupted(bench, "broken chain"):
        with bench.host.paused():
            bench.chain.stuck = {(bench.noise.randrange(6), bench.noise.randrange(8)): bench.noise.randrange(2)}
            bench.chain.in_register = True
            if bench.chain._forced(SETTINGS.safe_words) == SETTINGS.safe_words:
                bench.chain.stuck = {(5, 0): 0}
        assert meets(SwitchFault, call, GAP + COMMAND)
        with bench.host.paused():
            bench.chain.stuck = {}
        bench.reader.configure(SETTINGS)
    assert bench.witness.named[SampleFault.SWITCHES_DIFFER] > FAULTS["broken chain"]


@pytest.mark.slow
def test_restarts(bench):
    for _, call in interrupted(bench, "restart"):
        bench.host.reset()
        assert meets(BoardRestarted, call, GAP + COMMAND, "has restarted")
        assert meets(BoardRestarted, bench.reader.scan, 0.0, "this session has ended")
        bench.renew()


@pytest.mark.slow
def test_restarts_that_nobody_heard(bench):
    """The first heartbeat is lost: the refused command, or the silence, brings it out."""
    for number, call in interrupted(bench, "restart heard late", streams=ALTERNATING):
        bench.host.to_computer = lambda line: b"" if line.startswith(b"H") else line
        bench.host.reset()
        if number % 2:
            assert meets((NoAnswer, BoardRestarted), call, GAP + COMMAND)
        assert meets(BoardRestarted, bench.reader.scan, 2 * COMMAND)
        bench.host.to_computer = lambda line: line
        bench.renew()


@pytest.mark.slow
def test_unplugging(bench):
    for number, call in interrupted(bench, "unplugged", streams=ALTERNATING):
        bench.host.unplug()
        assert meets(DeviceLost, call, GAP)
        assert meets(DeviceLost, bench.reader.scan, 0.0, "this session has ended")
        if number % 5 == 0:
            assert meets(HardwareError, bench.reader.reconnect, 0.0)
            again = threading.Timer(0.05, bench.host.replug)
            again.start()
            with lasting(1.0 + OPENING):
                bench.reader = bench.reader.reconnect(patience=PATIENCE)
                bench.reader.configure(SETTINGS)
        else:
            bench.host.replug()
            bench.renew()


@pytest.mark.slow
def test_stalls(bench):
    for _, call in interrupted(bench, "stalled", streams=ALTERNATING):
        bench.host.stall()
        assert meets(NoAnswer, call, GAP + 2 * COMMAND)
        bench.host.stall(False)
        assert bench.goes_on()


@pytest.mark.slow
def test_a_computer_that_is_away_too_long(bench):
    for _, call in interrupted(bench, "lease"):
        with bench.host.paused():
            bench.clock.sleep(11.0)
        assert meets(NoAnswer, call, GAP + COMMAND, "heard nothing")
        assert bench.goes_on()


@pytest.mark.slow
def test_other_versions(bench):
    for number in range(FAULTS["other version"]):
        version = b",OK,%d.%d," % (number % 2 * 3, number)

        def hook(line, version=version):
            return sealed(line[:-6].replace(b",OK,2.0,", version).decode()) if b",OK,2.0," in line else line

        bench.host.to_computer = hook
        assert meets(VersionMismatch, bench.reader.reconnect, OPENING, r"version \d\.\d+ of the protocol")
        bench.host.to_computer = lambda line: line
        bench.renew()
    assert bench.goes_on()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["opened at another rate", "turned to another rate"])
def test_other_rates(bench, kind):
    opened = kind == "opened at another rate"
    for number, rest in interrupted(bench, kind, streams=(not opened,)):
        ratio, call = [0.5, 12.0, 2.0][number], bench.reader.reconnect if opened else rest
        with bench.host.paused():
            bench.host.to_computer = lambda line, ratio=ratio: at_another_rate(line, ratio)
            bench.host.to_board = lambda data, ratio=ratio: at_another_rate(data, 1 / ratio)
            bench.clock.sleep(1.0 if opened else 0.0)  # a heartbeat is due
        assert meets((NotABoard, NoAnswer), call, OPENING if opened else GAP + COMMAND)
        with bench.host.paused():
            bench.host.to_computer = bench.host.to_board = lambda data: data
        bench.renew()


def by_another_program(bench, settings, *, start=False):
    """Commands that the board gets behind the driver's back."""
    commands = [*draft_commands(settings), *([("START", "00000000")] if start else [])]
    with bench.host.paused() as firmware:
        firmware.feed(command_line(0, "STOP"))
        for number, command in enumerate(commands):
            firmware.feed(command_line(number + 1, *command))
            firmware.run(0.02)


@pytest.mark.slow
def test_another_program(bench):
    for number, call in interrupted(bench, "other program", streams=ALTERNATING):
        by_another_program(bench, REVERSED, start=bool(number % 2))
        assert meets(BoardRestarted, call, GAP * (number % 2) + COMMAND, None if number % 2 else "with the settings")
        bench.reader.configure(SETTINGS)


def test_another_program_without_the_check_of_the_hash(monkeypatch):
    """The campaign bites: without the check it finds wrong values."""
    monkeypatch.setattr(protocol_gate, "same_settings", lambda scan, configuration: True)
    bench = Bench("no hash")
    for _ in range(5):
        by_another_program(bench, REVERSED)
        bench.witness.look(bench.reader.scan())
        bench.reader.configure(SETTINGS)
    bench.close()
    assert len(bench.witness.wrong) == 5 * 2  # the coil in the middle is the same


@pytest.mark.slow
def test_scans_of_an_old_session(bench):
    """Lines that were true once come again: of an earlier stream they are left out, of an earlier start they end it."""
    for number in range(FAULTS["old session"]):
        kept = []
        bench.host.to_computer = lambda line, kept=kept: (kept.append(line), line)[1]
        bench.scans(5)
        bench.host.to_computer = lambda line: line
        old = [line for line in kept if line.startswith(b"S")][-1]
        restarted = number % 4 == 0
        if restarted:
            bench.host.reset()
            bench.renew()
        stale = bench.reader.counts.scans.stale
        bench.host.to_computer = lambda line, old=old: line + (old if line.startswith(b"S") else b"")
        if restarted:
            assert meets(BoardRestarted, lambda: bench.scans(5), GAP + COMMAND)
        else:
            bench.scans(5)
            assert bench.reader.counts.scans.stale > stale
        bench.host.to_computer = lambda line: line
        if restarted:
            bench.renew()
    assert bench.goes_on()
