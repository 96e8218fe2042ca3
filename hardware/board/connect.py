"""Open a board of any kind, and close it safely."""

from __future__ import annotations

import atexit
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from coilarray.errors import HardwareError
from coilarray.hardware.board.direct import DirectReader
from coilarray.hardware.chips.ldc1614 import DEVICE, MANUFACTURER
from coilarray.hardware.scan.readings import Identity, Reader
from coilarray.hardware.scan.wiring import Wiring, load_wiring, one_device_a_coil, wired_to_channels
from coilarray.hardware.wire import buses, ports

if TYPE_CHECKING:
    from coilarray.design.model import Design
    from coilarray.hardware.emulator.board import EmulatedBoard
    from coilarray.hardware.wire.protocol import LinkTimes


class Board:
    """An open board, made by `open_board`.

    Leaving its block, also by an exception, Ctrl-C or SIGTERM, grounds all coils and puts the
    converter to sleep. After SIGKILL a microcontroller ends its stream by itself, and chips on the
    computer's own buses are put to rest when the board is opened again.

    The `reader` measures at the `port` of this name, with the `wiring` of the switches. The
    `emulator` is the emulated board behind the reader, None for real hardware. Its ``thermometer``,
    or another that the user of the board sets, returns the temperature in °C, or None if it is not
    known at present.
    """

    def __init__(self, reader: Reader, port: str, wiring: Wiring, emulator: EmulatedBoard | None = None) -> None:
        self.reader, self.port, self.wiring, self.emulator = reader, port, wiring, emulator
        self.thermometer: Callable[[], float | None] | None = None if emulator is None else emulator.temperature
        self._ways_out = ExitStack()
        atexit.register(self.close)

    @property
    def identity(self) -> Identity:
        """Identity of the board."""
        return self.reader.identity

    @property
    def emulated(self) -> bool:
        """Whether the board is emulated."""
        return self.identity.emulated

    @property
    def line(self) -> str:
        """Description of the board and its converter in one line."""
        identity = self.identity
        ids = f"{identity.manufacturer:04X}/{identity.device:04X}"
        named = ports.parse_port(self.port).board
        if (identity.manufacturer, identity.device) == (MANUFACTURER, DEVICE):
            converter = f"LDC1614 ({ids})"
            if named is not None:
                clock = "its own oscillator" if named.clock is None else f"{named.clock * 1e-6:g} MHz at CLKIN"
                converter += f", channels {', '.join(map(str, named.channels))}, {clock}"
        elif (identity.manufacturer, identity.device) == (0, 0):
            converter = "no converter answers"
        else:
            converter = f"another chip than the LDC1614 ({ids})"
        return f"{self.port}: {identity.kind}; {converter}; wiring {self.wiring.name}; session {identity.boot:08X}"

    def check_chain(self) -> str | None:
        """Ask a microcontroller to check its chain of switches."""
        from coilarray.hardware.board.microcontroller import MicrocontrollerReader

        return self.reader.check_chain() if isinstance(self.reader, MicrocontrollerReader) else None

    def close(self) -> None:
        """Put the board to rest and close the port, and never raise."""
        with buses.held_signals():
            self.reader.close()
        atexit.unregister(self.close)

    def __enter__(self) -> Self:
        self._ways_out.enter_context(buses.orderly_termination())
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.close()
        finally:
            self._ways_out.close()


def open_board(
    port: str = ports.EMULATOR,
    *,
    design: Design | None = None,
    wiring: Wiring | None = None,
    times: LinkTimes | None = None,
    **emulation: Any,
) -> Board:
    """Open a board with grounded coils and a sleeping converter.

    The `port` is named as `coilarray.hardware.wire.ports.parse_port` reads it, the emulator by
    default. `design` is the design of the emulated coils, the reference design by default, `wiring`
    that of the switches or of coils to channels, by default of `wiring_of_board`, and `times` are
    time limits for a microcontroller. `emulation` are options of
    `coilarray.hardware.emulator.board.emulated_board`, which a real board ignores.

    Raises HardwareError for a text that names no port, or a port that cannot be opened, with the
    existing ports, and MissingDependencyError if the library of this kind of port is not installed.

    >>> with open_board() as board:  # doctest: +SKIP
    ...     board.reader.configure(scan_settings(board.wiring))
    ...     scan = board.reader.scan()
    """
    place = ports.parse_port(port)
    wired = wiring or wiring_of_board(place, design)
    _require_kind(port, place.board, wired)
    emulator = None
    reader: Reader
    match place:
        case ports.EmulatorPort():
            from coilarray.design.model import load_design
            from coilarray.hardware.emulator.board import Conditions, emulated_board

            if place.board is not None:
                conditions = replace(emulation.get("conditions") or Conditions(), clkin=place.board.clock)
                emulation = {**emulation, "conditions": conditions}
            emulator = emulated_board(design or load_design(), wired, **emulation)
            chain = emulator.chain if place.board is None else None
            reader = DirectReader(
                emulator.bus, chain, emulator.clock, wired.safe_words, kind=ports.EMULATOR, emulated=True
            )
        case ports.SerialPort(name, baud):
            from coilarray.hardware.board.microcontroller import open_microcontroller

            reader = open_microcontroller(name, baud=baud, times=times)
        case ports.LinuxPort() | ports.FtdiPort():
            reader = _direct_reader(place, wired)
    return Board(reader, port, wired, emulator)


def wiring_of_board(
    port: ports.Port, design: Design | None = None, name: str | None = None, coils: Sequence[str] | None = None
) -> Wiring:
    """Return the wiring of the board at a port."""
    board = port.board
    if coils is not None and (board is None or name is not None):
        raise HardwareError(
            "coils can be named only for a port with channels instead of switches, and without a wiring file."
        )
    if board is None or name is not None:
        wiring = load_wiring(name)
        _require_kind(str(name), board, wiring)
        if name is not None or design is None or not isinstance(port, ports.EmulatorPort):
            return wiring
        return wiring if set(design.array.names) == set(wiring.coils) else one_device_a_coil(design.array.names)
    known = [f"coil{channel + 1}" for channel in board.channels] if design is None else design.array.names
    if coils is not None and (missing := [coil for coil in coils if design is not None and coil not in known]):
        raise HardwareError(f"there is no coil {missing[0]!r} among {', '.join(known)}.")
    return wired_to_channels(known if coils is None else coils, board.channels)


def _require_kind(where: str, board: ports.ChannelBoard | None, wiring: Wiring) -> None:
    if board is None and wiring.channels:
        raise HardwareError(
            f"{where}: wiring {wiring.name} has coils at channels; give a port without switches, such as "
            "i2c:1?channels=0,1."
        )
    if board is not None and not wiring.channels:
        raise HardwareError(f"{where}: wiring {wiring.name} has switches; a port with channels has none.")
    if board is not None and not set(wiring.channels) <= set(board.channels):
        raise HardwareError(
            f"{where}: wiring {wiring.name} has a coil at channel {max(set(wiring.channels) - set(board.channels))}; "
            f"the port has {', '.join(map(str, board.channels))}."
        )


def _direct_reader(port: ports.LinuxPort | ports.FtdiPort, wiring: Wiring) -> DirectReader:
    bus: buses.RegisterBus
    switches: buses.SwitchChain | None = None
    with ExitStack() as opened:
        if isinstance(port, ports.LinuxPort):
            bus, kind = buses.LinuxRegisterBus(port.bus, port.address), f"I²C bus {port.bus} of this computer"
            opened.callback(bus.close)
            if port.board is None:
                switches = buses.SpiSwitchChain(port.spi_bus, port.spi_device, mode=port.mode, readback=port.readback)
                opened.callback(switches.close)
                kind = f"I²C bus {port.bus} and SPI {port.spi_bus}.{port.spi_device} of this computer"
        else:
            wired = port.board is None
            adapter = buses.Ft232h(port.url, port.address, switches=wired, mode=port.mode, readback=port.readback)
            opened.callback(adapter.close)
            bus, switches = adapter, adapter if wired else None
            kind = "FT232H" if wired else "FTDI adapter"
        reader = DirectReader(bus, switches, buses.Clock(), wiring.safe_words, kind=kind)
        opened.pop_all()
    return reader
