"""A board in memory, on a clock of its own: as much of the protocol as the tests of the driver need, and its faults.

Written from `hardware/firmware/PROTOCOL.md` for these tests; the real firmware speaks in test_board_firmware.py.
"""

from collections import deque

from coilarray.hardware.board.microcontroller import MicrocontrollerReader
from coilarray.hardware.emulator.board import VirtualClock
from coilarray.hardware.scan.wiring import load_wiring
from coilarray.hardware.wire.buses import DeviceLost
from coilarray.hardware.wire.protocol import LinkTimes
from support.emulated_reader import settings_of

SCAN_TIME = 0.3  # s


def crc16(data):
    """CRC-16/CCITT-FALSE bit by bit, as the textbook has it."""
    register = 0xFFFF
    for byte in data:
        register ^= byte << 8
        for _ in range(8):
            register = (register << 1) ^ (0x1021 if register & 0x8000 else 0)
            register &= 0xFFFF
    return register


def sealed(text):
    return text.encode() + b"*%04X\n" % crc16(text.encode())


class ScriptedBoard:
    """The port and the board behind it.

    `sent` holds the commands as they came; `spoil` changes a line on its way to the computer; `deaf` hears nothing;
    `silent` says nothing by itself; `words` makes the words of a scan from its number.
    """

    name = "scripted"

    def __init__(self):
        self.clock = VirtualClock()
        self.boot, self.version = 0x1234ABCD, "2.0"
        self.greeting_tail = "5449,3055,64,8"
        self.skew = 0  # µs of the board's clock at the start of the computer's
        self.hash, self.draft, self.mode, self.sent, self.dropped = 0, [], "u", [], 0
        self.spoil, self.refuse = lambda line: line, {}  # verb: (code, text)
        self.deaf = self.silent = self.unplugged = self.closed = False
        self.words = lambda number: ["0179%04X" % (number & 0xFFFF)] * 6
        self.scan_time = SCAN_TIME
        self._coming = b""
        self._going = deque()  # (time from which on a byte is there, bytes)
        self._last = (None, b"")  # the command before, and its reply
        self._sequence = self._started = self._next_scan = self._interval = 0
        self._heard = self._spoken = 0.0

    # the port

    def read(self, seconds):
        self._plugged()
        end = self.clock.now() + seconds
        while True:
            self._live()
            data = self._arrived()
            if data or self.clock.now() >= end:
                return data
            self.clock.sleep(min(self._next_event(), end) - self.clock.now())

    def write(self, data):
        self._plugged()
        self._live()
        *lines, self._coming = (self._coming + data).split(b"\n")
        for line in lines:
            if line and not self.deaf:
                self._hear(line)

    def close(self):
        self.closed = True

    def _plugged(self):
        if self.unplugged or self.closed:
            raise DeviceLost(f"{self.name} is gone.")

    def _arrived(self):
        data = b""
        while self._going and self._going[0][0] <= self.clock.now() and len(data) < 2048:
            data += self._going.popleft()[1]
        return data

    def _next_event(self):
        events = [self._going[0][0]] if self._going else []
        if self.mode == "s":
            events.append(self._next_scan + self.scan_time)
        events.append(self._spoken + 1.0)
        return max(min(events), self.clock.now() + 1e-4)

    # the board

    def microseconds(self, time=None):
        return round((self.clock.now() if time is None else time) * 1e6 + self.skew) & 0xFFFFFFFF

    def restart(self):
        self.boot += 1
        self.hash, self.mode, self._last = 0, "u", (None, b"")
        self.skew = -round(self.clock.now() * 1e6)
        self.heartbeat()

    def say(self, text):
        self.send(sealed(text))

    def send(self, line):
        line = self.spoil(line)
        if not line:
            return
        self._spoken = self.clock.now()
        self._going.append((self.clock.now(), line))

    def heartbeat(self):
        self.say(f"H{self.boot:08X},{self.microseconds():08X},{self.hash:04X},{self.mode}")

    def scan_text(self, number, time):
        words = ",".join(self.words(number))
        return f"{number & 0xFFFFFFFF:08X},{self.microseconds(time):08X},{self.hash:04X},{self.boot:08X},{words}"

    def end(self, code, text=""):
        self.mode = "i"
        self.say(f"E{code},{self.hash:04X},{self.boot:08X},{text}")

    def _live(self):
        """What the board does by itself until now."""
        while self.mode == "s" and not self.silent and self._next_scan + self.scan_time <= self.clock.now():
            start = self._next_scan
            if self.clock.now() - self._heard > 10.0:
                self.end(1, "lease")
                break
            self.say("S" + self.scan_text(self._sequence, start))
            self._sequence += 1
            self._next_scan = start + max(self._interval, self.scan_time)
        if not self.silent and self.clock.now() - self._spoken >= 1.0:
            self.heartbeat()

    def _hear(self, line):
        text, star, _ = line.decode("latin-1").rpartition("*")
        if not star or sealed(text)[:-1] != line:
            self.dropped += 1
            return
        if line == self._last[0]:
            self.send(self._last[1])
            return
        number, verb, *arguments = text[1:].split(",")
        self.sent.append((verb, *arguments))
        self._heard = self.clock.now()
        reply = sealed(f"<{number},{self._do(verb, arguments)}")
        self._last = (line, reply)
        self.send(reply)

    def _do(self, verb, arguments):
        if verb in self.refuse:
            code, text = self.refuse[verb]
            return f"ERR,{code},{text}"
        known = getattr(self, f"_do_{verb.lower()}", None)
        return "ERR,1,unknown" if known is None else ",".join(("OK", *known(*arguments)))

    def _do_hello(self):
        self._do_stop()
        return [self.version, "scripted 1", f"{self.boot:08X}", self.greeting_tail, "-"]

    def _do_stop(self):
        self.mode = "i" if self.hash else "u"
        return []

    def _do_begin(self, *_):
        self._do_stop()
        self.draft = []
        return []

    def _do_any(self, *arguments):
        self.draft.append(arguments)
        return []

    _do_wire = _do_safe = _do_reg = _do_wait = _do_state = _do_any

    def _do_commit(self, value):
        self.hash, self.mode = int(value, 16), "i"
        return [value]

    def _do_scan(self):
        start = self.clock.now()
        self.clock.sleep(self.scan_time)
        return [self.scan_text(0, start)]

    def _do_start(self, interval):
        self.mode, self._sequence, self._interval = "s", 0, int(interval, 16) * 1e-6
        self._next_scan = self.clock.now()
        return []

    def _do_ping(self):
        return [f"{self.boot:08X}", f"{self.microseconds():08X}", self.mode, str(self.dropped)]

    def _do_peek(self, address):
        return [{"7E": "5449", "7F": "3055"}.get(address, "0000")]

    def _do_chain(self):
        return ["none"]


SETTINGS = settings_of(load_wiring("six_coils"))
LONGEST = 0.44  # s: a scan of these settings in which no state ever has a result
TIMES = LinkTimes()
REPLY = TIMES.attempts * (TIMES.reply + LONGEST)  # s until a command is given up


def opened(board):
    return MicrocontrollerReader(board, clock=board.clock)


def configured(board):
    reader = opened(board)
    reader.configure(SETTINGS)
    board.sent.clear()
    return reader


def verbs(board):
    return [verb for verb, *_ in board.sent]


class Lasting:
    """Time on the board's clock that a block takes."""

    def __init__(self, board):
        self.clock = board.clock

    def __enter__(self):
        self.start = self.clock.now()
        return self

    def __exit__(self, *_):
        self.seconds = self.clock.now() - self.start
