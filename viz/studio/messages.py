"""Messages from a page to its session.

Frames of bytes come in, and checked messages go out.

A frame has a head of three numbers, as wslink's client sends them. They are the message that it is a part of, the place
where the part begins, and the length of the message. Bytes that no page of the studio sends raise a MessageError, after
which its session ends. Content that a page may send by accident, such as a number that is not finite, is refused in one
line, and the session continues.
"""

from __future__ import annotations

import inspect
import math
import struct
from collections.abc import Awaitable, Callable, Iterator
from functools import cache
from typing import Any

from pydantic import ConfigDict, TypeAdapter, ValidationError, validate_call, with_config
from typing_extensions import TypedDict

from coilarray.compute.extras import import_extra
from coilarray.errors import CoilarrayError, shown

LARGEST = 10_000_000
"""Bytes of a message."""

_HEAD = struct.Struct("<III")
_MOST_UNFINISHED = 16  # messages
_DEEPEST = 16  # nested lists and mappings
_STRICT = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)
_WHOLE = ConfigDict(strict=True, extra="allow")


class MessageError(CoilarrayError):
    """Bytes that no page of the studio sends."""


@with_config(_STRICT)
class Axis(TypedDict):
    """Axis of a sweep as on the page."""

    number: int
    key: str | None
    values: str


@with_config(_STRICT)
class _Changes(TypedDict, total=False):
    """State that the page may change; a cleared field is None."""

    tab: str
    problem: str
    choice: dict[str, str | bool | None]
    file_note: str
    file_problem: str
    large: str
    live_log: str | None
    live_port: str | None
    live_recording: str | None
    live_reference: list[str] | None
    matrix_digits: bool
    matrix_of: str
    new_dialog: bool
    new_over: bool
    new_problem: str
    open_dialog: bool
    open_over: str
    place: dict[str, str | None]
    run_goal: str
    run_kind: str
    run_trials: str | None
    save_dialog: bool
    save_name: str | None
    save_over: str
    save_title: str | None
    study_quantities: list[str] | None
    sweep_axes: list[Axis]
    target_place: list[str | None]
    tolerance_boards: str | None
    tolerance_file: str


@with_config(_STRICT)
class _Change(TypedDict):
    key: str
    value: Any


@with_config(_WHOLE)
class Message(TypedDict):
    """Call of a method of the session."""

    id: str
    method: str
    args: list[Any]


_CALLS: dict[str, Any] = {
    "wslink.hello": tuple[dict[str, Any]],
    "trame.state.get": tuple[()],
    "trame.state.update": tuple[list[_Change]],
    "trame.trigger": tuple[str, list[Any], dict[str, Any]],
    "trame.lifecycle.update": tuple[str],
    "trame.error.client": tuple[Any],
}
_OF_VIEW = "viewport."  # calls of the picture, checked by trame's own code


class Inbox:
    """Frames of one connection as they arrive."""

    def __init__(self) -> None:
        self._parts: dict[int, bytearray] = {}

    def take(self, frame: bytes) -> Message | None:
        """Take a frame and return the message that it completes.

        The result is None while the message is incomplete. An invalid frame raises a MessageError.
        """
        if len(frame) < _HEAD.size:
            raise MessageError("a frame must have a head.")
        number, begin, size = _HEAD.unpack_from(frame)
        part = self._parts.setdefault(number, bytearray())
        held = sum(map(len, self._parts.values())) + len(frame) - _HEAD.size
        if max(size, held) > LARGEST or len(self._parts) > _MOST_UNFINISHED:
            raise MessageError(f"a message must have at most {LARGEST} bytes; got {size}.")
        if begin != len(part) or begin + len(frame) - _HEAD.size > size:
            raise MessageError("the parts of a message must follow each other.")
        part += frame[_HEAD.size :]
        return None if len(part) < size else _message(bytes(self._parts.pop(number)))


def refusal(message: Message) -> str:
    """Explain in one line why a message is refused."""
    method, arguments = message["method"], message["args"]
    if any(isinstance(one, float) and not math.isfinite(one) for one in _leaves(message)):
        return f"the numbers of {shown(method)} must be finite."
    if method.startswith(_OF_VIEW):
        return ""
    if method not in _CALLS:
        return f"there is no {shown(method)}."
    problem = _problem(_CALLS[method], tuple(arguments))
    if not problem and method == "trame.state.update":
        problem = _problem(_Changes, {change["key"]: change["value"] for change in arguments[0]})
    return f"{method}: {problem}" if problem else ""


def checked(name: str, function: Callable[..., Any]) -> Callable[..., Awaitable[None]]:
    """Wrap a function of the page, which then refuses wrong arguments with MessageError."""
    strict = validate_call(config=_STRICT)(function)

    async def call(*arguments: Any) -> None:
        """Call the function with checked arguments."""
        try:
            result = strict(*arguments)
            if inspect.isawaitable(result):
                await result
        except ValidationError as error:
            raise MessageError(f"{name}: {_first(error)}") from None

    return call


def _message(data: bytes) -> Message:
    """Decode and check a message."""
    msgpack: Any = import_extra("msgpack", "pages of the studio", package="msgpack", extra="studio")
    try:
        found = msgpack.unpackb(data)
        for one in _leaves(found):
            if not isinstance(one, str | bool | int | float | None):
                raise MessageError(f"a message must not hold {type(one).__name__}.")
    except (ValueError, msgpack.UnpackException) as error:
        raise MessageError(f"a message must be MessagePack: {error or type(error).__name__}.") from None
    problem = _problem(Message, found)
    if problem:
        raise MessageError(f"message: {problem}")
    message: Message = found
    return message


def _leaves(tree: Any, depth: int = 0) -> Iterator[Any]:
    """Go through the keys and values of a tree of limited depth."""
    if depth > _DEEPEST:
        raise MessageError(f"a message must be at most {_DEEPEST} deep.")
    if isinstance(tree, dict):
        yield from tree
        for value in tree.values():
            yield from _leaves(value, depth + 1)
    elif isinstance(tree, list):
        for value in tree:
            yield from _leaves(value, depth + 1)
    else:
        yield tree


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind, config=None if hasattr(kind, "__pydantic_config__") else _STRICT)


def _problem(kind: Any, value: Any) -> str:
    try:
        _adapter(kind).validate_python(value)
    except ValidationError as error:
        return _first(error)
    return ""


def _first(error: ValidationError) -> str:
    """Describe the first of the errors in one line."""
    first = error.errors(include_url=False, include_context=False)[0]
    place = ".".join(map(str, first["loc"]))
    return f"{place}: {first['msg']}; got {shown(first['input'])}."
