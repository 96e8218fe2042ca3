"""Switches between coil ends and nets, without I/O.

This is the only table of a board's switches. The check of the settings, the self-test and the
emulated board all read it. The firmware has the rules of `check_switching` in C++
(`hardware/firmware/PROTOCOL.md`).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Literal, NamedTuple, get_args

from coilarray.design.scan_states import Passive, ScanState
from coilarray.errors import HardwareError

Net = Literal["ground", "INA", "INB", "other"]
"""Net that an end of a coil can be connected to, with the two pins of the converter."""
NETS: tuple[Net, ...] = get_args(Net)
SWITCHES = 8
"""Number of switches of a device, one for each bit of its word."""
UNUSED = 0xFF
"""Code of a switch that is not wired."""
Sense = Literal[1, -1]
Terminal = tuple[int, int]
"""Number of a coil, and of its end: 0 or 1."""
Node = Terminal | str
"""An end of a coil, or the name of a net."""


class WiredSwitch(NamedTuple):
    """End of a coil and net that one switch connects."""

    terminal: Terminal
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
    table: SwitchTable,
    words: bytes,
    *,
    stuck: Mapping[tuple[int, int], bool] = MappingProxyType({}),
    bit_order: Sequence[int] = range(SWITCHES),
) -> tuple[WiredSwitch, ...]:
    """Return the wired switches that conduct under these words.

    `stuck` has the broken switches by device and bit, True for closed. `bit_order` has the bit of
    the word that moves each switch of the table.
    """
    return tuple(
        switch
        for device, (switches, word) in enumerate(zip(table, words, strict=True))
        for bit, switch in enumerate(switches)
        if switch is not None and stuck.get((device, bit), bool(word >> bit_order[bit] & 1))
    )


class Closure:
    """Nets and ends of coils, connected by closed switches.

    The ends of `shorted` coils are connected to each other. `coils` conduct between their ends.
    """

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
    """Coils that the converter sees, or why it measures none.

    Without a state the pins are open, shorted, or grounded by a direct current path, or the coils
    between them are tangled, neither in series nor in parallel.
    """

    kind: Literal["coils", "open", "short", "grounded", "tangled"]
    state: ScanState | None = None


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
    """Return the termination of a coil without converter current."""
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
        _check_state(_nets(table, words, f"state {name}"), f"state {name}")


def _check_state(nets: Mapping[Terminal, Sequence[Net]], where: str) -> None:
    """Refuse forbidden connections of a state."""
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


def _nets(table: SwitchTable, words: bytes, where: str) -> dict[Terminal, list[Net]]:
    """Nets that the words connect to every end."""
    for device, (switches, word) in enumerate(zip(table, words, strict=True)):
        for bit, switch in enumerate(switches):
            if switch is None and word >> bit & 1:
                raise HardwareError(f"{where}: bit {bit} of word {device} must be 0; its switch is not wired.")
    nets: dict[tuple[int, int], set[Net]] = {}
    for terminal, net in closed_switches(table, words):
        nets.setdefault(terminal, set()).add(net)
    return {terminal: sorted(joined, key=NETS.index) for terminal, joined in nets.items()}


def _end(terminal: Terminal) -> str:
    coil, end = terminal
    return f"end {'ab'[end]} of coil {coil + 1}"
