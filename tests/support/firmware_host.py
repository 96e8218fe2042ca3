"""The firmware of `hardware/firmware`, compiled for this computer and run on stand-ins for its chips.

`Firmware` runs it step by step in the caller's thread; `FirmwareHost` runs it in a thread of its own behind a
pseudo-terminal, which pyserial opens as if it were the board.
"""

from __future__ import annotations

import binascii
import contextlib
import ctypes
import fcntl
import functools
import itertools
import os
import re
import select
import shutil
import struct
import subprocess
import tempfile
import termios
import threading
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from coilarray.hardware.wire.buses import BusFault, BusTimeout, Clock, RegisterBus, SwitchChain
from coilarray.hardware.wire.protocol import draft_commands

SKETCH = Path(__file__).parents[2] / "hardware" / "firmware" / "coilarray_reader"
SUPPORT = Path(__file__).parent / "firmware"
WARNINGS = ["-std=gnu++11", "-Wall", "-Wextra", "-Werror", "-Wconversion", "-Wshadow", "-fno-exceptions", "-fno-rtti"]
UNDEFINED = ["-fsanitize=undefined", "-fno-sanitize=vptr", "-fno-sanitize-recover=all"]
COMPILER = shutil.which("g++")
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="g++ is not installed")
BYTE_TIME = 10 / 115200  # s; a start bit, eight bits and a stop bit
SAFE_WORDS = b"\x11" * 6
_UNREAD = 256  # bytes that may wait at the computer's end before time stands still


def logic_sources() -> list[Path]:
    """The portable part of the firmware: all but what drives the pins."""
    return sorted(path for path in SKETCH.glob("*.cpp") if path.stem != "arduino_hal")


def compiled(folder: Path, name: str, *options: str, sketch: Path = SKETCH) -> Path:
    """Compile with g++, checked for undefined behaviour where its library is there, and return what came out."""
    target = folder / name
    command = [COMPILER, *WARNINGS, "-O1", "-g", f"-I{sketch}", f"-I{SUPPORT}", "-o", str(target), *options]
    if subprocess.run([*command, *UNDEFINED], check=False, capture_output=True).returncode:
        subprocess.run(command, check=True)
    return target


@functools.cache
def _library() -> ctypes.CDLL:
    folder = tempfile.TemporaryDirectory()
    sources = [str(path) for path in (*logic_sources(), SUPPORT / "board.cpp")]
    library = ctypes.CDLL(str(compiled(Path(folder.name), "board.so", "-shared", "-fPIC", *sources)))
    library.folder = folder  # lives as long as the library
    library.board_start.restype = ctypes.c_void_p
    library.board_start.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_uint8, ctypes.c_uint32, ctypes.c_double]
    library.board_run.restype = ctypes.c_double
    library.board_run.argtypes = [ctypes.c_void_p, ctypes.c_double, ctypes.c_int]
    library.board_feed.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_uint32]
    library.board_take_sent.argtypes = [ctypes.c_void_p, ctypes.c_char_p]
    for name in ("board_free", "board_busy"):
        getattr(library, name).argtypes = [ctypes.c_void_p]
    return library


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


_Now = ctypes.CFUNCTYPE(ctypes.c_double)
_Sleep = ctypes.CFUNCTYPE(None, ctypes.c_double)
_Read = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_uint8, ctypes.POINTER(ctypes.c_uint16))
_Write = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_uint8, ctypes.c_uint16)
_Clear = ctypes.CFUNCTYPE(None)
_Shift = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.POINTER(ctypes.c_uint8), ctypes.c_uint8, ctypes.POINTER(ctypes.c_uint8))
_DONE, _NOT_ACKNOWLEDGED, _TIMEOUT = range(3)


class _Callbacks(ctypes.Structure):
    _fields_ = [("now", _Now), ("sleep", _Sleep), ("read", _Read), ("write", _Write), ("clear", _Clear),
                ("shift", _Shift)]  # fmt: skip


_boots = itertools.count(1)


class Firmware:
    """The firmware on chips that are Python objects, with the time of all of them: it waits by `clock.sleep`.

    A `BusTimeout` is the guard of its bus, any other `BusFault` a missing acknowledgement; another exception of a chip
    is raised again out of the call that ran the firmware. `safe_words` are compiled in, for the switches at start-up;
    each byte that it sends takes `byte_time` in s.
    """

    def __init__(
        self, bus: RegisterBus, switches: SwitchChain, clock: Clock, *,
        safe_words: bytes = SAFE_WORDS, byte_time: float = BYTE_TIME,
    ) -> None:  # fmt: skip
        self.bus, self.switches, self.clock = bus, switches, clock
        self.safe_words, self.byte_time = safe_words, byte_time
        self.boot = 0
        self._error: BaseException | None = None
        self._library = _library()
        self._buffer = ctypes.create_string_buffer(1 << 16)
        self._callbacks = _Callbacks(
            _Now(clock.now), _Sleep(clock.sleep), _Read(self._read), _Write(self._write), _Clear(self._clear),
            _Shift(self._shift),
        )  # fmt: skip
        self._board: int | None = None
        self.reset()

    def reset(self) -> None:
        """Start again, as after power or the reset pin; the chips are not reset."""
        self.close()
        self.boot = next(_boots) * 0x9E3779B1 & 0xFFFFFFFF
        self._board = self._library.board_start(
            ctypes.byref(self._callbacks), self.safe_words, len(self.safe_words), self.boot, self.byte_time
        )
        self._check()

    def close(self) -> None:
        """Free the memory."""
        if self._board is not None:
            self._library.board_free(self._board)
            self._board = None

    @property
    def size(self) -> int:
        """Bytes of all that the logic remembers."""
        return self._library.board_size()

    @property
    def busy(self) -> bool:
        """Whether a scan or a stream is under way, or a line on its way out."""
        return bool(self._library.board_busy(self._board))

    def feed(self, data: bytes) -> None:
        """Give bytes to its port, in pieces that its buffer takes."""
        for start in range(0, len(data), 256):
            piece = data[start : start + 256]
            self._library.board_feed(self._board, piece, len(piece))
            self.step(0.0)

    def step(self, budget: float, *, stop_at_line: bool = False) -> float:
        """Run until nothing is due within `budget` s, or until a line is out; return the s until something is due."""
        idle = self._library.board_run(self._board, budget, stop_at_line)
        self._check()
        return idle

    def take(self) -> bytes:
        """Return what it sent since the last call."""
        return ctypes.string_at(self._buffer, self._library.board_take_sent(self._board, self._buffer))

    def run(self, seconds: float) -> bytes:
        """Run for a time of its clock and return what it sent."""
        end = self.clock.now() + seconds
        sent = []
        while True:
            left = end - self.clock.now()
            idle = self.step(max(left, 0.0))
            sent.append(self.take())
            if idle > 0 or left <= 0:
                break
        self.clock.sleep(end - self.clock.now())
        return b"".join(sent)

    def _check(self) -> None:
        if self._error is not None:
            error, self._error = self._error, None
            raise error

    def _guarded(self, transfer: Callable[[], None]) -> int:
        try:
            transfer()
        except BusTimeout:
            return _TIMEOUT
        except BusFault:
            return _NOT_ACKNOWLEDGED
        except BaseException as error:  # it must not pass through C++; raised again by _check
            self._error = self._error or error
            return _NOT_ACKNOWLEDGED
        return _DONE

    def _read(self, register: int, value: ctypes._Pointer) -> int:
        def transfer() -> None:
            value[0] = self.bus.read(register)

        return self._guarded(transfer)

    def _write(self, register: int, value: int) -> int:
        return self._guarded(lambda: self.bus.write(register, value))

    def _clear(self) -> None:
        self._guarded(self.bus.clear)

    def _shift(self, words: ctypes._Pointer, count: int, before: ctypes._Pointer) -> int:
        held: list[bytes | None] = [None]
        self._guarded(lambda: held.append(self.switches.shift(bytes(words[:count]))))
        for index, word in enumerate((held[-1] or b"")[:count]):
            before[index] = word
        return int(held[-1] is not None)


class FirmwareHost:
    """The firmware in a thread, behind a pseudo-terminal: `port`, for pyserial; another one after `replug`.

    Its time is that of `clock`. A virtual one jumps to the firmware's next moment while a scan or a stream is under
    way, but never runs ahead of the computer by more than 256 bytes that nobody has read yet, and passes as real time
    does while the firmware is idle. The computer's `Clock` is real time throughout. `options` are those of `Firmware`.
    """

    def __init__(self, bus: RegisterBus, switches: SwitchChain, clock: Clock, **options: Any) -> None:
        self.firmware = Firmware(bus, switches, clock, **options)
        self.clock = clock
        self.port = ""
        self._virtual = type(clock) is not Clock
        self._line = bytearray()  # sent by the firmware, not yet ended
        self._backlog = bytearray()  # for the port, which takes no more just now
        self._master = self._slave = -1
        self._wake_out, self._wake_in = os.pipe()
        self._closing = False
        self._condition = threading.Condition()
        self._pauses, self._resting, self._ended = 0, False, False
        self._error: BaseException | None = None
        self._plug()
        self._thread = threading.Thread(target=self._main, name="firmware", daemon=True)
        self._thread.start()

    def __enter__(self) -> FirmwareHost:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def boot(self) -> int:
        """The boot number of the firmware that runs."""
        return self.firmware.boot

    @contextlib.contextmanager
    def paused(self) -> Iterator[Firmware]:
        """Hold the thread between two steps, to look at or change the chips or the clock."""
        with self._condition:
            self._pauses += 1
            os.write(self._wake_in, b".")
            self._condition.wait_for(lambda: self._resting or self._ended)
        try:
            yield self.firmware
        finally:
            with self._condition:
                self._pauses -= 1
                self._condition.notify_all()

    def reset(self) -> None:
        """Reset the microcontroller, in the middle of a line where it sends one. The chips keep what they hold."""
        with self.paused():
            self._restart()

    def unplug(self) -> None:
        """Take the port away. The firmware stands still."""
        with self.paused():
            self._unplug()

    def replug(self) -> str:
        """Plug it in again: another port, and a firmware that started anew. Returns the port."""
        with self.paused():
            self._unplug()
            self._plug()
            self._restart()
            self._backlog.clear()
        return self.port

    def close(self) -> None:
        """Stop the thread; raise what a chip raised that no firmware could have met."""
        if self._thread.is_alive():
            with self.paused():
                self._closing = True
            self._thread.join()
        self._unplug()
        for end in (self._slave, self._wake_in, self._wake_out):
            with contextlib.suppress(OSError):
                os.close(end)
        self._slave = self._wake_in = self._wake_out = -1
        self.firmware.close()
        if self._error is not None:
            error, self._error = self._error, None
            raise error

    def _restart(self) -> None:
        self._to_port(bytes(self._line))
        self._line.clear()
        self.firmware.take()
        self.firmware.reset()

    def _plug(self) -> None:
        unplugged = self._slave
        self._master, self._slave = os.openpty()
        if unplugged >= 0:
            os.close(unplugged)
        tty.setraw(self._slave)  # or it would send our own lines back until the computer opens it
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)

    def _unplug(self) -> None:
        """The other end stays open until there is another port, so that no other process gets one of the same name."""
        if self._master >= 0:
            os.close(self._master)
        self._master = -1

    def _main(self) -> None:
        try:
            while not self._closing:
                with self._condition:
                    while self._pauses:
                        self._resting = True
                        self._condition.notify_all()
                        self._condition.wait()
                    self._resting = False
                if not self._closing:
                    self._turn()
        except BaseException as error:  # raised again by close
            self._error = error
        finally:
            with self._condition:
                self._ended = True  # not left to `is_alive`, which turns false after the last notification
                self._condition.notify_all()

    def _turn(self) -> None:
        if self._master < 0:
            self._wait(None, port=False)
            return
        self._flush()
        if self._waiting() > _UNREAD:
            self._wait(0.5e-3, port=False)
            return
        busy = self.firmware.busy
        idle = self.firmware.step(5e-3 if busy and self._virtual else 0.0, stop_at_line=True)
        self._send(self.firmware.take())
        if busy and self._virtual:
            self._receive()
            if idle > 0:
                self.clock.sleep(idle)
            return
        before = time.monotonic()
        self._wait(idle)
        self._receive()
        if self._virtual:
            self.clock.sleep(min(time.monotonic() - before, idle))

    def _wait(self, seconds: float | None, *, port: bool = True) -> None:
        """Until the computer writes, something is wanted of the thread, or the time is over."""
        ends = [self._wake_out, *([self._master] if port else [])]
        ready, _, _ = select.select(ends, [], [], seconds)
        if self._wake_out in ready:
            os.read(self._wake_out, 4096)

    def _receive(self) -> None:
        with contextlib.suppress(BlockingIOError):
            self.firmware.feed(os.read(self._master, 4096))

    def _send(self, data: bytes) -> None:
        self._line += data
        while b"\n" in self._line:
            end = self._line.index(b"\n") + 1
            self._to_port(bytes(self._line[:end]))
            del self._line[:end]
        self._flush()

    def _to_port(self, line: bytes) -> None:
        if line:
            self._backlog += line

    def _flush(self) -> None:
        if self._backlog and self._master >= 0:
            with contextlib.suppress(BlockingIOError):
                del self._backlog[: os.write(self._master, self._backlog)]

    def _waiting(self) -> int:
        """Bytes that the computer has not read yet."""
        (count,) = struct.unpack("i", fcntl.ioctl(self._slave, termios.FIONREAD, b"\0" * 4))
        return count + len(self._backlog)
