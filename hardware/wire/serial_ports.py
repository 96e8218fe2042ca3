"""Serial ports of this computer.

The module lists them, chooses a port by name or USB serial number, and opens it for this program alone.
"""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from types import ModuleType
from typing import Any, Protocol

from coilarray.compute.extras import import_extra
from coilarray.errors import HardwareError
from coilarray.hardware.wire.buses import DeviceLost, NoAnswer

try:
    import termios
except ImportError:  # Windows
    _LOSSES: tuple[type[Exception], ...] = (OSError,)
else:
    _LOSSES = (OSError, termios.error)  # pyserial does not catch the second error, which is not an OSError

BAUD = 115200
"""Baud rate of the protocol."""
BOARD_VENDORS = {0x1366: "SEGGER (J-Link of an XMC board)", 0x058B: "Infineon"}
"""USB vendors of the known boards. Ports of other boards must be named."""
_GONE: tuple[type[Exception], ...] = (*_LOSSES, TypeError)  # TypeError comes from a port that was closed meanwhile
_SERIAL_PREFIX = "usb:"
_TICK = 0.02  # s of one wait for bytes
_WRITE_TIMEOUT = 1.0  # s until a line that the device does not accept is given up
_MOST_BYTES = 4096  # read at once

_CANNOT_OPEN = {
    errno.ENOENT: "does not exist",
    errno.ENODEV: "has no device behind it",
    errno.ENXIO: "has no device behind it",
    errno.EACCES: "may not be opened by this user (on Linux: add the user to the group dialout)",
    errno.EPERM: "may not be opened by this user (on Linux: add the user to the group dialout)",
    errno.EBUSY: "is used by another program",
    errno.EAGAIN: "is used by another program",
}


@dataclass(frozen=True)
class PortInfo:
    """Serial port of this computer, described by the system.

    The name, "/dev/ttyACM0" or "COM5", opens it. A port that is not at USB has no vendor and product. The serial number
    is empty if the device has none.
    """

    name: str
    vendor: int | None
    product: int | None
    serial_number: str
    description: str

    @property
    def known(self) -> bool:
        """Whether its USB vendor makes boards known to this package."""
        return self.vendor in BOARD_VENDORS

    def __str__(self) -> str:
        numbers = "" if self.vendor is None else f" {self.vendor:04X}:{self.product or 0:04X}"
        serial_number = f" {_SERIAL_PREFIX}{self.serial_number}" if self.serial_number else ""
        return f"{self.name}{numbers}{serial_number} ({self.description})"


class BytePort(Protocol):
    """An open port to one device."""

    @property
    def name(self) -> str:
        """Name of the port, for messages."""

    def read(self, seconds: float) -> bytes:
        """Return at most 4096 received bytes.

        Without bytes it waits for at most the given time in s.
        """

    def write(self, data: bytes) -> None:
        """Send all bytes."""

    def close(self) -> None:
        """Close the port."""


def list_serial_ports() -> tuple[PortInfo, ...]:
    """Return the serial ports of this computer.

    Ports of known boards come first.
    """
    _pyserial()
    tools = import_extra("serial.tools.list_ports", "microcontroller boards", package="pyserial", extra="serial")
    ports = (
        PortInfo(port.device, port.vid, port.pid, port.serial_number or "", port.description or "")
        for port in tools.comports()
    )
    return tuple(sorted(ports, key=lambda port: (not port.known, port.name)))


def choose_serial_port(name: str | None = None) -> PortInfo:
    """Return a port by name or serial number.

    A name is "/dev/ttyACM0", "COM5" or "usb:SERIALNUMBER" with a USB serial number, whose leading zeros do not matter.
    Without a name, the only port of a known board is returned.
    """
    ports = list_serial_ports()
    if name is None:
        return _only([port for port in ports if port.known], "a port of a known board", ports)
    if not name.startswith(_SERIAL_PREFIX):
        named = [port for port in ports if port.name == name]
        return named[0] if named else PortInfo(name, None, None, "", "not listed by the system")
    number = name.removeprefix(_SERIAL_PREFIX).strip().lstrip("0")
    same = [port for port in ports if number and port.serial_number.lstrip("0") == number]
    return _only(same, f"a port of the USB serial number {name.removeprefix(_SERIAL_PREFIX)!r}", ports)


def _only(meant: list[PortInfo], what: str, ports: tuple[PortInfo, ...]) -> PortInfo:
    if len(meant) == 1:
        return meant[0]
    listed = ", ".join(str(port) for port in meant or ports) or "no serial port at all"
    found = f"there are {len(meant)}" if meant else "there is none"
    raise HardwareError(f"{what} is needed, but {found}: {listed}.")


def open_serial_port(name: str, *, baud: int = BAUD) -> BytePort:
    """Open a port for this program alone.

    The format is 8N1 without flow control.
    """
    return _SerialPort(name, baud)


def _pyserial() -> ModuleType:
    return import_extra("serial", "microcontroller boards", package="pyserial", extra="serial")


class _SerialPort:
    """A port of pyserial.

    Every error of pyserial that shows a lost device becomes DeviceLost.
    """

    def __init__(self, name: str, baud: int) -> None:
        self._library = _pyserial()
        self._name = name
        try:
            self._port: Any = self._library.Serial(
                name, baud, timeout=_TICK, write_timeout=_WRITE_TIMEOUT, exclusive=True
            )
        except ValueError as error:
            raise HardwareError(f"port {name} cannot be opened: {error}.") from None
        except _LOSSES as error:
            raise HardwareError(f"port {name} {_reason(error)}.") from None
        with suppress(*_LOSSES):  # discard earlier bytes; a port that is gone fails at the next read
            self._port.reset_input_buffer()

    @property
    def name(self) -> str:
        return self._name

    def read(self, seconds: float) -> bytes:
        with self._lost():
            waiting = self._port.in_waiting
            if waiting or seconds <= 0:
                return bytes(self._port.read(min(waiting, _MOST_BYTES)))
            first = bytes(self._port.read(1))  # waits for one tick
            return first + bytes(self._port.read(min(self._port.in_waiting, _MOST_BYTES - 1))) if first else b""

    def write(self, data: bytes) -> None:
        with self._lost():
            try:
                self._port.write(data)
            except self._library.SerialTimeoutException:
                raise NoAnswer(f"{self._name} took no bytes for {_WRITE_TIMEOUT:g} s.") from None

    def close(self) -> None:
        with suppress(Exception):
            self._port.close()

    @contextmanager
    def _lost(self) -> Iterator[None]:
        try:
            yield
        except _GONE as error:
            raise DeviceLost(f"{self._name} is gone: {error}.") from None


def _reason(error: Exception) -> str:
    number = getattr(error, "errno", None)
    if number is None and "exclusively lock" in str(error):  # pyserial 3.5 does not pass on the number of this error
        number = errno.EBUSY
    return _CANNOT_OPEN.get(number or 0, f"cannot be opened: {error}")
