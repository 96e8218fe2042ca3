"""Sections of a design's report: needs, tables and pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.circuit.coupling import (
    close_channels,
    couple_design,
    design_inductance,
    operating_field,
    provenance,
    scan_design,
    sweep_design,
    sweep_frequencies,
    terminations_of,
)
from coilarray.circuit.ports import solve_ports
from coilarray.compute.display_units import display_unit
from coilarray.compute.table import Block, Details, Group, Picture, Section, Table, Warn
from coilarray.design.boards import boards_words, check_boards, named_boards
from coilarray.design.fabs import load_profile
from coilarray.design.model import Design, DesignFile, metal_words, one_board
from coilarray.errors import CoilarrayError, DesignError, LocalizeError
from coilarray.geometry import Margin
from coilarray.paper.ellipse_model import SEMIAXIS_ADDITION, difference_from_published, published_model
from coilarray.report import page, port_tables, position, response_tables, tables
from coilarray.report.drawing import Drawing
from coilarray.report.order import order_table
from coilarray.report.summary import position_bounds
from coilarray.response.dataset import coils_outside, on_board, origin_of
from coilarray.response.map import response_map
from coilarray.response.setup import contact_at
from coilarray.response.target import target_map
from coilarray.studies.link import columns
from coilarray.viz.scenes.results import field_planes

# the line resolves the flanks of the bell to 1/200 of the board, the plane has about one sample per pixel
_LINE_POINTS = 401
_PLANE_STEP = 0.5e-3
_PLANE_POINTS = (100, 400)
_SWEEP_POINTS = 60
_PORT_POINTS = 200
# depths of the force curve, none closer to a depth of the design than this part of the greatest
_CURVE_POINTS, _CURVE_APART = 8, 0.02
_MOST_MATRIX = 12  # coils whose pairs are shown as a matrix, of more by kinds of neighbours
RULES, INPUTS = "rules", "inputs"  # parts of the page that its first lines link to
_PLACES = ("x", "y", "z", "layers")  # columns that do not part coils that are alike
_RESTS = {"bonded": "which are glued to the board", "frictionless": "which slide on the board"}


class Results:
    """Results for the sections, computed beside the drawing of pictures."""

    def __init__(
        self,
        file: DesignFile,
        distortion: xr.Dataset | None,
        link: xr.Dataset | None,
        drawing: Drawing,
        beside: ThreadPoolExecutor,
    ) -> None:
        """Begin the long computations, the common one first."""
        self.file, self.design, self.distortion, self.link = file, file.design, distortion, link
        self.several = len(self.design.coil_names) > 1
        self.active = self.design.array.middle_coil
        self.outlines = list(page.board_outlines(self.design).values())  # corners in m on the board
        switches = self.design.circuit.switches
        self.beside_q = switches.beside_q  # words about the resistance of switches in Q
        given = switches.off_capacitance or switches.terminal_capacitance or switches.bus_capacitance
        self.strays = "AC resistance, the capacitance of the windings" + (
            " and the switches" if given else " (those of the switches are 0 in this design)"
        )
        self.problems: dict[str, str] = {}
        self.fields: tuple[dict[str, xr.Dataset], dict[str, xr.Dataset]] = ({}, {})
        self.positions: position.MapPositions | None = None
        self._drawing = drawing
        design = self.design
        self.pressing = beside.submit(_press, design)
        self.board = beside.submit(self._draw_board)
        beside.submit(design_inductance, design)  # all others wait for it and compute independent parts meanwhile
        self.coupling = beside.submit(couple_design, design)
        self.circuit = beside.submit(_circuit, design)
        self.bare = beside.submit(_without_plates, design)
        self.linking = beside.submit(_links, design)
        self.targeting = beside.submit(lambda: None if design.target is None else target_map(design))
        self.responding = beside.submit(
            lambda: None if design.indentation is None else response_map(design, accuracy="auto")
        )

    def draw(self, function: Callable[..., list[Picture]], *arguments: object) -> Future[list[Picture]]:
        """Draw pictures in the other process."""
        return self._drawing.submit(function, *arguments)

    def _draw_board(self) -> Future[list[Picture]]:
        pressed = None if self.pressing.exception() else self.pressing.result()
        dent = None if pressed is None else pressed.isel(depth=-1)
        return self.draw(page.board_picture, self.design, self.active, dent)

    def plot(self, plot: str, name: str, caption: str, *arguments: object, **options: Any) -> Future[list[Picture]]:
        """Draw a picture by the name of a `coilarray.viz` function."""
        return self.draw(partial(page.plotted, **options), plot, name, caption, *arguments)

    def maps(self, name: str, where: str, response: xr.Dataset) -> tuple[Future[list[Picture]], ...]:
        """Draw δ as maps, none for a single row."""
        if min(response.sizes["x"], response.sizes["y"]) == 1:
            return ()
        caption = f"δ of each state over the {where}, with the outlines of the coils."
        return (self.plot("response_figure", name, caption, response, page.map_outlines(self.design, response)),)

    @cached_property
    def margins(self) -> Sequence[Margin]:
        """Margins to the fabrication rules."""
        return check_boards(self.design)

    @property
    def scan(self) -> xr.Dataset:
        """States of the scan plan."""
        return self.circuit.result()[0]

    @cached_property
    def close_states(self) -> list[tuple[str, str, float]]:
        """Pairs of states with close frequencies."""
        return close_channels(self.scan.state.values.tolist(), self.scan.frequency)

    @cached_property
    def pairs(self) -> Table:
        """Table of the coupling of every pair of coils."""
        return tables.pair_table(self.coupling.result())

    @cached_property
    def shown(self) -> xr.Dataset | None:
        """Response with positions on the board."""
        response = self.responding.result()
        return None if response is None else on_board(response)

    @property
    def shown_or_none(self) -> xr.Dataset | None:
        """`shown`, None if it cannot be computed."""
        return None if self.responding.exception() else self.shown

    @cached_property
    def target(self) -> xr.Dataset | None:
        """Map of the target with positions on the board."""
        found = self.targeting.result()
        return None if found is None else on_board(found)

    @property
    def target_or_none(self) -> xr.Dataset | None:
        """`target`, None if it cannot be computed."""
        return None if self.targeting.exception() else self.target

    @cached_property
    def bounds(self) -> xr.Dataset | None:
        """Bounds of a located position."""
        return None if self.shown_or_none is None else position_bounds(self.shown_or_none, self.design.array)

    @cached_property
    def sheet_share(self) -> dict[str, float]:
        """Least and largest share of magnetic sheets in inductances."""
        coupling = self.coupling.result()
        share = np.diag(coupling.sheet_inductance) / coupling.open_inductance.values
        return {"least": float(share.min()), "most": float(share.max())}


def _copper(r: Results) -> Section:
    pictures = []
    for board in named_boards(r.design):
        array, which = board.array, f" of the board {board.name}" if board.name else ""
        used = {layer for place in array.placements for layer in place.layers}
        for layer in array.stackup.names:
            if layer in used:
                name = page.picture_name(f"copper_{layer}", board)
                caption = f"Copper of layer {layer}{which}."
                pictures.append(r.plot("plot_copper", name, caption, array, layer, width=page.HALF))
    return Section("Copper", (Group("pairs", tuple(pictures)),))


def _boards(r: Results) -> Section | None:
    if not r.design.boards:
        return None
    boards, layers = tables.board_table(r.design), tables.layer_table(r.design)
    return Section("Boards", (
        "Places of the boards, each turned about the fixed axes x, y and z through its own origin, in this order, and "
        "then shifted. The circuit is of this design; each board has the rules and the copper of its own.",
        boards,
        Details("Layers", (layers,)),
    ))  # fmt: skip


def _indentation(r: Results) -> Section | None:
    setup = r.design.indentation
    if setup is None:
        return None
    found = r.pressing.result()
    assert found is not None  # with an indentation
    elastic = (
        "Large deformations of neo-Hookean sheets"
        if setup.strain == "finite"
        else "Linear elasticity with faces that only move up and down (3 % of δ at a depth of an eighth of the sheets)"
    )
    on_seat = f"which rest on an elastic bed ({setup.base})"
    wide = " The rectangular sample counts as wide here; the response includes its sides and its seat."
    return Section("Indentation", (
        f"A rigid {setup.indenter.name} is pressed into the sheets, {_RESTS.get(str(setup.base), on_seat)}. {elastic}, "
        "contact without friction or adhesion. Displacements u_z are of the upper faces of the sheets on the axis. The "
        f"ring is the highest rise of the free surface.{wide if setup.sample_bounds else ''}",
        Group("two", (r.draw(page.indentation_pictures, r.design, setup.indenter, found, r.active),)),
        response_tables.indentation_table(found),
    ))  # fmt: skip


def _coils(r: Results) -> Section:
    coupling = r.coupling.result()
    full = tables.coil_table(r.design, coupling)
    left_out, judged = coupling.attrs["left_out"], r.design.readout.is_judged
    main = ("coil", "open_inductance", "effective_inductance", "frequency", "quality_factor", "inductance_change")
    blocks: list[Block] = [
        replace(full.brief(), main=main).alike(*_PLACES),
        f"L_eff, f, R_eff and Q are {'what the converter sees' if judged else 'at the resonance with the tank'}, with "
        f"{r.strays}. R_eff and Q are of the coils without the "
        f"tank capacitor{r.beside_q}. The ideal columns leave out AC resistance and all strays."
        + (f" Left out everywhere: {left_out.rstrip('.')}." if left_out else ""),
    ]
    if r.sheet_share["most"] > 0:
        shares = dict.fromkeys(f"{100 * share:.2f}" for share in r.sheet_share.values())
        pairs = "; the table of all pairs has their part of M, and k with and without them" if r.several else ""
        blocks.append(
            f"All inductances include the flat magnetic sheets on the board, which make "
            f"{' to '.join(shares)}\u00a0% of L{pairs}."
        )
    return Section("Coils", tuple(blocks), (full, r.pairs))


def _coupling(r: Results) -> Section | None:
    if not r.several:
        return None
    coupling = r.coupling.result()
    kinds = tables.neighbour_table(r.design, coupling)
    few: list[Block] = []
    if len(r.design.coil_names) > _MOST_MATRIX:
        middle = tables.middle_coil(r.design)
        caption = f"Coupling coefficients k = M/√(L L) of {middle} with the other coils."
        names = dict(zip(r.design.coil_names, r.outlines, strict=True))
        pictures = [r.plot("plot_neighbours", "coupling", caption, coupling, names, middle)]
    else:
        few.append(Details("All pairs", (r.pairs.brief(),)))
        pictures = [
            r.plot("plot_coupling", "coupling", "Coupling coefficients k = M/√(L L).", coupling, width=page.HALF),
            r.plot(
                "plot_currents", "currents", "Current in each passive coil per ampere in the active one.", coupling,
                width=page.HALF,
            ),
        ]  # fmt: skip
    return Section("Coupling", (
        Group("two", tuple(pictures)), kinds, *few,
    ), (r.pairs,))  # fmt: skip


def _field(r: Results) -> Section:
    line, plane = r.fields = _fields(r.design, r.coupling.result(), r.active)
    where = "Beside the plates" if r.design.plates else "In free space"
    above = next(iter(plane.values())).z.item() - r.design.pose.z  # not always `field_height`
    height = f"{above * 1e3:.4g} mm above the board, {where[0].lower()}{where[1:]}"
    across = r.outlines[r.design.coil_names.index(r.active)][:, 0]
    sheets = ""
    if r.sheet_share["most"] > 0:
        sheets = " The field is computed without the magnetic sheets"
        sheets += ", which change the currents of the other coils." if r.several else "."
    return Section("Field", (
        f"{where}, in phase with the current of {r.active}.{sheets}",
        r.plot(
            "plot_field_lines", "field_line", f"B_z along x through {r.active}, {height}.", line,
            coil=(float(across.min()), float(across.max())),
        ),
        Group("pairs", tuple(
            r.plot(
                "plot_field_map", f"field_map_{k}",
                f"B_z of {r.active} {height}, per ampere{f': {label}' if len(plane) > 1 else ''}.", field,
                outlines=r.outlines, width=page.HALF,
            )
            for k, (label, field) in enumerate(plane.items())
        )),
        "Values along the line: `report/field_line.csv`.",
    ), (tables.line_table(line),))  # fmt: skip


def _circuit_section(r: Results) -> Section:
    scan, sweep = r.circuit.result()
    windings, limits = tables.winding_table(scan), tables.limit_table(scan)
    shown = windings.brief()
    drives, currents = tables.drive_table(scan), tables.state_current_table(scan)
    without = tables.converter_line(r.design)
    where, takes = ("it resonates with the tank", "") if without else (
        "the converter oscillates", ", which the converter takes for the inductance"
    )  # fmt: skip
    limited = without or "The limits of the converter refer to Q of the whole resonator."
    blocks: list[Block] = [
        f"Each state of the scan plan where {where}, with {r.strays}: the circuit of the table of coils. L_eff is "
        f"1/(ω²C){takes}. R_eff and Q are of the coils without the tank capacitor{r.beside_q}. {limited}",
        tables.state_table(scan).alike().with_common_note(),
    ]
    if r.close_states and not without:
        both = tables.close_line(r.close_states), tables.pulling_line(r.design, r.close_states)
        blocks.append(" ".join(filter(None, both)))
    blocks.append(shown.alike().with_common_note())
    causes = {
        "elastomer_delta": "when the elastomer is laid on the board",
        "dent_delta_bound": "at most for a dent that stays in the topmost sheet",
    }
    names = {column.name for column in shown.columns}
    if said := [words for name, words in causes.items() if name in names]:
        blocks.append(
            "The apparent δ is the relative change of L that the elastomer's permittivity causes, without the magnetic "
            f"effect: {', and '.join(said)}."
        )
    pictured = (
        ("apparent_inductance", "Apparent inductance Im Z/ω", "apparent_inductance"),
        ("resistance", "Effective resistance Re Z", "impedance_real"),
    )
    end = "of every state over frequency, tank capacitor left out."
    circuit = f"Equivalent circuit of {r.active}, the others open, with the errors of what is computed."
    blocks.append(Group("two", (
        r.plot("plot_equivalent_circuit", "equivalent_circuit", circuit, _equivalent_circuit(r), width=page.HALF),
        *(
            r.plot("plot_frequency_sweep", name, f"{words} {end}", sweep, quantity, width=page.HALF)
            for name, words, quantity in pictured
        ),
    )))  # fmt: skip
    if limits.rows:
        over = sum(row[-1] is False for row in limits.rows)
        target = " by the coils without the target" if r.design.target else ""
        kept = f"**{over} limits are broken**; they are marked." if over else f"all limits are kept{target}."
        details = Details(f"Limits of the {r.design.readout.converter}", (limits,), open=over > 0)
        kept = f"{r.design.readout.converter}: {kept}"
        blocks += [kept, drives.alike().with_common_note(), details]
    if r.several:
        blocks.append(Details("Currents in each state", (currents,)))
    return Section("Circuit", tuple(blocks), (windings, currents, limits, drives, tables.sweep_table(sweep)))


def _equivalent_circuit(r: Results) -> dict[str, str]:
    scan, design = r.scan.sel(coil=r.active), r.design
    H, F, ohm, Hz = (display_unit(unit) for unit in ("H", "F", "ohm", "Hz"))
    at = Hz.text(r.scan.attrs["ac_resistance_frequency_Hz"], ".4")
    values = {
        "L": f"{H.text(r.coupling.result().open_inductance.sel(coil=r.active), '.4')} ± 0.01 %",
        "R": f"{ohm.text(scan.ac_resistance, '.3')} ± 1 %\nat {at}",
    }
    if "winding_capacitance" in scan:
        values["winding"] = f"{F.text(scan.winding_capacitance, '.2')} ± 3 %"
    if design.is_tuned:
        values["tank"] = F.text(design.circuit.capacitance, ".4")
    return values


def _ports(r: Results) -> Section | None:
    solved = r.linking.result()
    if solved is None:
        return None
    found = [port_tables.port_table(r.design, solved), port_tables.link_table(solved), port_tables.mode_table(solved)]
    caption = (
        "|S| and efficiency over frequency; dotted lines are the resonances, the grey line is the link's frequency."
    )
    left_out = f" Left out: {solved.attrs['left_out'].rstrip('.')}." if solved.attrs["left_out"] else ""
    return Section("Ports", (
        "Coils with a source, tank or load of their own, which bypass switches and converter; the other coils are as "
        "terminated. |S| is for the resistances of the sources and loads. The efficiency is the power in the load over "
        "that which enters at the source, each source alone; the coils alone allow at most U²/(1 + √(1 + U²))² with "
        f"U = kQ.{left_out}",
        *(table for table in found if table.rows),
        r.plot("ports_figure", "ports", caption, solved),
        "S-parameters over frequency: `report/s_parameters.csv`.",
    ), (port_tables.sweep_table(solved),))  # fmt: skip


def _plates(r: Results) -> Section | None:
    if not r.design.plates:
        return None
    frequency = float(r.coupling.result().frequency.sel(coil=r.active))
    blocks: list[Block] = [
        f"Plates that stay where they are, with their skin depth at the resonance of {r.active}. A plate of several "
        "skin depths screens.",
        response_tables.plate_table(r.design, frequency),
    ]
    without = r.bare.result()
    if without is not None:
        blocks += [
            "Every number of this page is beside the plates. The second column of each pair is without them: eddy "
            "currents lower L and cost Q, permeability raises L.",
            response_tables.beside_plates_table(r.scan, without),
        ]
    return Section("Metal", tuple(blocks))


def _target(r: Results) -> Section | None:
    target = r.target
    if target is None:
        return None
    drive, coupling = response_tables.path_drive_table(target), response_tables.target_coupling_table(target)
    blocks: list[Block] = [
        "A target that is moved over the board, here where it moves each state the most: δ is the change of L against "
        f"the board without it. Its range ends where |δ| is three times the noise of {target.attrs['sigma']:g} in a "
        "reading. A step of distance is resolved as far as it is no less than the standard deviation of one reading.",
        r.plot(
            "target_figure",
            "target",
            "|δ|, inductance, quality factor and frequency of the states over the distance of the target, where it "
            "moves each the most; dotted: the noise of δ, and the values without the target.",
            target,
        ),
        *r.maps("target_maps", f"place of the target, {float(target.distance[0]) * 1e3:g} mm away", target),
        response_tables.range_table(target),
    ]
    if drive.rows:
        blocks += [
            "The drive current of a coil is set once. The amplitude must stay within 1.2 to 1.8 V over the whole path "
            "of the target: below, the converter measures poorly or not at all, above, its input clamps pull the "
            "frequency.",
            drive,
        ]
    blocks.append(Details("Every distance", (response_tables.target_table(target),)))
    if r.several:
        blocks.append(Details("Coupling with the target", (coupling,)))
    return Section("Target", tuple(blocks), (drive,))


def _response(r: Results) -> Section | None:
    shown, setup = r.shown, r.design.indentation
    if shown is None or setup is None:
        return None
    closed = ", the other coils closed as the plan says" if r.several else ""
    window = "" if setup.over_array[0] else ", in the window that the design gives"
    outside = coils_outside(shown)
    centres = f"centre{'s' if len(outside) != 1 else ''} of {', '.join(outside)}"
    return Section("Response", (
        "Response δ = (L_peak − L_0) / L_0 of every state of the scan plan as the converter sees it: L from the "
        f"resonance of the whole circuit, with and without the dent{closed}. For the magnetic field the sheets are "
        "laterally infinite and keep their permeability when they deform. Positions are of the indenter's axis on the "
        f"board{window}.",
        *([Warn(f"The window of the map leaves out the {centres}; without x_mm and y_mm it covers all coils.")]
          if outside else []),
        Group("large", r.maps(
            "response_maps", f"position of the indenter, {float(shown.depth[-1]) * 1e3:g} mm deep", shown,
        )),
        Group("two", (r.draw(page.response_line_pictures, shown),)),
        response_tables.response_table(shown),
    ))  # fmt: skip


def _position(r: Results) -> Section | None:
    if r.design.indentation is None:
        return None
    blocks: list[Block] = []
    if r.bounds is not None and min(r.bounds.sizes.values()) > 1:
        best = (
            "Least standard deviation of a located position over the board. Grey where it exceeds the size of the map "
            "in its direction: the position is not determined there."
        )
        blocks += [
            "Best possible standard deviation of the position from one scan (the Cramér–Rao bound), by the noise of "
            "the readings. `coilarray locate` comes near it.",
            Group("large", (r.plot("identifiability_figure", "position_bounds", best, r.bounds, r.outlines),)),
        ]
    try:
        blocks += _ellipse_blocks(r)
    except (DesignError, LocalizeError) as error:
        r.problems["Position"] = str(error)
        if not blocks:
            blocks.append(Warn(f"Not computed: {error}"))
    return Section("Position", tuple(blocks)) if r.several else None


def _ellipse_blocks(r: Results) -> list[Block]:
    one_board(r.design, "the ellipse model")
    if r.shown_or_none is None:
        raise LocalizeError("there is no response map.")
    response, compare = r.responding.result(), not difference_from_published(r.design)
    assert response is not None  # it is shown
    # beside the paper in its own system, and where the axis of the coils is not the board's
    own = compare or bool(origin_of(response)[1])
    found = r.positions = position.map_positions(response if own else r.shown_or_none)
    published = published_model() if compare else None
    axis = ""
    if found.axis != "x (mm)":
        axis = " Their x0 and the polynomials count from the origin of the map, all positions from the board's."
    error = "Error of x (found − true) over the map; grey where the model has no position."
    fits = position.fit_table(found.fits, found.model, compare=compare)
    return [
        f"Ellipse model of Gast & Zimmermann (2020), fitted to this map {found.depth * 1e3:g}\u00a0mm deep: curves of "
        "equal δ are ellipses centred on the axis of the coils, their semi-axes and centres polynomials of δ, and the "
        f"ellipses of two coils meet at the position.{axis} With {SEMIAXIS_ADDITION * 1e3:g}\u00a0mm added to A as in "
        f"the paper, the model of {', '.join(found.model.names)} gives a position at {len(found.found)} of the grid's "
        f"{len(found.readings)} places; the largest error of x there is {found.largest_error() * 1e3:.2f}\u00a0mm.",
        Group("two", (r.draw(page.ellipse_pictures, r.design, found, published),)),
        r.plot("plot_x_error", "x_error", error, found.error, outlines=r.outlines),
        replace(fits, name="ellipses"),
        Details("Polynomials of δ", (position.polynomial_table(found.model, compare=compare),)),
        Details("Positions", (position.map_position_table(found),)),
    ]


def _paper(r: Results) -> Section | None:
    if difference_from_published(r.design):
        return None
    table = position.paper_table(r.scan.frequency if r.design.is_tuned else None, r.positions)
    return Section("Beside the paper", (
        "Numbers that Gast & Zimmermann (2020) print, and those of this design. A, B and x0 are semi-axes and centre "
        "of the ellipses of Table A1; the errors of x are those of Table 2 and of the places of this map.", table,
    ))  # fmt: skip


def _order(r: Results) -> Section:
    return Section("What to order", (
        "Sizes, materials and parts as the design has them. Assumed entries are to be checked before an order.",
        Group("places", (order_table(r.file, r.margins),)),
    ))  # fmt: skip


def _distortion(r: Results) -> Section | None:
    if r.distortion is None:
        return None
    bands = "; bands: two standard deviations of the calibration" if "x0_std" in r.distortion else ""
    caption = f"Left: x0 over δ as predicted and as published. Right: what x0 loses without each cause{bands}."
    makers = (position.residual_table, position.cause_table, position.indenter_table)
    return Section("What moves x0", (
        "The map goes through the processing of Gast & Zimmermann (2020), and each cause is switched off in turn. "
        "Nothing is fitted to x0. Levels of δ of which the window leaves too little to know an ellipse are crossed "
        "out, counted and left out of every root mean square.",
        r.plot("distortion_figure", "distortion", caption, r.distortion),
        *(table for table in (make(r.distortion) for make in makers) if table.rows),
    ))  # fmt: skip


def _motion(r: Results) -> Section | None:
    if r.link is None:
        return None
    flat = columns(r.link)
    return Section("Link over motion", (
        f"Boards that move: {r.link.attrs.get('moved', '')}. M is known to 10⁻⁴ of the larger L.",
        r.plot("link_figure", "link", "Coupling and efficiency at every pose of the boards that move.", flat),
        Details("All poses", tuple(tables.link_tables(flat))),
    ))  # fmt: skip


def _rules(r: Results) -> Section:
    table = tables.rules_table(r.margins)
    broken, count = sum(not margin.kept for margin in r.margins), len(r.margins)
    blocks: list[Block] = []
    if (profile := r.file.values.get("fab.profile")) is not None:
        fab = load_profile(str(profile))
        links = "; ".join(f"[{title}]({url})" for title, url in fab.sources)
        blocks.append(
            f"Limits of {fab.title}, where the design gives no others; read {fab.read.isoformat()} from {links}."
        )
    said = (
        f"**{broken} of {count} margins are broken**; they are marked." if broken else f"All {count} margins are kept."
    )
    return Section("Fabrication rules", (
        *blocks, said,
        Details("All margins, tightest first", (Group("places", (table,)),), open=broken > 0, id=RULES),
    ))  # fmt: skip


def _design(r: Results) -> Section:
    listed = tables.design_table(r.file)
    decided = replace(listed, name="", rows=tuple(row for row in listed.rows if row[2] != "default"))
    defaults = replace(listed, name="", rows=tuple(row for row in listed.rows if row[2] == "default"))
    marked = "; assumed values are marked" if r.file.assumed else ""
    given = Group("text keys", (decided.without_empty_columns(),))
    blocks: list[Block] = [Details(f"Inputs of the design{marked}", (given,), open=True, id=INPUTS)]
    if defaults.rows:
        title = f"The other {len(defaults.rows)} values have their defaults"
        blocks.append(Details(title, (Group("text keys", (defaults.without_empty_columns(),)),)))
    return Section("Design", tuple(blocks), (listed,))


SECTIONS: dict[str, Callable[[Results], Section | None]] = {
    "Copper": _copper, "Fabrication rules": _rules, "Design": _design, "Indentation": _indentation, "Coils": _coils,
    "Coupling": _coupling, "Field": _field, "Circuit": _circuit_section, "Ports": _ports, "Link over motion": _motion,
    "Metal": _plates, "Response": _response, "Position": _position, "Beside the paper": _paper,
    "What moves x0": _distortion, "Target": _target, "Boards": _boards, "What to order": _order,
}  # fmt: skip
"""Sections in order, first those without the circuit."""

ORDER = (
    "Coils", "Coupling", "Field", "Circuit", "Ports", "Link over motion", "Metal", "Target", "Indentation", "Response",
    "Position", "Beside the paper", "What moves x0", "Boards", "What to order", "Copper", "Fabrication rules", "Design",
)  # fmt: skip
ESSENTIAL = ("Copper", "Fabrication rules", "Design", "Coils", "Coupling", "Circuit")
"""Sections without which there is no report."""


def lead(r: Results) -> list[Block]:
    """First lines of the page."""
    design, shorts = r.design, sorted(set(terminations_of(r.design)))
    metal = metal_words(design)
    grounded = f"{design.circuit.short_resistance:g}\u00a0Ω"
    others = {"short": f"grounded through {grounded}", "open": "open"}.get(
        " ".join(shorts), f"terminated as given (shorts of {grounded})"
    )
    measured = f" While one coil is measured the others are {others}." if r.several else ""
    lines: list[Block] = [design.source] if design.source else []
    lines.append(
        f"{'Coupling report' if r.several else 'Report'} of the design **{design.name}**: {boards_words(design)}"
        f"{f', with {metal}' if metal else ''}; tank capacitor {design.circuit.capacitance * 1e12:g} pF.{measured}"
    )
    return lines


def model_words(design: Design, r: Results) -> str:
    """Describe the model in a paragraph."""
    sheets = ", and by the image series of the flat magnetic sheets" if r.sheet_share["most"] > 0 else ""
    metal = (
        "; metal by the eddy currents in it at the frequency of each state" if design.plates or design.target else ""
    )
    where = "and the plane waves that plates send back" if design.plates else "in free space"
    return (
        "Model: straight rectangular traces; inductance by Neumann's integral averaged over the cross-sections (direct "
        f"current){sheets}{metal}; field by the Biot–Savart law on centre lines {where}. All tables, the response and "
        "the positions have one circuit, with skin and proximity effect and the capacitance of the windings; numbers "
        "without them are called ideal. All numbers: folder `report`."
    )


def _circuit(design: Design) -> tuple[xr.Dataset, xr.Dataset]:
    scan = scan_design(design)
    return scan, sweep_design(design, sweep_frequencies(scan, _SWEEP_POINTS))


def _links(design: Design) -> xr.Dataset | None:
    frequency = design.circuit.link_frequency
    if not design.circuit.ports or frequency is None:
        return None
    low, high = (share * frequency for share in port_tables.SWEPT)
    return solve_ports(design, np.union1d(np.geomspace(low, high, _PORT_POINTS), frequency))


def _without_plates(design: Design) -> xr.Dataset | None:
    if not design.plates:
        return None
    try:
        return scan_design(replace(design, plates=()))
    except CoilarrayError:
        return None


def _press(design: Design) -> xr.Dataset | None:
    setup = design.indentation
    if setup is None:
        return None
    depths = setup.depths  # of a smooth curve are those between them too
    between = np.linspace(0.0, depths[-1], _CURVE_POINTS + 1)[1:-1]
    apart = np.abs(between[:, None] - depths).min(axis=1) > _CURVE_APART * depths[-1]
    curve = sorted([*depths, *between[apart].tolist()])
    return contact_at(setup, design.sheets, curve).assign_attrs(provenance(design))


def _fields(design: Design, coupling: xr.Dataset, active: str) -> tuple[dict[str, xr.Dataset], dict[str, xr.Dataset]]:
    """Compute B in T on a line and a plane.

    The line passes through the active coil, and the others are open and terminated. A single coil
    has one field of each.
    """
    *level, height = field_planes(design, active, _PLANE_STEP)[0]
    middle = design.centres[design.coil_names.index(active)].tolist()
    states = {"others open": False, "others as terminated": True} if len(design.coil_names) > 1 else {"alone": False}

    def both(x: npt.ArrayLike, y: npt.ArrayLike) -> dict[str, xr.Dataset]:
        return {
            label: operating_field(design, coupling, active, x, y, height.low, terminated=terminated)
            for label, terminated in states.items()
        }

    x, y = (
        np.linspace(span.low, span.high, int(np.clip(round((span.high - span.low) / _PLANE_STEP) + 1, *_PLANE_POINTS)))
        for span in level
    )
    return both(np.linspace(level[0].low, level[0].high, _LINE_POINTS), middle[1]), both(x, y)
