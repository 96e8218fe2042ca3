"""Chips that remember every result they ever gave out, so that nothing else can pass for one."""

from __future__ import annotations

from collections import Counter, namedtuple
from typing import NamedTuple

from coilarray.hardware.scan.reader import SampleFault
from coilarray.hardware.scan.readings import Reason, judge
from coilarray.hardware.scan.wiring import UNUSED
from support.firmware_chips import StubChain, StubConverter

SENSOR_GONE = (0xA000, 0x2A00)
"""Flags of the data and of STATUS where nothing oscillates: under-range, watchdog, amplitude low."""
WRAP = 2**32 * 1e-6  # s of the board's clock; a new session begins with whatever it shows
SCAN = 1.1  # s that a scan may take; the host's idle board lets up to a second pass within a command
_PINS = (1, 2)  # nets INA and INB of a switch's code, 4·terminal + net
_CODES = 0x1000000  # the smallest code; a quarter of the reference is at 0x4000000


Held = namedtuple("Held", "state time msb lsb status error")
"""One result: state it was measured in, its time, the registers, and the error that was played or None."""


class _Needed(NamedTuple):
    """Bits of the words that a coil needs to oscillate, and their values.

    They are its own, and all switches to the converter: another coil's would ground a pin. Whether another coil is
    grounded or open changes the value, but not that there is one; no scan can tell.
    """

    mask: bytes
    value: bytes

    @classmethod
    def by(cls, settings, words):
        codes = [settings.wiring[8 * device : 8 * device + 8] for device in range(len(words))]
        closed = {codes[d][bit] for d, word in enumerate(words) for bit in range(8) if word >> bit & 1}
        (coil,) = {code >> 3 for code in closed if code & 3 in _PINS}
        mask = bytes(
            sum(1 << bit for bit, code in enumerate(row) if code != UNUSED and (code >> 3 == coil or code & 3 in _PINS))
            for row in codes
        )
        return cls(mask, _masked(words, mask))

    def hold(self, words):
        return _masked(words, self.mask) == self.value


def _masked(words, mask):
    return bytes(word & own for word, own in zip(words, mask, strict=True))


class WitnessedConverter(StubConverter):
    """A converter no two results of which are alike: the code tells the state and counts.

    `errors` is called with the state for each result and returns (flags of the data, bits of STATUS, reason) or None.
    """

    def __init__(self, clock, settings, **options):
        super().__init__(clock, conversion=settings.wait_us * 1e-6, **options)
        self.states = [_Needed.by(settings, state.words) for state in settings.states]
        self.chain = None
        self.held: dict[int, Held] = {}
        self.errors = lambda state: None
        self._count = 0
        self._now = None  # the result that is ready

    def _value(self, register):
        if register == 0x18:
            if not super()._value(register):
                return 0
            self._convert()
            return self._now.status
        if register in (0x00, 0x01):
            return self._now.lsb if register else self._now.msb
        return super()._value(register)

    def state_of(self, words):
        """The state whose coil these words measure, whatever they do with the ends of the others; None for no state."""
        return next((index for index, needed in enumerate(self.states) if needed.hold(words)), None)

    def _convert(self):
        state = self.state_of(self.chain.effective)
        error = (*SENSOR_GONE, Reason.WATCHDOG) if state is None else self.errors(state)
        flags, bits, reason = error or (0, 0, None)
        self._count += 1
        code = 0 if flags & 0xA000 else _CODES + ((0 if state is None else state) << 20) + self._count
        now = self.clock.now()
        self._now = Held(-1 if state is None else state, now, flags | code >> 16, code & 0xFFFF, 0x48 | bits, reason)
        self.held[code] = self._now


class WitnessedChain(StubChain):
    """A chain whose switches may be stuck: `stuck` maps (device, bit) to 0 or 1, whatever the words say.

    Where `in_register`, the bit is stuck in the shift register too, so that reading it back tells.
    """

    def __init__(self, clock, converter, devices, *, wired_back=True):
        super().__init__(clock, converter, devices, wired_back=wired_back)
        self.stuck: dict[tuple[int, int], int] = {}
        self.in_register = False
        self.corrupt = lambda words: self._forced(words) if self.in_register else words
        converter.chain = self

    @property
    def effective(self):
        return self._forced(self.words)

    def _forced(self, words):
        forced = bytearray(words)
        for (device, bit), value in self.stuck.items():
            forced[device] = forced[device] & ~(1 << bit) | value << bit
        return bytes(forced)


class Witness:
    """Compares every value that was accepted with what the converter held.

    `wrong` lists those that it never held, or not in this state, form or time, or that were accepted before; `named`
    counts what was said of the others: reasons of bad and doubtful results, faults of samples.
    """

    def __init__(self, converter):
        self.converter = converter
        self.seen: set[int] = set()
        self.wrong: list[str] = []
        self.named: Counter[Reason | SampleFault] = Counter()

    @property
    def accepted(self):
        return len(self.seen)

    def look(self, scan):
        for state, sample in enumerate(scan.samples):
            if sample.fault is not SampleFault.NONE:
                self.named[sample.fault] += 1
                continue
            verdict, reasons = judge(sample)
            self.named.update(reasons)
            if verdict == "bad":
                continue
            code = (sample.msb & 0xFFF) << 16 | sample.lsb
            held = self.converter.held.get(code)
            true = (
                held is not None
                and (held.state, held.msb, held.lsb, held.status) == (state, sample.msb, sample.lsb, sample.status)
                and (held.time - scan.time) % WRAP <= SCAN
                and (held.error is None) == (verdict == "good")
                and code not in self.seen
            )
            self.seen.add(code)
            if not true:
                self.wrong.append(f"scan {scan.sequence} at {scan.time:.6f}, state {state}: {sample}, held {held}")
