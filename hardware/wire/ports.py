"""Ports of boards by name, and the serial ports of this computer, listed, chosen and opened."""

from __future__ import annotations

import errno
import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qsl

from coilarray.compute.extras import import_extra
from coilarray.errors import HardwareError, MissingDependencyError
from coilarray.hardware.chips.ldc1614 import BUS_RATE, CHANNELS, EXTERNAL_CLOCK_RANGE
from coilarray.hardware.wire import buses

try:
    import termios
except ImportError:  # Windows
    _LOSSES: tuple[type[Exception], ...] = (OSError,)
else:
    _LOSSES = (OSError, termios.error)  # pyserial does not catch the second error, which is not an OSError

BAUD = 115200  # baud rate of the protocol
_GONE: tuple[type[Exception], ...] = (*_LOSSES, TypeError)  # TypeError comes from a port that was closed meanwhile
_SERIAL_PREFIX = "usb:"
_PURPOSE = "microcontroller boards"
_TICK = 0.02  # s of one wait for bytes
_WRITE_TIMEOUT = 1.0  # s until a line that the device does not accept is given up
_MOST_BYTES = 4096  # read at once
_NOT_ALLOWED = "may not be opened by this user (on Linux: add the user to the group dialout)"
_CANNOT_OPEN = {
    errno.ENOENT: "does not exist",
    errno.EACCES: _NOT_ALLOWED,
    errno.EPERM: _NOT_ALLOWED,
    errno.EBUSY: "is used by another program",
    errno.EAGAIN: "is used by another program",
}


@dataclass(frozen=True)
class PortInfo:
    """Serial port, with any USB serial number, of this computer."""

    name: str
    serial_number: str
    text: str


def list_serial_ports() -> tuple[PortInfo, ...]:
    """Return the serial ports of this computer."""
    for module in ("serial", "serial.tools.list_ports"):
        tools = import_extra(module, _PURPOSE, package="pyserial", extra="serial")
    found = []
    for port in sorted(tools.comports(), key=lambda port: port.device):
        numbers = "" if port.vid is None else f" {port.vid:04X}:{port.pid or 0:04X}"
        serial_number = f" {_SERIAL_PREFIX}{port.serial_number}" if port.serial_number else ""
        text = f"{port.device}{numbers}{serial_number} ({port.description or ''})"
        found.append(PortInfo(port.device, port.serial_number or "", text))
    return tuple(found)


def choose_serial_port(name: str) -> PortInfo:
    """Return a port by name or USB serial number."""
    ports = list_serial_ports()
    if not name.startswith(_SERIAL_PREFIX):
        return next((port for port in ports if port.name == name), PortInfo(name, "", name))
    number = name.removeprefix(_SERIAL_PREFIX).strip()
    same = [port for port in ports if number.lstrip("0") and port.serial_number.lstrip("0") == number.lstrip("0")]
    if len(same) == 1:
        return same[0]
    there = ", ".join(port.text for port in same or ports) or "no serial port at all"
    found = f"there are {len(same)}" if same else "there is none"
    raise HardwareError(f"a port of the USB serial number {number!r} is needed, but {found}: {there}.")


class OpenSerialPort:
    """A serial port of this program alone, 8N1 without flow control."""

    def __init__(self, name: str, *, baud: int = BAUD) -> None:
        self._library = import_extra("serial", _PURPOSE, package="pyserial", extra="serial")
        self.name = name
        try:
            self._port: Any = self._library.Serial(
                name, baud, timeout=_TICK, write_timeout=_WRITE_TIMEOUT, exclusive=True
            )
        except ValueError as error:
            raise HardwareError(f"port {name} cannot be opened: {error}.") from None
        except _LOSSES as error:
            reason = _CANNOT_OPEN.get(getattr(error, "errno", None) or 0, f"cannot be opened: {error}")
            raise HardwareError(f"port {name} {reason}.") from None
        with suppress(*_LOSSES):  # discard earlier bytes. A port that is gone fails at the next read
            self._port.reset_input_buffer()

    def read(self, seconds: float) -> bytes:
        """Return at most 4096 bytes, received in `seconds`."""
        with self._lost():
            waiting = self._port.in_waiting
            if waiting or seconds <= 0:
                return bytes(self._port.read(min(waiting, _MOST_BYTES)))
            first = bytes(self._port.read(1))  # waits for one tick
            return first + bytes(self._port.read(min(self._port.in_waiting, _MOST_BYTES - 1))) if first else b""

    def write(self, data: bytes) -> None:
        """Send all bytes."""
        with self._lost():
            try:
                self._port.write(data)
            except self._library.SerialTimeoutException:
                raise buses.NoAnswer(f"{self.name} took no bytes for {_WRITE_TIMEOUT:g} s.") from None

    def close(self) -> None:
        """Close the port, and never raise."""
        with suppress(Exception):
            self._port.close()

    @contextmanager
    def _lost(self) -> Iterator[None]:
        try:
            yield
        except _GONE as error:
            raise buses.DeviceLost(f"{self.name} is gone: {error}.") from None


EMULATOR = "emulator"  # name of the port of the emulated board
ADDRESSES = (0x2A, 0x2B)  # I²C addresses of the converter, with its pin ADDR low and high
_FIRMWARE_BUS_RATE = 150e3  # Hz, expected: hardware/firmware/README.md
_LINUX_BUS_RATE = 100e3  # Hz, of a bus without a clock set by the system: standard mode, as on a Raspberry Pi
_LONGEST = 200  # characters shown of a port's name
_LARGEST_BAUD = 10_000_000
_ALLOWED = (
    "emulator, a serial port (/dev/ttyACM0, COM5 or usb:SERIALNUMBER), i2c:BUS[:ADDRESS][,spi:BUS.DEVICE] or "
    "ftdi://ftdi:232h[:SERIALNUMBER]/1"
)
_SERIAL = re.compile(r"/dev/\S+|COM\d{1,3}|usb:\S+", re.IGNORECASE)
_LINUX = re.compile(r"i2c:(\d{1,3})(?::(0x[0-9a-f]{1,2}|\d{1,3}))?(?:,spi:(\d{1,3})\.(\d{1,3}))?", re.IGNORECASE)
_FTDI = re.compile(r"ftdi://[^/]+/[1-4]", re.IGNORECASE)
_CLOCK = re.compile(r"(\d+(?:\.\d*)?)(M|k|)Hz", re.IGNORECASE)
_UNITS = {"m": 1e6, "k": 1e3, "": 1.0}


@dataclass(frozen=True)
class ChannelBoard:
    """A converter whose coils are wired to its channels."""

    channels: tuple[int, ...]  # channels with coils, in the order of the coils
    clock: float | None = None  # clock at its pin CLKIN in Hz. None for its own oscillator


@dataclass(frozen=True)
class EmulatorPort:
    """Port of the emulator."""

    board: ChannelBoard | None = None


@dataclass(frozen=True)
class SerialPort:
    """A microcontroller."""

    name: str  # for `coilarray.hardware.wire.ports.choose_serial_port`
    baud: int = BAUD
    board: None = None  # the firmware has switches


@dataclass(frozen=True)
class LinuxPort:
    """Buses of this computer by their numbers."""

    bus: int
    address: int = ADDRESSES[0]
    spi_bus: int = 0
    spi_device: int = 0
    mode: int = buses.SPI_MODE
    readback: bool = False  # whether the end of the chain of switches is wired back
    board: ChannelBoard | None = None


@dataclass(frozen=True)
class FtdiPort:
    """An FT232H at USB, by its URL for pyftdi."""

    url: str
    address: int = ADDRESSES[0]
    mode: int = buses.SPI_MODE
    readback: bool = False
    board: ChannelBoard | None = None


Port = EmulatorPort | SerialPort | LinuxPort | FtdiPort


def parse_port(text: str) -> Port:
    """Read the name of a port.

    A name is ``emulator``, a serial port ``/dev/ttyACM0``, ``COM5`` or ``usb:SERIALNUMBER`` with
    ``?baud=9600``, buses ``i2c:1`` or ``i2c:1:0x2B,spi:0.1``, or an adapter ``ftdi://ftdi:232h/1``,
    also with ``address=0x2B``. Options of switches are ``?mode=2&readback=yes`` (SPI mode, end of
    the chain wired back). Without switches there are channels and the clock at the pin CLKIN.

    >>> parse_port("i2c:1:0x2B").address == 0x2B
    True
    >>> parse_port("i2c:1?channels=0,1&clock=40MHz").board
    ChannelBoard(channels=(0, 1), clock=40000000.0)
    """
    try:
        return _parse(text.strip())
    except ValueError as error:
        raise HardwareError(f"port {text[:_LONGEST]!r} is not valid: {error}.") from None


def _parse(text: str) -> Port:
    name, question_mark, query = text.partition("?")
    options: dict[str, str] = {}
    if question_mark:
        pairs = parse_qsl(query, keep_blank_values=True)
        options = dict(pairs)
        if not pairs or "=" not in query:
            raise ValueError("options after ? are KEY=VALUE, joined by &")
        if len(options) < len(pairs):
            raise ValueError("an option is given twice")
    port: Port
    if name == EMULATOR:
        port = EmulatorPort(_channel_board(options))
    elif _SERIAL.fullmatch(name):
        port = SerialPort(name, _integer(options.pop("baud", str(BAUD)), "baud", 1, _LARGEST_BAUD))
    elif linux := _LINUX.fullmatch(name):
        bus, address, spi_bus, spi_device = linux.groups()
        place = int(bus), _address(address), int(spi_bus or 0), int(spi_device or 0)
        if (board := _channel_board(options)) is None:
            port = LinuxPort(*place, **_shift(options))
        elif spi_bus is not None:
            raise ValueError("coils at the channels of a converter have no switches, and no spi")
        else:
            port = LinuxPort(*place, board=board)
    elif _FTDI.fullmatch(name):
        at, board = _address(options.pop("address", None)), _channel_board(options)
        port = FtdiPort(name, at, **_shift(options)) if board is None else FtdiPort(name, at, board=board)
    else:
        raise ValueError(f"it must be {_ALLOWED}")
    if options:  # remaining options
        raise ValueError(f"there is no option {next(iter(options))!r} of this port")
    return port


def _channel_board(options: dict[str, str]) -> ChannelBoard | None:
    if "channels" not in options:
        if "clock" in options:
            raise ValueError("clock needs channels=")
        return None
    text, clock = options.pop("channels"), options.pop("clock", None)
    if not re.fullmatch(rf"[0-{CHANNELS - 1}](,[0-{CHANNELS - 1}])*", text):
        raise ValueError(f"channels must be numbers from 0 to {CHANNELS - 1}, as 0,1; got {text[:40]!r}")
    channels = tuple(map(int, text.split(",")))
    if len(set(channels)) < len(channels):
        raise ValueError(f"channels must be named once each; got {text[:40]!r}")
    if clock is None:
        return ChannelBoard(channels)
    low, high = EXTERNAL_CLOCK_RANGE
    match = _CLOCK.fullmatch(clock)
    hertz = float(match[1]) * _UNITS[match[2].lower()] if match else math.nan
    if not low <= hertz <= high:
        raise ValueError(f"clock must be {low * 1e-6:g}MHz to {high * 1e-6:g}MHz, at CLKIN; got {clock[:40]!r}")
    return ChannelBoard(channels, hertz)


def _shift(options: dict[str, str]) -> dict[str, Any]:
    """Take the options of the transfers to the switches."""
    given: dict[str, Any] = {}
    if "mode" in options:
        given["mode"] = _integer(options.pop("mode"), "mode", 0, 3)
    if "readback" in options:
        answer = options.pop("readback")
        if answer not in ("yes", "no"):
            raise ValueError("readback must be yes or no")
        given["readback"] = answer == "yes"
    return given


def _address(text: str | None) -> int:
    address = ADDRESSES[0] if text is None else _integer(text, "address", 0, 0x7F)
    if address not in ADDRESSES:
        raise ValueError(f"the address of the converter must be {' or '.join(map(hex, ADDRESSES))}")
    return address


def _integer(text: str, key: str, low: int, high: int) -> int:
    try:
        value = int(text[:20], 0)
    except ValueError:
        value = low - 1
    if not low <= value <= high:
        raise ValueError(f"{key} must be a whole number from {low} to {high}; got {text[:40]!r}")
    return value


def bus_rate(port: Port) -> float:
    """Return the clock of a board's I²C bus in Hz."""
    match port:
        case SerialPort():
            return _FIRMWARE_BUS_RATE
        case FtdiPort():
            return buses.I2C_SPEED
        case LinuxPort():
            return buses.i2c_clock(port.bus) or _LINUX_BUS_RATE
    return BUS_RATE


def found_ports() -> Mapping[str, tuple[str, ...]]:
    """Return the ports of this computer by kind."""
    try:
        serial = tuple(port.text for port in list_serial_ports())
    except MissingDependencyError:  # without pyserial
        serial = ()
    return {EMULATOR: (EMULATOR,), "serial": serial, "linux": buses.linux_buses(), "ftdi": buses.ft232h_adapters()}
