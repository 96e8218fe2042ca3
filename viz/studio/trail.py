"""Designs of a page before and after the shown design.

Undo and redo go through them.
"""

from __future__ import annotations

from dataclasses import dataclass

from coilarray.viz.studio.work import Work

_LONGEST = 200


@dataclass(frozen=True, eq=False)
class Trail:
    """Earlier designs, and undone designs.

    The next undone design comes first.
    """

    before: tuple[Work, ...] = ()
    after: tuple[Work, ...] = ()

    def left(self, work: Work) -> Trail:
        """Trail after a new design has replaced `work`."""
        return Trail((*self.before, work)[-_LONGEST:])

    def undo(self, work: Work) -> tuple[Trail, Work]:
        """Trail and design before `work`.

        The design belongs to the same file. It must exist.
        """
        return Trail(self.before[:-1], (work, *self.after)), self.before[-1].of_file(work)

    def redo(self, work: Work) -> tuple[Trail, Work]:
        """Trail and design that was undone last.

        The design must exist.
        """
        return Trail((*self.before, work), self.after[1:]), self.after[0].of_file(work)
