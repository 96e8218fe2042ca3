"""Temperature from a sensor file of Linux.

The file is read once a second beside the scans, which never wait for it. The files of hwmon
(``/sys/class/hwmon/hwmon0/temp1_input``), thermal zones (``/sys/class/thermal/thermal_zone0/temp``) and the 1-wire bus
(``/sys/bus/w1/devices/28-*/temperature``) have a whole number in 0.001 °C, according to the kernel's documentation of
``/sys/class/hwmon``, ``thermal`` and ``w1_therm``. ``w1_slave`` of the latter has it behind ``t=``, with ``YES`` if its
checksum is right. A number with a decimal point, as another program may write it, is in °C.
"""

from __future__ import annotations

import math
import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from coilarray.errors import HardwareError

PERIOD = 1.0
"""Time in s from reading to reading."""

COLDEST, WARMEST = -100.0, 300.0
"""Range of accepted temperatures in °C. A sensor of the 1-wire bus without power shows 85 °C."""

_OUTDATED = 5.0  # s after which the last reading is outdated
_SLAVE = re.compile(r"(?s).*crc=\w+ YES\s.*t=(-?\d+)\s*")
_LONGEST = 4096  # bytes


def file_temperature(path: Path) -> float:
    """Read a temperature in °C from a file.

    A file without a temperature raises a HardwareError.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     sensor = Path(folder, "temp1_input")
    ...     _ = sensor.write_text("42375")
    ...     file_temperature(sensor)
    42.375
    """
    try:
        with path.open("rb") as file:
            text = file.read(_LONGEST).decode("ascii", errors="replace").strip()
    except (OSError, ValueError) as error:
        raise HardwareError(f"cannot read the temperature {path}: {getattr(error, 'strerror', error)}.") from None
    slave = _SLAVE.fullmatch(text)
    try:
        value = int(slave[1]) / 1000 if slave else float(text) if "." in text else int(text) / 1000
    except ValueError:
        value = math.nan
    if not COLDEST <= value <= WARMEST:
        raise HardwareError(
            f"{path} must hold a temperature from {COLDEST:g} to {WARMEST:g} °C, as a whole number in 0.001 °C or "
            f"with a decimal point in °C; got {text[:40]!r}."
        )
    return value


@contextmanager
def thermometer(path: Path) -> Iterator[Callable[[], float | None]]:
    """Read a file once a second in the background.

    The returned function gives the temperature in °C, or None if it is outdated. A file without a temperature at first
    raises a HardwareError. Later the temperature is None while the file cannot be read.
    """
    latest = (file_temperature(path), time.monotonic())
    ended = threading.Event()

    def follow() -> None:
        """Read the file until the block is left."""
        nonlocal latest
        while not ended.wait(PERIOD):
            try:
                latest = file_temperature(path), time.monotonic()
            except HardwareError:
                continue

    def temperature() -> float | None:
        value, when = latest
        return value if time.monotonic() - when <= _OUTDATED else None

    threading.Thread(target=follow, daemon=True, name="thermometer").start()
    try:
        yield temperature
    finally:
        ended.set()  # a sensor of the 1-wire bus may take a second to answer, and it is not awaited
