"""Names of board ports, the ports of this computer, and known boards without switches."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, NamedTuple
from urllib.parse import parse_qsl, urlsplit

from coilarray.errors import HardwareError, MissingDependencyError
from coilarray.hardware.chips.ldc1614 import (
    BUS_RATE,
    CONVERTERS,
    EXTERNAL_CLOCK_RANGE,
    SLOWEST_BUS_RATE,
    Converter,
    converter,
)
from coilarray.hardware.wire.buses import ShiftSettings
from coilarray.hardware.wire.direct_buses import I2C_SPEED, SwitchPins, ft232h_adapters, i2c_clock, linux_buses
from coilarray.hardware.wire.serial_ports import BAUD, PROBED_BAUDS, list_serial_ports

_UNITS = MappingProxyType({"mhz": 1e6, "khz": 1e3, "hz": 1.0})


@dataclass(frozen=True)
class ChannelBoard:
    """A converter whose coils are wired to its channels."""

    converter: Converter  # type of the converter
    channels: tuple[int, ...]  # channels with coils, in the order of the coils
    clock: float | None = None  # clock at its pin CLKIN in Hz. None for its own oscillator
    title: str = ""  # description of a known board. Empty for a board that options describe
    address: int = 0x2A  # I²C address
    source: str = ""  # source of its values, which are not verified on a device

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
    board they change it.

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


EMULATOR = "emulator"
"""Name of the port of the emulated board."""
ADDRESSES = (0x2A, 0x2B)
"""I²C addresses of the converter, with its pin ADDR low and high."""
_FIRMWARE_BUS_RATE = 150e3  # Hz, expected: hardware/firmware/README.md
_LINUX_BUS_RATE = 100e3  # Hz, of a bus without a clock set by the system: standard mode, as on a Raspberry Pi
_LONGEST = 200  # characters shown of a port's name
_MOST_OPTIONS = 20
_LARGEST_BAUD = 10_000_000
_ALLOWED = (
    "emulator, a serial port (/dev/ttyACM0, COM5 or usb:SERIALNUMBER), i2c:BUS[:ADDRESS][,spi:BUS.DEVICE] or ftdi://…/1"
)
_SERIAL = re.compile(r"/dev/\S+|COM\d{1,3}|usb:\S+", re.IGNORECASE)
_LINUX = re.compile(r"i2c:(\d{1,3})(?::(0x[0-9a-f]{1,2}|\d{1,3}))?(?:,spi:(\d{1,3})\.(\d{1,3}))?", re.IGNORECASE)
_SPI_IN_OPTIONS = re.compile(r",spi:[^,&]*", re.IGNORECASE)
_FTDI_PATH = re.compile(r"/[1-4]")


@dataclass(frozen=True)
class EmulatorPort:
    """Port of the emulator."""

    board: ChannelBoard | None = None


@dataclass(frozen=True)
class SerialPort:
    """A microcontroller."""

    name: str  # for `coilarray.hardware.wire.serial_ports.choose_serial_port`
    bauds: tuple[int, ...] = (BAUD,)  # to try in turn


@dataclass(frozen=True)
class LinuxPort:
    """Buses of this computer by their numbers."""

    bus: int
    address: int = ADDRESSES[0]
    spi_bus: int = 0
    spi_device: int = 0
    shift: ShiftSettings = field(default_factory=ShiftSettings)
    rate: float | None = None  # clock of the I²C bus in Hz, if the user states it
    board: ChannelBoard | None = None


@dataclass(frozen=True)
class FtdiPort:
    """An FT232H at USB, by its URL for pyftdi."""

    url: str
    address: int = ADDRESSES[0]
    pins: SwitchPins = field(default_factory=SwitchPins)
    shift: ShiftSettings = field(default_factory=ShiftSettings)
    board: ChannelBoard | None = None


Port = EmulatorPort | SerialPort | LinuxPort | FtdiPort


def parse_port(text: str) -> Port:
    """Read the name of a port.

    A name is ``emulator``, a serial port ``/dev/ttyACM0``, ``COM5`` or ``usb:SERIALNUMBER``, buses ``i2c:1`` or
    ``i2c:1:0x2B,spi:0.1``, or an adapter ``ftdi://ftdi:232h/1``. A serial port may have ``?baud=9600``, or
    ``?baud=any`` if the board's rate is not known. The firmware has 115200. The last two may have options after a
    ``?``, joined by ``&``: ``mode=2`` (SPI), ``speed=500000`` (in Hz), ``order=lsb``, ``readback=yes`` (the end of the
    chain of switches is wired back). ``i2c`` also has ``rate=400000`` (clock of the I²C bus in Hz), and ``ftdi`` has
    ``address=0x2B``, ``clock=0``, ``data=1``, ``sync=2``, ``back=3`` (pins C0 to C7 of the switches).

    Without switches, with coils at the channels of the converter, these two and the emulator have instead the options
    ``channels=0,1``, ``chip=LDC1612`` and ``clock=40MHz`` (at the pin CLKIN), or ``board=grove-ldc1612``, as
    `channel_board` reads them.

    >>> parse_port("i2c:1:0x2B").address == 0x2B
    True
    >>> parse_port("i2c:1?board=grove-ldc1612").board.channels
    (0, 1)
    """
    name, question_mark, query = text.strip().partition("?")
    if _SPI_IN_OPTIONS.search(query):
        raise _refused(text, "spi comes before the options, as i2c:1,spi:0.0?mode=1")
    options = _options(query, text) if question_mark else {}
    port: Port
    if name == EMULATOR:
        port = EmulatorPort(_board(options, text))
    elif _SERIAL.fullmatch(name):
        port = SerialPort(name, _bauds(options, text))
    elif linux := _LINUX.fullmatch(name):
        port = _linux_port(linux, options, text)
    elif name.lower().startswith("ftdi://"):
        port = _ftdi_port(name, options, text)
    else:
        raise _refused(text, f"it must be {_ALLOWED}")
    if options.keys() & {"chip", "clock"} and not isinstance(port, SerialPort):
        raise _refused(text, "chip and clock need channels= or board=")
    if options:  # remaining options
        raise _refused(text, f"there is no option {next(iter(options))!r}")
    return port


def board_of(port: Port) -> ChannelBoard | None:
    """Return the converter board of a port without switches."""
    return None if isinstance(port, SerialPort) else port.board


class BusRate(NamedTuple):
    """Clock of an I²C bus in Hz."""

    hertz: float
    known: bool = True


def bus_rate(port: Port) -> BusRate:
    """Return the clock of a board's I²C bus.

    It is 150 kHz with the firmware of `hardware/firmware`, 100 kHz with an FT232H, and 400 kHz with the emulator. A bus
    of this computer has the clock that the system has set. If the system sets no clock, it is 100 kHz and not known.
    """
    match port:
        case SerialPort():
            return BusRate(_FIRMWARE_BUS_RATE)
        case FtdiPort():
            return BusRate(I2C_SPEED)
        case LinuxPort():
            clock = port.rate or i2c_clock(port.bus)
            return BusRate(_LINUX_BUS_RATE, known=False) if clock is None else BusRate(clock)
    return BusRate(BUS_RATE)


def found_ports() -> Mapping[str, tuple[str, ...]]:
    """Return the ports of this computer by kind."""
    return {EMULATOR: (EMULATOR,), "serial": _serial_ports(), "linux": linux_buses(), "ftdi": ft232h_adapters()}


def _serial_ports() -> tuple[str, ...]:
    """Return the serial ports, none without pyserial."""
    try:
        return tuple(map(str, list_serial_ports()))
    except MissingDependencyError:
        return ()


def _linux_port(match: re.Match[str], options: dict[str, str], text: str) -> LinuxPort:
    """Make a port of Linux from its name and options."""
    bus, address, spi_bus, spi_device = match.groups()
    board, rate = _board(options, text), _stated_rate(options, text)
    if board is None:
        where = int(bus), _address(address, text), int(spi_bus or 0), int(spi_device or 0)
        return LinuxPort(*where, _shift(options, text), rate)
    if spi_bus is not None:
        raise _refused(text, "coils at the channels of a converter have no switches, and no spi")
    return LinuxPort(int(bus), _address(address, text, board.address), rate=rate, board=board)


def _ftdi_port(name: str, options: dict[str, str], text: str) -> FtdiPort:
    """Make a port at USB from its name and options."""
    try:
        parts = urlsplit(name)
    except ValueError as error:  # as of ftdi://[
        raise _refused(text, f"{error}") from None
    if not parts.netloc or not _FTDI_PATH.fullmatch(parts.path):
        raise _refused(text, "an adapter is named as ftdi://ftdi:232h/1 or ftdi://ftdi:232h:SERIALNUMBER/1")
    board = _board(options, text)
    address = _address(options.pop("address", None), text, ADDRESSES[0] if board is None else board.address)
    if board is not None:
        return FtdiPort(name, address, board=board)
    pins = {key: _number(options, key, text) for key in ("clock", "data", "sync", "back") if key in options}
    return FtdiPort(name, address, SwitchPins(**pins), _shift(options, text))


def _board(options: dict[str, str], text: str) -> ChannelBoard | None:
    """Take the options of a board without switches."""
    try:
        return channel_board(options)
    except HardwareError as error:
        raise _refused(text, str(error).rstrip(".")) from None


def _options(query: str, text: str) -> dict[str, str]:
    """Split the options after the question mark."""
    try:
        pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=True, max_num_fields=_MOST_OPTIONS)
    except ValueError:
        pairs = []
    if not pairs:
        raise _refused(text, "options after ? are KEY=VALUE, joined by &")
    options = dict(pairs)
    if len(options) < len(pairs):
        raise _refused(text, "an option is given twice")
    return options


def _bauds(options: dict[str, str], text: str) -> tuple[int, ...]:
    """Take the baud rates to try from the options."""
    given = options.pop("baud", str(BAUD))
    if given == "any":
        return PROBED_BAUDS
    if not (given.isdecimal() and given.isascii() and 0 < int(given[:8]) <= _LARGEST_BAUD):
        raise _refused(text, f"baud must be 1 to {_LARGEST_BAUD}, or any")
    return (int(given),)


def _shift(options: dict[str, str], text: str) -> ShiftSettings:
    """Take the options of the transfers to the switches."""
    given: dict[str, Any] = {}
    if "mode" in options:
        given["mode"] = _number(options, "mode", text)
    if "speed" in options:
        given["speed"] = float(_number(options, "speed", text))
    if "order" in options:
        given["least_significant_first"] = _choice(options, "order", {"msb": False, "lsb": True}, text)
    if "readback" in options:
        given["readback"] = _choice(options, "readback", {"no": False, "yes": True}, text)
    return ShiftSettings(**given)


def _stated_rate(options: dict[str, str], text: str) -> float | None:
    """Take the clock of the I²C bus from the options."""
    if "rate" not in options:
        return None
    low, high = SLOWEST_BUS_RATE, BUS_RATE
    try:
        rate = float(options.pop("rate"))
    except ValueError:
        rate = math.nan
    if not low <= rate <= high:
        raise _refused(text, f"rate must be {low:.0f} to {high:.0f} Hz, as the converter allows")
    return rate


def _address(given: str | None, text: str, default: int = ADDRESSES[0]) -> int:
    address = default if given is None else _integer(given, "address", text)
    if address not in ADDRESSES:
        raise _refused(text, f"the address of the converter must be {' or '.join(map(hex, ADDRESSES))}")
    return address


def _number(options: dict[str, str], key: str, text: str) -> int:
    return _integer(options.pop(key), key, text)


def _integer(given: str, key: str, text: str) -> int:
    try:
        return int(given, 0)
    except ValueError:
        raise _refused(text, f"{key} must be a whole number") from None


def _choice(options: dict[str, str], key: str, values: Mapping[str, bool], text: str) -> bool:
    given = options.pop(key)
    if given not in values:
        raise _refused(text, f"{key} must be {' or '.join(values)}")
    return values[given]


def _refused(text: str, reason: str) -> HardwareError:
    return HardwareError(f"port {text[:_LONGEST]!r} is not valid: {reason}.")
