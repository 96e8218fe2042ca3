"""Write a report's files from a design, section by section."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import xarray as xr

from coilarray import viz
from coilarray.circuit.coupling import provenance, terminations_of
from coilarray.compute.files import make_folder, write_bytes, write_text
from coilarray.compute.netcdf import netcdf_of
from coilarray.compute.table import Block, Group, Section, Table, Warn, html_card, html_table
from coilarray.compute.threads import Progress, threads
from coilarray.design.boards import boards_words
from coilarray.design.model import Design, DesignFile, metal_words
from coilarray.design.write import as_file
from coilarray.errors import CoilarrayError, DesignError, LocalizeError
from coilarray.geometry.rules import broken_rules
from coilarray.paper.ellipse_model import SEMIAXIS_ADDITION, difference_from_published
from coilarray.report import page, tables
from coilarray.report.drawing import drawing_beside
from coilarray.report.first_page import first_page
from coilarray.report.order import citations
from coilarray.report.sections import ESSENTIAL, ORDER, SECTIONS, Results, lead, model_words
from coilarray.report.summary import summary_table, verdicts
from coilarray.response.dataset import coils_outside

_LATEX_ROWS = 64  # longer tables are for programs, in the CSV files


@dataclass(frozen=True, eq=False)
class Report:
    """Files and numbers of a report.

    `page` is the HTML page, `folder` has the CSV, JSON and netCDF files, and `data` is the content
    of ``report.json``. `coupling` is the result of `coilarray.couple_design`. `rendering_problem`
    is the reason why the board's picture is a drawing, None if it is rendered. `summary` is the
    table of `coilarray.report.summary.summary_table`, and `verdicts` has a line for each exceeded
    limit. `first_page` and `sections` are the blocks of the page.
    """

    page: Path
    folder: Path
    coupling: xr.Dataset
    data: dict[str, object]
    rendering_problem: str | None
    summary: Table | None = None
    verdicts: Sequence[str] = ()
    first_page: tuple[Block, ...] = ()
    sections: tuple[Section, ...] = ()

    def __repr__(self) -> str:
        return f"<Report {self.page}: {'; '.join(self.verdicts) or 'every limit is kept'}>"

    def _repr_html_(self) -> str:
        verdicts = html_table((), [(line,) for line in self.verdicts or ("every limit is kept",)])
        summary = [] if self.summary is None else [self.summary.html()]
        return html_card(f"Report: {self.page}", verdicts, *summary)


def write_report(
    design: Design | DesignFile,
    where: str | Path = ".",
    *,
    distortion: xr.Dataset | None = None,
    link: xr.Dataset | None = None,
    progress: Progress | None = None,
) -> Report:
    """Compute the coupling of a design and write its report.

    Parameters
    ----------
    design : Design or DesignFile
        Design of the board. Assumed values are marked if it comes from a file, as
        `coilarray.design.model.load_design_file` reads it.
    where : str or Path
        Folder for ``report.html`` and the folder ``report``, made if it does not exist. Files of an
        earlier report there are replaced.
    distortion : xarray.Dataset, optional
        Result of `coilarray.paper.distortion.distortion` for the design. It adds the causes that
        move x0 to the page.
    link : xarray.Dataset, optional
        Result of `coilarray.studies.link.link` for the design. It adds coupling and efficiency over
        the motion of boards to the page, as ``link.csv`` to the folder.
    progress : callable, optional
        Function that is called with (done, total) as the work goes on.

    Returns
    -------
    Report
        Written files and their numbers.

    Raises
    ------
    LocalizeError
        A distortion of another design.
    DesignError
        A link of another design.
    OutputError
        A file that cannot be written, or a ``report.html`` that is no report of coilarray. Each
        file is written under a temporary name first, so none is left half-written.

    Notes
    -----
    Every table on the page is also in the folder as a CSV file of its name, such as ``summary.csv``,
    ``coils.csv`` and ``pairs.csv``. All of them are in ``report.json``, and those of up to 64 rows
    in ``tables.tex`` for LaTeX. The arrays are netCDF files, such as ``coupling.nc`` and ``scan.nc``.
    Parts that a design does not ask for are left out. Parts that cannot be computed are left out
    too, with the reason on the page.
    """
    file = as_file(design)
    design = file.design
    if distortion is not None and distortion.attrs.get("design_hash") != design.digest:
        raise LocalizeError(f"the distortion is that of another design than {design.name}.")
    if link is not None and link.attrs.get("design_hash") != design.digest:
        raise DesignError(f"the link is that of another design than {design.name}.")
    folder = Path(where)
    make_folder(folder)  # a folder that cannot be written is known before the work begins
    target = folder / "report.html"
    page.require_own(target)
    made: dict[str, Section] = {}
    # NumPy, SciPy and kernels on threads of their own, while pictures are drawn by another process
    with drawing_beside() as drawing, threads(6) as beside:
        results = Results(file, distortion, link, drawing, beside)
        scene, problem = drawing.submit(page.board_page, design), drawing.submit(viz.rendering_problem)
        for done, (title, make) in enumerate(SECTIONS.items(), start=1):
            try:
                section = make(results)
            except CoilarrayError as error:
                if title in ESSENTIAL:
                    raise
                results.problems[title] = str(error)
                section = Section(title, (Warn(f"Not computed: {error}"),))
            if section is not None:
                made[title] = section
            if progress is not None:
                progress(done, len(SECTIONS) + 1)
        sections = [made[title] for title in ORDER if title in made]
        summary = summary_table(
            results.coupling.result(), results.scan, results.margins, results.shown_or_none, results.bare.result(),
            results.target_or_none, results.bounds, None if results.linking.exception() else results.linking.result(),
        )  # fmt: skip
        reading = verdicts(results.scan, (), results.target_or_none, results.shown_or_none)
        broken = [*broken_rules(results.margins), *reading]
        first = first_page(results, summary, reading)
        all_tables = {summary.name: summary}
        for section in sections:
            all_tables |= section.tables()
        made_with = {**provenance(design), "date": page.now()}
        data = _data(results, broken, made_with) | {table.name: table.records() for table in all_tables.values()}
        texts = {f"{table.name}.csv": table.csv() for table in all_tables.values()}
        short = (table.latex() for table in all_tables.values() if 0 < len(table.rows) <= _LATEX_ROWS)
        texts["tables.tex"] = "% needs \\usepackage{booktabs} and UTF-8\n\n" + "\n".join(short)
        texts["report.json"] = json.dumps(data, indent=1, allow_nan=False) + "\n"
        contents = {name: netcdf_of(found) for name, found in _datasets(results).items() if found is not None}
        board = results.board.result()
        drawing.finish()
    # everything that can fail on the numbers comes before the first file
    title = design.title or design.name
    version = f"revision {design.revision}" if design.revision else f"design {design.digest[:8]}"
    program = f"coilarray {made_with['coilarray_version']}"
    by = " · ".join(filter(None, (design.name, version, design.author, made_with["date"][:10], program)))
    html = page.html_page(
        title,
        [Group("by", (by,)), *lead(results), *first],
        [
            Section("Summary", (Group("summary", (replace(summary.brief().without("key"), title=""),)),)),
            *sections,
            Section("How to cite", tuple(citations(paper=not difference_from_published(design)))),
            page.provenance_section(made_with, model_words(design, results)),
        ],
        title=f"{title} – {'coupling ' if results.several else ''}report",
        top=[board],
        scene=scene.result(),
        contents=True,
        foot=f"{title} · {by}" if title != design.name else by,
    )
    data_folder = folder / "report"
    make_folder(data_folder)
    for name, text in texts.items():
        write_text(data_folder / name, text)
    for name, content in contents.items():
        write_bytes(data_folder / f"{name}.nc", content)
    write_text(target, html)
    if progress is not None:
        progress(len(SECTIONS) + 1, len(SECTIONS) + 1)
    return Report(
        target, data_folder, results.coupling.result(), data, problem.result(), summary.brief().without("key"),
        broken, tuple(first), tuple(sections),
    )  # fmt: skip


def _data(r: Results, broken: list[str], made_with: dict[str, str]) -> dict[str, object]:
    design, coupling = r.design, r.coupling.result()
    indentation = r.problems.get("Indentation") or r.problems.get("Response") or ""
    located = r.positions and {
        "coils": list(r.positions.model.names),
        "depth_m": r.positions.depth,
        "axis": r.positions.axis,
        "semiaxis_addition_m": SEMIAXIS_ADDITION,
        "places": len(r.positions.readings),
        "located": len(r.positions.found),
        "largest_error_m": r.positions.largest_error(),
    }
    return {
        "schema": 1,
        "provenance": made_with,
        "title": design.title or design.name,
        "verdicts": broken,
        "board": boards_words(design),
        "metal": metal_words(design),
        "source": design.source,
        "capacitance_F": design.circuit.capacitance,
        "short_resistance_ohm": design.circuit.short_resistance,
        "terminations": dict(zip(design.coil_names, terminations_of(design), strict=True)),
        "left_out": coupling.attrs["left_out"],
        "close_channels": [{"states": [a, b], "relative_distance": distance} for a, b, distance in r.close_states],
        "close_channels_line": tables.close_line(r.close_states) if design.readout.is_judged else "",
        "converter": design.readout.converter,
        "indentation_problem": indentation,
        "coils_outside_map": [] if r.shown_or_none is None else coils_outside(r.shown_or_none),
        "position_problem": r.problems.get("Position", ""),
        "field_problem": r.problems.get("Field", ""),
        "target_problem": r.problems.get("Target", ""),
        "target_noise": None if r.target_or_none is None else float(r.target_or_none.attrs["sigma"]),
        "position": located,
        "sheet_share": r.sheet_share,
        "field_coil": r.active,
        "field_height_m": design.field_height,
    }


def _datasets(r: Results) -> dict[str, xr.Dataset | None]:
    field, (_, plane) = None, r.fields
    if plane:  # of both states, along ``others``
        field = xr.concat(list(plane.values()), dim="others", combine_attrs="drop_conflicts")
        field = field.assign_coords(others=[label.removeprefix("others ") for label in plane])
    return {
        "coupling": r.coupling.result(),
        "field": field,
        "scan": r.scan,
        "impedance": r.circuit.result()[1],
        "ports": None if r.linking.exception() else r.linking.result(),
        "target": None if r.targeting.exception() else r.targeting.result(),
        "indentation": None if r.pressing.exception() else r.pressing.result(),
        "response": None if r.responding.exception() else r.responding.result(),
        "position_bounds": r.bounds,
        "ellipses": None if r.positions is None else r.positions.fits,
    }
