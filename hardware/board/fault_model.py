"""Model of a faulty board, without input or output.

It defines the trials of a self-test and predicts their results for every single fault. A board has no meter. The state
of its switches shows only in whether the converter oscillates, and by how much the frequency of one coil rises when
another coil is shorted. Both are predicted here from the wiring alone. A fault whose prediction equals the measurement
is a finding.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

from coilarray.design.scan_states import Passive, ScanState
from coilarray.errors import HardwareError
from coilarray.hardware.scan.closure import SWITCHES, Closure, SwitchTable, closed_switches, switch_table
from coilarray.hardware.scan.wiring import Wiring

Delivery = Literal["as sent", "reversed", "a bit late", "not at all"]
"""Arrival of words at the chain: right, from its other end, one clock late (wrong SPI mode), or not at all."""
ENDS: Mapping[str, Passive] = {"both": "ground", "a": "ground one end", "b": "ground other end"}
"""Ends of a coil that a trial of its ground switches grounds, and the name of that state in a scan plan."""


@dataclass(frozen=True)
class Trial:
    """One state to measure."""

    words: bytes  # of the switches
    coil: str | None = None  # at the converter; None for no coil
    turned: bool = False  # whether its ends are exchanged
    other: str | None = None  # a second coil that is grounded
    grounded: str | None = None  # ends of the second coil: "both", "a" or "b"
    rest: Literal["ground", "open"] = "open"  # state of all coils that are not named


def trials(wiring: Wiring) -> tuple[tuple[Trial, ...], ...]:
    """Return all trials of a board in groups.

    The trials follow from the assumed wiring. Each group is best measured without a pause. The first group has no coil
    at the converter, and then every coil both ways round. One group for each coil follows. It measures the coil alone,
    and with every other coil grounded at both ends, at a and at b.
    """
    empty = (Trial(wiring.safe_words, rest="ground"), Trial(wiring.open_words))
    scan = [
        Trial(words, coil, sense < 0, rest="ground")
        for coil in wiring.coils
        for sense in (1, -1)
        if (words := _words(wiring, ScanState(coil, ((coil, sense),)))) is not None
    ]
    return ((*empty, *scan), *(_pairs(wiring, coil) for coil in wiring.coils))


def _pairs(wiring: Wiring, coil: str) -> tuple[Trial, ...]:
    """Return the trials of a coil with another coil grounded.

    The first trial has the coil with all others open, as the reference for the rest.
    """
    alone = Trial(wiring.words(ScanState(coil, ((coil, 1),), others="open")), coil)
    others = [other for other in wiring.coils if other != coil]
    pairs = []
    for other, (ends, passive) in itertools.product(others, ENDS.items()):
        state = ScanState(coil, ((coil, 1),), others="open", exceptions={other: passive})
        pairs.append(Trial(wiring.words(state), coil, other=other, grounded=ends))
    return (alone, *pairs)


def _words(wiring: Wiring, state: ScanState) -> bytes | None:
    """Words of a state.

    They are None if the wiring cannot turn a coil round.
    """
    try:
        return wiring.words(state)
    except HardwareError:
        return None


@dataclass(frozen=True)
class Prediction:
    """Predicted result of a trial."""

    oscillates: bool | None  # whether the converter has a sensor; None if that is uncertain
    shorted: frozenset[str]  # coils with their ends joined, which lower the inductance of their neighbours


@dataclass(frozen=True)
class Fault:
    """A possible fault of a board.

    With the defaults the board is good.
    """

    text: str  # description of the fault; empty for a good board
    wiring: Wiring  # true wiring of the board
    delivery: Delivery = "as sent"
    # Broken switches by the numbers of their device and bit in the words. True is closed and False is open.
    stuck: Mapping[tuple[int, int], bool] = field(default_factory=dict)
    missing: str | None = None  # coil that is not connected
    shorted: str | None = None  # coil whose ends are joined

    def predict(self, words: bytes) -> Prediction:
        """Predict the result of a trial with these words."""
        names = self.wiring.coils
        present = [coil for coil, name in enumerate(names) if name != self.missing]
        shorted = [coil for coil, name in enumerate(names) if name == self.shorted]
        closure = Closure(present, closed_switches(self._table, self._received(words), stuck=self.stuck), shorted)
        pins = {closure.group("INA"), closure.group("INB")}
        return Prediction(
            _oscillates(closure, any(set(branch.ends) == pins for branch in closure.branches)),
            frozenset(names[coil] for coil, ends in closure.branches if ends[0] == ends[1]),
        )

    @cached_property
    def _table(self) -> SwitchTable:
        return switch_table(self.wiring.encode())

    def _received(self, words: bytes) -> bytes:
        """Return the words that arrive at the switches."""
        match self.delivery:
            case "reversed":
                return words[::-1]
            case "not at all":
                return bytes(len(words))
            case "a bit late":
                return (int.from_bytes(words, "big") >> 1).to_bytes(len(words), "big")
        return words


def _oscillates(closure: Closure, measured: bool) -> bool | None:
    """Predict whether there is a sensor at the pins.

    The result is None if a coil connects a pin to ground, or two coils are in series.
    """
    if closure.joined("INA", "INB") or closure.joined("INA", "ground") or closure.joined("INB", "ground"):
        return False
    if closure.conducts("INA", "ground") or closure.conducts("INB", "ground"):
        return None
    return measured or (None if closure.conducts("INA", "INB") else False)


def single_faults(wiring: Wiring) -> tuple[Fault, ...]:
    """Return a good board and every board with one fault.

    The good board has the assumed wiring and is the first.
    """
    return (
        Fault("", wiring),
        *_stuck_switches(wiring),
        *(Fault(f"{coil} or a lead of it is broken", wiring, missing=coil) for coil in wiring.coils),
        *(Fault(f"{coil} is shorted", wiring, shorted=coil) for coil in wiring.coils),
        Fault("no word reaches the switches, or the converter is not joined to them", wiring, "not at all"),
        Fault("words arrive one clock late: another mode of SPI is needed", wiring, "a bit late"),
        Fault("the chain of devices is wired the other way round", wiring, "reversed"),
        *_other_maps(wiring),
    )


def _stuck_switches(wiring: Wiring) -> Iterator[Fault]:
    """Yield the faults of switches that stay open or closed."""
    for number, device in enumerate(wiring.devices, start=1):
        for switch in device.switches:
            name = f"{device.name}.{switch.name} ({switch.terminal} to {switch.net})"
            place = len(wiring.devices) - number, device.bits.index(switch.name)
            yield Fault(f"{name} stays open", wiring, stuck={place: False})
            yield Fault(f"{name} stays closed", wiring, stuck={place: True})


def _other_maps(wiring: Wiring) -> Iterator[Fault]:
    """Boards whose switches have other bits.

    They have orders that makers use, and any two bits exchanged.
    """
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
