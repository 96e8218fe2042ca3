"""What closes what: trials of the switches, and what each of them shows if one thing is wrong. No I/O.

A board has no meter. All that can be seen of its switches is whether the converter oscillates, and by how much the
frequency of one coil rises when another one is shorted. Both are predicted here for every single fault, from the wiring
alone: a fault that predicts what was seen is a finding.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

from coilarray.design.scan_states import Passive, ScanState
from coilarray.errors import HardwareError
from coilarray.hardware.scan.wiring import Switch, Terminal, Wiring

Delivery = Literal["as sent", "turned round", "a bit late", "not at all"]
"""How words arrive at the chain: right, from its other end, one clock late (the wrong mode of SPI), or not."""
ENDS: Mapping[str, Passive] = {"both": "ground", "a": "ground one end", "b": "ground other end"}
"""What of a coil is grounded in a trial of its ground switches."""


@dataclass(frozen=True)
class Trial:
    """One state to measure.

    Parameters
    ----------
    words : bytes
        Of the switches.
    coil : str or None
        On the converter; None where no coil is.
    turned : bool
        Whether its ends are exchanged.
    other, grounded : str or None
        A coil of which both ends, "a" or "b" are grounded; all the rest is open. Without, see `rest`.
    rest : {"ground", "open"}
        All coils that are not named.
    """

    words: bytes
    coil: str | None = None
    turned: bool = False
    other: str | None = None
    grounded: str | None = None
    rest: Literal["ground", "open"] = "open"


def trials(wiring: Wiring) -> tuple[tuple[Trial, ...], ...]:
    """Return all trials of a board in groups, each of which is best measured at a stretch.

    Parameters
    ----------
    wiring : Wiring
        Of the board, as assumed.

    Returns
    -------
    tuple of tuple of Trial
        The empty bus; every coil both ways; and for each coil that is measured alone, every other one grounded at both
        ends and at either.
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
    """Return a coil with all others open, which is what the rest is compared with, and with another one grounded."""
    alone = Trial(wiring.words(ScanState(coil, ((coil, 1),), others="open")), coil)
    others = [other for other in wiring.coils if other != coil]
    pairs = []
    for other, (ends, passive) in itertools.product(others, ENDS.items()):
        state = ScanState(coil, ((coil, 1),), others="open", exceptions={other: passive})
        pairs.append(Trial(wiring.words(state), coil, other=other, grounded=ends))
    return (alone, *pairs)


def _words(wiring: Wiring, state: ScanState) -> bytes | None:
    """Words of a state; None where the wiring cannot turn a coil round."""
    try:
        return wiring.words(state)
    except HardwareError:
        return None


@dataclass(frozen=True)
class Sight:
    """What a trial shows.

    Parameters
    ----------
    oscillates : bool or None
        Whether the converter has a sensor; None where that is not certain.
    shorted : frozenset of str
        Coils with their ends joined, which lower the inductance of their neighbours.
    measured : frozenset of str
        Coils between the pins of the converter: which they are cannot be seen.
    """

    oscillates: bool | None
    shorted: frozenset[str]
    measured: frozenset[str]


@dataclass(frozen=True)
class Fault:
    """One thing that may be wrong with a board; without any of them, nothing is.

    Parameters
    ----------
    text : str
        For people; empty for a good board.
    wiring : Wiring
        As it really is.
    delivery : {"as sent", "turned round", "a bit late", "not at all"}
        Of the words.
    stuck : mapping of (Terminal, str) to bool
        Switches, by the end and the net that they join, that stay closed (True) or open.
    missing, shorted : str or None
        Coils.
    """

    text: str
    wiring: Wiring
    delivery: Delivery = "as sent"
    stuck: Mapping[tuple[Terminal, str], bool] = field(default_factory=dict)
    missing: str | None = None
    shorted: str | None = None

    def sight(self, words: bytes) -> Sight:
        """Predict what these words show."""
        nodes = _Nodes(["ground", "INA", "INB", "other", *itertools.chain.from_iterable(self._ends.values())])
        for terminal, net in self._closed(words):
            nodes.join(terminal, net)
        if self.shorted is not None:
            nodes.join(*self._ends[self.shorted])
        coils = {coil: ends for coil, ends in self._ends.items() if coil != self.missing}
        shorted = frozenset(coil for coil, ends in coils.items() if nodes.joined(*ends))
        measured = frozenset(coil for coil, ends in coils.items() if _between_pins(nodes, *ends))
        return Sight(_oscillates(nodes, coils.values(), bool(measured)), shorted, measured)

    def _closed(self, words: bytes) -> set[tuple[Terminal, str]]:
        closed = {join for join, stays in self.stuck.items() if stays}
        for switches, word in zip(self._switches, self._received(words), strict=True):
            closed |= {(s.terminal, s.net) for bit, s in enumerate(switches) if s is not None and word >> bit & 1}
        return {join for join in closed if self.stuck.get(join, True)}

    @cached_property
    def _switches(self) -> tuple[tuple[Switch | None, ...], ...]:
        """Switches by word, in the order of sending, and bit."""
        found = []
        for device in reversed(self.wiring.devices):
            by_name = {switch.name: switch for switch in device.switches}
            found.append(tuple(by_name.get(name) for name in device.bits))
        return tuple(found)

    @cached_property
    def _ends(self) -> dict[str, tuple[Terminal, Terminal]]:
        return {coil: (Terminal(coil, "a"), Terminal(coil, "b")) for coil in self.wiring.coils}

    def _received(self, words: bytes) -> bytes:
        match self.delivery:
            case "turned round":
                return words[::-1]
            case "not at all":
                return bytes(len(words))
            case "a bit late":
                return (int.from_bytes(words, "big") >> 1).to_bytes(len(words), "big")
        return words


class _Nodes:
    """Nets and ends of coils, joined by switches."""

    def __init__(self, names: Sequence[Hashable]) -> None:
        self._group = {name: k for k, name in enumerate(names)}

    def join(self, first: Hashable, second: Hashable) -> None:
        kept, lost = self._group[first], self._group[second]
        if kept != lost:
            self._group = {name: kept if group == lost else group for name, group in self._group.items()}

    def joined(self, first: Hashable, second: Hashable) -> bool:
        return self._group[first] == self._group[second]


def _between_pins(nodes: _Nodes, a: Terminal, b: Terminal) -> bool:
    return (nodes.joined(a, "INA") and nodes.joined(b, "INB")) or (nodes.joined(a, "INB") and nodes.joined(b, "INA"))


def _oscillates(nodes: _Nodes, coils: Collection[tuple[Terminal, Terminal]], measured: bool) -> bool | None:
    """Whether there is a sensor at the pins; None where a coil leads one to ground, or two are in series."""
    if nodes.joined("INA", "INB") or nodes.joined("INA", "ground") or nodes.joined("INB", "ground"):
        return False
    for a, b in coils:  # from here on, what direct current reaches
        nodes.join(a, b)
    if nodes.joined("INA", "ground") or nodes.joined("INB", "ground"):
        return None
    return measured or (None if nodes.joined("INA", "INB") else False)


def faults(wiring: Wiring) -> tuple[Fault, ...]:
    """Return a good board and every board with one thing wrong.

    Parameters
    ----------
    wiring : Wiring
        As assumed.

    Returns
    -------
    tuple of Fault
        The good board first.
    """
    return (
        Fault("", wiring),
        *_stuck_switches(wiring),
        *(Fault(f"{coil} or a lead of it is broken", wiring, missing=coil) for coil in wiring.coils),
        *(Fault(f"{coil} is shorted", wiring, shorted=coil) for coil in wiring.coils),
        Fault("no word reaches the switches, or the converter is not joined to them", wiring, "not at all"),
        Fault("words arrive one clock late: another mode of SPI is needed", wiring, "a bit late"),
        Fault("the chain of devices is wired the other way round", wiring, "turned round"),
        *_other_maps(wiring),
    )


def _stuck_switches(wiring: Wiring) -> Iterator[Fault]:
    for device in wiring.devices:
        for switch in device.switches:
            name = f"{device.name}.{switch.name} ({switch.terminal} to {switch.net})"
            join = switch.terminal, switch.net
            yield Fault(f"{name} stays open", wiring, stuck={join: False})
            yield Fault(f"{name} stays closed", wiring, stuck={join: True})


def _other_maps(wiring: Wiring) -> Iterator[Fault]:
    """Boards whose switches have other bits: orders that makers use, and any two bits exchanged."""
    places = tuple(range(8))
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
        yield Fault(
            f"the chain is wired the other way round, and its bits are from bit 0 on {bits}", other, "turned round"
        )
    for first, second in itertools.combinations(places, 2):
        exchanged = list(places)
        exchanged[first], exchanged[second] = second, first
        other = _with_order(wiring, exchanged)
        if other.encode() != wiring.encode():
            yield Fault(f"bits {first} and {second} of every device are exchanged", other)


def _with_order(wiring: Wiring, order: Sequence[int]) -> Wiring:
    devices = (replace(device, bits=tuple(device.bits[k] for k in order)) for device in wiring.devices)
    return replace(wiring, devices=tuple(devices))
