"""Designs of a page before and after the one on show: what undo and redo go through."""

from __future__ import annotations

from dataclasses import dataclass

from coilarray.viz.studio.work import Work

_LONGEST = 200


@dataclass(frozen=True, eq=False)
class Trail:
    """Earlier designs, and those that were undone, the next one first."""

    before: tuple[Work, ...] = ()
    after: tuple[Work, ...] = ()

    def left(self, work: Work) -> Trail:
        """Return the trail after a new design has taken the place of `work`."""
        return Trail((*self.before, work)[-_LONGEST:])

    def undo(self, work: Work) -> tuple[Trail, Work]:
        """Return the trail and the design before `work`, which is of the same file; there must be one."""
        return Trail(self.before[:-1], (work, *self.after)), self.before[-1].of_file(work)

    def redo(self, work: Work) -> tuple[Trail, Work]:
        """Return the trail and the design that was undone last; there must be one."""
        return Trail((*self.before, work), self.after[1:]), self.after[0].of_file(work)
