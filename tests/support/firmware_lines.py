"""Lines of the protocol for the tests of the firmware."""

import binascii
import re

from coilarray.hardware.wire.protocol.lines import draft_commands


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
    """Commands from BEGIN to COMMIT that tell a board its settings; test_protocol.py holds them against the hash."""
    return [",".join(command) for command in draft_commands(settings)]
