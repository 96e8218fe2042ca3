"""Lines of the computer: single commands, and the commands that tell a board its settings."""

from __future__ import annotations

from coilarray.hardware.scan.settings import ScanSettings
from coilarray.hardware.wire.protocol.lines import seal

IDS = 0x100
"""Commands are numbered 00 to FF and then from 00 again."""
WIRED_SWITCHES = 8
"""Of a device: bytes in the wiring."""


def command_line(number: int, verb: str, *arguments: str) -> bytes:
    r"""Line of a command.

    Examples
    --------
    >>> command_line(0x1A, "PEEK", "7E")
    b'>1A,PEEK,7E*9237\n'
    """
    return seal(",".join((f">{number:02X}", verb, *arguments)))


def draft_commands(settings: ScanSettings) -> tuple[tuple[str, ...], ...]:
    """Commands that tell a board its settings: verb and arguments each, from BEGIN to COMMIT."""
    wiring = settings.wiring
    devices = [wiring[first : first + WIRED_SWITCHES] for first in range(0, len(wiring), WIRED_SWITCHES)]
    return (
        ("BEGIN", f"{len(devices):02X}", f"{len(settings.states):02X}"),
        *(("WIRE", f"{index:02X}", switches.hex().upper()) for index, switches in enumerate(devices)),
        ("SAFE", settings.safe_words.hex().upper()),
        *(("REG", f"{address:02X}", f"{value:04X}") for address, value in settings.registers),
        ("WAIT", f"{settings.wait_us:08X}", f"{settings.timeout_us:08X}"),
        *(
            ("STATE", f"{index:02X}", state.words.hex().upper(), f"{settings.drive_register(state):04X}")
            for index, state in enumerate(settings.states)
        ),
        ("COMMIT", f"{settings.hash:04X}"),
    )
