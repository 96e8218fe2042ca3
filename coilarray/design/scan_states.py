"""Switches and their parts, bus, tank and the states of a scan."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, get_args

from coilarray.errors import CoilarrayError, HardwareError, NetworkError, require_positive, shown

Passive = Literal["ground", "ground one end", "ground other end", "open", "load"]
"""Termination of a coil that is not measured, both ends or one end to ground for a grounded
coil."""
CONVERTER_PIN = 4e-12  # capacitance of a pin of the LDC1614 to ground in F, about (TI SNOSCY9A, eq. 3)
PartName = Literal["ADG714", "ADG738", "ADG739"]  # names of the known parts
_NETS = 3  # nets that every end of a coil has a switch to: ground and both sides of the bus
_LOAD = 50.0  # Ω, into which the off isolation is measured
_DECADE = 10e6  # Hz, frequency of the off isolation
_FROM_MEMORY = "not verified: the table of the data sheet was not read"


@dataclass(frozen=True)
class Switches:
    """The multiplexer, the bus and the tank.

    Raises NetworkError for a value that is negative or not finite, a tank that is not positive, or
    another place.

    Parameters
    ----------
    on_resistance : float
        Resistance of a closed switch in Ω.
    off_capacitance : float
        Capacitance of an open switch in F. Every terminal has one switch to each of A, B and
        ground.
    terminal_capacitance : float
        Capacitance from each coil terminal to ground in F, at the common pin of its switches.
    bus_capacitance : float
        Capacitance from each side of the measuring bus to ground in F. It includes the other pins
        of all its switches, and the converter's pins.
    lead_inductance : float
        Inductance of each lead from the bus to the converter in H.
    tank_capacitance : float
        Capacitance in F of the capacitor that the coil resonates with.
    tank_at : {"converter", "coil"}
        Place of that capacitor: across the converter, or across the terminals of the measured
        coils.
    """

    on_resistance: float = 0.0
    off_capacitance: float = 0.0
    terminal_capacitance: float = 0.0
    bus_capacitance: float = 0.0
    lead_inductance: float = 0.0
    tank_capacitance: float = 120e-12
    tank_at: Literal["converter", "coil"] = "converter"

    def __post_init__(self) -> None:
        strays = ("off_capacitance", "terminal_capacitance", "bus_capacitance")
        for name in ("on_resistance", *strays, "lead_inductance"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise NetworkError(f"{name} must be finite and not negative; got {value}.")
        require_positive("tank_capacitance", self.tank_capacitance, " F", NetworkError)
        if self.tank_at not in ("converter", "coil"):
            raise NetworkError(f"tank_at must be 'converter' or 'coil'; got {self.tank_at!r}.")

    @property
    def beside_q(self) -> str:
        """Description of the switches' resistance beside Q, if any.

        >>> "quality factor" + Switches(2.5).beside_q, Switches().beside_q
        ('quality factor, with 5 Ω of switches', '')
        """
        return f", with {2 * self.on_resistance:.4g} Ω of switches" if self.on_resistance else ""

    @property
    def across_coil(self) -> float:
        """Capacitance in F across a measured coil: the tank, and both sides to ground in series.

        >>> round(Switches(terminal_capacitance=42e-12, bus_capacitance=153e-12).across_coil * 1e12, 1)
        217.5
        """
        return self.tank_capacitance + (self.bus_capacitance + self.terminal_capacitance) / 2


@dataclass(frozen=True)
class ScanState:
    """One state of the multiplexer.

    Parameters
    ----------
    name : str
        Name of the state in results.
    measured : tuple of (str, {1, -1})
        The measured coils in order, each with its sense. A sense of −1 reverses its terminals.
    connection : {"series", "parallel"}
        Connection of several measured coils.
    others : {"ground", "ground one end", "ground other end", "open", "load"}
        Termination of every other coil.
    exceptions : mapping of str to such a value
        Terminations of coils, by name, that differ from `others`.
    load_resistance : float
        Resistance of a load in Ω.
    """

    name: str
    measured: tuple[tuple[str, int], ...]
    connection: Literal["series", "parallel"] = "series"
    others: Passive = "ground"
    exceptions: Mapping[str, Passive] = field(default_factory=dict)
    load_resistance: float = 50.0


def paper_plan(names: Sequence[str]) -> tuple[ScanState, ...]:
    """Return the plan of Gast & Zimmermann (2020): each coil in turn, all others grounded."""
    return tuple(ScanState(name, ((name, 1),)) for name in names)


def terminated_state(
    name: str,
    measured: tuple[tuple[str, int], ...],
    terminations: Mapping[str, Passive],
    connection: Literal["series", "parallel"] = "series",
    exceptions: Mapping[str, Passive] | None = None,
    load_resistance: float = 50.0,
) -> ScanState:
    """Return a state, other coils with their terminations."""
    own = dict(exceptions or {})
    taken = {coil for coil, _ in measured} | set(own)
    own |= {coil: passive for coil, passive in terminations.items() if coil not in taken and passive != "ground"}
    return ScanState(name, measured, connection, "ground", own, load_resistance)


def referenced_names(
    states: Sequence[str], reference: Sequence[str], error: type[CoilarrayError] = NetworkError
) -> tuple[str, ...]:
    """Return the states of all but the reference coils."""
    for name in reference:
        if name not in states:
            raise error(f"a reference coil must be one of {', '.join(states)}; got {name!r}.")
    if not reference or len(set(reference)) < len(reference):
        raise error(f"reference coils must be named once each, at least one; got {list(reference)}.")
    others = tuple(name for name in states if name not in reference)
    if not others:
        raise error(f"reference coils must leave another state; got all of {', '.join(states)}.")
    return others


def check_state(state: ScanState, names: Sequence[str]) -> None:
    """Refuse a state that is impossible with these coils."""
    known = ", ".join(names)
    if not state.measured:
        raise NetworkError(f"state {state.name} measures no coil; name at least one of {known}.")
    measured = [name for name, _ in state.measured]
    for name in (*measured, *state.exceptions):
        if name not in names:
            raise NetworkError(f"state {state.name} names the coil {name!r}; there are {known}.")
    if len(set(measured)) != len(measured):
        raise NetworkError(f"state {state.name} measures a coil twice: {', '.join(measured)}.")
    both = sorted(set(measured) & set(state.exceptions))
    if both:
        raise NetworkError(f"state {state.name} measures {both[0]} and also makes it {state.exceptions[both[0]]}.")
    if any(sense not in (1, -1) for _, sense in state.measured):
        raise NetworkError(f"state {state.name} must give each measured coil the sense 1 or -1.")
    if state.connection not in ("series", "parallel"):
        raise NetworkError(f"state {state.name} must join coils in series or parallel; got {state.connection!r}.")
    for passive in (state.others, *state.exceptions.values()):
        if passive not in get_args(Passive):
            raise NetworkError(
                f"state {state.name}: a coil must be measured, ground, ground one end, open or load; got {passive!r}."
            )
    if not (math.isfinite(state.load_resistance) and state.load_resistance > 0):
        raise NetworkError(f"load_resistance of state {state.name} must be positive; got {state.load_resistance} Ω.")


@dataclass(frozen=True)
class SwitchPart:
    """Package of eight switches, each closed by one bit, with typical values.

    `bits` are the switches from bit 0 to bit 7, and `drains` the common pins with theirs. The
    isolation is in dB, at 10 MHz into 50 Ω. Capacitances to ground are in F, of both pins if
    closed. `unverified` has the fields that no public source confirmed, with the reason.
    """

    name: PartName
    title: str
    bits: tuple[str, ...]
    drains: Mapping[str, tuple[str, ...]]
    on_resistance: float
    off_isolation: float
    source_capacitance: float
    drain_capacitance: float
    on_capacitance: float
    unverified: Mapping[str, str] = field(default_factory=dict)

    @property
    def off_capacitance(self) -> float:
        """Capacitance through an open switch in F, C = 10^(−a/20)/(ω R) for an isolation of a."""
        return float(10 ** (-self.off_isolation / 20) / (2 * math.pi * _DECADE * _LOAD))

    @property
    def closing(self) -> float:
        """Capacitance to ground in F that a closing switch adds."""
        return self.on_capacitance - self.source_capacitance - self.drain_capacitance

    def capacitances(self, switches: Switches, coils: int) -> Switches:
        """Return switches with the capacitances of this part, traces not counted."""
        return replace(
            switches,
            off_capacitance=self.off_capacitance,
            terminal_capacitance=self.drain_capacitance * (1 if self.drains else _NETS),
            bus_capacitance=2 * coils * self.source_capacitance + self.closing + CONVERTER_PIN,
        )


_A, _B = (tuple(f"S{k}{side}" for k in range(1, 5)) for side in "AB")
_ONE_TO_EIGHT = tuple(f"S{k}" for k in range(1, 9))
_CAPACITANCES = ("source_capacitance", "drain_capacitance", "on_capacitance")
_PARTS = (
    SwitchPart(
        "ADG714", "eight switches, each with two pins of its own", _ONE_TO_EIGHT, {},
        on_resistance=2.5, off_isolation=60, source_capacitance=11e-12, drain_capacitance=11e-12, on_capacitance=22e-12,
        unverified=dict.fromkeys((*_CAPACITANCES, "off_isolation"), _FROM_MEMORY),
    ),
    SwitchPart(
        "ADG738", "eight switches with one common pin", _ONE_TO_EIGHT, {"D": _ONE_TO_EIGHT},
        on_resistance=2.5, off_isolation=55, source_capacitance=13e-12, drain_capacitance=85e-12, on_capacitance=96e-12,
        unverified=dict.fromkeys((*_CAPACITANCES, "bits"), _FROM_MEMORY)
        | {"off_isolation": "that of the ADG728, which has the same switches and another bus"},
    ),
    SwitchPart(
        "ADG739", "twice four switches with a common pin", (*_A, *_B), {"DA": _A, "DB": _B},
        on_resistance=2.5, off_isolation=55, source_capacitance=13e-12, drain_capacitance=42e-12, on_capacitance=48e-12,
        unverified=dict.fromkeys(_CAPACITANCES, _FROM_MEMORY)
        | {
            "bits": "not verified: the data sheet's table was not read; S4B first and S1A last as sibling parts "
            "suggest; the closure self-test tells",
            "off_isolation": "that of the ADG729, which has the same switches and another bus",
        },
    ),
)  # fmt: skip
PARTS: Mapping[str, SwitchPart] = {part.name: part for part in _PARTS}
"""Known parts by name. R_ON and topology are from the front pages of ADG714/715 Rev. B and
ADG738/739 Rev. A, at 5 V. Bits of the ADG714 are from ADG714/715, S8 first. Off isolation is from
ADG728/729 Rev. C, −75 dB at 1 MHz and −55 dB at 10 MHz."""


def switch_part(name: str, what: str = "wiring.device.part") -> SwitchPart:
    """Return a part by name, called `what` in messages."""
    if name not in PARTS:
        raise HardwareError(f"{what} must be {', '.join(PARTS)}; got {shown(name)}.")
    return PARTS[name]
