"""Errors of the connection between computer and coils."""

from __future__ import annotations

from coilarray.errors import HardwareError


class DeviceLost(HardwareError):  # noqa: N818 - the field's words
    """The port is gone.

    It was unplugged, or taken away by the system.
    """


class NoAnswer(HardwareError):  # noqa: N818
    """No valid message came in time.

    A command had no reply, or a stream stalled.
    """


class NotABoard(HardwareError):  # noqa: N818
    """The received bytes have no valid record.

    They come from another device, or with another baud rate.
    """


class VersionMismatch(HardwareError):  # noqa: N818
    """The board has another major version of the protocol."""


class CommandRefused(HardwareError):  # noqa: N818
    """The board answered a command with an error."""


class BoardRestarted(HardwareError):  # noqa: N818
    """The board or its converter was reset while measuring.

    Its settings are gone.
    """


class BusFault(HardwareError):  # noqa: N818
    """A chip does not answer or returns wrong values.

    A value that is read back differs from the written value.
    """


class SwitchFault(HardwareError):  # noqa: N818
    """Switches do not follow their words."""


class BusTimeout(BusFault):
    """A chip or the bus delays a transfer too long."""
