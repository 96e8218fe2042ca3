"""Tab of motion: couplings while a board of a design moves along an axis."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from coilarray.compute.display_units import number_text
from coilarray.design.model import Design
from coilarray.geometry import Pose
from coilarray.studies.link import link, pose_of
from coilarray.viz.studio.job import Step
from coilarray.viz.studio.session import Panel, Session
from coilarray.viz.studio.work import number_of

_PLACES = 41  # of the slider
_PAIRS = 12  # with the largest k
_WAY = 20.0  # mm, length of the first way


def motion_of(design: Design, name: str, axis: str, low: float, high: float) -> dict[str, Any]:
    """Couplings of a board at places in mm along an axis, and their changes against its own place."""
    own, places = pose_of(design, name), np.linspace(low, high, _PLACES)
    shift = dict(zip("xyz", own.shift.tolist(), strict=True))
    poses = [Pose(**{**shift, axis: place * 1e-3}, turn=own.turn) for place in places.tolist()]
    found = link(design, {name: [own, *poses]}).coupling.transpose("pair", "pose")
    strongest = np.argsort(-np.abs(found.values).max(axis=1), kind="stable")[:_PAIRS]
    rows = [
        {
            "pair": str(found.pair.values[k]).replace(",", " and "),
            "k": [number_text(value, 4, "+") for value in found.values[k, 1:].tolist()],
            "change": [number_text(value, 4, "+") for value in (found.values[k, 1:] - found.values[k, 0]).tolist()],
        }
        for k in strongest
    ]
    where = {"board": name, "axis": "xyz".index(axis), "own": shift[axis] * 1e3, "at": places.round(6).tolist()}
    return {**where, "rows": rows}


class MotionPanel(Panel):
    """Panel with a board that moves in the picture."""

    def __init__(self, session: Session) -> None:
        values = {
            "motion_boards": [], "motion_board": "", "motion_axis": "z", "motion_ends": ["", ""], "motion_at": 0,
            "motion": {}, "motion_problem": "",
        }  # fmt: skip
        session.state.client_only("motion_at")
        super().__init__(session, values, "motion_problem", move_along=self._along)

    def show(self, design: Design) -> None:
        """Offer the boards of a design."""
        state, names = self._state, [board.name for board in design.boards if board.name]
        state.motion_boards, state.motion = names, {}
        if state.motion_board not in names:
            state.motion_board, state.motion_ends = next(iter(names), ""), ["", ""]
            state.tab = "numbers" if state.tab == "motion" and not names else state.tab
        self.begin()

    def offer(self) -> None:
        """Offer another way, which begins at the board's own place."""
        self._state.motion, self._state.motion_ends = {}, ["", ""]
        self.begin()

    def begin(self) -> None:
        """Compute the motion of the open tab."""
        session, state, design = self._session, self._state, self._session.work.design
        if state.tab != "motion" or state.motion or not state.motion_board:
            return
        if not all(state.motion_ends):
            own = getattr(pose_of(design, state.motion_board), state.motion_axis) * 1e3
            state.motion_ends = [f"{own:g}", f"{own + _WAY:g}"]

        def show(found: dict[str, Any]) -> None:
            if session.is_current(design):
                state.motion, state.motion_problem = found, ""

        low, high = (number_of("an end of the way", text) for text in state.motion_ends)
        compute = partial(motion_of, design, state.motion_board, state.motion_axis, low, high)
        session.slow.ask([Step("motion", compute, show, partial(session.say, place="motion_problem"))])

    def _along(self, low: str, high: str) -> None:
        self._state.motion, self._state.motion_ends = {}, [low, high]
        self.begin()
