"""Errors of the connection between computer and coils."""

from __future__ import annotations

from coilarray.errors import HardwareError


class DeviceLost(HardwareError):  # noqa: N818 - the field's words
    """The port is gone: unplugged, or taken away by the system."""


class NoAnswer(HardwareError):  # noqa: N818
    """Nothing valid came in time: no reply to a command, or a stream that stalled."""


class NotABoard(HardwareError):  # noqa: N818
    """Bytes come, but no valid record: another device, or another baud rate."""


class VersionMismatch(HardwareError):  # noqa: N818
    """The board speaks another major version of the protocol."""


class CommandRefused(HardwareError):  # noqa: N818
    """The board answered a command with an error."""


class BoardRestarted(HardwareError):  # noqa: N818
    """The board or its converter was reset while it was measuring, so its settings are gone."""


class BusFault(HardwareError):  # noqa: N818
    """A chip does not answer, or what it reads back is not what was written."""


class SwitchFault(HardwareError):  # noqa: N818
    """Switches that do not do what their words say."""


class BusTimeout(BusFault):
    """A chip or the bus itself holds up a transfer for too long."""
