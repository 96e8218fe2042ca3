"""Fields of the replies to HELLO and PING."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from coilarray.hardware.wire.protocol.messages import (
    MessageError,
    Mode,
    decimal,
    hexadecimal,
)

VERSION = (1, 0)
"""Major and minor version of the protocol that this package speaks."""


@dataclass(frozen=True)
class Greeting:
    """What a board says of itself.

    Parameters
    ----------
    version : tuple of int
        Major and minor version of its protocol.
    firmware : str
        For people.
    boot : int
        Of its session; another number after every start.
    manufacturer, device : int
        Identity registers of the converter; 0 where it does not answer.
    most_states, most_devices : int
        That a configuration may have.
    capabilities : frozenset of str
        Words; "readback" where the end of the chain of switches is wired back.
    """

    version: tuple[int, int]
    firmware: str
    boot: int
    manufacturer: int
    device: int
    most_states: int
    most_devices: int
    capabilities: frozenset[str]


@dataclass(frozen=True)
class Pong:
    """Reply to PING: session, time in µs (wraps at 2³²), mode, and the lines that the board has dropped so far."""

    boot: int
    time: int
    mode: Mode
    dropped: int


def read_version(fields: Sequence[str]) -> tuple[int, int]:
    """Read major and minor version of a reply to HELLO; the rest of it may look otherwise in another major version."""
    major, dot, minor = (fields[0] if fields else "").partition(".")
    if not dot:
        raise MessageError(f"a version must be two numbers with a dot; got {major!r}.")
    return decimal(major), decimal(minor)


def read_greeting(fields: Sequence[str]) -> Greeting:
    """Read the fields of a reply to HELLO; MessageError where one has another form."""
    if len(fields) < 8:  # a later minor version may have more
        raise MessageError(f"a greeting must have 8 fields; got {len(fields)}.")
    _, firmware, boot, manufacturer, device, states, devices, capabilities = fields[:8]
    return Greeting(
        version=read_version(fields),
        firmware=firmware,
        boot=hexadecimal(boot, 8),
        manufacturer=hexadecimal(manufacturer, 4),
        device=hexadecimal(device, 4),
        most_states=decimal(states),
        most_devices=decimal(devices),
        capabilities=frozenset(capabilities.split("+")) - {"-", ""},
    )


def read_pong(fields: Sequence[str]) -> Pong:
    """Read the fields of a reply to PING; MessageError where one has another form."""
    if len(fields) < 4:
        raise MessageError(f"a reply to PING must have 4 fields; got {len(fields)}.")
    boot, time, mode, dropped = fields[:4]
    if mode not in {member.value for member in Mode}:
        raise MessageError(f"a mode must be u, i or s; got {mode!r}.")
    return Pong(hexadecimal(boot, 8), hexadecimal(time, 8), Mode(mode), decimal(dropped))
