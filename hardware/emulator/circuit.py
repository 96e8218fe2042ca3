"""Which coils the converter sees through the closed switches, and what closes the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from scipy.cluster.hierarchy import DisjointSet

from coilarray.design.scan_states import Passive, ScanState
from coilarray.hardware.emulator.adg739_chain import WiredSwitch

Node = tuple[int, int] | str


class Seen(NamedTuple):
    """What the converter sees.

    Parameters
    ----------
    kind : {"coils", "open", "short", "grounded", "tangled"}
        Coils between its pins; nothing; its pins joined; a pin that direct current leads to ground; coils that are
        joined in another way than in series or in parallel.
    state : ScanState or None
        The coils and what closes the others, where there are coils between the pins.
    """

    kind: Literal["coils", "open", "short", "grounded", "tangled"]
    state: ScanState | None = None


@dataclass(frozen=True)
class _Branch:
    coil: int
    ends: tuple[Node, Node]  # groups of joined nodes


def what_is_seen(closed: Sequence[WiredSwitch], names: Sequence[str]) -> Seen:
    """Solve the nets.

    Parameters
    ----------
    closed : sequence of WiredSwitch
        Switches that conduct.
    names : sequence of str
        Of the coils, by number.

    Returns
    -------
    Seen

    Notes
    -----
    A coil joins its two ends for direct current. Coils that hang on the converter by one end only count as open, and
    so do idle ones that are joined to each other.

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
    if _led(branches, pin_a, ground) or _led(branches, pin_b, ground):
        return Seen("grounded")
    if not _led(branches, pin_a, pin_b):
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


def _led(branches: Sequence[_Branch], start: Node, goal: Node) -> bool:
    """Whether direct current flows from one group to another."""
    reached, grown = {start}, True
    while grown and goal not in reached:
        more = {end for branch in branches if reached & set(branch.ends) for end in branch.ends}
        grown = not more <= reached
        reached |= more
    return goal in reached


def _between(
    branches: Sequence[_Branch], pin_a: Node, pin_b: Node
) -> tuple[Literal["series", "parallel"], tuple[tuple[int, Literal[1, -1]], ...]] | None:
    """Coils between the pins with their sense, in series or all in parallel; None for anything else."""
    direct = [branch for branch in branches if set(branch.ends) == {pin_a, pin_b}]
    others = [branch for branch in branches if branch not in direct and branch.ends[0] != branch.ends[1]]
    through = _led(others, pin_a, pin_b)
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
    """Whether current from pin to pin can pass a branch: not where it hangs by one end."""
    rest = [other for other in branches if other is not branch]
    first, second = branch.ends
    return (_led(rest, pin_a, first) and _led(rest, second, pin_b)) or (
        _led(rest, pin_a, second) and _led(rest, first, pin_b)
    )


def _sense(branch: _Branch, start: Node) -> Literal[1, -1]:
    return 1 if branch.ends[0] == start else -1


def _closing(branch: _Branch, ground: Node) -> Passive:
    """Say what closes a coil that no current of the converter passes."""
    first, second = (end == ground for end in branch.ends)
    if branch.ends[0] == branch.ends[1]:
        return "ground"  # joined ends carry the induced current wherever they are
    if first:
        return "ground one end"
    return "ground other end" if second else "open"
