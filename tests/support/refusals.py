"""What must be refused, in one line each, and functions that fail."""

from __future__ import annotations

from collections.abc import Callable

import pytest


def refused(error: type[Exception], message: str, call: Callable[..., object], *arguments, **options) -> None:
    """Check that a call raises this error, and that its text is one line that matches the message."""
    with pytest.raises(error, match=message) as caught:
        call(*arguments, **options)
    assert "\n" not in str(caught.value)


def raising(error: BaseException) -> Callable[[], None]:
    """Return a function that raises an error."""

    def fail() -> None:
        raise error

    return fail
