"""Panel with the picture in 3-D.

It has the scene of the current tab, and switches for its groups.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, get_args

from coilarray.compute.html import png_url
from coilarray.design.model import Design, build_design
from coilarray.viz.scenes.board import board_in_pieces, scene_of_lifted_board
from coilarray.viz.scenes.draw import bar_of, gradient
from coilarray.viz.scenes.scene import Scene, Side
from coilarray.viz.studio.calculator import Step
from coilarray.viz.studio.panel import Panel
from coilarray.viz.studio.scene_making import BoardParts, metal_scene
from coilarray.viz.studio.view import SceneView

if TYPE_CHECKING:
    from coilarray.viz.studio.page import Page

_STOPS = 24  # colours of a bar


class ScenePanel(Panel):
    """Panel with the view and its scene."""

    def __init__(self, page: Page) -> None:
        self._parts: BoardParts | None = None
        self._expected = 0  # number of the last scene that makes the shown scene stale
        self._saved: Scene | None = None  # scene of the design as given or last saved
        self._alone: tuple[Design, bool, Scene] | None = None  # the last scene without results, with or without sheets
        self._drawn: Scene | None = None
        problem = page.setup.rendering_problem or ("not shown" if page.setup.services.alone else None)
        self._view = None if problem else SceneView(page.server, self._at_rest)
        values = {
            "scene_problem": problem or "", "scene_rests": False, "scene_sides": list(get_args(Side)),
            "hidden_groups": [], "legend": _legend(Scene()), "scene_sheets": False, "scene_saved": False,
            "saved_picture": "", "saved_name": "",
        }  # fmt: skip
        super().__init__(
            page, values, look_from=self._look_from, toggle_group=self._toggle, toggle_sheets=self._toggle_sheets,
            toggle_saved=self._toggle_saved,
        )  # fmt: skip

    @property
    def html(self) -> str:
        """HTML of the view.

        It is empty if nothing can be rendered.
        """
        return "" if self._view is None else str(self._view.widget.html)

    def expect(self) -> None:
        """Mark the picture as stale.

        The mark stays until a scene is drawn whose step is made later than now.
        """
        self._expected += 1
        if self._view is not None and "scene" not in self._page.state.stale:
            with self._page.state as state:
                state.stale = [*state.stale, "scene"]

    def steps(self) -> list[Step]:
        """Make the step that computes the current scene.

        It is the scene of the current tab. If nothing can be rendered, there is no step.
        """
        if self._view is None:
            return []
        design, tab, sheets = self._page.work.design, str(self._page.state.tab), bool(self._page.state.scene_sheets)
        number = self._expected

        def compute() -> tuple[Design, int, Scene]:
            return design, number, self._scene(design, tab, sheets)

        steps = [Step("scene", compute, self._show, self._fail)]
        work = self._page.work
        if self._page.state.scene_saved:

            def compute_saved() -> tuple[str, Scene]:
                saved = build_design(work.kept, design.name)
                return f"{work.file} as saved", _scene_alone(saved, sheets)

            steps.append(Step("saved scene", compute_saved, self._show_saved, self._fail))
        return steps

    def close(self) -> None:
        """Release the window."""
        if self._view is not None:
            self._view.close()

    def _scene(self, design: Design, tab: str, sheets: bool) -> Scene:
        """Compute a scene in a thread.

        The `sheets` are lifted off the board if nothing else lies over it.
        """
        makers: dict[str, Callable[[Design, BoardParts], Scene | None]] = {
            "switches": self._page.switches.scene,
            "touch": self._page.touch.scene,
            "live": self._page.live.scene,
        }
        scene = None
        if tab in makers:
            scene = makers[tab](design, self._board(design))
        if scene is None and (design.plates or design.target is not None):
            scene = self._page.metal.scene(design, self._board(design))
        if scene is not None:
            return scene
        if self._alone is None or self._alone[0] is not design or self._alone[1] != sheets:
            self._alone = design, sheets, _scene_alone(design, sheets)
        return self._alone[2]

    def _board(self, design: Design) -> BoardParts:
        if self._parts is None or self._parts.design is not design:
            self._parts = BoardParts(design, *board_in_pieces(design.array))
        return self._parts

    def _show(self, found: tuple[Design, int, Scene]) -> None:
        """Show a scene and its legend."""
        if self._view is None:
            return
        design, number, scene = found

        def sent() -> None:
            with self._page.state as state:
                state.legend, state.scene_problem = _legend(scene), ""
                if number == self._expected:
                    self._page.arrived("scene", design)

        if scene is self._drawn:
            sent()
        else:
            self._drawn = scene
            self._view.show(scene, sent)

    def _show_saved(self, found: tuple[str, Scene]) -> None:
        """Show the scene of the saved design."""
        if not self._page.state.scene_saved:  # any more
            return
        with self._page.state as state:
            state.saved_name, self._saved = found
            if self._view is not None:
                self._view.make_room_for(self._saved)
            self._draw_saved()

    def _draw_saved(self) -> None:
        """Draw the saved design beside the shown design.

        The camera is the same.
        """
        if self._view is not None and self._saved is not None and self._page.state.scene_saved:
            self._page.state.saved_picture = png_url(self._view.picture(self._saved))

    def show_saved(self, there: bool) -> None:
        """Show or hide the saved design beside the shown design.

        A design without a file has no saved design.
        """
        self._page.state.scene_saved = there and bool(self._page.work.kept)
        self._saved = None
        if self._view is not None:
            self._view.make_room_for(None)
        self._page.state.saved_picture = ""

    def _toggle_saved(self) -> None:
        self.show_saved(not self._page.state.scene_saved)
        self._page.redraw()

    def _fail(self, problem: str) -> None:
        with self._page.state as state:
            state.scene_problem = problem

    def _at_rest(self, rests: bool) -> None:
        with self._page.state as state:
            if rests:
                self._draw_saved()
            state.scene_rests = rests

    def _look_from(self, side: Side) -> None:
        if self._view is not None and side in get_args(Side):
            self._view.look_from(side)

    def _toggle_sheets(self) -> None:
        self._page.state.scene_sheets = not self._page.state.scene_sheets
        self._page.redraw()

    def _toggle(self, name: str) -> None:
        state = self._page.state
        hidden = set(state.hidden_groups) ^ {name}
        state.hidden_groups = sorted(hidden)
        if self._view is not None:
            self._view.hide(hidden)


def _scene_alone(design: Design, sheets: bool) -> Scene:
    """Scene of a board without results.

    It has plates or lifted sheets.
    """
    if design.plates:
        return metal_scene(BoardParts(design, *board_in_pieces(design.array)), None, 0, None)
    return scene_of_lifted_board(design.array, design.sheets if sheets else ())


def _legend(scene: Scene) -> dict[str, Any]:
    """Legend of a scene as plain values.

    It has groups with their colours, bars with title, colours and numbers, and notes.
    """
    bars = [bar_of(scale, _STOPS) for scale in scene.scales]
    return {
        "groups": [{"name": name, "colour": gradient(colours)} for name, colours in scene.groups.items()],
        "bars": [{"title": title, "colours": gradient(colours), "ticks": ticks} for title, colours, ticks in bars],
        "notes": list(scene.notes),
    }
