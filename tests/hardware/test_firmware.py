"""The firmware's logic, compiled here, on small stand-ins for its chips: every command, error, fault and rule.

Who checks whom: its hash against `ScanSettings.canonical`, its rules of switching against `closure.check_switching`
(Python, by another hand), its checksum against `binascii`, its memory against the sanitizers of the compiler.
"""

import itertools
import random
import re
import shutil
import subprocess
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.emulated_reader import settings_of
from support.firmware_chips import StubChain, StubConverter

from coilarray.errors import HardwareError
from coilarray.hardware.emulator.board import VirtualClock
from coilarray.hardware.scan.settings import StateSettings
from coilarray.hardware.scan.wiring import load_wiring
from coilarray.hardware.wire.buses import BusFault, BusTimeout

from support.firmware_host import (  # isort: skip
    SKETCH, SUPPORT, Firmware, compiled, draft, intact, logic_sources, needs_compiler, seal,
)  # fmt: skip

pytestmark = needs_compiler

CODE = 0x17982F3
WORDS = f"{CODE:08X}"
SETTINGS = settings_of(load_wiring(), rcount=900, drives={f"coil{number}": 4 + number for number in range(1, 7)})
SAFE = SETTINGS.safe_words
LEASE = 10.0  # s


class Board:
    """Firmware, its stand-ins, and a computer that counts its commands."""

    def __init__(self, *, wired_back=False, devices=6, start=0.0, **options):
        self.clock = VirtualClock(start)
        self.converter = StubConverter(self.clock, lambda: CODE, conversion=SETTINGS.wait_us * 1e-6)
        self.chain = StubChain(self.clock, self.converter, devices, wired_back=wired_back)
        self.firmware = Firmware(self.converter, self.chain, self.clock, **options)
        self.number, self.begun = -1, b""
        self.before = self.lines(0.1)

    def lines(self, seconds):
        """Run and return the texts of the whole lines that came; every one of them must be intact."""
        *lines, self.begun = (self.begun + self.firmware.run(seconds)).split(b"\n")
        return [intact(line) for line in lines if line]

    def send(self, command):
        self.number = (self.number + 1) % 256
        self.firmware.feed(seal(f">{self.number:02X},{command}"))

    def reply(self, number, within=1.0):
        """The reply to a command, without its number; other lines are passed over."""
        end = self.clock.now() + within
        while self.clock.now() < end:
            for line in self.lines(1e-3):
                if line.startswith(f"<{number:02X},"):
                    return line[4:]
        raise AssertionError("no reply")

    def ask(self, command, within=1.0):
        self.send(command)
        return self.reply(self.number, within)

    def repeat(self, command):
        """Send a command once more with the number of the last one."""
        self.firmware.feed(seal(f">{self.number:02X},{command}"))

    def start(self, interval=0):
        """Start a stream with an interval in µs."""
        return self.ask(f"START,{interval:08X}")

    def scans(self, seconds):
        """Run and return the scans of a stream."""
        return [line for line in self.lines(seconds) if line.startswith("S")]

    def configure(self, plan=SETTINGS):
        return [self.ask(command) for command in draft(plan)]

    @property
    def mode(self):
        return self.ask("PING").split(",")[3]

    @property
    def resting(self):
        return self.converter.asleep and self.chain.words == SAFE


def configured(**options):
    board = Board(**options)
    assert board.configure()[-1] == f"OK,{SETTINGS.hash:04X}"
    return board


@pytest.fixture
def fresh():
    return Board()


@pytest.fixture
def board():
    return configured()


def scan_words(reply):
    """Words of a scan reply or line, after its sequence, time, hash and boot number."""
    return reply.split(",")[-6:]


def numbers_of(scans):
    return [int(line[1:9], 16) for line in scans]


def times_of(lines):
    """The board's time in µs in heartbeats or scans."""
    return [int(line.split(",")[1], 16) for line in lines]


def gaps(times):
    return [(later - earlier) % 2**32 for earlier, later in itertools.pairwise(times)]


def test_heartbeat_every_second_without_another_line(fresh):
    fresh.lines(0.5)
    fresh.ask("PING")  # puts it off by half a second
    times = times_of(line for line in fresh.lines(3.5) if line.startswith("H"))
    assert len(times) == 3
    assert times[0] > 1.5e6  # µs: 0.1 s of the start, 0.5 s, and a whole second after the reply
    # 1 s from line to line, and what one poll takes
    assert gaps(times) == pytest.approx([1e6, 1e6], abs=200)


def test_hello(fresh):
    assert fresh.ask("HELLO") == f"OK,2.0,coilarray-reader-2.0,{fresh.firmware.boot:08X},5449,3055,32,16,-"
    fresh.converter.fault = raising(BusFault("absent"))  # zeros of a converter that does not answer
    assert ",0000,0000," in fresh.ask("HELLO")
    assert Board(wired_back=True).ask("HELLO").endswith(",readback")


@pytest.mark.parametrize(("name", "options"), [
    ("six_coils", {"discard": 3}), ("six_coils_4", {"clock": 40e6, "external_clock": True}),
])  # fmt: skip
def test_configuration_reaches_the_chip_and_has_the_hash_of_the_settings(name, options):
    plan = settings_of(load_wiring(name), rcount=1234, drives=9, **options)
    board = Board(devices=len(plan.safe_words), safe_words=plan.safe_words)
    assert board.configure(plan)[-1] == f"OK,{plan.hash:04X}"
    for address, value in plan.registers:
        assert board.converter.registers[address] == (value | 0x2000 if address == 0x1A else value)
    assert (board.chain.words, board.mode) == (plan.safe_words, "i")


def test_scan(board):
    sequence, time, plan, boot, *words = board.ask("SCAN").removeprefix("OK,").split(",")
    assert (sequence, plan, boot) == ("00000000", f"{SETTINGS.hash:04X}", f"{board.firmware.boot:08X}")
    assert words == [WORDS] * 6
    assert int(time, 16) / 1e6 < board.clock.now()
    assert board.resting
    # its steps are those of the rules
    board.chain.history.clear()
    board.converter.log.clear()
    board.ask("SCAN")
    words = [words for words, _ in board.chain.history]
    assert words == [sent for state in SETTINGS.states for sent in (bytes(6), state.words, SAFE)]
    assert all(slept for _, slept in board.chain.history)
    config = dict(SETTINGS.registers)[0x1A]
    steps = []
    for state in SETTINGS.states:
        steps += [("write", 0x1E, SETTINGS.drive_register(state)), ("write", 0x1A, config), ("read", 0x18, 0x48)]
        steps += [("read", 0x00, CODE >> 16), ("read", 0x01, CODE & 0xFFFF), ("write", 0x1A, config | 0x2000)]
    steps.append(("read", 0x14, dict(SETTINGS.registers)[0x14]))
    assert board.converter.log == steps


def test_stream_keeps_its_interval_and_does_not_make_up_a_missed_one(board):
    board.start()
    assert numbers_of(board.scans(0.2))[0] == 0
    board.ask("STOP")
    board.start(50_000)
    scans = board.scans(2.0)
    assert numbers_of(scans)[0] == 0  # every stream counts from nought
    assert len(scans) == pytest.approx(40, abs=1)
    assert gaps(times_of(scans)) == pytest.approx([50_000] * (len(scans) - 1), abs=200)  # µs; a poll with one transfer
    board.clock.sleep(1.0)  # the board was held up
    numbers = numbers_of(board.scans(0.5))
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    assert len(numbers) <= 12  # 10 of half a second, the one under way, and the late one; not the 20 that were missed


@pytest.mark.parametrize("command", ["STOP", "HELLO"])
def test_stop_and_hello_rest_the_board_and_are_always_allowed(fresh, command):
    assert fresh.ask(command).startswith("OK")
    fresh.configure()
    fresh.start()
    assert fresh.ask(command).startswith("OK")
    assert (fresh.resting, fresh.mode) == (True, "i")
    assert not fresh.scans(2.0)


@pytest.mark.parametrize("command", ["STOP", "HELLO", "BEGIN,06,06"])
def test_a_scan_that_is_ended_gets_no_reply(board, command):
    board.send("SCAN")
    board.lines(0.004)
    board.send(command)
    replies = [line for line in board.lines(0.5) if line.startswith("<")]
    assert [reply[:3] for reply in replies] == [f"<{board.number:02X}"]
    assert board.resting


def test_ping_within_a_scan_and_the_scan_after_it(board):
    board.send("SCAN")
    board.lines(0.004)
    board.send("PING")
    ping, scan = (line for line in board.lines(0.5) if line.startswith("<"))
    assert ping.startswith(f"<{board.number:02X},OK,{board.firmware.boot:08X}")
    assert scan.startswith(f"<{board.number - 1:02X},OK,00000000,")
    board.repeat("PING")
    assert board.lines(0.1) == [ping]  # the repeat of the ping, not of the scan
    # a repeat gets the last reply and does nothing
    board.send("SCAN")
    reply = board.lines(0.2)
    log = list(board.converter.log)
    board.repeat("SCAN")
    assert (board.lines(0.2), board.converter.log) == (reply, log)


@pytest.mark.parametrize(("wired_back", "answer"), [(False, "none"), (True, "same")])
def test_peek_and_chain(wired_back, answer):
    board = configured(wired_back=wired_back)
    assert (board.ask("PEEK,7F"), board.ask("CHAIN")) == ("OK,3055", f"OK,{answer}")
    assert board.resting
    board.chain.corrupt = lambda words: bytes([words[0] ^ 0x80]) + words[1:]
    assert board.ask("CHAIN") == ("OK,differ" if wired_back else "OK,none")


def test_stream_ends_with_its_lease(board):
    board.start(1_000_000)
    started, lines = board.clock.now(), []
    for _ in range(12):
        board.firmware.feed(b">00,PING*0000\n")  # noise does not renew it
        lines += board.lines((LEASE + 2) / 12)
    (end,) = [line for line in lines if line.startswith("E")]
    assert end == f"E1,{SETTINGS.hash:04X},{board.firmware.boot:08X},lease ended"
    assert {line[0] + line[-2:] for line in lines[lines.index(end) + 1 :]} == {"H,i"}
    assert len([line for line in lines if line.startswith("S")]) == 10
    assert board.clock.now() - started == pytest.approx(LEASE + 2)
    assert (board.resting, board.mode) == (True, "i")


def raising(error, verb=None, register=None):
    """A fault of every transfer, or of those of one kind or register."""

    def fault(this_verb, this_register):
        if verb in (None, this_verb) and register in (None, this_register):
            raise error

    return fault


@pytest.mark.parametrize("command", [
    "WIRE,06,0000000000000000", "WIRE,00,00000000000000", "WIRE,00,000000000000000x", "SAFE,1111111111",
    "REG,09,0001", "REG,1A,3401", "REG,1A,1400", "REG,1B,820C", "REG,14,0002", "REG,14,1000", "REG,08,0004",
    "WAIT,00000002,00000001,00,00000000", "WAIT,00000001,03938701,00,00000000", "WAIT,00000000,00000001,10,00000000",
    "WAIT,00000000,00000001,0F,00000002", "STATE,06,111111111111,3000", "STATE,00,111111111111,3001", "COMMIT,1234G",
])  # fmt: skip
def test_bad_arguments_of_a_draft(fresh, command):
    fresh.ask("BEGIN,06,06")
    assert re.fullmatch(r"ERR,2,[^,*]{1,80}", fresh.ask(command))


@pytest.mark.parametrize("command", [
    "SCAN", "START,00000000", "PEEK,7F", "CHAIN", "REG,08,FFFF", "COMMIT,0000",
])  # fmt: skip
@pytest.mark.parametrize("running", ["SCAN", "START,00000000"])
def test_busy(board, command, running):
    board.send(running)
    board.lines(0.004)
    assert board.ask(command) == "ERR,9,a scan or a stream is under way"
    assert board.mode == ("s" if "START" in running else "i")


def test_another_hash_chip_or_no_draft(board):
    assert (board.ask("COMMIT,0000"), board.mode) == ("ERR,3,no draft", "i")
    for command in draft(SETTINGS)[:-1]:
        board.ask(command)
    assert board.ask("COMMIT,0000") == f"ERR,5,hash of the draft is {SETTINGS.hash:04X}"
    assert board.mode == "u"
    board.converter.registers[0x7F] = 0x3054
    assert (board.configure()[-1], board.mode) == ("ERR,8,5449 3054", "u")


@pytest.mark.parametrize("error", [BusFault("absent"), BusTimeout("stuck")])
@pytest.mark.parametrize("register", [0x7E, 0x7F, 0x1A, 0x08, 0x1B])
def test_bus_fault_in_commit(fresh, error, register):
    *commands, commit = draft(SETTINGS)
    assert {fresh.ask(command) for command in commands} == {"OK"}
    fresh.converter.fault = raising(error, register=register)
    cleared = fresh.converter.cleared
    assert fresh.ask(commit).startswith("ERR,6,")
    assert fresh.converter.cleared > cleared
    assert fresh.mode == "u"


def with_words(words, *, safe=SAFE, wiring=SETTINGS.wiring):
    return replace(SETTINGS, safe_words=safe, wiring=wiring, states=(StateSettings("state", words, 6),))


codes = st.sampled_from([*range(16), 0xFF])


@pytest.mark.slow
@settings(max_examples=120)
@given(st.data())
def test_rules_of_switching_agree_with_pythons(data):
    """Small wirings with few terminals, so that chance finds the legal cases too."""
    board = Board(devices=2, safe_words=b"\0\0")
    wiring = bytes(data.draw(st.lists(codes, min_size=16, max_size=16)))
    grounded = [sum((code & 3 == 0) << bit for bit, code in enumerate(wiring[half : half + 8])) for half in (0, 8)]
    safe = data.draw(st.sampled_from([bytes(grounded), bytes(2), b"\x11\x11"]))
    words = bytes(data.draw(st.lists(st.integers(0, 255).map(lambda a: a & 0x55), min_size=2, max_size=2)))
    plan = with_words(words, safe=safe, wiring=wiring)
    wanted = "OK,"
    try:
        plan.check_switching()
    except HardwareError:
        wanted = "ERR,4,"
    assert board.configure(plan)[-1].startswith(wanted)


def state_of(board):
    """Index of the state that is measured, or None."""
    return next((index for index, state in enumerate(SETTINGS.states) if board.chain.words == state.words), None)


def in_state(board, wanted, error, at=None):
    def fault(verb, register):
        if state_of(board) == wanted and at in (None, register):
            raise error

    return fault


@pytest.mark.parametrize("register", [0x1E, 0x1A, 0x18, 0x00, 0x01])
def test_any_transfer_of_a_state_may_fail(board, register):
    board.converter.fault = in_state(board, 4, BusFault("absent"), register)
    assert scan_words(board.ask("SCAN")) == [WORDS] * 4 + ["!1"] + [WORDS]
    assert board.resting or register == 0x1A
    board.converter.fault = lambda verb, at: None
    assert scan_words(board.ask("SCAN")) == [WORDS] * 6


def test_switches_wait_for_a_converter_that_did_not_go_to_sleep(board):
    def fault(verb, register):
        if state_of(board) == 1 and (verb, register) == ("write", 0x1A) and not board.converter.asleep:
            raise BusFault("absent")

    board.converter.fault = fault
    board.chain.history.clear()
    assert scan_words(board.ask("SCAN")) == [WORDS, "!1", *[WORDS] * 4]
    awake = [index for index, (_, slept) in enumerate(board.chain.history) if not slept]
    assert awake == [5]  # only the words that ground the coils after it


@pytest.mark.parametrize("error", [BusFault("absent"), BusTimeout("stuck")])
def test_three_bus_faults_running_end_the_stream(board, error):
    board.start()
    board.lines(0.1)
    cleared = board.converter.cleared
    board.converter.fault = in_state(board, 3, error)
    lines = board.lines(1.0)
    marked = [line for line in lines if line.startswith("S") and scan_words(line)[3] != WORDS]
    assert len(marked) == 3
    assert f"E3,{SETTINGS.hash:04X},{board.firmware.boot:08X},bus fault" in lines
    assert board.converter.cleared > cleared
    assert ("write", 0x1C, 0x8000) in board.converter.log
    assert (board.mode, board.resting) == ("u", True)


def test_no_result_in_time(board):
    board.converter.converts = False
    looks, woken = [], []

    def watch(verb, register):  # called at the end of a transfer
        if (verb, register) == ("read", 0x18):
            looks.append(board.clock.now() - woken[-1])
        if (verb, register) == ("write", 0x1A) and board.converter.asleep:
            woken.append(board.clock.now())

    board.converter.fault = watch
    assert scan_words(board.ask("SCAN")) == ["!3"] * 6
    each = len(looks) // 6
    assert looks == pytest.approx(looks[:each] * 6, abs=50e-6)
    # once after the wait, then every millisecond and at the time-out; a transfer takes 120 µs
    assert looks[0] == pytest.approx(SETTINGS.wait_us * 1e-6 + 120e-6, abs=50e-6)
    assert gaps(looks[: each - 1]) == pytest.approx([1e-3] * (each - 2), abs=50e-6)
    assert looks[each - 1] == pytest.approx(SETTINGS.timeout_us * 1e-6 + 120e-6, abs=50e-6)


def test_an_error_that_an_early_look_cleared_is_not_lost(board):
    board.converter.conversion += 3e-3
    read, told = board.converter.read, []

    def reading(register):
        value = read(register)
        if register == 0x18 and not told:
            told.append(value)
            return value | 0x0800  # watchdog, and no result yet
        return value

    board.converter.read = reading
    assert scan_words(board.ask("SCAN")) == [f"{WORDS}.0848", *[WORDS] * 5]


@pytest.mark.parametrize("streaming", [True, False])
def test_converter_that_was_reset(board, streaming):
    if streaming:
        board.start()
        board.lines(0.105)
        board.converter.reset()
        lines = board.lines(1.0)
        (bad,) = [line for line in lines if "!" in line]
        assert scan_words(bad) == ["!4"] * 6
        assert lines[lines.index(bad) + 1] == f"E2,{SETTINGS.hash:04X},{board.firmware.boot:08X},converter was reset"
    else:
        board.converter.reset()
        assert scan_words(board.ask("SCAN")) == ["!4"] * 6
    assert (board.mode, board.resting) == ("u", True)
    assert board.configure()[-1].startswith("OK")
    assert scan_words(board.ask("SCAN")) == [WORDS] * 6


@pytest.mark.parametrize("fault", [None, BusFault("cut off"), BusTimeout("cut off")])
def test_after_a_transfer_that_was_cut_off_every_register_is_verified(board, fault):
    """It may have changed any of them; the converter's data sheet says so of a stop that comes early."""
    count, sound = itertools.count(), dict(board.converter.registers)

    def cut_off(verb, register):
        if (verb, register) == ("read", 0x00) and next(count) == 2:
            board.converter.registers[0x0C] = 0x0100
            if fault:
                raise fault

    board.converter.fault = cut_off
    words = scan_words(board.ask("SCAN"))
    assert words == (["!4"] * 6 if fault else [WORDS] * 6)
    assert board.mode == ("u" if fault else "i")
    board.converter.registers = sound
    board.configure()
    count = itertools.count()
    board.converter.fault = raising(BusFault("once"), "read", 0x01)
    assert scan_words(board.ask("SCAN")) == ["!1"] * 6  # nothing was changed: no reset
    assert {("read", address) for address in (0x08, 0x0C, 0x10, 0x14, 0x19, 0x1A, 0x1B)} <= {
        step[:2] for step in board.converter.log[-20:]
    }


def test_switches_that_differ_end_the_stream():
    board = configured(wired_back=True)
    board.start()
    board.lines(0.1)
    wrong = SETTINGS.states[1].words
    board.chain.corrupt = lambda words: bytes([words[0] ^ 2]) + words[1:] if words == wrong else words
    lines = board.lines(1.0)
    marked = [line for line in lines if "!" in line]
    assert [scan_words(line) for line in marked] == [[WORDS, "!5", *[WORDS] * 4]] * 3
    assert f"E4,{SETTINGS.hash:04X},{board.firmware.boot:08X},switches differ" in lines
    assert board.mode == "u"
    # those that differ before a state are not joined to it
    board.chain.corrupt = lambda words: words
    assert board.configure()[-1].startswith("OK")
    board.chain.history.clear()
    board.chain.corrupt = lambda words: b"\xff" * 6
    assert scan_words(board.ask("SCAN")) == ["!5"] * 6
    assert not {state.words for state in SETTINGS.states} & {words for words, _ in board.chain.history}


@pytest.mark.parametrize(("data", "dropped"), [
    (b"\n\r\n\n", 0), (b">00,PING*0000\n", 1), (seal(">00,PING").lower(), 1), (b"\x00\xff\n\x80\n", 2),
    (b"a" * 513 + b"\n", 1), (b"a" * 100_000 + b"\n", 1), (seal("S00,PING"), 1), (seal(">G0,PING"), 1),
    (seal(">00"), 1), (seal(">00,STOP")[:-1] + b"\r\r\n", 1), (seal(">00,STOP").replace(b"*", b"-"), 1),
])  # fmt: skip
def test_lines_that_are_dropped(fresh, data, dropped):
    fresh.firmware.feed(data)
    assert (fresh.lines(0.1), fresh.ask("PING").split(",")[-1]) == ([], str(dropped))


def test_the_boards_time_wraps():
    board = configured(start=2**32 * 1e-6 - 1.0)
    board.start(100_000)
    times = times_of(board.scans(3.0))
    assert min(times) < 3e6 < max(times)
    assert gaps(times) == pytest.approx([1e5] * (len(times) - 1), abs=200)
    assert not [line for line in board.lines(4.0) if line.startswith("E")]
    assert [line for line in board.lines(LEASE) if line.startswith("E1")]


def damaged(chance, line):
    """A line with one fault of the kinds that a serial port makes."""
    where = chance.randrange(len(line))
    return chance.choice([
        line[:where] + line[where + 1 :],
        line[:where] + bytes([line[where] ^ 1 << chance.randrange(8)]) + line[where + 1 :],
        line[:where] + line[where : where + 1] + line[where:],
        line[:where],
        line[:where] + chance.randbytes(3) + line[where:],
    ])  # fmt: skip


def session_bytes(chance, count):
    """Commands of a session in random order, some damaged, some with random arguments."""
    others = ["HELLO", "SCAN", "START,00000000", "START,00010000", "STOP", "PING", "PEEK,18", "CHAIN"]
    commands = [*draft(SETTINGS), *others]
    number = 0
    for _ in range(count):
        number += chance.random() < 0.9
        if chance.random() < 0.3:
            for command in commands[:23]:
                number += 1
                yield seal(f">{number & 255:02X},{command}")
        command = chance.choice(commands)
        if chance.random() < 0.3:
            verb, *arguments = command.split(",")
            arguments = ["".join(chance.choice("0123456789ABCDEFx,") for _ in argument) for argument in arguments]
            command = ",".join([verb, *arguments])
        line = seal(f">{number & 255:02X},{command}")
        yield damaged(chance, line) if chance.random() < 0.3 else line


def test_words_that_are_not_legal_never_reach_the_switches():
    """Whatever the computer says: random commands with right checksums, half of them after a good configuration."""
    chance = random.Random(80)
    board = Board()
    for line in session_bytes(chance, 1000):
        board.firmware.feed(line)
        board.firmware.step(chance.choice([0.0, 0.001, 0.02]))
        board.firmware.take()
    legal = {SAFE, bytes(6), *(state.words for state in SETTINGS.states)}
    sent = {words for words, _ in board.chain.history}
    assert len(sent) > 3
    for words in sent - legal:  # of a state that chance made
        with_words(words).check_switching()
    assert all(slept for _, slept in board.chain.history)
    assert len(board.chain.history) > 1000


@pytest.mark.slow
def test_no_access_outside_its_memory(tmp_path):
    """The logic under the address and undefined-behaviour sanitizers, on chips of which one transfer in 20 fails."""
    sources = [str(path) for path in (*logic_sources(), SUPPORT / "fuzz.cpp")]
    try:
        program = compiled(tmp_path, "fuzz", "-fsanitize=address", "-no-pie", *sources)
    except subprocess.CalledProcessError:
        pytest.skip("the compiler has no address sanitizer")
    chance = random.Random(5)
    data = b"".join(session_bytes(chance, 3000)) + chance.randbytes(20_000)
    done = subprocess.run([str(program), "20"], check=False, input=data, capture_output=True, timeout=600)
    assert (done.returncode, done.stderr) == (0, b"")
    assert int(done.stdout) > 1000


def test_fits_the_microcontroller(tmp_path):
    """Compiled for its core as the Arduino core's own flags do, without the core: code and constants, and memory."""
    compiler, size = shutil.which("arm-none-eabi-g++"), shutil.which("arm-none-eabi-size")
    if not (compiler and size):
        pytest.skip("arm-none-eabi-g++ is not installed")
    include = {"input": b"#include <string.h>", "capture_output": True}
    if subprocess.run([compiler, "-x", "c++", "-E", "-"], check=False, **include).returncode:
        pytest.skip("arm-none-eabi-g++ has no C library")
    sketch = tmp_path / "sketch.cpp"
    sketch.write_text('#include "coilarray_reader.ino"\n')
    flags = ["-mcpu=cortex-m0", "-mthumb", "-Os", "-std=gnu++11", "-ffunction-sections", "-fdata-sections",
             "-fno-threadsafe-statics", "-fno-rtti", "-fno-exceptions", "-Wall", "-Wextra", "-Werror"]  # fmt: skip
    objects = []
    for source in (*sorted(SKETCH.glob("*.cpp")), sketch):
        objects.append(str(tmp_path / f"{source.stem}.o"))
        command = [compiler, *flags, f"-I{SKETCH}", f"-I{SUPPORT}", "-c", str(source), "-o", objects[-1]]
        subprocess.run(command, check=True)
    lines = subprocess.run([size, "-t", *objects], check=True, capture_output=True, text=True).stdout.splitlines()
    text, data, bss = map(int, lines[-1].split()[:3])
    assert text + data < 24 * 1024  # of 64 KB; the Arduino core takes some 10 KB
    assert data + bss < 8 * 1024  # of 16 KB
