"""What a driver must not do, although the chips let it happen."""

from __future__ import annotations


class UndocumentedUse(Exception):  # noqa: N818 - not an error of a board: a fault of the driver that no driver may catch
    """Use of a chip that its data sheet does not allow: raised in strict mode, else noted."""


class Misuse:
    """Notes undocumented use, and raises in strict mode.

    Parameters
    ----------
    strict : bool
        Whether to raise.

    Examples
    --------
    >>> misuse = Misuse(strict=False)
    >>> misuse.note("register 0x1D is not documented")
    >>> misuse.notes
    ['register 0x1D is not documented']
    """

    _MOST = 1000  # a driver gone wild must not fill the memory

    def __init__(self, strict: bool) -> None:
        self.strict = strict
        self.notes: list[str] = []

    def remark(self, what: str) -> None:
        """Note something that may not be the driver's fault: never raises."""
        if len(self.notes) < self._MOST:
            self.notes.append(what)

    def note(self, what: str) -> None:
        """Note one use; UndocumentedUse in strict mode."""
        self.remark(what)
        if self.strict:
            raise UndocumentedUse(what)
