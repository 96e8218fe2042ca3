"""Converter and switches on the buses of a Linux computer.

Such a computer is a Raspberry Pi. The buses are /dev/i2c-N and /dev/spidevN.M.
"""

from __future__ import annotations

import contextlib
import errno
import importlib
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

from coilarray.compute.extras import import_extra
from coilarray.errors import HardwareError
from coilarray.hardware.wire.buses import ShiftSettings
from coilarray.hardware.wire.faults import BusFault, BusTimeout, DeviceLost, SwitchFault

DEVICES = Path("/dev")
"""Folder of the system's devices."""
SYSTEM = Path("/sys/class/i2c-adapter")
"""Folder with the system's data about its I²C buses."""
_PURPOSE = "boards on this computer's own buses"
_GONE = {errno.ENODEV, errno.ENOENT, errno.EBADF, errno.ESHUTDOWN}
_HELD_UP = {errno.ETIMEDOUT, errno.EAGAIN, errno.EBUSY}
_START_BYTE = 0x00  # as a read: nine clocks that no chip may acknowledge


def linux_buses() -> tuple[str, ...]:
    """Return the names of the buses of this computer.

    They have the form ``i2c:1`` and ``spi:0.0``. The result is empty on another system.
    """
    i2c = [f"i2c:{path.name.removeprefix('i2c-')}" for path in DEVICES.glob("i2c-*")]
    spi = [f"spi:{path.name.removeprefix('spidev')}" for path in DEVICES.glob("spidev*")]
    return (*sorted(i2c), *sorted(spi))


def i2c_clock(bus: int) -> float | None:
    """Return the clock of a computer's I²C bus in Hz.

    It is read from the device tree, and None if it is not set there. The property is a 32-bit number, most significant
    byte first, as every number in a device tree.
    """
    for node in ("of_node", "device/of_node"):
        with contextlib.suppress(OSError):
            held = (SYSTEM / f"i2c-{bus}" / node / "clock-frequency").read_bytes()
            if len(held) == 4 and any(held):
                return float(int.from_bytes(held, "big"))
    return None


class LinuxRegisterBus:
    """A `RegisterBus` through the kernel's I²C, /dev/i2c-N.

    This program alone may use it while it is open. A HardwareError is raised for a bus that is missing, may not be
    opened, is used by another program or lacks a needed function. A MissingDependencyError is raised without smbus2.
    """

    def __init__(self, bus: int, address: int) -> None:
        self._library = import_extra("smbus2", _PURPOSE, package="smbus2", extra="linux")
        self._address = address
        self._path = DEVICES / f"i2c-{bus}"
        with _opening(self._path):
            self._bus: Any = self._library.SMBus(str(self._path))
        try:
            with _opening(self._path):
                _lock(self._bus.fd)
            if not self._bus.funcs & self._library.I2cFunc.I2C:
                raise HardwareError(f"{self._path} cannot read registers of 16 bits: it is not a full I²C bus.")
        except BaseException:
            self.close()
            raise

    def read(self, register: int) -> int:
        """Return a register."""
        message = self._library.i2c_msg
        answer = message.read(self._address, 2)
        self._transfer(message.write(self._address, [register]), answer)
        return int.from_bytes(bytes(answer), "big")

    def write(self, register: int, value: int) -> None:
        """Write a register."""
        self._transfer(self._library.i2c_msg.write(self._address, [register, *value.to_bytes(2, "big")]))

    def clear(self) -> None:
        """Send nine clocks and a stop.

        The kernel frees a bus that a chip holds, if its driver can.
        """
        with contextlib.suppress(BusFault):  # no chip answers to this
            self._transfer(self._library.i2c_msg.read(_START_BYTE, 1))

    def close(self) -> None:
        """Close the bus. Never raises."""
        with contextlib.suppress(Exception):
            self._bus.close()

    def _transfer(self, *messages: Any) -> None:
        """Transfer messages and translate the system's errors."""
        try:
            self._bus.i2c_rdwr(*messages)
        except OSError as error:
            where = f"the converter at {self._address:#04x} on {self._path}"
            if error.errno in _GONE:
                raise DeviceLost(f"{self._path} is gone: {error.strerror}.") from None
            if error.errno in _HELD_UP:
                raise BusTimeout(f"{where} holds up the bus: {error.strerror}.") from None
            raise BusFault(f"{where} does not answer: {error.strerror}.") from None


class SpiSwitchChain:
    """A `SwitchChain` through the kernel's SPI, /dev/spidevN.M.

    Its chip select is SYNC. A HardwareError is raised for a port that is missing, may not be opened or has no such mode
    or speed. A MissingDependencyError is raised without spidev.
    """

    def __init__(self, bus: int, device: int, settings: ShiftSettings) -> None:
        library: ModuleType = import_extra("spidev", _PURPOSE, package="spidev", extra="linux")
        self._settings = settings
        self._path = DEVICES / f"spidev{bus}.{device}"
        self._port: Any = library.SpiDev()
        try:
            with _opening(self._path):
                self._port.open_path(str(self._path))
                self._port.mode, self._port.bits_per_word = settings.mode, 8
                self._port.max_speed_hz = round(settings.speed)
        except BaseException:
            self.close()
            raise

    def shift(self, words: bytes) -> bytes | None:
        """Send the words while SYNC is low.

        The rise of SYNC latches them.
        """
        try:
            returned = self._port.xfer2(list(self._settings.ordered(words)))
        except OSError as error:
            if error.errno in _GONE:
                raise DeviceLost(f"{self._path} is gone: {error.strerror}.") from None
            raise SwitchFault(f"{self._path} could not send to the switches: {error.strerror}.") from None
        return self._settings.ordered(bytes(returned)) if self._settings.readback else None

    def close(self) -> None:
        """Close the port. Never raises."""
        with contextlib.suppress(Exception):
            self._port.close()


def _lock(descriptor: int) -> None:
    """Lock out a second program of this package.

    Two programs that read the converter in turn would corrupt each other's results.
    """
    fcntl = importlib.import_module("fcntl")  # missing on Windows, which has no such bus either
    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


@contextlib.contextmanager
def _opening(path: Path) -> Iterator[None]:
    """Translate the system's errors about a device into one line."""
    try:
        yield
    except FileNotFoundError:
        there = ", ".join(linux_buses()) or "none at all"
        raise HardwareError(f"there is no {path}; ports of this kind: {there}.") from None
    except PermissionError:
        raise HardwareError(
            f"{path} may not be opened by this user; add the user to the group {_group(path)}."
        ) from None
    except BlockingIOError:
        raise HardwareError(f"{path} is used by another program.") from None
    except OSError as error:
        raise HardwareError(f"{path} cannot be used: {error.strerror}.") from None


def _group(path: Path) -> str:
    try:
        return path.group()
    except (OSError, KeyError, NotImplementedError):
        return "that owns it"
