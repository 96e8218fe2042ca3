"""Write the files of a report from a design."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray import viz
from coilarray.circuit.coupling import couple_design, design_inductance, provenance, terminations_of
from coilarray.circuit.impedance import close_channels, scan_design, sweep_design, sweep_frequencies
from coilarray.circuit.operating_field import operating_field
from coilarray.compute.files import make_folder, write_bytes, write_text
from coilarray.compute.html import html_card, html_table
from coilarray.compute.netcdf import netcdf_of
from coilarray.compute.table import Picture, Table, Value
from coilarray.compute.threads import Progress, threads
from coilarray.design.fab_limits import load_profile
from coilarray.design.model import Design, DesignFile
from coilarray.design.words import metal_words
from coilarray.design.write import as_file
from coilarray.errors import CoilarrayError, LocalizeError
from coilarray.geometry import check_rules
from coilarray.geometry.array import array_words
from coilarray.paper.ellipse_model import SEMIAXIS_ADDITION
from coilarray.paper.published import difference_from_published, published_model
from coilarray.report import (
    circuit_tables,
    figures,
    indentation_tables,
    localize_tables,
    metal_tables,
    tables,
    target_tables,
)
from coilarray.report.drawing import drawing_beside
from coilarray.report.page import now, render_page, with_contents
from coilarray.report.position import MapPositions, map_position_table, map_positions
from coilarray.report.summary import position_bounds, summary_table, verdicts
from coilarray.response.dataset import coils_outside, on_board, origin_of
from coilarray.response.map import response_map
from coilarray.response.setup import contact_at
from coilarray.response.target import target_map

T = TypeVar("T")

# the line resolves the flanks of the bell to 1/200 of the board, the plane has about one sample per pixel
_LINE_POINTS = 401
_PLANE_STEP = 0.5e-3
_PLANE_POINTS = (100, 400)
_SWEEP_POINTS = 60
# depths of the force curve, none closer to a depth of the design than this part of the greatest
_CURVE_POINTS, _CURVE_APART = 8, 0.02
_ENTERING = ("elastomer.", "indenter.", "indentation.")  # keys of the design shown beside the indentation


@dataclass(frozen=True, eq=False)
class Report:
    """Files and numbers of a report.

    Parameters
    ----------
    page : Path
        File of the HTML page.
    folder : Path
        Folder of the CSV, JSON and netCDF files.
    coupling : xarray.Dataset
        Result of `coilarray.couple_design`.
    data : dict
        Content of ``report.json``.
    rendering_problem : str or None
        Reason why the board's picture is a drawing, in one line. None if it is rendered.
    summary : Table or None
        Least and largest values of the decisive quantities, see `coilarray.report.summary.summary_table`.
    verdicts : sequence of str
        A line for each limit that is exceeded.
    """

    page: Path
    folder: Path
    coupling: xr.Dataset
    data: dict[str, object]
    rendering_problem: str | None
    summary: Table | None = None
    verdicts: Sequence[str] = ()

    def __repr__(self) -> str:
        return f"<Report {self.page}: {'; '.join(self.verdicts) or 'every limit is kept'}>"

    def _repr_html_(self) -> str:
        verdicts = html_table((), [(line,) for line in self.verdicts or ("every limit is kept",)])
        summary = [] if self.summary is None else [html_table(self.summary.headers, self.summary.cells())]
        return html_card(f"Report: {self.page}", verdicts, *summary)


def write_report(
    design: Design | DesignFile,
    where: str | Path = ".",
    *,
    distortion: xr.Dataset | None = None,
    progress: Progress | None = None,
) -> Report:
    """Compute the coupling of a design and write its report.

    Parameters
    ----------
    design : Design or DesignFile
        Design of the board. Assumed values are marked if it comes from a file, as
        `coilarray.design.model.load_design_file` reads it.
    where : str or Path
        Folder for ``report.html`` and the folder ``report``, made if it does not exist. Files of an earlier report
        there are replaced.
    distortion : xarray.Dataset, optional
        Result of `coilarray.paper.distortion.distortion` for the design. It adds the causes that move x0 to the
        page.
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
    OutputError
        A file that cannot be written. Each file is written under a temporary name first, so none is left half-written.

    Notes
    -----
    Every number on the page is also in the folder: ``summary.csv``, ``coils.csv``, ``pairs.csv``, ``design.csv``,
    ``rules.csv``, ``field_line.csv``, ``windings.csv``, ``states.csv``, ``state_currents.csv``, ``ldc1614.csv``,
    ``ldc1614_drive.csv``, ``sweep.csv``, ``indentation.csv``, ``response.csv``, ``ellipses.csv``, ``polynomials.csv``,
    ``map_positions.csv``, ``residuals.csv`` and ``causes.csv``. For metal there are ``plates.csv``,
    ``beside_plates.csv``, ``target.csv``, ``target_range.csv``, ``target_drive.csv`` and ``target_coupling.csv``. All
    of them are in ``report.json``. The arrays are in ``coupling.nc``, ``field.nc``, ``scan.nc``, ``impedance.nc``,
    ``target.nc``, ``indentation.nc``, ``response.nc``, ``position_bounds.nc`` and ``ellipses.nc``. Parts that a design
    does not ask for are left out. Parts that cannot be computed are left out too, with the reason on the page.
    """
    file = as_file(design)
    design = file.design
    if distortion is not None and distortion.attrs.get("design_hash") != design.digest:
        raise LocalizeError(f"the distortion is that of another design than {design.name}.")
    folder = Path(where)
    data_folder = folder / "report"
    make_folder(folder)  # a folder that cannot be written is known before the work begins
    done = itertools.count(1)

    def step() -> None:
        """Report that one of the eight steps is complete."""
        if progress is not None:
            progress(next(done), 8)

    pictures: list[Future[list[Picture]]] = []
    # NumPy, SciPy and kernels on threads of their own, while pictures are drawn by another process
    with drawing_beside() as drawing, threads(6) as beside:

        def draw(function: Callable[..., list[Picture]], *arguments: object) -> None:
            pictures.append(drawing.submit(function, *arguments))

        pressing = beside.submit(_or_reason, lambda: _press(design))
        beside.submit(design_inductance, design)  # all others wait for it and compute independent parts meanwhile
        coupled = beside.submit(couple_design, design)
        circuit = beside.submit(_circuit, design)
        bare = beside.submit(_without_plates, design)
        targeting = beside.submit(_or_reason, lambda: None if design.target is None else target_map(design))
        responding = beside.submit(
            _or_reason, lambda: None if design.indentation is None else response_map(design, reach="auto")
        )
        # parts without a circuit come first
        draw(figures.copper_pictures, design)
        draw(figures.board_picture, design)
        scene = drawing.submit(figures.board_page, design)
        problem = drawing.submit(viz.rendering_problem)
        margins = check_rules(design.array, design.rules)
        step()
        active = design.array.middle_coil
        indentation, indentation_problem = pressing.result()
        if design.indentation is not None and indentation is not None:
            draw(figures.indentation_pictures, design, design.indentation.indenter, indentation, active)
        step()
        coupling = coupled.result()
        if len(design.array.names) > 1:
            draw(figures.coupling_pictures, coupling)
        step()
        fields, field_problem = _or_reason(lambda: _fields(design, coupling, active))
        line, plane = fields or ({}, {})
        if fields:
            draw(figures.field_pictures, design, active, line, plane)
        step()
        scan, sweep = circuit.result()
        draw(figures.sweep_pictures, sweep)
        step()
        response, response_problem = responding.result()
        positions, position_problem = None, "there is no response map."
        compare = not difference_from_published(design)
        shown = None if response is None else on_board(response)
        if response is not None and shown is not None:
            draw(figures.response_pictures, design, shown)
            # beside the paper in its own system, and where the axis of the coils is not the board's
            counted = response if compare or origin_of(response)[1] else shown
            positions, position_problem = _or_reason(lambda: map_positions(counted))
        bounds = None if shown is None else position_bounds(shown, design.array)
        if bounds is not None and min(bounds.sizes.values()) > 1:
            draw(figures.bounds_picture, design, bounds)
        if positions is not None:
            draw(figures.position_pictures, design, positions, published_model() if compare else None)
        if distortion is not None:
            draw(figures.distortion_picture, distortion)
        without = bare.result()
        target, target_problem = targeting.result()
        seen = None if target is None else on_board(target)
        if seen is not None:
            draw(figures.target_pictures, design, seen)
        step()
        # while the last pictures are drawn
        all_tables = [
            summary_table(coupling, scan, margins, shown, without, seen, bounds),
            tables.coil_table(design, coupling),
            tables.pair_table(coupling),
            tables.design_table(file),
            tables.rules_table(margins),
            *([tables.line_table(line)] if line else []),
            *_circuit_tables(scan, sweep),
            *_metal_tables(design, coupling, scan, without, seen),
            *([] if indentation is None else [indentation_tables.indentation_table(indentation)]),
            *([] if shown is None else [indentation_tables.response_table(shown)]),
            *([] if positions is None else _position_tables(positions, compare)),
            *([] if distortion is None else _distortion_tables(distortion)),
        ]
        broken = verdicts(scan, margins, seen, shown)
        close = close_channels(scan.state.values.tolist(), scan.frequency)
        data: dict[str, object] = {
            "schema": 1,
            "provenance": {**provenance(design), "date": now()},
            "title": design.title or design.name,
            "verdicts": broken,
            "board": array_words(design.array),
            "metal": metal_words(design),
            "source": design.source,
            "capacitance_F": design.circuit.capacitance,
            "short_resistance_ohm": design.circuit.short_resistance,
            "terminations": dict(zip(design.array.names, terminations_of(design), strict=True)),
            "left_out": coupling.attrs["left_out"],
            "close_channels": [{"states": [a, b], "relative_distance": distance} for a, b, distance in close],
            "close_channels_line": circuit_tables.close_line(close),
            "indentation_problem": indentation_problem or response_problem,
            "coils_outside_map": [] if shown is None else coils_outside(shown),
            "position_problem": "" if design.indentation is None else position_problem,
            "field_problem": field_problem,
            "target_problem": target_problem,
            "target_noise": None if target is None else float(target.attrs["sigma"]),
            "position": None if positions is None else _position_summary(positions),
            "sheet_share": _sheet_share(coupling),
            "field_coil": active,
            "field_height_m": design.field_height,
            **{table.name: table.records() for table in all_tables},
        }
        texts = {f"{table.name}.csv": table.csv() for table in all_tables}
        texts["report.json"] = json.dumps(data, indent=1, allow_nan=False) + "\n"
        datasets = {
            "coupling": coupling, "field": _both(plane) if plane else None, "scan": scan, "impedance": sweep,
            "target": target, "indentation": indentation, "response": response,
            "position_bounds": bounds, "ellipses": None if positions is None else positions.fits,
        }  # fmt: skip
        contents = {name: netcdf_of(dataset) for name, dataset in datasets.items() if dataset is not None}
        drawing.finish()
        step()
    # everything that can fail on the numbers comes before the first file
    page = _page(file, data, all_tables, [picture for drawn in pictures for picture in drawn.result()], scene.result())
    make_folder(data_folder)
    for name, text in texts.items():
        write_text(data_folder / name, text)
    for name, content in contents.items():
        write_bytes(data_folder / f"{name}.nc", content)
    write_text(folder / "report.html", page)
    step()
    return Report(folder / "report.html", data_folder, coupling, data, problem.result(), all_tables[0].brief(), broken)


def _circuit(design: Design) -> tuple[xr.Dataset, xr.Dataset]:
    """Return scan and sweep of the design's circuit."""
    scan = scan_design(design)
    return scan, sweep_design(design, sweep_frequencies(scan, _SWEEP_POINTS))


def _without_plates(design: Design) -> xr.Dataset | None:
    """Scan of the design without its plates, or None.

    It is None if the design has no plates or if it has no circuit with or without them.
    """
    if not design.plates:
        return None
    return _or_reason(lambda: scan_design(replace(design, plates=())))[0]


def _metal_tables(
    design: Design, coupling: xr.Dataset, scan: xr.Dataset, without: xr.Dataset | None, target: xr.Dataset | None
) -> list[Table]:
    """Tables of plates and target."""
    found = []
    if design.plates:
        frequency = float(coupling.frequency.sel(coil=design.array.middle_coil))
        found.append(metal_tables.plate_table(design, frequency))
    if without is not None:
        found.append(metal_tables.beside_plates_table(scan, without))
    if target is not None:
        found += [target_tables.target_table(target), target_tables.range_table(target)]
        found += [target_tables.path_drive_table(target)]
        found += [target_tables.target_coupling_table(target)] if len(design.array.names) > 1 else []
    return found


def _sheet_share(coupling: xr.Dataset) -> dict[str, float]:
    """Share of the magnetic sheets in the coils' inductances.

    Least and largest share over the coils.
    """
    share = np.diag(coupling.sheet_inductance) / coupling.open_inductance.values
    return {"least": float(share.min()), "most": float(share.max())}


def _press(design: Design) -> xr.Dataset | None:
    """Force curve and dents of the design's indentation.

    None if it has no indentation.
    """
    setup = design.indentation
    if setup is None:
        return None
    depths = _curve(setup.depths)
    return contact_at(setup, design.sheets, depths).assign_attrs(provenance(design))


def _or_reason(compute: Callable[[], T]) -> tuple[T | None, str]:
    """Return a result or the reason of failure.

    After a successful computation the reason is empty. After a failure the result is None.
    """
    try:
        return compute(), ""
    except CoilarrayError as error:
        return None, str(error)


def _position_tables(positions: MapPositions, compare: bool) -> list[Table]:
    return [
        replace(localize_tables.fit_table(positions.fits, positions.model, compare=compare), name="ellipses"),
        localize_tables.polynomial_table(positions.model, compare=compare),
        map_position_table(positions),
    ]


def _distortion_tables(distortion: xr.Dataset) -> list[Table]:
    makers = (localize_tables.residual_table, localize_tables.cause_table, localize_tables.indenter_table)
    return [table for table in (make(distortion) for make in makers) if table.rows]


def _position_summary(positions: MapPositions) -> dict[str, object]:
    """Numbers of the page's paragraph about positions, in SI units."""
    return {
        "coils": list(positions.model.names),
        "depth_m": positions.depth,
        "axis": positions.axis,
        "semiaxis_addition_m": SEMIAXIS_ADDITION,
        "places": len(positions.readings),
        "located": len(positions.found),
        "largest_error_m": positions.largest_error(),
    }


def _curve(depths: Sequence[float]) -> list[float]:
    """Depths in m of a smooth force curve.

    They are the depths of a design and others between zero and the greatest.
    """
    between = np.linspace(0.0, depths[-1], _CURVE_POINTS + 1)[1:-1]
    apart = np.abs(between[:, None] - depths).min(axis=1) > _CURVE_APART * depths[-1]
    return sorted([*depths, *between[apart].tolist()])


def _circuit_tables(scan: xr.Dataset, sweep: xr.Dataset) -> list[Table]:
    of_scan = (
        circuit_tables.winding_table, circuit_tables.state_table, circuit_tables.state_current_table,
        circuit_tables.limit_table, circuit_tables.drive_table,
    )  # fmt: skip
    return [*(table(scan) for table in of_scan), circuit_tables.sweep_table(sweep)]


def _fields(design: Design, coupling: xr.Dataset, active: str) -> tuple[dict[str, xr.Dataset], dict[str, xr.Dataset]]:
    """Compute the field B above the board, in T.

    It is computed on a line along x through the active coil and on a plane, with the others open and terminated. A
    single coil has one field of each.
    """
    x_min, y_min, x_max, y_max = design.array.bounds
    place = design.array.placements[design.array.names.index(active)]
    states = {"others open": False, "others as terminated": True} if len(design.array.names) > 1 else {"alone": False}
    along = np.linspace(x_min, x_max, _LINE_POINTS)
    x = np.linspace(x_min, x_max, _samples(x_max - x_min))
    y = np.linspace(y_min, y_max, _samples(y_max - y_min))

    def both(x: npt.ArrayLike, y: npt.ArrayLike) -> dict[str, xr.Dataset]:
        """Fields with the other coils open and terminated."""
        return {
            label: operating_field(design, coupling, active, x, y, design.field_height, terminated=terminated)
            for label, terminated in states.items()
        }

    return both(along, place.y), both(x, y)


def _samples(extent: float) -> int:
    least, most = _PLANE_POINTS
    return min(max(round(extent / _PLANE_STEP) + 1, least), most)


def _both(plane: dict[str, xr.Dataset]) -> xr.Dataset:
    """Combine both states of the plane along ``others``."""
    joined = xr.concat(list(plane.values()), dim="others", combine_attrs="drop_conflicts")
    return joined.assign_coords(others=[label.removeprefix("others ") for label in plane])


def _page(
    file: DesignFile,
    data: Mapping[str, object],
    all_tables: Sequence[Table],
    pictures: Sequence[Picture],
    scene: str | None,
) -> str:
    """Compose the page."""
    by_name = {table.name: table for table in all_tables}
    profile = file.values.get("fab.profile")
    listed = by_name["design"]

    def values_where(chosen: Callable[[tuple[Value, ...]], bool]) -> Table:
        return replace(listed, rows=tuple(row for row in listed.rows if chosen(row))).without_empty_columns()

    page = render_page(
        "page.html.j2",
        design=file.design,
        file=file,
        shorts=sorted(set(terminations_of(file.design))),
        data=data,
        tables=by_name,
        entering=values_where(lambda row: str(row[0]).startswith(_ENTERING)),
        decided=values_where(lambda row: row[2] != "default"),
        defaults=values_where(lambda row: row[2] == "default"),
        fab=None if profile is None else load_profile(str(profile)),
        pictures={picture.name: picture for picture in pictures},
        copper=[picture for picture in pictures if picture.name.startswith("copper_")],
        maps=[picture for picture in pictures if picture.name.startswith("field_map_")],
        scene=scene,
        made=data["provenance"],
    )
    return with_contents(page)
