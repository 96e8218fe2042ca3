"""Self-test of a board's switches and coils, and the drive currents of its coils.

The self-test needs scans only. The switches show only in whether the converter oscillates, and by how much the
frequency of a coil rises when another coil is shorted. Both are predicted from the wiring for every
single fault. A fault whose prediction equals the measurement is a finding. Until the test has
passed, the assignment of bits to switches is an assumption.
"""

from __future__ import annotations

import contextlib
import functools
import itertools
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

from coilarray.compute.threads import Progress
from coilarray.design.scan_states import Passive, ScanState
from coilarray.errors import HardwareError
from coilarray.hardware.board.direct import BUS_FAULTS
from coilarray.hardware.chips.ldc1614 import register
from coilarray.hardware.scan.readings import RawSample, RawScan, Reader, Reason, SampleFault, judge, read_scan
from coilarray.hardware.scan.settings import LARGEST_DRIVE, ScanSettings, StateSettings
from coilarray.hardware.scan.wiring import SWITCHES, Closure, SwitchTable, Wiring, closed_switches, switch_table
from coilarray.hardware.wire.buses import BusFault, SwitchFault

_INIT = register("DRIVE_CURRENT0").field("INIT_IDRIVE0")
_RCOUNT = 0x1000  # conversions of 3 ms


@dataclass(frozen=True)
class FoundDrive:
    """Drive current of a coil."""

    code: int  # IDRIVE, 0 to 31
    proposed: int  # INIT_IDRIVE, found by the converter itself, 0 if it gave no result
    reasons: tuple[Reason, ...]  # warnings about the amplitude that remain with this code


def find_drives(reader: Reader, settings: ScanSettings) -> Mapping[str, FoundDrive]:
    """Find the drive current of every state.

    No object may be near the sensor that is absent during the measurement. The procedure of the
    data sheet starts at INIT_IDRIVE of the automatic amplitude. The code is changed by one until
    neither a low nor a high amplitude is reported, or is the largest that is not too high.
    """
    found = {state.name: _find(reader, settings, state) for state in settings.states}
    reader.rest()
    return found


def _find(reader: Reader, settings: ScanSettings, state: StateSettings) -> FoundDrive:
    proposal = _sample(reader, replace(settings, automatic_drive=True), state, 0)
    proposed = ((proposal.drive or 0) & _INIT.mask) >> _INIT.lsb

    def reasons_of(code: int) -> tuple[Reason, ...]:
        return judge(_sample(reader, settings, state, code), state.channel)[1]

    code, reasons = proposed, reasons_of(proposed)
    if Reason.AMPLITUDE_HIGH in reasons:
        while Reason.AMPLITUDE_HIGH in reasons and code > 0:
            code -= 1
            reasons = reasons_of(code)
    else:
        while reasons and code < LARGEST_DRIVE:
            higher = reasons_of(code + 1)
            if Reason.AMPLITUDE_HIGH in higher:
                break
            code, reasons = code + 1, higher
    if not set(reasons) <= {Reason.AMPLITUDE_LOW, Reason.AMPLITUDE_HIGH}:
        raise HardwareError(f"{state.name} does not oscillate with any drive current: {', '.join(reasons)}.")
    return FoundDrive(code, proposed, reasons)


def _sample(reader: Reader, settings: ScanSettings, state: StateSettings, code: int) -> RawSample:
    """Measure a state, or all wired channels, with a current."""
    changed = replace(state, drive=code)
    states = tuple(changed if one == state else one for one in settings.states) if settings.wired else (changed,)
    reader.configure(replace(settings, states=states, rcount=_RCOUNT))
    return reader.scan().samples[states.index(changed)]


Delivery = Literal["as sent", "reversed", "a bit late", "not at all"]
"""Arrival of words: right, from the chain's other end, a clock late (wrong SPI mode), or never."""
ENDS: Mapping[str, Passive] = {"both": "ground", "a": "ground one end", "b": "ground other end"}
"""Ends of a coil that a trial grounds, and the name of that state in a scan plan."""


@dataclass(frozen=True)
class Trial:
    """One state to measure."""

    words: bytes  # of the switches
    coil: str | None = None  # at the converter, None for no coil
    turned: bool = False  # whether its ends are exchanged
    other: str | None = None  # a second coil that is grounded
    grounded: str | None = None  # ends of the second coil: "both", "a" or "b"
    rest: Literal["ground", "open"] = "open"  # state of all coils that are not named


def trials(wiring: Wiring) -> tuple[tuple[Trial, ...], ...]:
    """Return all trials of a board in groups.

    Each is best measured without a pause. The first has no coil at the converter, and then every
    coil both ways round. Each coil then has a group: alone, and with every other coil grounded at
    both ends, at a and at b.
    """
    first = [Trial(wiring.safe_words, rest="ground"), Trial(bytes(len(wiring.devices)))]
    for coil, sense in itertools.product(wiring.coils, (1, -1)):
        with contextlib.suppress(HardwareError):  # a wiring that cannot turn the coil round
            words = wiring.words(ScanState(coil, ((coil, sense),)))
            first.append(Trial(words, coil, sense < 0, rest="ground"))
    groups = [tuple(first)]
    for coil in wiring.coils:
        group = [Trial(wiring.words(ScanState(coil, ((coil, 1),), others="open")), coil)]
        others = [other for other in wiring.coils if other != coil]
        for other, (ends, passive) in itertools.product(others, ENDS.items()):
            state = ScanState(coil, ((coil, 1),), others="open", exceptions={other: passive})
            group.append(Trial(wiring.words(state), coil, other=other, grounded=ends))
        groups.append(tuple(group))
    return tuple(groups)


@dataclass(frozen=True)
class Prediction:
    """Predicted result of a trial."""

    oscillates: bool | None  # whether the converter has a sensor, None if that is uncertain
    shorted: frozenset[str]  # coils with their ends joined, which lower the inductance of their neighbours


@dataclass(frozen=True)
class Fault:
    """A possible fault of a board."""

    text: str  # description of the fault, empty for a good board
    wiring: Wiring  # true wiring of the board
    delivery: Delivery = "as sent"
    # Broken switches by the numbers of their device and bit, True for closed.
    stuck: Mapping[tuple[int, int], bool] = field(default_factory=dict)
    missing: str | None = None  # coil that is not connected
    shorted: str | None = None  # coil whose ends are joined

    def predict(self, words: bytes) -> Prediction:
        """Predict the result of a trial with these words."""
        arriving = {
            "as sent": words,
            "reversed": words[::-1],
            "a bit late": (int.from_bytes(words, "big") >> 1).to_bytes(len(words), "big"),
            "not at all": bytes(len(words)),
        }[self.delivery]
        names = self.wiring.coils
        present = [coil for coil, name in enumerate(names) if name != self.missing]
        shorted = [coil for coil, name in enumerate(names) if name == self.shorted]
        closure = Closure(present, closed_switches(self._table, arriving, stuck=self.stuck), shorted)
        pins = {closure.group("INA"), closure.group("INB")}
        oscillates: bool | None = any(set(branch.ends) == pins for branch in closure.branches)
        to_ground = any(closure.conducts(pin, "ground") for pin in ("INA", "INB"))
        if len(pins) == 1 or closure.group("ground") in pins:
            oscillates = False
        elif to_ground or (not oscillates and closure.conducts("INA", "INB")):
            oscillates = None
        return Prediction(oscillates, frozenset(names[coil] for coil, ends in closure.branches if ends[0] == ends[1]))

    @cached_property
    def _table(self) -> SwitchTable:
        return switch_table(self.wiring.encode())


def single_faults(wiring: Wiring) -> tuple[Fault, ...]:
    """Return a good board and every board with one fault."""
    faults = [Fault("", wiring)]
    for number, device in enumerate(wiring.devices, start=1):
        for switch in device.switches:
            name = f"{device.name}.{switch.name} ({switch.terminal} to {switch.net})"
            place = len(wiring.devices) - number, device.bits.index(switch.name)
            faults += [
                Fault(f"{name} stays {'closed' if closed else 'open'}", wiring, stuck={place: closed})
                for closed in (False, True)
            ]
    faults += [Fault(f"{coil} or a lead of it is broken", wiring, missing=coil) for coil in wiring.coils]
    faults += [Fault(f"{coil} is shorted", wiring, shorted=coil) for coil in wiring.coils]
    return (
        *faults,
        Fault("no word reaches the switches, or the converter is not joined to them", wiring, "not at all"),
        Fault("words arrive one clock late: another mode of SPI is needed", wiring, "a bit late"),
        Fault("the chain of devices is wired the other way round", wiring, "reversed"),
        *_other_maps(wiring),
    )


def _other_maps(wiring: Wiring) -> Iterator[Fault]:
    places = tuple(range(SWITCHES))
    low, high = places[:4], places[4:]
    interleaved = [
        tuple(itertools.chain.from_iterable(zip(*halves, strict=True))) for halves in ((low, high), (high, low))
    ]
    orders = [places[::-1], high + low, low[::-1] + high[::-1], high[::-1] + low[::-1]]
    orders += [order[::step] for order in interleaved for step in (1, -1)]
    for order in orders:
        other = _with_order(wiring, order)
        bits = ", ".join(other.devices[0].bits)
        yield Fault(f"the switches have other bits than the wiring says: from bit 0 on {bits}", other)
        yield Fault(f"the chain is wired the other way round, and its bits are from bit 0 on {bits}", other, "reversed")
    for first, second in itertools.combinations(places, 2):
        exchanged = list(places)
        exchanged[first], exchanged[second] = second, first
        other = _with_order(wiring, exchanged)
        if other.encode() != wiring.encode():
            yield Fault(f"bits {first} and {second} of every device are exchanged", other)


def _with_order(wiring: Wiring, order: Sequence[int]) -> Wiring:
    devices = (replace(device, bits=tuple(device.bits[k] for k in order)) for device in wiring.devices)
    return replace(wiring, devices=tuple(devices))


RCOUNT = 0x4000  # RCOUNT of conversions of 12 ms, with an error of a frequency of less than a millionth
NOTICEABLE = 2e-5
"""Least relative rise of a frequency by a shorted neighbour. On the reference board the nearest
give 1.5e-3, the second 1.2e-4, and a single grounded end, by its capacitance, less than 1e-6."""
_MOST_STATES = 16  # at a time. Every board takes this number
_ATTEMPTS = 3
_ANY_CAPACITANCE = 120e-12  # F. Only frequencies are used


@dataclass(frozen=True)
class CoilCheck:
    """Measurements of one coil."""

    coil: str
    frequency: float | None  # Hz, with all other coils grounded, None if nothing oscillates
    turned: float | None  # the same with its ends exchanged, None as well if the wiring cannot exchange them
    felt_by: str | None  # coil whose frequency changes most when this coil is grounded, None if no other oscillates
    rises: Mapping[str, float]  # of that frequency, relative, with "both" ends of this coil grounded, only "a" or "b"


@dataclass(frozen=True)
class SelfTest:
    """Result of a self-test.

    It has the measurements of the `coils`, in the order of the wiring, and the `symptoms`,
    measurements that a good board would not give. Each of the `findings` is a fault that explains
    all measurements alone. There are none if there are several faults. `untested` are faults that a
    board which has passed could still have.
    """

    coils: tuple[CoilCheck, ...]
    symptoms: tuple[str, ...]
    findings: tuple[str, ...]
    untested: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether the board behaves according to the wiring."""
        return not self.symptoms


@dataclass(frozen=True)
class _Seen:
    """A trial's frequency in Hz, and change in its group."""

    trial: Trial
    frequency: float | None
    reference: Trial | None = None
    change: float | None = None


def self_test(reader: Reader, wiring: Wiring, settings: ScanSettings, *, progress: Progress | None = None) -> SelfTest:
    """Try every switch of a board.

    The `reader` is not configured afterwards, and its coils are grounded. `wiring` is the assumed
    one. Of the `settings` of the board's coils, clock, dividers and drive currents are used.
    `progress` is called with (done, total) after each group of states.

    Six coils take 110 states, about 2 s. A single fault is named, several at once give only
    symptoms. Neighbouring coils must be coupled strongly enough that a shorted coil raises the
    frequency of the other by `NOTICEABLE`. Without switches the test shows only whether the coil at
    every channel oscillates.

    Raises BusFault if the converter did not answer three times, SwitchFault if the chain of
    switches returns other words than it was sent, and HardwareError if the board refuses the
    settings or cannot scan.
    """
    if wiring.channels:
        return _of_channels(reader, settings)
    groups = [part for group in trials(wiring) for part in _parts(group)]
    seen: list[_Seen] = []
    for k, group in enumerate(groups):
        seen += _measured(reader, settings, group)
        if progress is not None:
            progress(k + 1, len(groups))
    reader.rest()
    checks = {coil: _check(coil, seen) for coil in wiring.coils}
    alone = {one.trial.coil for one in seen if one.reference is one.trial and one.frequency is not None}
    judged = [(one, _rise(one, checks, alone)) for one in seen]
    good, *faulty = single_faults(wiring)
    symptoms = tuple(_symptom(one, rise) for one, rise in _differences(good, judged))
    fitting = [fault for fault in faulty if next(_differences(fault, judged), None) is None]
    if symptoms:
        return SelfTest(tuple(checks.values()), symptoms, tuple(fault.text for fault in fitting), ())
    words = {one.trial.words for one in seen}
    broken = {fault.text for fault in fitting if fault.stuck or fault.missing or fault.shorted}
    other = {fault.text for fault in fitting if any(fault.predict(one) != good.predict(one) for one in words)}
    untested = [fault.text for fault in fitting if fault.text in broken | other]  # no maps that change nothing
    return SelfTest(tuple(checks.values()), (), (), tuple(untested))


def _of_channels(reader: Reader, settings: ScanSettings) -> SelfTest:
    """Test in one scan whether every channel's coil oscillates."""
    trying = replace(settings, rcount=RCOUNT)
    reader.configure(trying)
    readings = read_scan(_answered(reader), trying, _ANY_CAPACITANCE).states
    reader.rest()
    dead = [(state, one) for state, one in zip(settings.states, readings, strict=True) if one.frequency is None]
    return SelfTest(
        coils=tuple(CoilCheck(one.name, one.frequency, None, None, {}) for one in readings),
        symptoms=tuple(
            f"{one.name} at channel {state.channel} does not oscillate: {', '.join(one.reasons)}" for state, one in dead
        ),
        findings=tuple(
            f"{one.name} or a lead of it is broken or shorted, its capacitor is missing, or its drive is too weak"
            for _, one in dead[:1]
            if len(dead) == 1
        ),
        untested=("coils at exchanged channels",) if len(readings) > 1 else (),
    )


def _answered(reader: Reader) -> RawScan:
    for _ in range(_ATTEMPTS):
        scan = reader.scan()
        if not any(sample.fault in BUS_FAULTS for sample in scan.samples):
            return scan
    raise BusFault(f"the converter did not answer in {_ATTEMPTS} scans; nothing could be tested.")


def _parts(group: Sequence[Trial]) -> list[tuple[Trial, ...]]:
    """Divide a group into scans that a board accepts."""
    head = group[:1] if group[-1].other is not None else ()
    rest, size = group[len(head) :], _MOST_STATES - len(head)
    return [(*head, *rest[k : k + size]) for k in range(0, len(rest), size)]


def _measured(reader: Reader, settings: ScanSettings, group: Sequence[Trial]) -> list[_Seen]:
    drives = {state.name: state.drive for state in settings.states}
    states = tuple(
        StateSettings(f"trial {k}", trial.words, drives.get(trial.coil or "", settings.states[0].drive))
        for k, trial in enumerate(group)
    )
    trying = replace(settings, states=states, rcount=RCOUNT)
    reader.configure(trying)
    scan = _answered(reader)
    if any(sample.fault == SampleFault.SWITCHES_DIFFER for sample in scan.samples):
        raise SwitchFault(
            "the chain of switches does not return the words that it was sent; no switch could be tested."
        )
    frequencies = [state.frequency for state in read_scan(scan, trying, _ANY_CAPACITANCE).states]
    if group[-1].other is None:
        return [_Seen(trial, frequency) for trial, frequency in zip(group, frequencies, strict=True)]
    first = frequencies[0]
    return [
        _Seen(trial, f, group[0], None if f is None or first is None else f / first - 1)
        for trial, f in zip(group, frequencies, strict=True)
    ]


def _check(coil: str, seen: Sequence[_Seen]) -> CoilCheck:
    scan = {one.trial.turned: one.frequency for one in seen if one.trial.coil == coil and one.trial.rest == "ground"}
    changes = [(one.trial, one.change) for one in seen if one.trial.other == coil and one.change is not None]
    felt_by = max(changes, key=lambda pair: abs(pair[1]), default=(None, 0.0))[0]
    return CoilCheck(
        coil,
        scan.get(False),
        scan.get(True),
        None if felt_by is None else felt_by.coil,
        {
            str(trial.grounded): change
            for trial, change in changes
            if felt_by is not None and trial.coil == felt_by.coil
        },
    )


def _symptom(one: _Seen, rise: int | None) -> str:
    trial, does = one.trial, "oscillates" if one.frequency is not None else "does not oscillate"
    if trial.coil is None:
        return f"with all coils {'grounded' if trial.rest == 'ground' else 'open'} the converter {does}"
    if trial.other is None:
        others = "all others grounded" if trial.rest == "ground" else "all others open"
        return f"{trial.coil}{', turned round,' if trial.turned else ''} {does} with {others}"
    what = "both ends" if trial.grounded == "both" else f"end {trial.grounded} alone"
    shown = {None: does, 1: "feels a short", 0: "feels no short", -1: "feels a short taken away"}[rise]
    return f"{trial.coil} {shown} where {what} of {trial.other} {'are' if trial.grounded == 'both' else 'is'} grounded"


def _differences(fault: Fault, judged: Sequence[tuple[_Seen, int | None]]) -> Iterator[tuple[_Seen, int | None]]:
    """Yield the measurements that contradict the fault."""
    predict = functools.cache(fault.predict)
    for one, rise in judged:
        predicted = predict(one.trial.words)
        if predicted.oscillates is not None and predicted.oscillates != (one.frequency is not None):
            yield one, None
        elif rise is not None and one.reference is not None:
            reference = predict(one.reference.words)
            added, removed = len(predicted.shorted - reference.shorted), len(reference.shorted - predicted.shorted)
            if added + removed <= 1 and added - removed != rise:
                yield one, rise


def _rise(one: _Seen, checks: Mapping[str, CoilCheck], alone: Set[str | None]) -> int | None:
    """Direction of the frequency change of one measurement."""
    check = None if one.trial.other is None else checks[one.trial.other]
    if check is None or one.change is None or one.trial.coil != check.felt_by:
        return None
    largest = max(map(abs, check.rises.values()))
    if largest < NOTICEABLE:  # the neighbour that would show it may not oscillate
        return 0 if alone >= checks.keys() - {check.coil} else None
    if abs(one.change) < largest / 2:
        return 0
    return 1 if one.change > 0 else -1
