"""Summary of the design, as in its report.

It follows every change, and has the response on request.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import xarray as xr

from coilarray.design.model import Design
from coilarray.viz.studio.calculator import Step
from coilarray.viz.studio.job import with_progress
from coilarray.viz.studio.panel import Panel
from coilarray.viz.studio.searching import map_of
from coilarray.viz.studio.services import Summary

if TYPE_CHECKING:
    from coilarray.viz.studio.page import Page


class SummaryPanel(Panel):
    """Table above the numbers."""

    def __init__(self, page: Page) -> None:
        self._response: tuple[str, xr.Dataset] | None = None  # response of the design with this hash
        values = {
            "summary": {"headers": [], "rows": [], "verdicts": [], "converter": True}, "summary_lacks": False,
            "can_summarize": page.setup.services.summarize is not None,
        }  # fmt: skip
        super().__init__(page, values, respond=self._respond)

    def steps(self, design: Design, coupling: xr.Dataset) -> list[Step]:
        """Make the step that summarizes a design.

        It follows the circuit. Without a summarizing function there is no step.
        """
        summarize = self._page.setup.services.summarize
        if summarize is None:
            return []
        known = self._response is not None and self._response[0] == design.digest
        response = self._response[1] if self._response is not None and known else None

        def show(summary: Summary) -> None:
            """Show a summary."""
            with self._page.state as state:
                if self._page.is_current(design):
                    state.summary = {
                        "headers": list(summary.headers), "rows": [list(row) for row in summary.rows],
                        "verdicts": list(summary.verdicts), "converter": summary.converter,
                    }  # fmt: skip
                    state.summary_lacks = response is None and design.indentation is not None
                self._page.arrived("summary", design)

        fail = partial(self._page.failed, "summary", design)
        return [Step("summary", lambda: summarize(design, coupling, response), show, fail)]

    def _respond(self) -> None:
        """Compute the response map for the summary.

        It gives the summary's rows of the response.
        """
        page = self._page
        design = page.work.design

        def done(response: xr.Dataset) -> None:
            self._response = design.digest, response
            circuit = page.numbers.circuit
            if circuit is not None:
                page.slow.ask(self.steps(page.work.design, circuit.coupling))

        item = (map_of, page.work.opened.document, design.name)
        page.start_bar("response", f"response of {design.name}", with_progress, item, done)
