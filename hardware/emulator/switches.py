"""ADG739 packages in a daisy chain, the port that shifts words into them, and the circuit that closed switches make."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from scipy.cluster.hierarchy import DisjointSet

from coilarray.design.scan_states import Passive, ScanState
from coilarray.errors import HardwareError
from coilarray.hardware.wire.buses import Clock

SWITCHES = 8
"""Number of switches of a package, one for each bit of its word."""
FALLING_EDGE_MODES = (1, 2)
"""SPI modes in which data is stable at the falling clock edge, where the chip samples it."""


@dataclass(frozen=True)
class WiredSwitch:
    """The two things that a switch connects.

    Parameters
    ----------
    terminal : tuple of (int, {0, 1})
        Number of the coil and of its end.
    net : {"ground", "INA", "INB", "other"}
        Net on the other side of the switch.
    """

    terminal: tuple[int, int]
    net: str


_NETS = ("ground", "INA", "INB", "other")
_UNUSED = 0xFF


def netlist(code: bytes) -> tuple[tuple[WiredSwitch | None, ...], ...]:
    """Decode a wiring as it is sent to a board.

    Parameters
    ----------
    code : bytes
        Eight bytes per device in the order of the words, bit 0 first: 4·terminal + net, or 0xFF for an unused switch.

    Returns
    -------
    tuple of tuple of WiredSwitch or None
        Switches of each device, by bit.

    Raises
    ------
    HardwareError
        A length that is not a multiple of eight.

    Examples
    --------
    >>> netlist(bytes([0x05, *[0xFF] * 7]))[0][0]
    WiredSwitch(terminal=(0, 1), net='INA')
    """
    if not code or len(code) % SWITCHES:
        raise HardwareError(f"a wiring must have {SWITCHES} bytes a device; got {len(code)}.")
    switches = [None if byte == _UNUSED else WiredSwitch(divmod(byte >> 2, 2), _NETS[byte & 0b11]) for byte in code]
    return tuple(tuple(switches[k : k + SWITCHES]) for k in range(0, len(switches), SWITCHES))


class Adg739Chain:
    """A daisy chain of packages behind one shift register.

    Parameters
    ----------
    devices : sequence of sequence of WiredSwitch or None
        Switches of each device, as `netlist` returns them: the first device is at the far end of the chain and gets
        the first byte.
    before_change, after_change : callable
        Called before and after switches move.
    readback : bool
        Whether the end of the chain is wired back to the computer.

    Notes
    -----
    A bit is shifted in at every falling edge of the clock; when SYNC rises, each package latches its last eight. After
    power-up all switches are open. Only power-up resets a package.
    """

    def __init__(
        self,
        devices: Sequence[Sequence[WiredSwitch | None]],
        *,
        before_change: Callable[[], None] = lambda: None,
        after_change: Callable[[], None] = lambda: None,
        readback: bool = True,
    ) -> None:
        self.devices = tuple(tuple(device) for device in devices)
        self.readback = readback
        self.latches = 0
        self.bit_order = list(range(SWITCHES))
        """Bit of the word that moves each switch of the netlist; change it to emulate a board with another map."""
        self._before_change, self._after_change = before_change, after_change
        self._stuck: dict[tuple[int, int], bool] = {}
        self._register = 0  # the far end of the chain first
        self._words = bytes(len(self.devices))

    def power_up(self) -> None:
        """Restore the supply: the register is empty and all switches are open."""
        self._before_change()
        self._register = 0
        self._words = bytes(len(self.devices))
        self._after_change()

    @property
    def words(self) -> bytes:
        """Words that the packages latched last, in the order of sending."""
        return self._words

    def closed(self) -> tuple[WiredSwitch, ...]:
        """Return the switches that conduct, including those stuck closed."""
        return self._those(lambda place: self._stuck.get(place, self._commanded(place)))

    def commanded(self) -> tuple[WiredSwitch, ...]:
        """Return the switches that would conduct if none were stuck."""
        return self._those(self._commanded)

    def transfer(self, data: bytes, *, mode: int = 1, lsb_first: bool = False) -> bytes | None:
        """Shift bytes in with SYNC low, then let SYNC rise.

        Parameters
        ----------
        data : bytes
            Bytes to send, any number of them.
        mode : int
            SPI mode, 0 to 3. In modes 0 and 3 data changes at the edge at which the chip samples it, so that the chip
            takes the bit before.
        lsb_first : bool
            Whether the least significant bit is sent first; the chip expects the most significant one first.

        Returns
        -------
        bytes or None
            Bytes that left the far end of the chain; None where it is not wired back.
        """
        count = SWITCHES * len(data)
        sent = int.from_bytes(_turned(data) if lsb_first else data)
        if mode not in FALLING_EDGE_MODES:
            sent >>= 1
        through = self._register << count | sent
        self._register = through & (1 << SWITCHES * len(self.devices)) - 1
        self._latch()
        if not self.readback:
            return None
        came = (through >> SWITCHES * len(self.devices)).to_bytes(len(data))
        return _turned(came) if lsb_first else came

    def stick(self, device: int, bit: int, state: Literal["open", "closed"]) -> None:
        """Break a switch, so that it stays open or closed whatever its bit says.

        Parameters
        ----------
        device, bit : int
            Position of its device in the order of the words, and of its bit in the word.
        state : {"open", "closed"}
            State in which it is stuck.
        """
        self._before_change()
        self._stuck[device, bit] = state == "closed"
        self._after_change()

    def heal(self) -> None:
        """Repair all switches."""
        self._before_change()
        self._stuck.clear()
        self._after_change()

    def find(self, coil: int, end: int, net: str) -> tuple[int, int]:
        """Return device and bit of the switch from an end of a coil to a net; HardwareError where there is none."""
        for device, switches in enumerate(self.devices):
            for bit, switch in enumerate(switches):
                if switch == WiredSwitch((coil, end), net):
                    return device, bit
        raise HardwareError(f"no switch joins end {end} of coil {coil} to {net}.")

    def _latch(self) -> None:
        words = self._register.to_bytes(len(self.devices))
        self.latches += 1
        if words != self._words:
            self._before_change()
            self._words = words
            self._after_change()

    def _those(self, chosen: Callable[[tuple[int, int]], bool]) -> tuple[WiredSwitch, ...]:
        return tuple(
            switch
            for device, switches in enumerate(self.devices)
            for bit, switch in enumerate(switches)
            if switch is not None and chosen((device, bit))
        )

    def _commanded(self, place: tuple[int, int]) -> bool:
        device, bit = place
        return bool(self._words[device] >> self.bit_order[bit] & 1)


def _turned(data: bytes) -> bytes:
    """Return the bytes with their bits reversed."""
    return bytes(int(f"{byte:08b}"[::-1], 2) for byte in data)


class EmulatedSwitches:
    """Serial port between a driver and the emulated chain: a `coilarray.hardware.wire.buses.SwitchChain`.

    Parameters
    ----------
    chain : Adg739Chain
        Chain of switches that the port drives.
    clock : Clock
        Clock of the board, on which shifting takes its time.
    speed : float
        SPI clock frequency in Hz.
    """

    def __init__(self, chain: Adg739Chain, clock: Clock, *, speed: float = 8e6) -> None:
        self.chain = chain
        self.clock = clock
        self.speed = speed
        self.mode = 1
        """SPI mode; change it to emulate a port with another mode."""
        self.lsb_first = False
        """Bit order; change it to emulate a port with the wrong one."""
        self.broken = False
        """Whether the data line is broken, so that the chain receives zeros."""

    def shift(self, words: bytes) -> bytes | None:
        """Send one byte per device, the first to the far end of the chain, and latch all of them at once."""
        self.clock.sleep(8 * len(words) / self.speed)
        sent = bytes(len(words)) if self.broken else words
        return self.chain.transfer(sent, mode=self.mode, lsb_first=self.lsb_first)

    def close(self) -> None:
        """Release the port."""


Node = tuple[int, int] | str


class Seen(NamedTuple):
    """Circuit between the pins of the converter.

    Parameters
    ----------
    kind : {"coils", "open", "short", "grounded", "tangled"}
        Coils between the pins; nothing; pins shorted to each other; a pin with a direct-current path to ground; coils
        connected neither in series nor in parallel.
    state : ScanState or None
        Measured coils and terminations of the others, where there are coils between the pins.
    """

    kind: Literal["coils", "open", "short", "grounded", "tangled"]
    state: ScanState | None = None


@dataclass(frozen=True)
class _Branch:
    coil: int
    ends: tuple[Node, Node]  # groups of joined nodes


def what_is_seen(closed: Sequence[WiredSwitch], names: Sequence[str]) -> Seen:
    """Find which coils the converter sees through the closed switches, and how the others are terminated.

    Parameters
    ----------
    closed : sequence of WiredSwitch
        Switches that conduct.
    names : sequence of str
        Names of the coils, by number.

    Returns
    -------
    Seen
        Circuit between the pins of the converter.

    Notes
    -----
    A coil conducts direct current between its ends. Coils connected to the converter at one end only count as open, as
    do idle coils that are connected to each other.

    Examples
    --------
    >>> what_is_seen([WiredSwitch((0, 0), "INA"), WiredSwitch((0, 1), "INB")], ["coil1"]).state.measured
    (('coil1', 1),)
    """
    groups: DisjointSet = DisjointSet(["ground", "INA", "INB", "other"])
    for coil in range(len(names)):
        groups.add((coil, 0))
        groups.add((coil, 1))
    for switch in closed:
        groups.merge(switch.terminal, switch.net)
    ground, pin_a, pin_b = (groups[net] for net in ("ground", "INA", "INB"))
    branches = [_Branch(coil, (groups[coil, 0], groups[coil, 1])) for coil in range(len(names))]
    if pin_a == pin_b:
        return Seen("short")
    if _conducts(branches, pin_a, ground) or _conducts(branches, pin_b, ground):
        return Seen("grounded")
    if not _conducts(branches, pin_a, pin_b):
        return Seen("open")
    joined = _between(branches, pin_a, pin_b)
    if joined is None:
        return Seen("tangled")
    connection, measured = joined
    passive = {
        names[branch.coil]: _closing(branch, ground)
        for branch in branches
        if branch.coil not in {coil for coil, _ in measured}
    }
    coils = tuple((names[coil], sense) for coil, sense in measured)
    state = ScanState("+".join(name for name, _ in coils), coils, connection, "open", passive)
    return Seen("coils", state)


def _conducts(branches: Sequence[_Branch], start: Node, goal: Node) -> bool:
    """Whether direct current can flow from one group of nodes to another."""
    connected, grown = {start}, True
    while grown and goal not in connected:
        more = {end for branch in branches if connected & set(branch.ends) for end in branch.ends}
        grown = not more <= connected
        connected |= more
    return goal in connected


def _between(
    branches: Sequence[_Branch], pin_a: Node, pin_b: Node
) -> tuple[Literal["series", "parallel"], tuple[tuple[int, Literal[1, -1]], ...]] | None:
    """Coils between the pins with their sense, in series or all in parallel; None for anything else."""
    direct = [branch for branch in branches if set(branch.ends) == {pin_a, pin_b}]
    others = [branch for branch in branches if branch not in direct and branch.ends[0] != branch.ends[1]]
    through = _conducts(others, pin_a, pin_b)
    if direct:
        coils = tuple((branch.coil, _sense(branch, pin_a)) for branch in direct)
        return None if through else ("series" if len(direct) == 1 else "parallel", coils)
    chain: list[tuple[int, Literal[1, -1]]] = []
    at = pin_a
    left = [branch for branch in others if _on_a_path(branch, others, pin_a, pin_b)]
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


def _on_a_path(branch: _Branch, branches: Sequence[_Branch], pin_a: Node, pin_b: Node) -> bool:
    """Whether current from pin to pin can flow through a branch; not where only one of its ends is connected."""
    rest = [other for other in branches if other is not branch]
    first, second = branch.ends
    return (_conducts(rest, pin_a, first) and _conducts(rest, second, pin_b)) or (
        _conducts(rest, pin_a, second) and _conducts(rest, first, pin_b)
    )


def _sense(branch: _Branch, start: Node) -> Literal[1, -1]:
    return 1 if branch.ends[0] == start else -1


def _closing(branch: _Branch, ground: Node) -> Passive:
    """Return the termination of a coil that carries no current of the converter."""
    first, second = (end == ground for end in branch.ends)
    if branch.ends[0] == branch.ends[1]:
        return "ground"  # with shorted ends the induced current flows, grounded or not
    if first:
        return "ground one end"
    return "ground other end" if second else "open"
