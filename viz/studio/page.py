"""Page of the studio: its panels, which show one session, and their Vue templates in ``html``."""

from __future__ import annotations

import logging
import traceback
from dataclasses import replace
from typing import Any

from coilarray.errors import CoilarrayError, shown
from coilarray.viz.studio.design import BuildPanel, DesignPanel, NewPanel
from coilarray.viz.studio.live import LivePanel
from coilarray.viz.studio.metal import MetalPanel
from coilarray.viz.studio.numbers import NumbersPanel, SummaryPanel
from coilarray.viz.studio.runs import RunsPanel
from coilarray.viz.studio.session import Session, Setup, template
from coilarray.viz.studio.studies import StudiesPanel
from coilarray.viz.studio.switches import SwitchesPanel
from coilarray.viz.studio.touch import TouchPanel
from coilarray.viz.studio.view import ScenePanel
from coilarray.viz.studio.work import Work

_LOG = logging.getLogger(__name__)
_PARTS = (
    "bar", "drawer", "scene", "summary", "numbers", "build", "switches", "touch", "metal", "runs", "studies", "live",
    "dialogs",
)  # fmt: skip
# Results that a change of the design makes stale.
_FOLLOWING = ("scene", "numbers", "rules", "circuit", "target", "summary")


class Page(Session):
    """Open page, which begins with the design `work`."""

    def __init__(self, setup: Setup, work: Work, tab: str) -> None:
        super().__init__(setup, work)
        self.tab = tab  # of the browser
        self.endpoint: Any = None  # endpoint of its messages
        self.numbers = NumbersPanel(self, self._circuit_solved, self._circuit_failed)
        self.summary = SummaryPanel(self, lambda: self.numbers.circuit)
        self.build = BuildPanel(self)
        self.switches = SwitchesPanel(self, lambda: self.numbers.circuit)
        self.touch = TouchPanel(self)
        self.metal = MetalPanel(self, lambda: self.numbers.circuit)
        self.live = LivePanel(self)
        tabs = {"switches": self.switches.scene, "touch": self.touch.scene, "live": self.live.scene}
        self.scene = ScenePanel(self, tabs, self.metal.scene)
        self.runs = RunsPanel(self)
        self.studies = StudiesPanel(self)
        self.design = DesignPanel(self, self.saved)
        self.new = NewPanel(self)
        self.state.tab = "live" if setup.services.alone else "numbers"
        for function in (self.redraw, self.runs.offer):
            self.state.change("tab")(lambda function=function, **_: function())
        self.state.change("matrix_of")(lambda **_: self.numbers.draw())
        self._build_layout()
        self.server.controller.on_server_bind.add(lambda server: setattr(self, "endpoint", server["ws"]))
        self.server.controller.on_error.add(_log_error)
        self.server.controller.on_exception.add(self._refuse_call)
        self.server.start(
            backend="generic", exec_mode="task", port=0, timeout=0, disable_logging=True, show_connection_info=False,
            open_browser=False,
        )  # fmt: skip
        self.numbers.forget_saved(work)
        self.take(work)

    async def close(self) -> None:
        """End all computations and processes of the page, and its server."""
        from trame.app.core import AVAILABLE_SERVERS
        from trame_vtk.modules.vtk import HELPERS_PER_SERVER

        self.runs.close()
        await super().close()
        self.scene.close()
        await self.server.stop()
        AVAILABLE_SERVERS.pop(self.key, None)
        HELPERS_PER_SERVER.pop(self.key, None)

    def saved(self, work: Work) -> None:
        """Show that the design is in a file now, maybe with another name or title."""
        same = work.design is self.work.design
        self.work = replace(self.work, file=work.file)  # no other file is opened
        if not same:
            self._show(work, typed=True)
            return
        self.work = work
        self.numbers.forget_saved(work)
        self.design.show(work, typed=True)
        self.redraw()

    def _show(self, work: Work, *, typed: bool) -> None:
        opened = work.file != self.work.file
        other = opened or set(work.design.array.names) != set(self.work.design.array.names)
        if work.kept is not self.work.kept:
            self.numbers.forget_saved(work)
        self.work = work
        with self.state:
            if not work.kept and self.state.scene_saved:
                self.scene.show_saved(False)
            self._say_trail()
            self.build.show(work)
            self.design.show(work, typed=typed)
            self.switches.show(work.design, anew=opened)
            self.touch.show(work.design, anew=other)
            self.metal.show(work.design, anew=other)
            self.live.show(work.design)
            self.runs.show(work.design)
            self.runs.offer()
            self.studies.show(work, anew=other)
            self.state.accuracy, self.state.scene_rests = "working", False
            asked = {
                "scene": self.scene.steps(), "target": self.metal.steps(work.design),
                "summary": self.setup.services.summarize is not None,
            }  # fmt: skip
            self.state.stale = [name for name in _FOLLOWING if asked.get(name, True)]
            self.state.failures = {}
            self._say_accuracy()
        self._follow()

    def _follow(self) -> None:
        """Compute everything that depends on the design."""
        if self.setup.services.alone:
            return
        design, numbers = self.work.design, self.numbers
        self.calculator.ask([numbers.rough(design), numbers.rules(design), numbers.full(design)])
        self.redraw()
        self.slow.ask(self.metal.steps(design))

    def redraw(self, *, moving: bool = False) -> None:
        """Compute the scene of the current tab again."""
        if not moving:
            self.scene.expect()
        self.scenes.ask(self.scene.steps())

    def _circuit_solved(self) -> None:
        """Show what depends on the circuit."""
        self.switches.solve()
        circuit = self.numbers.circuit
        if circuit is not None:
            self.slow.ask(self.summary.steps(self.work.design, circuit.coupling))
        if self.state.tab == "switches" or self.state.show_eddies:
            self.redraw()

    def _circuit_failed(self, problem: str) -> None:
        self.switches.fail(problem)

    def _refuse_call(self, error: Exception) -> None:
        """Show the error of a call of the page, with a traceback if it is of our own code."""
        frames = traceback.walk_tb(error.__traceback__)
        if any(str(frame.f_globals.get("__name__")).startswith("coilarray.") for frame, _ in frames):
            traceback.print_exception(error)
        self.say(str(CoilarrayError(f"{type(error).__name__}: {error}")))

    def _build_layout(self) -> None:
        """Build the page from its HTML parts."""
        from trame.ui.vuetify3 import VAppLayout

        text = template("page")
        for name in _PARTS:
            text = text.replace(f"<!-- {name} -->", template(name))
        with VAppLayout(self.server) as layout:
            layout.root.add_child(text.replace("<!-- view -->", self.scene.html))


def _log_error(message: Any) -> None:
    """Log an error of the page's scripts, which may contain anything, in one line."""
    _LOG.warning("coilarray: the page of the studio reports %s", shown(message))
