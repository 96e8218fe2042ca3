"""Lines of printable characters with a checksum.

The module makes commands for a board and has a parser that finds lines in any bytes.
"""

from __future__ import annotations

import binascii
from dataclasses import dataclass, replace

from coilarray.hardware.scan.closure import SWITCHES
from coilarray.hardware.scan.settings import ScanSettings

MAX_LINE = 512
"""Characters of a line with its checksum, without the line feed."""
IDS = 0x100
"""Commands are numbered 00 to FF and then from 00 again."""
_PRINTABLE = bytes(range(0x20, 0x7F))
_CHECKSUM = 5  # characters: an asterisk and four digits


def seal(text: str) -> bytes:
    r"""Return a line with its checksum and line feed.

    The line has 1 to 507 characters from 0x20 to 0x7E. The checksum is CRC-16/CCITT-FALSE.

    >>> seal(">00,STOP")
    b'>00,STOP*3783\n'
    """
    data = text.encode("ascii", errors="replace") if text.isascii() else b""
    if not 0 < len(data) <= MAX_LINE - _CHECKSUM or data.translate(None, _PRINTABLE):
        raise ValueError(f"a line must be 1 to {MAX_LINE - _CHECKSUM} printable ASCII characters; got {text!r}.")
    return b"%b*%04X\n" % (data, binascii.crc_hqx(data, 0xFFFF))


def intact(line: bytes) -> bool:
    """Check whether a line ends in its checksum."""
    return line[-_CHECKSUM:] == b"*%04X" % binascii.crc_hqx(line[:-_CHECKSUM], 0xFFFF)


@dataclass(frozen=True)
class LineCounts:
    """Counts of a parser.

    They are intact lines, and lines dropped for one reason, each counted once.
    """

    good: int = 0
    wrong_checksum: int = 0
    wrong_character: int = 0
    too_long: int = 0

    @property
    def dropped(self) -> int:
        """Lines dropped for any reason."""
        return self.wrong_checksum + self.wrong_character + self.too_long


class LineParser:
    r"""Parser from bytes to the texts of intact lines.

    It never keeps more than one line.

    >>> parser = LineParser()
    >>> parser.feed(b"noise\n>00,STOP*37")
    []
    >>> parser.feed(b"83\r\n"), parser.counts.wrong_checksum
    (['>00,STOP'], 1)
    """

    def __init__(self) -> None:
        self._begun = bytearray()  # of the line that has not ended yet
        self._overrun = False  # this line is already too long, and its bytes are no longer kept
        self._counts = LineCounts()

    @property
    def counts(self) -> LineCounts:
        """Counts so far."""
        return self._counts

    def feed(self, data: bytes) -> list[str]:
        """Take bytes in pieces of any size.

        The texts of the lines that end in them are returned without their checksums.
        """
        *ended, rest = data.split(b"\n")
        texts = []
        for piece in ended:
            self._keep(piece)
            if (text := self._end()) is not None:
                texts.append(text)
        self._keep(rest)
        return texts

    def _keep(self, piece: bytes) -> None:
        room = MAX_LINE + 1 - len(self._begun)  # one more byte for a carriage return
        self._overrun = self._overrun or len(piece) > room
        self._begun += piece[:room]

    def _end(self) -> str | None:
        """Return the text of the finished line if intact."""
        line, overrun = bytes(self._begun).removesuffix(b"\r"), self._overrun
        self._begun.clear()
        self._overrun = False
        counts = self._counts
        if not line and not overrun:
            return None
        if overrun or len(line) > MAX_LINE:
            self._counts = replace(counts, too_long=counts.too_long + 1)
        elif line.translate(None, _PRINTABLE):
            self._counts = replace(counts, wrong_character=counts.wrong_character + 1)
        elif len(line) <= _CHECKSUM or not intact(line):
            self._counts = replace(counts, wrong_checksum=counts.wrong_checksum + 1)
        else:
            self._counts = replace(counts, good=counts.good + 1)
            return line[:-_CHECKSUM].decode("ascii")
        return None


def command_line(number: int, verb: str, *arguments: str) -> bytes:
    r"""Return the line of a command.

    >>> command_line(0x1A, "PEEK", "7E")
    b'>1A,PEEK,7E*9237\n'
    """
    return seal(",".join((f">{number:02X}", verb, *arguments)))


def draft_commands(settings: ScanSettings) -> tuple[tuple[str, ...], ...]:
    """Return the commands that send a board its settings.

    Each has a verb and arguments. They run from BEGIN to COMMIT.
    """
    wiring = settings.wiring
    devices = [wiring[first : first + SWITCHES] for first in range(0, len(wiring), SWITCHES)]
    return (
        ("BEGIN", f"{len(devices):02X}", f"{len(settings.states):02X}"),
        *(("WIRE", f"{index:02X}", switches.hex().upper()) for index, switches in enumerate(devices)),
        ("SAFE", settings.safe_words.hex().upper()),
        *(("REG", f"{address:02X}", f"{value:04X}") for address, value in settings.registers),
        (
            "WAIT",
            *(f"{time:08X}" for time in (settings.wait_us, settings.timeout_us)),
            f"{settings.discard:02X}",
            f"{settings.again_us:08X}",
        ),
        *(
            ("STATE", f"{index:02X}", state.words.hex().upper(), f"{settings.drive_register(state):04X}")
            for index, state in enumerate(settings.states)
        ),
        ("COMMIT", f"{settings.hash:04X}"),
    )
