"""Commands that compute: ``coilarray report``, ``impedance``, ``response`` and ``target``."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from coilarray import viz
from coilarray.cli import shared
from coilarray.compute.display_units import PER_MILLION, DisplayUnit, number_text, value_text
from coilarray.compute.files import write_text
from coilarray.compute.table import Card, Column, Group, Table, Warn, plain_text, text_table
from coilarray.errors import DesignError, ElastomerError, GeometryError, OutputError
from coilarray.report.drawing import drawing_beside
from coilarray.report.pdf import browser as pdf_browser
from coilarray.report.pdf import write_pdf

Match = Literal["L", "SS", "SP", "PS", "PP"]
Series = Literal["E12", "E24", "E96"]

if TYPE_CHECKING:
    import xarray as xr

    from coilarray.design.model import Design
    from coilarray.report.write import Report
    from coilarray.response.map import Imperfections, Reach


_COMPILE = "from coilarray.electromagnetics import kernels; kernels.compile_kernels()"
_LAST = "paths._rows_sum-*.nbi"  # of the kernels that every command compiles: the index of its code on disk
_FEW = 12  # coils, whose numbers are printed one by one
_FILES = r"\.(nc|csv|cir|sub|inp|s\d+p)"
_REST = "rest_distance_mm"
_SHEET = "thickness_error_mm."


@contextmanager
def compiling_beside() -> Iterator[None]:
    """Compile kernels in another process, unless on disk, while the block runs."""
    kept = Path(os.environ.get("NUMBA_CACHE_DIR") or Path(__file__).parents[1] / "electromagnetics/kernels/__pycache__")
    off = os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")
    there = next((folder for folder in (kept, *kept.parents) if os.access(folder, os.F_OK)), kept)
    if off or (os.cpu_count() or 1) < 2 or any(kept.rglob(_LAST)) or not os.access(there, os.W_OK):
        yield
        return
    quiet = subprocess.DEVNULL
    # what goes wrong there goes wrong here too, and is said here
    child = subprocess.Popen([sys.executable, "-P", "-c", _COMPILE], stdin=quiet, stdout=quiet, stderr=quiet)
    try:
        yield
    finally:
        child.kill()
        child.wait()


def report(
    designs: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="DESIGN",
            help="Design file (TOML) or name of a bundled design, gast2020 by default, or two of them.",
        ),
    ] = None,
    out: Annotated[Path, shared.out_option("Folder for report.html and the folder report.")] = Path(),
    distortion: Annotated[
        Path | None, typer.Option(help="Result of `coilarray paper distortion --out` (.nc), to be included.")
    ] = None,
    link: Annotated[Path | None, typer.Option(help="Result of `coilarray link --out` (.nc), to be included.")] = None,
    pdf: Annotated[
        bool, typer.Option("--pdf", help="Also print report.pdf, by an installed Chromium, Chrome or Edge.")
    ] = False,
    open_it: Annotated[bool, typer.Option("--open", help="Open the report in the browser.")] = False,
    every: shared.Every = False,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Write the report of a design, with tables and pictures.

    Writes report.html, and the folder report with its numbers as CSV, JSON, netCDF and LaTeX tables. Of two designs
    it writes a page that compares them, and the report of each into a folder of its name.

    Example: coilarray report gast2020 --out results --open

    Example: coilarray report a.toml b.toml --pdf
    """
    shared.check_folder(out)
    if len(designs or ()) > 2:
        raise DesignError(f"a report is of one design or of two; got {len(designs or ())}.")
    program = pdf_browser() if pdf else ""  # before the work
    if len(designs or ()) == 2:
        results = distortion, link
        _report_beside(designs or [], out, results, program, open_it=open_it, as_json=as_json, allow=allow_violations)
        return
    design = designs[0] if designs else None
    opened = shared.open_design_file(design, allow_violations=allow_violations, boards=True)  # before other processes
    with compiling_beside(), drawing_beside():
        from coilarray.compute.netcdf import read_checked
        from coilarray.paper.distortion import DISTORTION
        from coilarray.report.sections import SECTIONS
        from coilarray.report.write import write_report
        from coilarray.studies.link import LINK

        causes = None if distortion is None else read_checked(distortion, DISTORTION)
        motion = None if link is None else read_checked(link, LINK)
        with shared.progress_bar("report", [*(title.lower() for title in SECTIONS), "page"]) as progress:
            made = write_report(opened, out, distortion=causes, link=motion, progress=progress)
    printed = f", {write_pdf(made.page, program)}" if pdf else ""
    if made.rendering_problem is not None:
        shared.say(f"coilarray: note: {made.rendering_problem}", err=True)
    if as_json:
        shared.print_json(made.data)
    else:
        _print_report(opened.design, made, every=every)
        shared.say(f"wrote {made.page}{printed} and the data in {made.folder}{os.sep}")
    if open_it:
        shared.open_page(made.page)


def _print_report(design: Design, made: Report, *, every: bool) -> None:
    from coilarray.report.tables import neighbour_table

    shared.say(f"{design.name}  {design.title}".rstrip())
    for block in made.first_page:
        if isinstance(block, Warn):
            shared.say(f"{shared.MARKS[block.kind]} {plain_text(block.text)}")
        elif isinstance(block, Group) and block.kind == "cards":
            cards = [(one.name, one.value, one.remark) for one in block.blocks if isinstance(one, Card)]
            shared.say("")
            shared.say(text_table(("", "", ""), cards))
    tables = [made.summary] if every and made.summary is not None else []
    coils = _coils(design, made.coupling)
    if len(coils.rows) > _FEW and not every:
        tables += [coils.without("neighbours").alike(), neighbour_table(design, made.coupling)]
    else:
        tables.append(coils)
    for table in tables:
        shared.say("")
        shared.say(table)


def _report_beside(
    designs: list[str],
    out: Path,
    results: tuple[Path | None, ...],
    program: str,
    *,
    open_it: bool,
    as_json: bool,
    allow: bool,
) -> None:
    if any(results):
        raise DesignError("--distortion and --link are for the report of one design.")
    opened = [shared.open_design_file(one, allow_violations=allow, boards=True) for one in designs]
    with compiling_beside():  # each report has a drawing process of its own
        from coilarray.report.beside import write_beside

        with shared.progress_bar(f"report of {' and '.join(one.design.name for one in opened)}") as progress:
            made = write_beside(opened, out, progress)
    page = out / "report.html"
    printed = f", {write_pdf(page, program)}" if program else ""
    if as_json:
        shared.print_json({file.design.name: report.data for file, report in zip(opened, made, strict=True)})
        return
    shared.say(f"wrote {page}{printed}, {' and '.join(str(report.page) for report in made)}")
    if open_it:
        shared.open_page(page)


def _coils(design: Design, coupling: xr.Dataset) -> Table:
    import numpy as np

    names, centres = coupling.coil.values.tolist(), design.centres
    distance = np.linalg.norm(centres[:, None] - centres, axis=2)
    np.fill_diagonal(distance, np.inf)
    four = DisplayUnit("µH", 1e6)  # four digits of the largest, as L is known to 1e-4
    columns = [Column("coil"), Column("open_inductance", "L", "H", four)]
    if design.is_tuned:
        columns += [Column("effective_inductance", "L_eff", "H", four), Column("frequency", "f", "Hz")]
    columns.append(Column("neighbours", "k to the neighbours"))
    rows = []
    for a, name in enumerate(names):
        # neighbours: the coils at the least distance, to a twentieth
        near = np.flatnonzero(np.isfinite(distance[a]) & (distance[a] <= 1.05 * distance[a].min()))
        numbers = [float(coupling[column.name][a]) for column in columns[1:-1]]
        neighbours = ", ".join(f"{names[b]} {number_text(float(coupling.coupling[a, b]), 4, '+')}" for b in near)
        rows.append((name, *numbers, neighbours or "none"))
    return Table("", "", tuple(columns), tuple(rows))


def impedance(
    design: shared.DesignArgument = None,
    from_mhz: Annotated[
        float | None,
        typer.Option("--from-MHz", help="Lowest frequency of the sweep; a tenth of the resonance by default."),
    ] = None,
    to_mhz: Annotated[
        float | None, typer.Option("--to-MHz", help="Highest frequency; above resonance and self-resonance by default.")
    ] = None,
    points: Annotated[
        int, shared.number_option("--points", 2, 10_000, "Number of frequencies, evenly spaced on a logarithmic scale.")
    ] = 50,
    noise: Annotated[
        bool, typer.Option("--noise", help="Print the noise and drift of the readings, cause by cause, instead.")
    ] = False,
    reference: shared.References = None,
    ports: Annotated[
        bool, typer.Option("--ports", help="Print the ports instead: impedances, efficiencies and resonances.")
    ] = False,
    match: Annotated[
        Match | None,
        typer.Option(
            "--match",
            help="With --ports: find the capacitors, L for two that match each source to its coil, or the topology of "
            "a wireless power link, of the source's and of the load's coil.",
        ),
    ] = None,
    series: Annotated[
        Series, typer.Option("--series", help="Standard values for --match, and their tolerance (10, 5 or 1 %).")
    ] = "E24",
    out: Annotated[
        Path | None,
        shared.out_option("Also write the sweep: .nc, .csv; the network: .cir, .sub (SPICE), .sNp, .inp (FastHenry)."),
    ] = None,
    plot: Annotated[
        Path | None,
        shared.plot_option("curves over frequency: L, R and Q with both resonances, or S and efficiency of the ports"),
    ] = None,
    every: shared.Every = False,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Compute inductances, couplings, resonances and impedances.

    Prints the matrices of L, M and k, of more than 12 coils k by kind of neighbour, and for each
    state of the scan the circuit with AC resistance, winding capacitance and switches, with the
    limits of the converter. Coils that are alike share a row. --all prints every row.

    With --noise it prints every cause of noise instead: its noise in one scan, its drift per
    kelvin, its change since L_0 was read, and the source of the value. Values and settings are in
    the table [readout] of the design. `locate`, position errors and the ranges of targets assume
    the σ of δ at the end. `coilarray board info --noise` compares a recording with it.

    With --ports it prints the links between the [[circuit.ports]] of the design, at the frequency
    of the link. --out then writes their sweep as .nc or .csv, or their S-parameters at 50 ohm as
    .sNp. With --match other capacitors are found, and how far standard values and their
    tolerances change the result.

    Example: coilarray impedance link.toml --ports --match SS --series E24

    Example: coilarray impedance gast2020 --from-MHz 0.5 --to-MHz 5 --out sweep.csv --plot sweep.png

    Example: coilarray impedance gast2020 --noise --reference coil6
    """
    if out is not None and not re.fullmatch(_FILES, out.suffix.lower()):
        raise OutputError(f"--out must end in .nc, .csv, .cir, .sub, .sNp or .inp; got {out}.")
    shared.check_file("--out", out, None)
    _require_range(1e-6 if from_mhz is None else from_mhz, 1e6 if to_mhz is None else to_mhz)  # before any work
    if reference and not noise:
        raise GeometryError("--reference is for --noise.")
    if match is not None and not ports:
        raise GeometryError("--match is for --ports.")
    if noise and ports:
        raise GeometryError("--noise and --ports print instead of the rest; give one of them.")
    opened = shared.open_design(design, allow_violations=allow_violations, boards=True)
    if noise:
        _print_noise(opened, reference or [], as_json=as_json)
        return
    if ports:
        _print_ports(opened, (from_mhz, to_mhz, points), match, series, (out, plot), as_json=as_json)
        return
    suffix = "" if out is None else out.suffix.lower()
    if suffix == ".inp" and opened.plates:
        raise OutputError(f"--out .inp cannot hold [[plate]], which {opened.name} has; write .cir or .sNp.")
    import numpy as np
    import xarray as xr

    from coilarray.circuit import coupling as circuit
    from coilarray.circuit.board_circuit import board_circuit
    from coilarray.circuit.network import checked_network
    from coilarray.electromagnetics.inductance import coupling_matrix
    from coilarray.report import tables

    with shared.progress_bar("inductance matrix") as progress:
        # two coils in one place are refused here, before any circuit
        inductance = checked_network(board_circuit(opened, progress=progress).inductance, 0.0)[0]
    with shared.progress_bar("states") as progress:
        scan = circuit.scan_design(opened, progress=progress)
    errors = board_circuit(opened).plate_error_attributes
    low, high = (f * 1e-6 for f in circuit.sweep_range(scan))
    low, high = low if from_mhz is None else from_mhz, high if to_mhz is None else to_mhz
    _require_range(low, high)
    even = np.geomspace(low * 1e6, high * 1e6, points)
    frequencies = even if plot is None else circuit.sweep_frequencies(scan, points, (even[0], even[-1]))
    with shared.progress_bar(f"impedance at {frequencies.size} frequencies") as progress:
        curves = circuit.sweep_design(opened, frequencies, progress=progress)
    sweep = curves.sel(frequency=even)
    of_sweep = tables.sweep_table(sweep)
    if suffix in (".nc", ".csv"):
        shared.write_numbers(out, sweep, of_sweep.csv)
    elif out is not None:
        _write_network(opened, scan, out)
    shared.draw(plot, lambda: viz.frequency_figure(curves, scan))
    states, windings = tables.state_table(scan), tables.winding_table(scan)
    drives, limits = tables.drive_table(scan), tables.limit_table(scan)
    close = circuit.close_channels(scan.state.values.tolist(), scan.frequency.values)
    data: dict[str, object] = {**shared.design_record(opened), "names": list(opened.coil_names)}
    if as_json:
        coupling = circuit.couple_design(opened)
        data |= {
            "inductance_H": inductance.tolist(),
            "coupling": coupling.coupling.values.tolist(),
            "coils": tables.coil_table(opened, coupling).records(),
            "pairs": tables.pair_table(coupling).records(),
            **errors,
            "states": states.records(),
            "windings": windings.records(),
            "state_currents": tables.state_current_table(scan).records(),
            "capacitance_F": scan.capacitance.values.tolist() if "capacitance" in scan else None,
            "left_out": scan.attrs["left_out"],
            "converter": opened.readout.converter,
            "ldc1614_drive": drives.records(),
            "ldc1614": limits.records(),
            "close_channels": [{"states": [a, b], "relative_distance": d} for a, b, d in close],
            "sweep": of_sweep.records(),
        }
    lines = [*shared.plate_error_lines(errors), *_limit_lines(scan, opened)]
    without = tables.converter_line(opened)
    lines += [without] if without else [tables.close_line(close), tables.pulling_line(opened, close)] if close else []
    if opened.circuit.ports:
        lines.append(f"ports of {', '.join(port.coil for port in opened.circuit.ports)}: coilarray impedance --ports")
    lines = [*filter(None, lines), *shared.left_out_lines(scan.attrs["left_out"])]
    shown = [states, windings, drives] if opened.is_tuned else [windings]
    shown = [one for one in (shown if every else [one.alike().with_common_note() for one in shown]) if one.rows]
    if len(inductance) > _FEW and not every:
        k = ("coil", "other"), coupling_matrix(inductance)
        of_names = xr.Dataset({"coupling": k}, {"coil": list(opened.coil_names)})
        shown.insert(0, tables.neighbour_table(opened, of_names))
    else:
        shown[:0] = tables.matrix_tables(list(opened.coil_names), inductance)
    shared.print_result(data, as_json=as_json, tables=shown, lines=lines, files=(out, plot))


def _limit_lines(scan: xr.Dataset, design: Design) -> list[str]:
    from coilarray.report.summary import verdicts

    if not design.readout.is_judged:
        return []
    without = " without the target (coilarray target has it with)" if design.target else ""
    so_far = "as far as these numbers go, " if scan.attrs["left_out"] else ""
    kept = f"✔ {design.readout.converter}: {so_far}all limits are kept{without}"
    return [f"✖ {line}" for line in verdicts(scan.assign_attrs(left_out=""), ())] or [kept]


def _write_network(design: Design, scan: xr.Dataset, out: Path) -> None:
    from coilarray.circuit.board_circuit import board_circuit
    from coilarray.circuit.coupling import couple_design
    from coilarray.circuit.network_files import exchange_frequencies, export_network, fasthenry_input

    if out.suffix.lower() == ".inp":
        frequency = float(couple_design(design).frequency.mean())
        resistivity = design.circuit.resistivity
        if any(board.design.circuit.resistivity != resistivity for board in design.placed):
            raise OutputError("--out .inp holds one resistivity, and the boards have several; write .cir or .sNp.")
        text = fasthenry_input(design.paths, [frequency], title=design.name, resistivity=resistivity)
        write_text(out, text)
    else:
        circuit = board_circuit(design)
        export_network(circuit.swept(exchange_frequencies(circuit.network)), out, title=design.name)


def _print_noise(design: Design, reference: list[str], *, as_json: bool) -> None:
    from coilarray.circuit.noise_budget import noise_budget
    from coilarray.report.tables import budget_lines, converter_line, noise_table, sigma_table

    budget = noise_budget(design)
    if reference:
        budget = budget.referenced(reference)
    data = {**shared.design_record(design), **budget.to_record()}
    tables = (noise_table(budget), sigma_table(budget))
    lines = budget_lines(budget)
    if without := converter_line(design):
        lines.append(f"{without} The noise is that of an LDC1614 with the settings of [readout].")
    shared.print_result(data, as_json=as_json, tables=tables, lines=lines)


def _print_ports(
    design: Design,
    sweep: tuple[float | None, float | None, int],
    match: Match | None,
    series: Series,
    files: tuple[Path | None, Path | None],
    *,
    as_json: bool,
) -> None:
    import numpy as np

    from coilarray.circuit.matching import compensated, matched_port
    from coilarray.circuit.network import coil_impedance
    from coilarray.circuit.network_files import touchstone
    from coilarray.circuit.ports import design_ports, port_impedance, solve_ports
    from coilarray.report import port_tables

    out, plot = files
    suffix = "" if out is None else out.suffix.lower()
    if suffix in (".cir", ".sub", ".inp"):
        raise OutputError(f"--out of --ports must end in .nc, .csv or .sNp; got {out}.")
    there, network = design_ports(design)
    tables: list[Table] = []
    if match is not None:
        Z = coil_impedance(network, np.array([there.frequency]))[0]
        for source in there.sources if match == "L" else ():
            there = matched_port(there, Z, there.active[source].coil)
        there = there if match == "L" else compensated(there, Z, match)
        design = replace(design, circuit=replace(design.circuit, ports=there.ports))
        tables += port_tables.capacitor_tables(there, Z, series)
    low, high = (
        share * there.frequency * 1e-6 if f is None else f
        for share, f in zip(port_tables.SWEPT, sweep[:2], strict=True)
    )
    _require_range(low, high)
    f = np.union1d(np.geomspace(low * 1e6, high * 1e6, sweep[2]), there.frequency)
    solved = solve_ports(design, f)
    if suffix in (".nc", ".csv"):
        shared.write_numbers(out, solved, port_tables.sweep_table(solved).csv)
    elif out is not None:
        there, network = design_ports(design, f)
        Z = port_impedance(there, coil_impedance(network, f), f)
        touchstone([port.coil for port in there.active], Z, f, out)
    shared.draw(plot, lambda: viz.ports_figure(solved))
    found = [port_tables.port_table(design, solved), port_tables.link_table(solved), port_tables.mode_table(solved)]
    tables = [*(table for table in found if table.rows), *tables]
    data = {**shared.design_record(design), **{table.name: table.records() for table in tables}}
    lines = shared.left_out_lines(solved.attrs["left_out"])
    shared.print_result(data, as_json=as_json, tables=tables, lines=lines, files=files)


def _require_range(low: float, high: float) -> None:
    if not 1e-6 <= low < high <= 1e6:
        raise GeometryError(f"--from-MHz must be at least 1e-06 and below --to-MHz; got {low:g} and {high:g}.")


def response(
    design: shared.DesignArgument = None,
    depth_mm: shared.Depths = None,
    x_mm: shared.PlacesX = None,
    y_mm: shared.PlacesY = None,
    experiment: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUE",
            help="Imperfection of the experiment: depth_error_mm, tilt_x_mrad, tilt_y_mrad, offset_x_mm, offset_y_mm, "
            "drift, column_drift, thickness_error_mm.SHEET, noise (of each reading of L), seed; or rest_distance_mm, "
            "the height of an indenter with a material while L_0 is read. May be repeated.",
        ),
    ] = None,
    ideal: shared.Ideal = False,
    reach: Annotated[
        str,
        typer.Option(
            help="Coils included at a position: all; a number from 0.0001 to 0.1 for only those near the indenter "
            "that keep the error of δ below this fraction of its peak; auto for 0.001 on large boards, else all."
        ),
    ] = "auto",
    dent: Annotated[bool, typer.Option("--dent", help="Compute the dent and the force alone, without coils.")] = False,
    out: shared.NumbersFile = Path("response.nc"),
    plot: Annotated[Path | None, shared.plot_option("the maps of the deepest dent, or with --dent the dent")] = None,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Compute the response of every coil to an indentation.

    Computes δ = (L_peak − L_0)/L_0 of every state of the scan, for every position and depth of the
    indenter, with the other coils as the scan terminates them. The table shows the peak of every
    map. Positions in the table, the picture and a .csv are on the board. In a .nc they count from
    the map's origin, which it states. After an interruption the same command resumes from the
    folder FILE.parts. On large boards only the coils near the indenter are included, and a line
    says so.

    An indenter with a material (indenter.material of the design) also changes δ by its eddy
    currents and its magnetisation. Their share is shown beside δ. L_0 is read while the indenter
    just touches the sheets. A negative depth of such an indenter is a height above the sheets:
    --depth-mm=-5,-1,0,1.

    Plates below the coils ([[plate]]: a backplane, a copper pour) are included at the frequency of
    each state. Infinite plates reflect the field of the coils and of the dent, plates with an
    outline only the field of the coils.

    With --dent the table has the displacement of each sheet's upper face on the axis, the force of
    the indenter, which has no friction, and the ring, the highest rise of the free surface. A
    rectangular sample counts as wide, and its seat as even.

    Example: coilarray response gast2020 --depth-mm 0.5,1 --out map.nc --plot map.png

    Example: coilarray response gast2020 --dent --depth-mm 0.1:1:10 --out dent.csv
    """
    depths, *places = (
        shared.lengths(option, text) for option, text in (("--depth-mm", depth_mm), ("--x-mm", x_mm), ("--y-mm", y_mm))
    )
    if dent:
        _print_dent(design, depths, out, plot, as_json=as_json)
        return
    imperfections = _experiment(experiment or ())
    counted: Reach = None if reach == "all" else "auto"
    if reach not in ("all", "auto"):
        from coilarray.response.map import LARGEST_ERROR, LEAST_ERROR

        with suppress(ValueError):
            counted = float(reach)
        if not isinstance(counted, float) or not LEAST_ERROR <= counted <= LARGEST_ERROR:
            raise ElastomerError(
                f"--reach must be all, auto or {LEAST_ERROR:g} to {LARGEST_ERROR:g}, an error of δ; got {reach!r}."
            )
    from coilarray.circuit.converter_limits import reading_lines
    from coilarray.report.page import map_outlines
    from coilarray.report.response_tables import path_drive_table, response_table
    from coilarray.report.tables import converter_line
    from coilarray.response.dataset import coils_outside, on_board
    from coilarray.response.map import response_map

    opened = shared.open_design(design, allow_violations=allow_violations, boards=True)
    x, y = shared.from_map_origin(opened.indentation, *places)
    if ideal:
        imperfections = replace(imperfections, network="ideal")
    with shared.map_parts(out) as keep, shared.progress_bar("response") as progress:
        result = response_map(
            opened, depths=depths, x=x, y=y, imperfections=imperfections, accuracy=counted, keep=keep,
            progress=progress,
        )  # fmt: skip
        shown = on_board(result)
        table = response_table(shown)
        in_metres = shown.delta.rename(depth="depth_m", y="y_m", x="x_m")
        shared.write_numbers(out, result, lambda: in_metres.to_dataframe().to_csv(lineterminator="\n"))
    shared.draw(plot, lambda: viz.response_figure(shown, map_outlines(opened, shown)))
    error, lifted = result.attrs["error_of_peak"], result.attrs.get("lifted_m")
    without = converter_line(opened)
    lines = [*([without] if without else reading_lines(shown)), *([] if ideal else shared.missing_capacitance(opened))]
    if error:
        lines.append(
            f"only coils up to {result.attrs['coil_cutoff_m'] * 1e3:.0f} mm from the indenter are included: the error "
            f"of δ is up to {error:g} of its peak; --reach all includes every coil"
        )
    lines.append(shared.wrote_map(out, result))
    if outside := coils_outside(shown) if x is None and y is None else []:
        lines.append(f"note: the design's positions do not include the centres of {', '.join(outside)}")
    if lifted:
        weightless = opened.indentation is not None and not opened.indentation.unevenness.weight
        held = "; without seat_weight_Pa only the indenter holds it down" * weightless
        lines.append(f"note: the sample rises off its seat by up to {lifted * 1e3:.2g} mm{held}")
    # a path through metal needs its own drive; a dent alone changes no amplitude
    drive = path_drive_table(shown if "metal_delta" in shown else shown.drop_vars("amplitude", errors="ignore"))
    data = {
        **shared.design_record(opened), "file": out and str(out), "error_of_peak": error, "lifted_m": lifted,
        table.name: table.records(), drive.name: drive.records(),
    }  # fmt: skip
    tables = [table, *([drive] if drive.rows else [])]
    shared.print_result(data, as_json=as_json, tables=tables, lines=lines, files=[plot])


def _print_dent(
    name: str | None, depths: list[float] | None, out: Path | None, plot: Path | None, *, as_json: bool
) -> None:
    if depths is not None and depths[0] <= 0:
        raise ElastomerError(f"--depth-mm must be above zero with --dent; got {depths[0] * 1e3:g}.")
    from coilarray.circuit.coupling import provenance
    from coilarray.design.model import load_design_file
    from coilarray.report.response_tables import indentation_table
    from coilarray.response.setup import contact_at, indentation_of

    file = load_design_file(name)
    opened = file.design
    setup = indentation_of(opened)
    result = contact_at(setup, opened.sheets, depths or setup.depths).assign_attrs(provenance(opened))
    how = f"{setup.indenter.name}, base {setup.base}, {setup.strain} strain"
    table = replace(indentation_table(result), title=how)
    shared.write_numbers(out, result, table.csv)
    shared.draw(plot, lambda: viz.indentation_figure(result, setup.indenter))
    lines = []
    if setup.sample_bounds is not None:
        lines.append("The sample counts as wide here, on an even seat that holds it. Responses include sides and seat.")
    tables, others = ("elastomer.", "indenter.", "indentation."), (".x_mm", ".y_mm", ".origin", "_permeability")
    assumed = {key: why for key, why in file.assumed.items() if key.startswith(tables) and not key.endswith(others)}
    lines += [f"assumed: {key} = {value_text(file.values[key])}: {why}" for key, why in assumed.items()]
    data = {
        **shared.design_record(opened), "indenter": setup.indenter.name, "base": str(setup.base),
        "strain": setup.strain, "dents": table.records(), "assumed": assumed,
    }  # fmt: skip
    shared.print_result(data, as_json=as_json, tables=[table], lines=lines, files=(out, plot))


def _experiment(texts: Sequence[str]) -> Imperfections:
    from coilarray.studies.calibrate.plan import IMPERFECTIONS, imperfections_of

    values: dict[str, float] = {}
    known = (*IMPERFECTIONS, f"{_SHEET}SHEET", "noise", "seed", _REST)
    for text in texts:
        key, _, value = text.partition("=")
        if key not in known and not key.startswith(_SHEET):
            raise ElastomerError(f"--experiment must be KEY=VALUE with a key of {', '.join(known)}; got {text!r}.")
        if key in values:
            raise ElastomerError(f"--experiment must name {key} once.")
        try:
            values[key] = float(value)
        except ValueError:
            raise ElastomerError(f"--experiment {key} must be a number; got {value!r}.") from None
    seed = values.get("seed", 0.0)
    if not seed.is_integer():
        raise ElastomerError(f"--experiment seed must be a whole number; got {seed:g}.")
    sheets = {key.removeprefix(_SHEET): value * 1e-3 for key, value in values.items() if key.startswith(_SHEET)}
    return replace(
        imperfections_of(values), thickness_errors=sheets, noise=values.get("noise", 0.0), seed=int(seed),
        rest=values.get(_REST, 0.0) * 1e-3,
    )  # fmt: skip


def target(
    design: Annotated[
        str,
        typer.Argument(
            metavar="DESIGN",
            help="Design file (TOML) with a [target], or name of a bundled design; proximity by default.",
            show_default=False,
        ),
    ] = "proximity",
    distance_mm: Annotated[
        str | None, typer.Option(help="Distances, such as 0.5,1 or START:STOP:COUNT; the design's by default.")
    ] = None,
    x_mm: shared.PlacesX = None,
    y_mm: shared.PlacesY = None,
    noise: shared.Noise = None,
    ideal: shared.Ideal = False,
    accuracy: shared.Accuracy = "full",
    out: shared.NumbersFile = Path("target.nc"),
    plot: Annotated[Path | None, shared.plot_option("δ, L, Q and f against the distance")] = None,
    maps: Annotated[Path | None, shared.plot_option("the maps of δ at the least distance", "--maps")] = None,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Compute the response of every coil to a metal target.

    The [target] of the design, of metal or ferrite, is moved over the board, vertically and
    sideways. At every position the whole circuit is solved: L, R, Q, R_p and f of every state of
    the scan, its δ relative to the board without the target, and every coupling. The tables show
    each state without the target, and at the position where the target changes it most, with the
    relative change Δf/f of its frequency, about −δ/2. They also show its range, the distance at
    which |δ| is 3 times the noise, and the distances up to which 1, 10 and 100 µm are resolved.
    Positions in tables, pictures and a .csv are on the board. The design may have any [[plate]]
    beside a target, with a sphere only those below the coils. A plate that nearly touches the
    copper takes longest: --accuracy screen takes a third of the time. Over magnetic sheets or
    beside plates an interrupted map of a disc or another outline is resumed, distance by distance,
    from the folder FILE.parts by the same command.

    Example: coilarray target proximity --distance-mm 1:20:14 --out target.csv --plot target.png
    """
    distances = shared.lengths("--distance-mm", distance_mm, positive=True)
    places = [shared.lengths(option, text) for option, text in (("--x-mm", x_mm), ("--y-mm", y_mm))]
    from coilarray.circuit.converter_limits import reading_lines
    from coilarray.report import response_tables as made
    from coilarray.report.page import map_outlines
    from coilarray.report.tables import converter_line
    from coilarray.response.dataset import on_board
    from coilarray.response.target import target_map

    opened = shared.open_design(design, allow_violations=allow_violations, boards=True)
    x, y = shared.from_map_origin(opened.target, *places)
    network: Literal["ideal"] | None = "ideal" if ideal else None
    with shared.map_parts(out) as keep, shared.progress_bar("target") as progress:
        result = target_map(
            opened, distances=distances, x=x, y=y, noise=noise, network=network, accuracy=accuracy,
            keep=keep, progress=progress,
        )  # fmt: skip
        shown = on_board(result)
        shared.write_numbers(out, result, made.values_table(shown).csv)
    drive = made.path_drive_table(shown)
    tables = made.base_table(shown), made.target_table(shown), made.range_table(shown), *([drive] if drive.rows else [])
    shared.draw(plot, lambda: viz.target_figure(shown))
    shared.draw(maps, lambda: viz.response_figure(shown, map_outlines(opened, shown)))
    data = {
        **shared.design_record(opened),
        "file": out and str(out),
        "body": result.attrs["target"],
        "material": result.attrs["material"],
        "noise": result.attrs["sigma"],
        **{key: value for key, value in result.attrs.items() if key.startswith("plate_")},
        **{table.name: table.records() for table in (*tables, made.target_coupling_table(shown))},
    }
    sigma = PER_MILLION.text(result.attrs["sigma"], ".2")
    lines = [
        *([without] if (without := converter_line(opened)) else reading_lines(shown)),
        *shared.plate_error_lines(result.attrs),
        f"noise of δ {sigma}{shared.noise_source(noise, result)}: the range ends where |δ| is "
        f"{result.attrs['range_factor']:g} times that; a step of distance is resolved if it is at least the standard "
        "deviation of one reading",
        shared.wrote_map(out, result),
    ]
    shared.print_result(data, as_json=as_json, tables=tables, lines=lines, files=[plot, maps])
