"""Window with a scene and a switch for every group."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from coilarray.errors import MissingDependencyError
from coilarray.geometry.array import CoilArray
from coilarray.geometry.sheet import Sheet
from coilarray.viz.offscreen import silent_screen, window_problem, without_screen
from coilarray.viz.palette import INK
from coilarray.viz.scenes.board import scene_of_lifted_board
from coilarray.viz.scenes.camera import Side
from coilarray.viz.scenes.draw import draw, font_file, text_name
from coilarray.viz.scenes.scene import Scene

_SIZE = (1280, 800)  # pixels
_BOX, _STEP, _RIM = 20, 29, 20  # size of a switch, distance to the next, and to the edge of the window, in pixels
_LETTER = 8.5  # width of a letter beside a switch in pixels


def show(scene: Scene, *, side: Side = "oblique") -> None:
    """Open a window with a scene.

    The function returns when the user closes it.

    Parameters
    ----------
    scene : Scene
        Scene that is shown. Every group has a switch.
    side : {"oblique", "top", "front", "right"}
        Side from which it is seen.

    Raises
    ------
    MissingDependencyError
        If no window can be opened or this machine cannot render.
    """
    check_window()
    from coilarray.viz.extra_3d import pyvista

    scene = scene.still()
    plotter: Any = pyvista.Plotter(title="coilarray", window_size=list(_SIZE))
    if without_screen(plotter.render_window.GetClassName()):  # the screen has gone since the check
        plotter.close()
        raise MissingDependencyError(silent_screen())
    plotter.enable_anti_aliasing("ssaa")
    longest = max((len(group) for group in scene.groups), default=0)
    panel = ((_RIM + 2 * _BOX + _LETTER * longest) / _SIZE[0], (_RIM + len(scene.groups) * _STEP) / _SIZE[1])
    draw(scene, plotter, side=side, panel=panel)
    add_switches(scene, plotter)
    plotter.show()


def check_window() -> None:
    """Refuse a window that cannot be opened.

    It raises a MissingDependencyError before the scene is computed.
    """
    problem = window_problem()
    if problem is not None:
        raise MissingDependencyError(problem)


def show_board(array: CoilArray, sheets: Sequence[Sheet] = ()) -> None:
    """Open a window with a board.

    It shows the board of an `array` and `sheets` on it, until the user closes it. The errors are the same as in `show`.
    """
    show(scene_of_lifted_board(array, sheets))


def add_switches(scene: Scene, plotter: Any) -> dict[str, Callable[[bool], None]]:
    """Put a switch for every group into a window.

    True shows the group, and False hides it.
    """
    from matplotlib.colors import to_rgb

    height = plotter.window_size[1]
    switches = {}
    for place, (group, colours) in enumerate(scene.groups.items()):
        switch = switches[group] = _switch(scene, plotter, group)
        y = height - _RIM - _BOX - place * _STEP
        strongest = min(colours, key=lambda colour: sum(to_rgb(colour)))  # white is off, and zero on some scales
        box = {"size": _BOX, "border_size": 2, "color_on": strongest, "color_off": "white"}
        plotter.add_checkbox_button_widget(switch, value=True, position=(_RIM, y), **box)
        letters = {"font_size": 7, "color": INK, "font_file": font_file()}  # PyVista's points have two pixels
        plotter.add_text(group, position=(_RIM + 1.5 * _BOX, y), name=f"name of switch {group}", **letters)
    return switches


def _switch(scene: Scene, plotter: Any, group: str) -> Callable[[bool], None]:
    """Make the function that shows or hides a group."""
    names = [part.name for part in scene.parts if part.group == group]
    looks = {(text.height, text.bold, text.always) for text in scene.texts if text.group == group}
    names += [f"{text_name(group, *look)}-labels" for look in looks]
    actors = [plotter.actors[name] for name in names]

    def switch(shown: bool) -> None:
        for actor in actors:
            actor.SetVisibility(shown)
        plotter.render()

    return switch
