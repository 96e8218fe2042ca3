"""Serial ports of this computer, listed, chosen and opened."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

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
    """An open serial port, 8N1 without flow control.

    This program alone uses it. Every error of pyserial that shows a lost device becomes DeviceLost.
    """

    def __init__(self, name: str, *, baud: int = BAUD) -> None:
        self._library = import_extra("serial", _PURPOSE, package="pyserial", extra="serial")
        self._name = name
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

    @property
    def name(self) -> str:
        """Name of the port, for messages."""
        return self._name

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
                raise NoAnswer(f"{self._name} took no bytes for {_WRITE_TIMEOUT:g} s.") from None

    def close(self) -> None:
        """Close the port, and never raise."""
        with suppress(Exception):
            self._port.close()

    @contextmanager
    def _lost(self) -> Iterator[None]:
        try:
            yield
        except _GONE as error:
            raise DeviceLost(f"{self._name} is gone: {error}.") from None
