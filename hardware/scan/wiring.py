"""Switches of a board: their wiring, the words of states, and the circuits that they make.

The check of the settings, the self-test and the emulated board all read the same table of switches.
The firmware has the rules of `check_switching` in C++ (`hardware/firmware/PROTOCOL.md`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Literal, NamedTuple, TypeVar, get_args

from pydantic import Field

from coilarray.design.keys import Name, Table
from coilarray.design.scan_states import Passive, ScanState, check_state, switch_part
from coilarray.design.toml_file import TomlFiles
from coilarray.errors import HardwareError, listed, shown
from coilarray.hardware.chips.ldc1614 import CHANNELS

Net = Literal["ground", "INA", "INB", "other"]
"""Net that an end of a coil can be connected to, with the two pins of the converter."""
NETS: tuple[Net, ...] = get_args(Net)
SWITCHES = 8  # number of switches of a device, one for each bit of its word
UNUSED = 0xFF  # code of a switch that is not wired
Sense = Literal[1, -1]
NumberedEnd = tuple[int, int]  # number of a coil, and of its end: 0 or 1
Node = NumberedEnd | str  # an end of a coil, or the name of a net


class WiredSwitch(NamedTuple):
    """End of a coil and net that one switch connects."""

    terminal: NumberedEnd
    net: Net

    @property
    def code(self) -> int:
        """Byte of the switch in an encoded wiring."""
        coil, end = self.terminal
        return 4 * (2 * coil + end) + NETS.index(self.net)


SwitchTable = tuple[tuple[WiredSwitch | None, ...], ...]
"""Switches of every device in the order of the words, by bit, None if not wired."""


def switch_table(wiring: bytes) -> SwitchTable:
    """Decode eight bytes for each device, bit 0 first.

    A byte is 4·terminal + net, or 0xFF for a switch that is not wired.

    >>> switch_table(bytes([0x05, *[0xFF] * 7]))[0][0]
    WiredSwitch(terminal=(0, 1), net='INA')
    """
    if not wiring or len(wiring) % SWITCHES:
        raise HardwareError(f"a wiring must have {SWITCHES} bytes a device; got {len(wiring)}.")
    switches = [None if code == UNUSED else WiredSwitch(divmod(code >> 2, 2), NETS[code & 0b11]) for code in wiring]
    return tuple(tuple(switches[k : k + SWITCHES]) for k in range(0, len(switches), SWITCHES))


def closed_switches(
    table: SwitchTable, words: bytes, *, stuck: Mapping[tuple[int, int], bool] = MappingProxyType({})
) -> tuple[WiredSwitch, ...]:
    """Return the switches that conduct under these words, or are `stuck` closed."""
    return tuple(
        switch
        for device, (switches, word) in enumerate(zip(table, words, strict=True))
        for bit, switch in enumerate(switches)
        if switch is not None and stuck.get((device, bit), bool(word >> bit & 1))
    )


class Closure:
    """Nets and ends of coils, connected by switches and `shorted` coils."""

    def __init__(self, coils: Collection[int], closed: Iterable[WiredSwitch], shorted: Collection[int] = ()) -> None:
        self._group: dict[Node, Node] = {net: net for net in NETS}
        for switch in closed:
            self._join(switch.terminal, switch.net)
        for coil in shorted:
            self._join((coil, 0), (coil, 1))
        self.branches = [Branch(coil, (self.group((coil, 0)), self.group((coil, 1)))) for coil in coils]
        """Conducting coils between the groups of their ends."""

    def group(self, node: Node) -> Node:
        """Return the node that represents all nodes connected to it."""
        return self._group.get(node, node)

    def joined(self, first: Node, second: Node) -> bool:
        """Check whether closed switches connect two nodes."""
        return self.group(first) == self.group(second)

    def conducts(self, first: Node, second: Node) -> bool:
        """Check whether direct current flows between two nodes."""
        return _path_exists(self.branches, self.group(first), self.group(second))

    def _join(self, first: Node, second: Node) -> None:
        kept, lost = self.group(first), self.group(second)
        self._group |= {first: kept, second: kept}
        for node, group in self._group.items():
            if group == lost:
                self._group[node] = kept


class Branch(NamedTuple):
    """A coil between two groups of connected nodes."""

    coil: int
    ends: tuple[Node, Node]


class Seen(NamedTuple):
    """Coils that the converter sees, or why it measures none."""

    kind: Literal["coils", "open", "short", "grounded", "tangled"]  # grounded: by a direct current path
    state: ScanState | None = None  # of coils; tangled ones are neither in series nor parallel


def what_is_seen(closed: Iterable[WiredSwitch], names: Sequence[str]) -> Seen:
    """Return the coils that the converter sees through switches.

    A coil conducts direct current. Coils with only one end on the converter count as open, and so
    do idle coils that are connected to each other.

    >>> what_is_seen([WiredSwitch((0, 0), "INA"), WiredSwitch((0, 1), "INB")], ["coil1"]).state.measured
    (('coil1', 1),)
    """
    closure = Closure(range(len(names)), closed)
    if closure.joined("INA", "INB"):
        return Seen("short")
    if closure.conducts("INA", "ground") or closure.conducts("INB", "ground"):
        return Seen("grounded")
    if not closure.conducts("INA", "INB"):
        return Seen("open")
    measured = _between_pins(closure)
    if measured is None:
        return Seen("tangled")
    connection, coils = measured
    numbers, ground = {coil for coil, _ in coils}, closure.group("ground")
    others = {names[one.coil]: _passive(one, ground) for one in closure.branches if one.coil not in numbers}
    named = tuple((names[coil], sense) for coil, sense in coils)
    return Seen("coils", ScanState("+".join(name for name, _ in named), named, connection, "open", others))


def _path_exists(branches: Sequence[Branch], start: Node, goal: Node) -> bool:
    """Check whether direct current flows between two groups."""
    found, grown = {start}, True
    while grown and goal not in found:
        more = {end for branch in branches if found & set(branch.ends) for end in branch.ends}
        grown = not more <= found
        found |= more
    return goal in found


def _between_pins(closure: Closure) -> tuple[Literal["series", "parallel"], tuple[tuple[int, Sense], ...]] | None:
    """Coils between the pins with their sense."""
    pin_a, pin_b = closure.group("INA"), closure.group("INB")
    direct = [branch for branch in closure.branches if set(branch.ends) == {pin_a, pin_b}]
    others = [branch for branch in closure.branches if branch not in direct and branch.ends[0] != branch.ends[1]]
    if direct:
        coils = tuple((branch.coil, _sense(branch, pin_a)) for branch in direct)
        through = _path_exists(others, pin_a, pin_b)
        return None if through else ("series" if len(direct) == 1 else "parallel", coils)
    chain: list[tuple[int, Sense]] = []
    at = pin_a
    left = [branch for branch in others if _carries_current(branch, others, pin_a, pin_b)]
    while at != pin_b:
        here = [branch for branch in left if at in branch.ends]
        if len(here) != 1:
            return None
        (branch,) = here
        left.remove(branch)
        sense = _sense(branch, at)
        chain.append((branch.coil, sense))
        at = branch.ends[1] if sense == 1 else branch.ends[0]
    return None if left else ("series", tuple(chain))


def _carries_current(branch: Branch, branches: Sequence[Branch], pin_a: Node, pin_b: Node) -> bool:
    """Check whether pin-to-pin current can pass a branch."""
    rest = [other for other in branches if other is not branch]
    return any(
        _path_exists(rest, pin_a, first) and _path_exists(rest, second, pin_b)
        for first, second in (branch.ends, branch.ends[::-1])
    )


def _sense(branch: Branch, start: Node) -> Sense:
    return 1 if branch.ends[0] == start else -1


def _passive(branch: Branch, ground: Node) -> Passive:
    if branch.ends[0] == branch.ends[1]:
        return "ground"  # connected ends carry the induced current wherever they are
    first, second = (end == ground for end in branch.ends)
    if first:
        return "ground one end"
    return "ground other end" if second else "open"


def check_switching(wiring: bytes, safe_words: bytes, states: Sequence[tuple[str, bytes]]) -> None:
    """Refuse words that make a forbidden connection.

    The safe words must ground every end and close nothing else. A state must not connect an end to
    two nets, or a pin of the converter to two ends, to an end alone, or to another coil than the
    other pin.
    """
    if not states:
        raise HardwareError("a scan must have at least one state; got none.")
    table = switch_table(wiring)
    nets = _nets(table, safe_words, "the safe words")
    wired = {switch.terminal for switches in table for switch in switches if switch is not None}
    loose = next((terminal for terminal in sorted(wired) if nets.get(terminal) != ["ground"]), None)
    if loose is not None:
        raise HardwareError(f"the safe words must ground {_end(loose)} and nothing else; they do not.")
    for name, words in states:
        where = f"state {name}"
        nets = _nets(table, words, where)
        for terminal, joined in nets.items():
            if len(joined) > 1:
                listed = " and ".join("another net" if net == "other" else net for net in joined)
                raise HardwareError(f"{where} joins {_end(terminal)} to {listed} at once.")
        on_a, on_b = ([terminal for terminal, joined in nets.items() if pin in joined] for pin in ("INA", "INB"))
        for pin, terminals in (("INA", on_a), ("INB", on_b)):
            if len(terminals) > 1:
                raise HardwareError(f"{where} joins {' and '.join(map(_end, terminals))} to {pin} at once.")
        if len(on_a) != len(on_b):
            raise HardwareError(f"{where} joins an end to one pin of the converter and nothing to the other.")
        if on_a and on_a[0][0] != on_b[0][0]:
            raise HardwareError(f"{where} joins {_end(on_a[0])} to INA but {_end(on_b[0])} to INB.")


def _nets(table: SwitchTable, words: bytes, where: str) -> dict[NumberedEnd, list[Net]]:
    for device, (switches, word) in enumerate(zip(table, words, strict=True)):
        for bit, switch in enumerate(switches):
            if switch is None and word >> bit & 1:
                raise HardwareError(f"{where}: bit {bit} of word {device} must be 0; its switch is not wired.")
    nets: dict[tuple[int, int], set[Net]] = {}
    for terminal, net in closed_switches(table, words):
        nets.setdefault(terminal, set()).add(net)
    return {terminal: sorted(joined, key=NETS.index) for terminal, joined in nets.items()}


def _end(terminal: NumberedEnd) -> str:
    coil, end = terminal
    return f"end {'ab'[end]} of coil {coil + 1}"


End = Literal["a", "b"]  # the two ends of a coil
SCHEMA = 1  # version of the wiring file format
WIRINGS = TomlFiles("wiring", HardwareError, "coilarray.hardware.scan.wirings")
_STARTER = "six_coils"
_MOST_COILS = 31  # the code of a switch is a byte, 4·terminal + net, and 0xFF means that it is not wired
_MOST_DEVICES = 255
_GROUNDED: Mapping[Passive, tuple[End, ...]] = {
    "ground": ("a", "b"),
    "ground one end": ("a",),
    "ground other end": ("b",),
    "open": (),
}


class Terminal(NamedTuple):
    """One end of a coil."""

    coil: str
    end: End

    def __str__(self) -> str:
        return f"{self.coil}.{self.end}"


class Switch(NamedTuple):
    """Switch, such as ``"S1A"``, between an end and a net."""

    name: str
    terminal: Terminal
    net: Net


@dataclass(frozen=True)
class Device:
    """One package of eight switches."""

    name: str
    part: str  # an entry of `coilarray.design.scan_states.PARTS`
    bits: tuple[str, ...]  # names of the switches from bit 0 to bit 7 of its word
    switches: tuple[Switch, ...]


@dataclass(frozen=True)
class Wiring:
    """Wiring of a board with or without switches.

    Data pass the `devices` in order, the first next to the computer, so that the first byte that is
    sent goes to the last device. Without switches the `coils` are wired to the `channels` of the
    converter, 0 to 3, and a coil's ends are grounded inside it while another coil is measured.
    Words belong to the whole chain, in the order in which they are sent. `name` and `title` are for
    messages. `assumed` has the keys of the wiring that are not verified, with the reasons.

    Raises HardwareError for a channel that does not exist or has two coils, a wiring of switches
    that cannot ground every end of every coil or not measure every coil, an end with two switches
    to the same net, an unknown part or coil, switches that cannot share their common pin, or names
    that are used twice.
    """

    name: str
    title: str
    coils: tuple[str, ...]
    devices: tuple[Device, ...]
    assumed: tuple[tuple[str, str], ...] = ()
    channels: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        for kind, names in (("coil", self.coils), ("device", tuple(device.name for device in self.devices))):
            if (twice := first_repeated(names)) is not None:
                raise HardwareError(f"wiring {self.name} names the {kind} {twice!r} twice.")
        if self.channels:
            if self.devices or len(self.channels) != len(self.coils):
                raise HardwareError(f"wiring {self.name} must have a channel for each coil, and no devices.")
            if (again := first_repeated(self.channels)) is not None:
                raise HardwareError(f"wiring {self.name} names the channel {again} twice.")
            if wrong := [channel for channel in self.channels if not 0 <= channel < CHANNELS]:
                raise HardwareError(f"wiring {self.name}: a channel must be 0 to {CHANNELS - 1}; got {wrong[0]}.")
            return
        if not 1 <= len(self.coils) <= _MOST_COILS or not 1 <= len(self.devices) <= _MOST_DEVICES:
            raise HardwareError(
                f"wiring {self.name} must have 1 to {_MOST_COILS} coils and 1 to {_MOST_DEVICES} devices; "
                f"got {len(self.coils)} and {len(self.devices)}."
            )
        for device in self.devices:
            self._check_device(device)
        joins = [(switch.terminal, switch.net) for device in self.devices for switch in device.switches]
        if (double := first_repeated(joins)) is not None:
            raise HardwareError(f"wiring {self.name} has two switches from {double[0]} to {double[1]}; one is allowed.")
        for terminal in self.terminals:
            if (terminal, "ground") not in joins:
                raise HardwareError(f"wiring {self.name} must have a switch that grounds {terminal}; there is none.")
        for coil in self.coils:
            if not {(Terminal(coil, "a"), "INA"), (Terminal(coil, "b"), "INB")} <= set(joins):
                raise HardwareError(f"wiring {self.name} must join {coil}.a to INA and {coil}.b to INB; it cannot.")

    @property
    def terminals(self) -> tuple[Terminal, ...]:
        """Both ends of every coil, in order."""
        return tuple(Terminal(coil, end) for coil in self.coils for end in get_args(End))

    @property
    def safe_words(self) -> bytes:
        """Words that ground every coil end and close nothing else."""
        if self.channels:
            return b""
        return self._close({(terminal, "ground") for terminal in self.terminals})

    def channel(self, coil: str) -> int:
        """Return the channel of the converter that measures a coil."""
        if coil not in self.coils:
            raise HardwareError(f"wiring {self.name} has no coil {coil!r}; there are {listed(self.coils)}.")
        return self.channels[self.coils.index(coil)] if self.channels else 0

    def words(self, state: ScanState) -> bytes:
        """Return the words of a state that measures a coil."""
        check_state(state, self.coils)
        if len(state.measured) > 1:
            joined = ", ".join(name for name, _ in state.measured)
            raise HardwareError(f"state {state.name} must measure one coil, as one bus can; got {joined}.")
        ((measured, sense),) = state.measured
        if self.channels:
            others = {coil: state.exceptions.get(coil, state.others) for coil in self.coils if coil != measured}
            wrong = next((coil for coil, passive in others.items() if passive != "ground"), None)
            if sense < 0 or wrong is not None:
                why = f"turn {measured} round" if sense < 0 else f"make {wrong} {others[str(wrong)]!r}; it is grounded"
                raise HardwareError(f"state {state.name}: wiring {self.name} has no switches that {why}.")
            return b""
        joins: set[tuple[Terminal, Net]] = {
            (Terminal(measured, "a"), "INA" if sense > 0 else "INB"),
            (Terminal(measured, "b"), "INB" if sense > 0 else "INA"),
        }
        for coil in self.coils:
            if coil == measured:
                continue
            passive = state.exceptions.get(coil, state.others)
            if passive not in _GROUNDED:
                raise HardwareError(f"state {state.name}: wiring {self.name} cannot make {coil} {passive!r}.")
            joins |= {(Terminal(coil, end), "ground") for end in _GROUNDED[passive]}
        return self._close(joins)

    def encode(self) -> bytes:
        """Return eight bytes per device."""
        codes = bytearray()
        for device in reversed(self.devices):
            by_name = {
                name: WiredSwitch((self.coils.index(coil), get_args(End).index(end)), net).code
                for name, (coil, end), net in device.switches
            }
            codes += bytes(by_name.get(name, UNUSED) for name in device.bits)
        return bytes(codes)

    def _close(self, joins: set[tuple[Terminal, Net]]) -> bytes:
        """Return the words for connections, the chain's far end first."""
        words, left = bytearray(), set(joins)
        for device in reversed(self.devices):
            closed = [switch for switch in device.switches if (switch.terminal, switch.net) in joins]
            left -= {(switch.terminal, switch.net) for switch in closed}
            words.append(sum(1 << device.bits.index(switch.name) for switch in closed))
        if left:
            terminal, net = min(left)
            raise HardwareError(f"wiring {self.name} has no switch from {terminal} to {net}.")
        return bytes(words)

    def _check_device(self, device: Device) -> None:
        part = switch_part(device.part)
        if sorted(device.bits) != sorted(part.bits):
            got = listed(map(shown, device.bits)) or "none"
            raise HardwareError(
                f"wiring {self.name}, device {device.name}: bits must name each of {listed(part.bits)} once; got {got}."
            )
        for switch in device.switches:
            if switch.name not in device.bits:
                raise HardwareError(f"wiring {self.name}: {device.name} has no switch {switch.name!r}.")
            if switch.terminal not in self.terminals:
                raise HardwareError(
                    f"wiring {self.name}: {device.name}.{switch.name} goes to {shown(str(switch.terminal))}; "
                    f"there are the coils {listed(self.coils)} with ends a and b."
                )
        # A common pin is one side of its switches, so they must connect the same end of a coil, or the same net.
        for names in part.drains.values():
            wired = [switch for switch in device.switches if switch.name in names]
            for one, other in combinations(wired, 2):
                if one.terminal != other.terminal and one.net != other.net:
                    raise HardwareError(
                        f"wiring {self.name}, {device.name} ({device.part}): {one.name} from {one.terminal} to "
                        f"{one.net} and {other.name} from {other.terminal} to {other.net} share a common pin, which "
                        "cannot be both; switches of one common pin must join the same end or the same net."
                    )


def load_wiring(name_or_path: str | Path | None = None) -> Wiring:
    """Read a wiring file, or raise HardwareError.

    `name_or_path` is the name of a bundled wiring or a TOML file. The default ``"six_coils"`` has
    one device per coil.

    >>> wiring = load_wiring()
    >>> wiring.safe_words.hex()
    '111111111111'
    """
    given = _STARTER if name_or_path is None else str(name_or_path)
    return parse_wiring(WIRINGS.text(given), given)


def one_device_a_coil(coils: Sequence[str]) -> Wiring:
    """Return a wiring with one ADG739 for each coil."""
    bundled = load_wiring()
    (pattern, *_) = bundled.devices
    devices = tuple(
        replace(
            pattern,
            name=f"U{k}",
            switches=tuple(one._replace(terminal=Terminal(coil, one.terminal.end)) for one in pattern.switches),
        )
        for k, coil in enumerate(coils, start=1)
    )
    assumed = (("wiring", "one device a coil, as no wiring was given"), *bundled.assumed[1:])
    return Wiring("one_device_a_coil", "One ADG739 a coil", tuple(coils), devices, assumed)


def wired_to_channels(coils: Sequence[str], channels: Sequence[int]) -> Wiring:
    """Return the wiring of coils at channels, without switches."""
    if len(coils) > len(channels):
        raise HardwareError(
            f"there are {len(channels)} channels ({', '.join(map(str, channels))}) for {len(coils)} coils; none is "
            f"left for {coils[len(channels)]}: name the coils that are wired, such as "
            f"{', '.join(coils[: len(channels)])}."
        )
    used = tuple(channels[: len(coils)])
    return Wiring("channels", "Coils at the channels of the converter", tuple(coils), (), channels=used)


def parse_wiring(text: str, origin: str = "wiring") -> Wiring:
    """Read a wiring from the text of a TOML file."""
    file = WIRINGS.check(_File, WIRINGS.parse(text, origin), origin)
    try:
        return file.wiring.build(Path(origin).stem)
    except HardwareError as error:
        raise HardwareError(f"{origin[:200]}: {error}") from None


class _SwitchTable(Table):
    """``S1A = { … }``: what one switch joins."""

    coil: Name
    """Coil whose end the switch joins."""
    end: End
    """Which end of it."""
    net: Net
    """What it is joined to."""


class _PartTable(Table):
    """``[wiring.part.NAME]``: another order of the bits of a part."""

    bits: Annotated[list[str], Field(min_length=8, max_length=8)]
    """Names of the switches from the least significant bit up."""
    assumed: str | None = None
    """Why the order had to be assumed."""


class _DeviceTable(Table):
    """``[[wiring.device]]``: one package."""

    name: Name
    """Name of the package."""
    part: Name
    """Its part number."""
    switch: Annotated[dict[Name, _SwitchTable], Field(min_length=1, max_length=8)]


class _WiringTable(Table):
    """``[wiring]``: the coils and what their ends are joined by."""

    title: str
    """What the board is, in words."""
    coils: Annotated[list[Name] | None, Field(min_length=1, max_length=_MOST_COILS)] = None
    """Names of the coils, of a board with switches."""
    channels: dict[Name, int] = Field(default_factory=dict)
    """Channel of the converter of each coil, of a board without switches."""
    assumed: str | None = None
    """Why the wiring had to be assumed."""
    part: dict[Name, _PartTable] = Field(default_factory=dict)
    device: Annotated[list[_DeviceTable], Field(max_length=_MOST_DEVICES)] = Field(default_factory=list)

    def build(self, name: str) -> Wiring:
        if self.channels and self.coils:
            raise HardwareError(f"wiring {name} must have coils with devices, or channels of coils; got both.")
        parts = {name: switch_part(name, "a table of wiring.part") for name in self.part}
        parts |= {device.part: switch_part(device.part) for device in self.device}
        bits = {name: self.part[name].bits if name in self.part else part.bits for name, part in parts.items()}
        reasons = {"wiring": self.assumed}
        for key, part in parts.items():
            own = {"bits": self.part[key].assumed} if key in self.part else {}
            reasons |= {f"{key}.{field}": reason for field, reason in {**part.unverified, **own}.items()}
        return Wiring(
            name=name,
            title=self.title,
            coils=tuple(self.channels or self.coils or ()),
            channels=tuple(self.channels.values()),
            devices=tuple(
                Device(
                    device.name,
                    device.part,
                    tuple(bits[device.part]),
                    tuple(Switch(key, Terminal(one.coil, one.end), one.net) for key, one in device.switch.items()),
                )
                for device in self.device
            ),
            assumed=tuple((key, reason) for key, reason in reasons.items() if reason is not None),
        )


class _File(Table):
    schema_: Annotated[int, Field(ge=SCHEMA, le=SCHEMA)] = Field(alias="schema")
    """Version of the file format."""
    wiring: _WiringTable


_T = TypeVar("_T", bound=Hashable)


def first_repeated(items: Sequence[_T]) -> _T | None:
    """Return the first repeated item of a sequence, or None."""
    return next((item for item, count in Counter(items).items() if count > 1), None)
