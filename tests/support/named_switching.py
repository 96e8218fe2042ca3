"""The rules of switching on the names of a wiring: a second way beside `coilarray.hardware.scan.closure`."""

from __future__ import annotations

from coilarray.errors import HardwareError


def nets_of(wiring, words):
    """Nets that each end of each coil is joined to; HardwareError where a switch is closed that is not wired."""
    joined = dict.fromkeys(wiring.terminals, ())
    if len(words) != len(wiring.devices):
        raise HardwareError(f"wiring {wiring.name} needs {len(wiring.devices)} words; got {len(words)}.")
    for device, word in zip(wiring.devices, reversed(words), strict=True):
        switches = {switch.name: switch for switch in device.switches}
        for name in (name for bit, name in enumerate(device.bits) if word >> bit & 1):
            if name not in switches:
                raise HardwareError(f"word {word:#04x} closes {name} of {device.name}, which is not wired.")
            switch = switches[name]
            joined[switch.terminal] = (*joined[switch.terminal], switch.net)
    return joined


def check_words(wiring, words):
    """Raise HardwareError where words join what no state of a scan may join, by the names of the wiring."""
    joined = nets_of(wiring, words)
    for terminal, nets in joined.items():
        if len(nets) > 1:
            raise HardwareError(f"words {words.hex()} join {terminal} to {' and '.join(nets)} at once.")
    on = {"INA": [], "INB": []}
    for terminal, nets in joined.items():
        for net in nets:
            if net in on:
                on[net].append(terminal)
    for net, terminals in on.items():
        if len(terminals) > 1:
            raise HardwareError(f"words {words.hex()} join {' and '.join(map(str, terminals))} to {net} at once.")
    if bool(on["INA"]) != bool(on["INB"]):
        net, (terminal, *_) = next((net, terminals) for net, terminals in on.items() if terminals)
        raise HardwareError(f"words {words.hex()} join {terminal} to {net} and nothing to the other pin.")
    if on["INA"] and on["INA"][0].coil != on["INB"][0].coil:
        raise HardwareError(f"words {words.hex()} join {on['INA'][0]} to INA but {on['INB'][0]} to INB.")
