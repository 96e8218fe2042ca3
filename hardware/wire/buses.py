"""Buses of a driver, with their errors, on this computer, and ending signals.

A Linux computer, such as a Raspberry Pi, has /dev/i2c-N and /dev/spidevN.M. An FT232H (or FT2232H)
has a single engine for serial buses, which I²C uses. Therefore its switches get clock and data from
the pins C0 to C2 of the second port, level by level, and C3 reads the end of their chain. All
levels of a transfer go over USB at once.
"""

from __future__ import annotations

import contextlib
import errno
import importlib
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import FrameType, ModuleType
from typing import Any, Protocol

from coilarray.compute.extras import import_extra
from coilarray.errors import HardwareError, MissingDependencyError


class DeviceLost(HardwareError):  # noqa: N818 - the field's words
    """The port is gone."""


class NoAnswer(HardwareError):  # noqa: N818
    """No valid message came in time."""


class NotABoard(HardwareError):  # noqa: N818
    """The received bytes have no valid record."""


class VersionMismatch(HardwareError):  # noqa: N818
    """The board has another major version of the protocol."""


class CommandRefused(HardwareError):  # noqa: N818
    """The board answered a command with an error."""


class BoardRestarted(HardwareError):  # noqa: N818
    """The board or its converter was reset while measuring."""


class BusFault(HardwareError):  # noqa: N818
    """A chip does not answer or returns wrong values."""


class SwitchFault(HardwareError):  # noqa: N818
    """Switches do not follow their words."""


class BusTimeout(BusFault):
    """A chip or the bus delays a transfer too long."""


_ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
_EXIT_CODE = 128  # plus the number of the signal, as a shell reports it
Handler = Callable[[int, FrameType | None], Any]


@contextlib.contextmanager
def held_signals() -> Iterator[None]:
    """Delay ending signals within a block of the main thread."""
    came: list[int] = []
    try:
        with _handled(lambda number, _: came.append(number), instead_of_any=True):
            yield
    finally:
        for number in came:
            signal.raise_signal(number)


@contextlib.contextmanager
def orderly_termination() -> Iterator[None]:
    """Raise SystemExit on SIGTERM, or when the terminal is closed."""

    def leave(number: int, _: FrameType | None) -> None:
        raise SystemExit(_EXIT_CODE + number)

    with _handled(leave, instead_of_any=False):
        yield


@contextlib.contextmanager
def _handled(handler: Handler, *, instead_of_any: bool) -> Iterator[None]:
    """Handle signals without another handler, or with `instead_of_any` all."""
    before: dict[int, Any] = {}
    try:
        if threading.current_thread() is threading.main_thread():
            for number in _ENDING:
                present = signal.getsignal(number)
                # Python cannot put back None. Ignored signals stay ignored, as nohup requires.
                if present == signal.SIG_DFL or (instead_of_any and present not in (None, signal.SIG_IGN)):
                    before[number] = present
                    signal.signal(number, handler)
        yield
    finally:
        for number, present in before.items():
            signal.signal(number, present)


class RegisterBus(Protocol):
    """I²C to one converter."""

    def read(self, register: int) -> int:
        """Return a register."""

    def write(self, register: int, value: int) -> None:
        """Write a register."""

    def clear(self) -> None:
        """Free a bus that a chip holds low."""

    def close(self) -> None:
        """Close the bus, and never raise."""


class SwitchChain(Protocol):
    """A daisy chain of switches behind a serial port."""

    def shift(self, words: bytes) -> bytes | None:
        """Send one byte per device and latch all together.

        The first byte goes to the far end of the chain. If its end is wired back, the previous
        words are returned.
        """

    def close(self) -> None:
        """Close the port, and never raise."""


class Clock:
    """Time of the board. This one is the computer's."""

    def now(self) -> float:
        """Return the time in s since an arbitrary start."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait."""
        time.sleep(max(seconds, 0.0))


DEVICES = Path("/dev")  # folder of the system's devices
SYSTEM = Path("/sys/class/i2c-adapter")  # folder with the system's data about its I²C buses
SPI_MODE = 1  # mode of SPI, 0 to 3, that suits the switches, as far as is known
_SPI_SPEED = 1_000_000  # Hz. The ADG739 takes 30 MHz (not verified)
_LINUX_PURPOSE = "boards on this computer's own buses"
_GONE = {errno.ENODEV, errno.ENOENT, errno.EBADF, errno.ESHUTDOWN}
_HELD_UP = {errno.ETIMEDOUT, errno.EAGAIN, errno.EBUSY}
_START_BYTE = 0x00  # as a read: nine clocks that no chip may acknowledge


def linux_buses() -> tuple[str, ...]:
    """Return the names of the buses of this computer."""
    i2c = [f"i2c:{path.name.removeprefix('i2c-')}" for path in DEVICES.glob("i2c-*")]
    spi = [f"spi:{path.name.removeprefix('spidev')}" for path in DEVICES.glob("spidev*")]
    return (*sorted(i2c), *sorted(spi))


def i2c_clock(bus: int) -> float | None:
    """Return a bus's clock in Hz, None if the device tree lacks it."""
    for node in ("of_node", "device/of_node"):
        with contextlib.suppress(OSError):
            held = (SYSTEM / f"i2c-{bus}" / node / "clock-frequency").read_bytes()
            if len(held) == 4 and any(held):
                return float(int.from_bytes(held, "big"))
    return None


class LinuxRegisterBus:
    """A `RegisterBus` through the kernel's I²C, /dev/i2c-N."""

    def __init__(self, bus: int, address: int) -> None:
        self._library = import_extra("smbus2", _LINUX_PURPOSE, package="smbus2", extra="linux")
        self._address = address
        self._path = DEVICES / f"i2c-{bus}"
        with _opening(self._path):
            self._bus: Any = self._library.SMBus(str(self._path))
        try:
            with _opening(self._path):
                fcntl = importlib.import_module("fcntl")  # missing on Windows, which has no such bus either
                fcntl.flock(self._bus.fd, fcntl.LOCK_EX | fcntl.LOCK_NB)  # locks out a second program of this package
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
        """Send nine clocks and a stop."""
        with contextlib.suppress(BusFault):  # no chip answers to this
            self._transfer(self._library.i2c_msg.read(_START_BYTE, 1))

    def close(self) -> None:
        """Close the bus, and never raise."""
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
    """A `SwitchChain` through the kernel's SPI, /dev/spidevN.M."""

    def __init__(self, bus: int, device: int, *, mode: int = SPI_MODE, readback: bool = False) -> None:
        library: ModuleType = import_extra("spidev", _LINUX_PURPOSE, package="spidev", extra="linux")
        self._readback = readback
        self._path = DEVICES / f"spidev{bus}.{device}"
        self._port: Any = library.SpiDev()
        try:
            with _opening(self._path):
                self._port.open_path(str(self._path))
                self._port.mode, self._port.bits_per_word, self._port.max_speed_hz = mode, 8, _SPI_SPEED
        except BaseException:
            self.close()
            raise

    def shift(self, words: bytes) -> bytes | None:
        """Send the words while SYNC is low."""
        try:
            returned = self._port.xfer2(list(words))
        except OSError as error:
            if error.errno in _GONE:
                raise DeviceLost(f"{self._path} is gone: {error.strerror}.") from None
            raise SwitchFault(f"{self._path} could not send to the switches: {error.strerror}.") from None
        return bytes(returned) if self._readback else None

    def close(self) -> None:
        """Close the port, and never raise."""
        with contextlib.suppress(Exception):
            self._port.close()


@contextlib.contextmanager
def _opening(path: Path) -> Iterator[None]:
    """Translate the system's errors about a device into one line."""
    try:
        yield
    except FileNotFoundError:
        there = ", ".join(linux_buses()) or "none at all"
        raise HardwareError(f"there is no {path}; ports of this kind: {there}.") from None
    except PermissionError:
        group = "i2c" if path.name.startswith("i2c") else "spi"
        raise HardwareError(f"{path} may not be opened by this user; add the user to the group {group}.") from None
    except BlockingIOError:
        raise HardwareError(f"{path} is used by another program.") from None
    except OSError as error:
        raise HardwareError(f"{path} cannot be used: {error.strerror}.") from None


I2C_SPEED = 100e3  # Clock of the I²C bus in Hz. The converter allows 400 kHz if the pull-ups are strong enough.
_FTDI_PURPOSE = "boards on an FT232H"
_WITH_SECOND_PORT = {0x6014: "232h", 0x6010: "2232h"}  # USB product numbers
_SECOND_PORT = 8  # its pins follow the pins of the first port, which has the I²C
_CLOCK, _DATA, _SYNC = 0x01, 0x02, 0x04  # pins C0 to C2 of the second port: SCLK, DIN of the first device, SYNC
_DRIVEN = _CLOCK | _DATA | _SYNC
_BACK = 3  # number of the pin C3: DOUT of the last device
# Commands of the engine, and the lines of I²C in its first port.
_SET_LOW, _SET_HIGH, _GET_HIGH, _SEND = 0x80, 0x82, 0x83, 0x87
_SCL, _SDA = 0x01, 0x02
_CLOCKS = 9
_HOLD = 10  # repeats of a level that lasts 5 µs, half a clock of 100 kHz
_READ_ATTEMPTS = 4
_USB_TIMEOUT = 500  # ms
_NO_LIBUSB = "No backend available"  # pyftdi's message without it


def ft232h_adapters() -> tuple[str, ...]:
    """Return the URLs of the adapters at this computer."""
    try:
        found = _library("pyftdi.ftdi").Ftdi.list_devices()
    except Exception:  # a list of adapters does not report missing libraries
        return ()
    return tuple(
        f"ftdi://ftdi:{_WITH_SECOND_PORT[device.pid]}{f':{device.sn}' if device.sn else ''}/1"
        for device, _ in found
        if device.pid in _WITH_SECOND_PORT
    )


class Ft232h:
    """A `RegisterBus` and a `SwitchChain` on an FT232H adapter.

    The pyftdi URL is ``ftdi://ftdi:232h:SERIALNUMBER/1``. Without `switches` its second port is not
    used. Their SPI `mode` is 0 to 3. With `readback` the end of their chain is wired back.
    """

    def __init__(
        self, url: str, address: int, *, switches: bool = True, mode: int = SPI_MODE, readback: bool = False
    ) -> None:
        self._url, self._address, self._mode, self._readback = url, address, mode, readback
        i2c, usb = _library("pyftdi.i2c"), _library("pyftdi.usbtools")
        self._controller: Any = i2c.I2cController()
        self._not_acknowledged: type[Exception] = i2c.I2cNackError
        idle = _SYNC | (_CLOCK if mode & 2 else 0)
        pins = {"direction": _DRIVEN << _SECOND_PORT, "initial": idle << _SECOND_PORT} if switches else {}
        try:
            self._controller.configure(url, frequency=I2C_SPEED, **pins)
            self._controller.set_retry_count(1)  # this module judges a failed transfer itself
            self._controller.ftdi.timeouts = (_USB_TIMEOUT, _USB_TIMEOUT)
            self._port: Any = self._controller.get_port(address)
            if switches and self._controller.width <= _SECOND_PORT:
                raise HardwareError(f"{url} has no pins C0 to C7 for the switches; an FT232H or FT2232H has them.")
            if switches:  # pyftdi drives only pins that begin high
                self._controller.ftdi.write_data(bytes([_SET_HIGH, idle, _DRIVEN]))
        except (OSError, ValueError, usb.UsbToolsError) as error:
            self.close()
            if _NO_LIBUSB in str(error):
                raise MissingDependencyError(
                    f"{url} cannot be opened: the library libusb 1.0 is not installed (Debian: sudo apt "
                    "install libusb-1.0-0; macOS: brew install libusb; Windows: the WinUSB driver, by Zadig)."
                ) from None
            raise HardwareError(f"{url} cannot be opened: {_one_line(error)}.") from None
        except BaseException:
            self.close()
            raise

    def read(self, register: int) -> int:
        """Return a register."""
        with self._translated_errors():
            answer = bytes(self._port.exchange([register], 2))
        if len(answer) != 2:
            raise BusTimeout(f"the adapter {self._url} returned {len(answer)} bytes of a register, not 2.")
        return int.from_bytes(answer, "big")

    def write(self, register: int, value: int) -> None:
        """Write a register."""
        with self._translated_errors():
            self._port.write([register, *value.to_bytes(2, "big")])

    def clear(self) -> None:
        """Send nine clocks and a stop."""
        clocks = [_SDA, _SDA | _SCL] * _CLOCKS
        levels = [_SDA | _SCL, *clocks, _SDA, 0, _SCL, _SDA | _SCL]
        commands = bytes(byte for level in levels for byte in (_SET_LOW, level, _SCL | _SDA) * _HOLD)
        with self._translated_errors():
            self._controller.ftdi.write_data(commands)

    @contextlib.contextmanager
    def _translated_errors(self) -> Iterator[None]:
        try:
            yield
        except self._not_acknowledged:
            raise BusFault(f"the converter at {self._address:#04x} on {self._url} does not answer.") from None
        except OSError as error:
            raise _lost_or(BusTimeout, self._url, error) from None

    def shift(self, words: bytes) -> bytes | None:
        """Send the words while SYNC is low."""
        bits = [bool(byte >> bit & 1) for byte in words for bit in reversed(range(8))]
        try:
            self._controller.ftdi.write_data(bytes(self._commands(bits)))
            if not self._readback:
                return None
            levels = bytes(self._controller.ftdi.read_data_bytes(len(bits), _READ_ATTEMPTS))
        except OSError as error:
            raise _lost_or(SwitchFault, self._url, error) from None
        if len(levels) != len(bits):
            raise SwitchFault(f"the adapter {self._url} returned {len(levels)} levels of the switches' {len(bits)}.")
        back = "".join(str(level >> _BACK & 1) for level in levels)
        return int(back, 2).to_bytes(len(words), "big")

    def close(self) -> None:
        """Close the adapter, whose pins keep their levels, and never raise."""
        with contextlib.suppress(Exception):
            self._controller.close(freeze=True)  # a SYNC that floats could latch anything

    def _commands(self, bits: Iterable[bool]) -> Iterator[int]:
        # A level is read just before the edge at which the switches read the bit.
        idle_high, second_edge = bool(self._mode & 2), bool(self._mode & 1)  # CPOL and CPHA
        idle = _CLOCK if idle_high else 0
        before, after = (_CLOCK - idle, idle) if second_edge else (idle, _CLOCK - idle)
        yield from (_SET_HIGH, idle, _DRIVEN)
        for bit in bits:
            data = _DATA if bit else 0
            yield from (_SET_HIGH, before | data, _DRIVEN)
            if self._readback:
                yield _GET_HIGH
            yield from (_SET_HIGH, after | data, _DRIVEN)
        yield from (_SET_HIGH, idle, _DRIVEN, _SET_HIGH, idle | _SYNC, _DRIVEN)
        if self._readback:
            yield _SEND


def _library(module: str) -> Any:
    return import_extra(module, _FTDI_PURPOSE, package="pyftdi", extra="ftdi")


def _lost_or(fault: type[HardwareError], url: str, error: OSError) -> HardwareError:
    """Return DeviceLost if USB itself failed, else the fault."""
    if isinstance(error, (_library("pyftdi.ftdi").FtdiError, _library("usb.core").USBError)):
        return DeviceLost(f"the adapter {url} is gone: {_one_line(error)}.")
    return fault(f"the adapter {url} does not answer: {_one_line(error)}.")


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()).rstrip(".") or type(error).__name__
