"""Which words a board may give its switches, from the settings alone; the rules of `hardware/firmware/PROTOCOL.md`.

The firmware has the same rules in C++: a state that joins two coils to the bus, or a pin of the converter to ground,
is refused on both sides.
"""

from __future__ import annotations

from collections.abc import Mapping

from coilarray.errors import HardwareError
from coilarray.hardware.scan.settings import ScanSettings
from coilarray.hardware.scan.wiring import UNUSED

_NETS = ("ground", "INA", "INB", "another net")
_GROUND, _INA, _INB, _ = range(4)
_SWITCHES = 8


def check_switching(settings: ScanSettings) -> None:
    """Refuse settings that could join what must not be joined.

    Parameters
    ----------
    settings : ScanSettings
        Its `wiring`, `safe_words` and the words of its states are looked at.

    Raises
    ------
    HardwareError
        No state, safe words that do not ground every end or close anything else, a switch that is not wired, an end on
        two nets at once, a pin of the converter with two ends, alone, or with another coil than the other pin.
    """
    if not settings.states:
        raise HardwareError("a scan must have at least one state; got none.")
    nets = _nets(settings.wiring, settings.safe_words, "the safe words")
    used = {code >> 2 for code in settings.wiring if code != UNUSED}
    loose = next((terminal for terminal in sorted(used) if nets.get(terminal) != {_GROUND}), None)
    if loose is not None:
        raise HardwareError(f"the safe words must ground {_end(loose)} and nothing else; they do not.")
    for state in settings.states:
        _check_state(_nets(settings.wiring, state.words, f"state {state.name}"), f"state {state.name}")


def _check_state(nets: Mapping[int, set[int]], where: str) -> None:
    for terminal, joined in nets.items():
        if len(joined) > 1:
            raise HardwareError(
                f"{where} joins {_end(terminal)} to {' and '.join(_NETS[net] for net in joined)} at once."
            )
    on = {net: [terminal for terminal, joined in nets.items() if net in joined] for net in (_INA, _INB)}
    for net, terminals in on.items():
        if len(terminals) > 1:
            raise HardwareError(f"{where} joins {' and '.join(map(_end, terminals))} to {_NETS[net]} at once.")
    if len(on[_INA]) != len(on[_INB]):
        raise HardwareError(f"{where} joins an end to one pin of the converter and nothing to the other.")
    if on[_INA] and on[_INA][0] // 2 != on[_INB][0] // 2:
        raise HardwareError(f"{where} joins {_end(on[_INA][0])} to INA but {_end(on[_INB][0])} to INB.")


def _nets(wiring: bytes, words: bytes, where: str) -> dict[int, set[int]]:
    """Nets of every end that the words join to any."""
    nets: dict[int, set[int]] = {}
    for device, word in enumerate(words):
        for bit in range(_SWITCHES):
            if not word >> bit & 1:
                continue
            code = wiring[_SWITCHES * device + bit]
            if code == UNUSED:
                raise HardwareError(f"{where}: bit {bit} of word {device} must be 0; its switch is not wired.")
            nets.setdefault(code >> 2, set()).add(code & 3)
    return nets


def _end(terminal: int) -> str:
    return f"end {'ab'[terminal % 2]} of coil {terminal // 2 + 1}"
