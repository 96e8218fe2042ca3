"""Page of the studio: panels and templates in ``html``."""

from __future__ import annotations

import logging
import re
import traceback
from dataclasses import replace
from typing import Any

from coilarray.errors import CoilarrayError, shown
from coilarray.viz.studio.design import BuildPanel, DesignPanel, NewPanel
from coilarray.viz.studio.live import LivePanel
from coilarray.viz.studio.metal import MetalPanel
from coilarray.viz.studio.numbers import NumbersPanel, SwitchesPanel
from coilarray.viz.studio.runs import RunsPanel, StudiesPanel
from coilarray.viz.studio.session import Session, Setup, template
from coilarray.viz.studio.touch import TouchPanel
from coilarray.viz.studio.view import ScenePanel
from coilarray.viz.studio.work import Work

_LOG = logging.getLogger(__name__)
_DEFAULTS = {
    **{
        field: {"density": "compact", "variant": "outlined", "hideDetails": True}
        for field in ("VTextField", "VSelect", "VAutocomplete", "VCombobox", "VCheckbox")
    },
    "VSlider": {"density": "compact", "hideDetails": True, "color": "primary", "thumbSize": 14, "trackSize": 3},
    "VBtnToggle": {"density": "compact", "variant": "outlined", "divided": True},
    "VAlert": {"density": "compact"},
}
"""Looks of the parts of the page."""
# Results that a change of the design makes stale.
_FOLLOWING = ("scene", "numbers", "rules", "circuit", "target", "summary")


class Page(Session):
    """Open page, which begins with the design `work`."""

    def __init__(self, setup: Setup, work: Work, tab: str) -> None:
        super().__init__(setup, work)
        self.tab = tab  # of the browser
        self.endpoint: Any = None  # endpoint of its messages
        self.numbers = NumbersPanel(self, self._circuit_solved)
        self.build = BuildPanel(self)
        self.switches = SwitchesPanel(self, self.numbers)
        self.touch = TouchPanel(self)
        self.metal = MetalPanel(self, lambda: self.numbers.circuit and self.numbers.circuit.coupling)
        self.live = LivePanel(self)
        tabs = {"switches": self.switches.scene, "touch": self.touch.scene, "live": self.live.scene}
        self.scene = ScenePanel(self, tabs, self.metal.scene)
        self.runs = RunsPanel(self)
        self.studies = StudiesPanel(self)
        self.design = DesignPanel(self, self.saved)
        self.new = NewPanel(self)
        self.state.tab = "live" if setup.services.alone else "numbers"
        for names, function in (
            (("tab", "scene_sheets", "show_eddies"), self.redraw), (("tab",), self.runs.offer),
            (("matrix_of",), self.numbers.draw), (("hidden_groups",), self.scene.hide),
            (("live_span", "live_paused"), self.live.draw),
        ):  # fmt: skip
            self.state.change(*names)(lambda function=function, **_: function())
        self._build_layout()
        self.server.controller.on_server_bind.add(lambda server: setattr(self, "endpoint", server["ws"]))
        # an error of the page's scripts may contain anything
        self.server.controller.on_error.add(lambda text: _LOG.warning("coilarray: the page reports %s", shown(text)))
        self.server.controller.on_exception.add(self._refuse_call)
        self.server.start(
            backend="generic", exec_mode="task", port=0, timeout=0, disable_logging=True, show_connection_info=False,
            open_browser=False,
        )  # fmt: skip
        self.numbers.show(work)
        self.take(work)

    async def close(self) -> None:
        """End all computations and processes, and the server."""
        from trame.app.core import AVAILABLE_SERVERS
        from trame_vtk.modules.vtk import HELPERS_PER_SERVER

        self.runs.close()
        await super().close()
        self.scene.close()
        await self.server.stop()
        AVAILABLE_SERVERS.pop(self.key, None)
        HELPERS_PER_SERVER.pop(self.key, None)

    def saved(self, work: Work) -> None:
        """Show a saved design, maybe of another name or title."""
        same = work.design is self.work.design
        self.work = replace(self.work, file=work.file)  # no other file is opened
        if not same:
            self._show(work, typed=True)
            return
        self.work = work
        self.numbers.show(work)
        self.design.show(work, typed=True)

    def _show(self, work: Work, *, typed: bool) -> None:
        opened = work.file != self.work.file
        other = opened or set(work.design.array.names) != set(self.work.design.array.names)
        if work.kept is not self.work.kept:
            self.numbers.show(work)
        self.work = work
        design = work.design
        with self.state:
            self.state.can_undo, self.state.can_redo = bool(self._before), bool(self._after)
            self.build.show(work)
            self.design.show(work, typed=typed)
            self.switches.show(design, anew=opened)
            self.touch.show(design, anew=other)
            self.metal.show(design, anew=other)
            self.live.show(design)
            self.runs.show(design)
            self.runs.offer()
            self.studies.show(work, anew=other)
            self.state.accuracy, self.state.scene_rests, self.state.failures = "working", False, {}
            asked = {
                "scene": self.scene.steps(), "target": self.metal.steps(design),
                "summary": self.setup.services.summarize is not None,
            }  # fmt: skip
            self.state.stale = [name for name in _FOLLOWING if asked.get(name, True)]
            self._say_accuracy()
        if not self.setup.services.alone:  # everything that depends on the design is computed
            self.calculator.ask(self.numbers.steps(design))
            self.slow.ask(self.metal.steps(design))
            self.redraw()

    def redraw(self, *, moving: bool = False) -> None:
        """Compute the scene of the current tab again."""
        if not moving:
            self.scene.expect()
        self.scenes.ask(self.scene.steps())

    def _circuit_solved(self, problem: str) -> None:
        """Show what depends on the circuit."""
        if problem:
            self.switches.fail(problem)
            return
        self.switches.solve()
        if self.state.tab == "switches" or self.state.show_eddies:
            self.redraw()

    def _refuse_call(self, error: Exception) -> None:
        """Show a call's error, with traceback if our own."""
        frames = traceback.walk_tb(error.__traceback__)
        if any(str(frame.f_globals.get("__name__")).startswith("coilarray.") for frame, _ in frames):
            traceback.print_exception(error)
        self.say(str(CoilarrayError(f"{type(error).__name__}: {error}")))

    def _build_layout(self) -> None:
        """Build the page from its HTML parts."""
        from trame.ui.vuetify3 import VAppLayout

        def part(found: re.Match[str]) -> str:
            """Part of the page, with a value for its capitals."""
            name, value = found.groups()
            return self.scene.html if name == "view" else filled(template(name).replace("VALUE", value or ""))

        def filled(text: str) -> str:
            return re.sub(r"<!-- (\w+)(?: (\w+))? -->", part, text)

        with VAppLayout(self.server, vuetify_config={"defaults": _DEFAULTS}) as layout:
            layout.root.add_child(filled(template("page")))
