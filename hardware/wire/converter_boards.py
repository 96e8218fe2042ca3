"""Boards whose coils are wired straight to converter channels.

They are known boards, and boards that options describe.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import MappingProxyType

from coilarray.errors import HardwareError
from coilarray.hardware.chips.converters import CONVERTERS, Converter, converter
from coilarray.hardware.chips.ldc1614 import EXTERNAL_CLOCK_RANGE

_UNITS = MappingProxyType({"mhz": 1e6, "khz": 1e3, "hz": 1.0})


@dataclass(frozen=True)
class ChannelBoard:
    """A converter whose coils are wired to its channels.

    Parameters
    ----------
    converter : Converter
        Type of the converter.
    channels : tuple of int
        Channels with coils, in the order of the coils.
    clock : float or None
        Clock at its pin CLKIN in Hz. None for its own oscillator.
    title : str
        Description of a known board. Empty for a board that options describe.
    address : int
        I²C address.
    source : str
        Source of its values, which are not verified on a device.
    """

    converter: Converter
    channels: tuple[int, ...]
    clock: float | None = None
    title: str = ""
    address: int = 0x2A
    source: str = ""

    @property
    def text(self) -> str:
        """Description in one line for people."""
        clock = "its own oscillator" if self.clock is None else f"{self.clock * 1e-6:g} MHz at CLKIN"
        name = f"{self.title}: " if self.title else ""
        plural = "s" if len(self.channels) > 1 else ""
        return f"{name}{self.converter.name}, channel{plural} {', '.join(map(str, self.channels))}, {clock}"


_LDC1612, _LDC1614 = CONVERTERS["LDC1612"], CONVERTERS["LDC1614"]
_PRINTER = (
    "clock and address: public firmware of 3-D printers; its I²C needs soldered wires, its clock may need firmware"
)
BOARDS = MappingProxyType({
    "grove-ldc1612": ChannelBoard(
        _LDC1612, (0, 1), 40e6, "Grove 2-channel inductive sensor", 0x2B,
        "address and clock: the maker's library for Arduino",
    ),
    "btt-eddy": ChannelBoard(_LDC1612, (0,), 12e6, "BTT Eddy", 0x2A, _PRINTER),
    "cartographer": ChannelBoard(_LDC1612, (0,), 24e6, "Cartographer", 0x2A, _PRINTER),
    "mellow-fly": ChannelBoard(_LDC1612, (0,), 40e6, "Mellow Fly Eddy", 0x2A, _PRINTER),
    "ldc1614evm": ChannelBoard(
        _LDC1614, (0, 1, 2, 3), 40e6, "LDC1614EVM", 0x2A,
        "clock: answers of the maker in a public forum",
    ),
})  # fmt: skip
"""Known boards by the name of the option ``board``."""


def channel_board(options: dict[str, str]) -> ChannelBoard | None:
    """Take a channel board from the options of a port.

    None is returned if no option describes such a board. The options are ``board=grove-ldc1612``, or ``channels=0,1``
    with ``chip=LDC1612`` (LDC1614 by default) and ``clock=40MHz`` (at CLKIN; ``internal`` by default). Given with a
    board they change it. An invalid value raises a HardwareError.

    >>> channel_board({"channels": "0,1", "clock": "40MHz"}).text
    'LDC1614, channels 0, 1, 40 MHz at CLKIN'
    """
    if not {"board", "channels"} & options.keys():
        return None
    name = options.pop("board", None)
    if name is not None and name.lower() not in BOARDS:
        raise HardwareError(f"board must be {', '.join(BOARDS)}; got {name[:40]!r}")
    known = ChannelBoard(_LDC1614, ()) if name is None else BOARDS[name.lower()]
    changed = [] if name is None else [key for key in ("chip", "channels", "clock") if key in options]
    chip = converter(options.pop("chip")) if "chip" in options else known.converter
    channels = _channels(options.pop("channels"), chip) if "channels" in options else known.channels
    clock = _clock(options.pop("clock")) if "clock" in options else known.clock
    if any(channel >= chip.channels for channel in channels):
        raise HardwareError(f"an {chip.name} has the channels 0 to {chip.channels - 1}; got {max(channels)}")
    source = f"{known.source}; given with the port instead: {', '.join(changed)}" if changed else known.source
    return ChannelBoard(chip, channels, clock, known.title, known.address, source)


def _channels(text: str, chip: Converter) -> tuple[int, ...]:
    """Read the channel numbers of an option."""
    parts = text.split(",")
    if not all(part.isdecimal() and part.isascii() and len(part) == 1 for part in parts):
        raise HardwareError(f"channels must be numbers from 0 to {chip.channels - 1}, as 0,1; got {text[:40]!r}")
    channels = tuple(map(int, parts))
    if len(set(channels)) < len(channels):
        raise HardwareError(f"channels must be named once each; got {text[:40]!r}")
    return channels


def _clock(text: str) -> float | None:
    """Read ``internal``, or a CLKIN frequency with its unit."""
    if text.lower() == "internal":
        return None
    low, high = EXTERNAL_CLOCK_RANGE
    number = text.lower().rstrip("mkhz")
    unit = _UNITS.get(text.lower()[len(number) :])
    try:
        clock = float(number) * (math.nan if unit is None else unit)
    except ValueError:
        clock = math.nan
    if not low <= clock <= high:
        raise HardwareError(
            f"clock must be internal, or {low * 1e-6:g}MHz to {high * 1e-6:g}MHz at CLKIN; got {text[:40]!r}"
        )
    return clock
