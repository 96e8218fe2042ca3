"""Lines of the protocol for the tests of the firmware, written from `hardware/firmware/PROTOCOL.md` alone."""

import binascii
import re


def seal(text):
    """A text with its checksum and line feed."""
    return b"%b*%04X\n" % (text.encode(), binascii.crc_hqx(text.encode(), 0xFFFF))


def intact(line):
    """The text of a whole line without its line feed, which must be as the protocol has it."""
    assert 6 <= len(line) <= 512
    assert re.fullmatch(rb"[\x20-\x7E]*\*[0-9A-F]{4}", line)
    assert int(line[-4:], 16) == binascii.crc_hqx(line[:-5], 0xFFFF)
    return line[:-5].decode()


def draft(settings):
    """Commands from BEGIN to COMMIT that tell a board its settings."""
    wiring, devices = settings.wiring, len(settings.safe_words)
    return [
        f"BEGIN,{devices:02X},{len(settings.states):02X}",
        *(f"WIRE,{device:02X},{wiring[8 * device : 8 * device + 8].hex().upper()}" for device in range(devices)),
        f"SAFE,{settings.safe_words.hex().upper()}",
        *(f"REG,{address:02X},{value:04X}" for address, value in settings.registers),
        f"WAIT,{settings.wait_us:08X},{settings.timeout_us:08X}",
        *(
            f"STATE,{index:02X},{state.words.hex().upper()},{settings.drive_register(state):04X}"
            for index, state in enumerate(settings.states)
        ),
        f"COMMIT,{settings.hash:04X}",
    ]
