"""Tables of coils, design, rules, fields, circuit, converter and noise."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import KILOHM, MM, PER_MILLION, PERCENT, DisplayUnit, display_unit
from coilarray.compute.table import Column, Table, Value, cell, dataset_table
from coilarray.design.boards import named_boards
from coilarray.design.model import Design, DesignFile
from coilarray.geometry import Margin

if TYPE_CHECKING:
    import xarray as xr

    from coilarray.circuit.noise_budget import NoiseBudget

_DEGREES = DisplayUnit("°", 180 / math.pi, 5)
_ALIKE_K = 2e-4  # of k, as M is known to 10⁻⁴ of L
_ALIKE_PLACES = 0.01  # of the least distance of two coils
_FOUR = DisplayUnit(digits=4)  # as M is known to 10⁻⁴ of L
_LINK_WORDS = {"M_uH": "M (µH)", "voltage_V_per_A": "U (V/A)", "deg": "°"}
_LENGTH, _NUMBER = DisplayUnit("mm", 1e3, 4), DisplayUnit(significant=True)
_LAST = 4  # digits of L after the first, as it is known to 1e-4
_ALIKE = 1e-6  # relative distance of frequencies that is only rounding
_MICROHENRY = DisplayUnit("µH", 1e6)  # four digits of the largest
_NOISE = DisplayUnit("10⁻⁶", 1e6, 3, significant=True)
_DRIFT = DisplayUnit("10⁻⁶/K", 1e6, 3, significant=True)


def coil_table(design: Design, coupling: xr.Dataset) -> Table:
    """Return the coils alone, and with their neighbours as terminated."""
    layers = ["+".join(place.layers) for board in design.placed for place in board.array.placements]
    by_sheets = coupling.sheet_inductance
    single = coupling.assign(layers=("coil", layers), sheet_inductance=("coil", np.diag(by_sheets), by_sheets.attrs))
    names = (
        "coil", "layers", *(axis for axis in ("x", "y", "z") if axis in coupling.coords), "open_inductance",
        "effective_inductance", "frequency", "quality_factor",
        "effective_resistance", "inductance_change", "open_frequency", "sheet_inductance", "resistance",
        "ideal_effective_inductance", "ideal_frequency",
    )  # fmt: skip
    return dataset_table("coils", "Coils", single, names, {"inductance_change": PERCENT})


def board_table(design: Design) -> Table:
    """Return the places and sizes of all boards of a design."""
    columns = (
        *map(Column, ("board", "design")),
        Column("coils", unit="1", shown=_FOUR),
        *(Column(axis, unit="m", shown=_LENGTH) for axis in "xyz"),
        *(Column(f"turn_{axis}", f"turn about {axis}", "rad", _DEGREES) for axis in "xyz"),
        *(Column(name, unit="m", shown=_LENGTH) for name in ("width", "height", "thickness")),
    )
    rows: list[tuple[Value, ...]] = []
    for board in design.placed:
        x_min, y_min, x_max, y_max = board.array.bounds
        size = (x_max - x_min, y_max - y_min, board.array.stackup.thickness)
        name, pose = board.name or ("" if rows else design.name), board.pose
        rows.append((name, board.design.name, len(board.array.names), *pose.shift.tolist(), *pose.turn, *size))
    return Table("boards", "Boards", columns, tuple(rows))


def layer_table(design: Design) -> Table:
    """Return the layers of all boards of a design, from the top."""
    columns = (
        *map(Column, ("board", "layer")),
        Column("copper", unit="m", shown=_LENGTH),
        Column("dielectric", "dielectric below", "m", _LENGTH),
        Column("epsilon_r", "its relative permittivity", "1", DisplayUnit(digits=3)),
    )
    rows: list[tuple[Value, ...]] = []
    for board in named_boards(design):
        stackup = board.array.stackup
        below: list[tuple[Value, ...]] = [
            *zip(stackup.dielectric_thickness, stackup.epsilon_r, strict=True), ("", "")
        ]  # fmt: skip
        for layer, copper, slab in zip(stackup.names, stackup.copper_thickness, below, strict=True):
            rows.append((board.name or design.name, layer, copper, *slab))
    return Table("layers", "Layers of the boards", columns, tuple(rows))


def pair_table(coupling: xr.Dataset) -> Table:
    """Return the couplings, also without sheets and plates."""
    from coilarray.electromagnetics.inductance import coupling_matrix

    by_plates = coupling.plate_inductance.values if "plate_inductance" in coupling else 0.0
    bare = coupling_matrix(coupling.inductance.values - coupling.sheet_inductance.values - by_plates)
    described = {"long_name": "coupling coefficient without magnetic sheets and plates", "units": "1"}
    both = coupling.assign(
        mutual_inductance=coupling.inductance.assign_attrs(long_name="mutual inductance"),
        bare_coupling=(("coil", "other"), bare, described),
    ).rename(coil="active")
    names = (
        "active", "other", "mutual_inductance", "sheet_inductance", "coupling", "bare_coupling", "current_real",
        "current_imag", "contribution",
    )  # fmt: skip
    table = dataset_table("pairs", "Pairs of coils", both, names)
    return replace(table, rows=tuple(row for row in table.rows if row[0] != row[1]))


def middle_coil(design: Design) -> str:
    """Return the coil nearest to the middle of all boards."""
    places = design.centres
    middle = (places.min(axis=0) + places.max(axis=0)) / 2
    return design.coil_names[int(np.linalg.norm(places - middle, axis=1).argmin())]


def neighbour_table(design: Design, coupling: xr.Dataset) -> Table:
    """Return the couplings by kind of neighbour, the strongest first.

    Pairs are of one kind if one coil lies as far from the other in x, y and z, whatever the signs, and kinds of one
    distance are joined if their k agree.
    """
    names, k = coupling.coil.values.tolist(), coupling.coupling.values
    places = design.centres
    first, second = np.triu_indices(len(names), 1)
    k, apart = k[first, second], np.abs(places[first] - places[second])
    step = _ALIKE_PLACES * float(np.linalg.norm(apart, axis=1).min())
    kinds: dict[tuple[int, ...], list[int]] = {}
    for n, kind in enumerate(map(tuple, (apart / step).round().astype(int).tolist())):
        kinds.setdefault(kind, []).append(n)
    rows: list[tuple[str, float, float, float, float]] = []
    for pairs in sorted(kinds.values(), key=lambda pairs: -float(np.abs(k[pairs]).max())):
        n, low, high = pairs[0], float(k[pairs].min()), float(k[pairs].max())
        distance = float(np.linalg.norm(apart[n]))
        like = [
            j for j, row in enumerate(rows)
            if abs(row[2] - distance) < step and max(abs(row[3] - low), abs(row[4] - high)) < _ALIKE_K
        ]  # fmt: skip
        if like:
            example, count, _, least, most = rows[like[0]]
            rows[like[0]] = (example, count + len(pairs), distance, min(least, low), max(most, high))
        else:
            rows.append((f"{names[first[n]]} – {names[second[n]]}", float(len(pairs)), distance, low, high))
    columns = (
        Column("pairs", "kind of neighbour, for example"), Column("count", "pairs", "1", DisplayUnit(digits=0)),
        Column("distance", unit="m", shown=DisplayUnit("mm", 1e3, 2)),
        Column("least_k", "least k", "1", _FOUR), Column("most_k", "largest k", "1", _FOUR),
    )  # fmt: skip
    return Table("neighbours", "Coupling by kind of neighbour", columns, tuple(rows))


def link_tables(columns: xr.Dataset) -> list[Table]:
    """Return the numbers of a link at every pose, from `coilarray.studies.link.columns`.

    Several pairs of coils have rows of their own, and the numbers of the pose, such as resonances, a second table.
    """
    frame = columns.to_dataframe().reset_index()
    names, places = list(map(str, frame.columns)), len(columns.dims)
    pairs = list(dict.fromkeys(name.partition("[")[2] for name in names if "[" in name))

    def table(name: str, names: list[str], pairs: list[str]) -> Table:
        exact = (_FOUR if one.partition("[")[0] == "k" or "efficiency" in one else None for one in names)
        shown = tuple(Column(one, _in_words(one), "1", unit) for one, unit in zip(names, exact, strict=True))
        rows = []
        for row in frame.to_dict("records"):
            for pair in pairs:
                of_pair = {**row, "pair": pair.removesuffix("]").replace(",", " – ")}
                rows.append(tuple(cell(of_pair.get(f"{one}[{pair}", of_pair.get(one, math.nan))) for one in names))
        return Table(name, "Link over the poses", shown, tuple(rows))

    if len(pairs) <= 1:
        return [table("link", names, [""])]
    of_pairs = dict.fromkeys(name.partition("[")[0] for name in names if "[" in name)
    of_pose = [name for name in names if "[" not in name]
    found = [table("link", [*names[:places], "pair", *of_pairs], pairs)]
    return [*found, table("link_poses", of_pose, [""])] if len(of_pose) > places else found


def _in_words(name: str) -> str:
    """Name a column of a link, of a pair without its coils."""
    kind = name.partition("[")[0]
    words, _, unit = kind.rpartition("_")
    return _LINK_WORDS.get(kind) or (
        f"{words.replace('_', ' ')} ({_LINK_WORDS.get(unit, unit)})" if unit in ("mm", "deg", "MHz") else
        kind.replace("_", " ")
    )  # fmt: skip


def design_table(file: DesignFile) -> Table:
    """Return all values of the design, with reasons if assumed."""
    rows = []
    for key, value in file.values.items():
        if not file.design.sheets and key.rpartition(".")[2].startswith("elastomer") and key not in file.given:
            continue
        origin = "assumed" if key in file.assumed else "given" if key in file.given else "default"
        rows.append((key, _plain(value), origin, file.assumed.get(key, "")))
    return Table(
        "design", "Design", tuple(map(Column, ("key", "value", "origin", "reason"))), tuple(rows), mark="assumed"
    )


def rules_table(margins: Sequence[Margin]) -> Table:
    """Return the margins to the rules with their places."""
    columns = (
        *map(Column, ("rule", "layer", "feature")),
        *(Column(name, unit="1") for name in ("value", "limit", "margin")),
        Column("unit"),
        Column("x", unit="m"),
        Column("y", unit="m"),
        Column("kept"),
    )
    rows = tuple(
        (
            *(m.rule, m.layer, m.feature, m.value, m.limit, m.margin, m.unit or "1"),
            *("" if place is None else place for place in (m.x, m.y)),
            m.kept,
        )
        for m in margins
    )
    units = tuple(MM if m.unit else _NUMBER for m in margins)  # rules are kept to 1 µm
    return Table("rules", "Fabrication rules", columns, rows, units, mark="no")


def line_table(fields: Mapping[str, xr.Dataset]) -> Table:
    """Return B_z per ampere in the active coil by state."""
    columns = (
        Column("x", unit="m"),
        *(Column(f"Bz_{of.replace('others as', 'as').replace(' ', '_')}", f"B_z, {of}", "T/A") for of in fields),
    )
    values = (field.B.sel(component="z").values.ravel().tolist() for field in fields.values())
    rows = tuple(zip(next(iter(fields.values())).x.values.tolist(), *values, strict=True))
    return Table("field_line", "B_z along a line", columns, rows)


def _plain(value: object) -> str:
    """Write a value as in design files, lists without brackets."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (list, tuple)):
        return ", ".join(_plain(item) if not isinstance(item, (list, tuple)) else f"[{_plain(item)}]" for item in value)
    return f"{value:g}" if isinstance(value, float) else str(value)


def matrix_tables(names: Sequence[str], inductance: FloatArray) -> list[Table]:
    """Return the matrices of L and M (H), and of k."""
    from coilarray.electromagnetics.inductance import coupling_matrix

    if len(names) == 1:
        return [Table("L", "Inductance", (Column("coil"), Column("L", unit="H")), ((names[0], inductance[0, 0]),))]
    coupling = coupling_matrix(inductance)
    tables, micro = [], display_unit("H")
    largest = float(np.abs(micro.of(inductance)).max())
    micro = replace(micro, digits=max(_LAST - math.floor(math.log10(largest)), 0))
    for name, unit, values in (("L and M", micro, inductance), ("k", _FOUR, coupling)):
        columns = (Column("coil"), *(Column(one, one, "1", replace(unit, symbol="")) for one in names))
        rows = tuple((one, *row) for one, row in zip(names, values.tolist(), strict=True))
        tables.append(Table(name, unit.label(name), columns, rows))
    return tables


def winding_table(scan: xr.Dataset) -> Table:
    """Return resistance and capacitance of every winding."""
    frequency = (
        (),
        scan.attrs["ac_resistance_frequency_Hz"],
        {"units": "Hz", "long_name": "frequency of the AC resistance"},
    )
    names = (
        "coil", "ac_resistance_frequency", "ac_resistance", "resistance_model", "winding_capacitance",
        "self_resonance", "bare_winding_capacitance", "elastomer_delta", "dent_delta_bound",
    )  # fmt: skip
    few = (("F", "pF", 1e12), ("Hz", "MHz", 1e-6), ("1", "10⁻⁶", 1e6))  # as capacitances are known to 3 % and more
    three = {unit: DisplayUnit(symbol, factor, 3, significant=True) for unit, symbol, factor in few}
    shown = dict.fromkeys(("elastomer_delta", "dent_delta_bound"), three["1"])
    shown |= dict.fromkeys(("winding_capacitance", "bare_winding_capacitance"), three["F"])
    shown["self_resonance"] = three["Hz"]
    scan = scan.assign(ac_resistance_frequency=frequency)
    return dataset_table("windings", "Windings", scan, [name for name in names if name in scan], shown)


def state_table(scan: xr.Dataset) -> Table:
    """Return all states of the scan, where the converter oscillates."""
    from coilarray.circuit.converter_limits import with_reasons

    names = (
        "state", "frequency", "effective_inductance", "effective_resistance", "resistance_ratio", "quality_factor",
        "loaded_quality_factor", "parallel_resistance", *(["part_frequency"] if "part_frequency" in scan else []),
    )  # fmt: skip
    scan, read = with_reasons(scan)
    return dataset_table(
        "states", "States", scan, (*names, *read), {"parallel_resistance": KILOHM, "effective_inductance": _MICROHENRY}
    )


def converter_line(design: Design) -> str:
    """Say that no converter is set, if so."""
    if design.readout.is_judged:
        return ""
    return 'No converter is set (readout.converter = "none"): its limits and its drive are not checked.'


def close_line(pairs: Sequence[tuple[str, str, float]]) -> str:
    """Describe states with close frequencies, from `close_channels`."""
    from coilarray.circuit.coupling import CLOSE_CHANNELS

    if not pairs:
        return ""
    one, other, distance = pairs[0]
    closest = "coincide" if distance < _ALIKE else f"by {100 * distance:.2g} %"
    which = f"{len(pairs)} pairs of states are" if len(pairs) > 1 else "one pair of states are"
    return (
        f"The resonances of {which} closer than {100 * CLOSE_CHANNELS:g} % ({one} and {other} {closest}); "
        "this matters only with several converters that measure at the same time."
    )


def pulling_line(design: Design, pairs: Sequence[tuple[str, str, float]]) -> str:
    """Describe what two converters at once make of the closest states, of one coil each."""
    from coilarray.circuit.pulling import converter_pair

    measured = {state.name: [name for name, _ in state.measured] for state in design.plan}
    close = [measured[name] for name in pairs[0][:2]] if pairs else []
    if [len(coils) for coils in close] != [1, 1] or close[0] == close[1]:
        return ""
    (first,), (second,) = close
    found = converter_pair(design, first, second)
    shifts = " and ".join(f"{PERCENT.text(shift, '+.2')}" for shift in found.shifts.tolist())
    if not found.beat:
        return f"Two converters at {first} and {second} would lock to one frequency, off by {shifts}."
    beat = DisplayUnit("kHz", 1e-3).text(found.beat, ".3")
    return f"Two converters at {first} and {second} would shift each other's frequency by {shifts} and beat at {beat}."


def state_current_table(scan: xr.Dataset) -> Table:
    """Return one row for each state and coil."""
    names = ("state", "coil", "current_real", "current_imag")
    return dataset_table("state_currents", "Currents in each state", scan, names)


def limit_table(scan: xr.Dataset) -> Table:
    """Return the limits of an LDC1614 for every state."""
    from coilarray.circuit.converter_limits import channels_of, check_channel

    columns = (
        *map(Column, ("state", "limit")),
        *(Column(name, label, "1", _FOUR) for name, label in (("value", "value"), ("low", "from"), ("high", "to"))),
        Column("kept"),
    )
    rows = tuple(
        (state, limit.name, limit.value, limit.low, cell(limit.high), limit.kept)
        for state, *resonator in channels_of(scan)
        for limit in check_channel(*resonator)
    )
    return Table("ldc1614", "LDC1614", columns, rows, mark="no")


def drive_table(scan: xr.Dataset) -> Table:
    """Return the LDC1614's drive and least settling count by state."""
    from coilarray.circuit.converter_limits import RESISTANCE, channels_of, drive_for
    from coilarray.hardware import settle_count

    columns = (
        Column("state"),
        Column("idrive_code", "IDRIVE"),
        Column("drive_current", unit="A"),
        Column("amplitude", "peak amplitude", "V"),
        Column("settle_count", "SETTLECOUNT, at least", "1"),
    )
    rows: list[tuple[Value, ...]] = []
    for state, f, R_p, Q, _ in channels_of(scan):
        drive = drive_for(R_p) if RESISTANCE[0] <= R_p <= RESISTANCE[1] else None
        setting = ("none fits", "", "") if drive is None else (str(drive.code), drive.current, drive.amplitude)
        rows.append((state, *setting, settle_count(f, Q)))
    return Table("ldc1614_drive", "Drive of the LDC1614", columns, tuple(rows))


def sweep_table(sweep: xr.Dataset) -> Table:
    """Return one row for each frequency and state."""
    names = ("frequency", "state", "impedance_real", "impedance_imag", "apparent_inductance", "quality_factor")
    return dataset_table("sweep", "Impedance over frequency", sweep, names)


def noise_table(budget: NoiseBudget) -> Table:
    """Return the causes of noise with worst states, and totals."""
    columns = (
        Column("cause"),
        Column("scan_noise", "noise of a scan", "1", _NOISE),
        Column("drift", "drift", "1/K", _DRIFT),
        Column("change", "since L_0", "1", _NOISE),
        Column("coils", "coils"),
        Column("size", "size"),
        Column("source", "source"),
    )
    rows: list[tuple[Value, ...]] = [
        (
            cause.name, *(_largest_value(values) for values in (cause.noise, cause.drift, np.abs(cause.change))),
            "common" if cause.common else "each", cause.size, cause.source,
        )
        for cause in budget.causes
    ]  # fmt: skip
    changes = np.sqrt(np.sum([cause.change**2 for cause in budget.causes], axis=0))
    rows.append(("all in quadrature", *map(_largest_value, (budget.scan_noise, budget.drift, changes)), "", "", ""))
    return Table("causes", "Noise and drift of L, relative", columns, tuple(rows))


def sigma_table(budget: NoiseBudget) -> Table:
    """Return noise, drift and σ of δ by state."""
    columns = (
        Column("state"),
        Column("noise", "noise of δ", "1", _NOISE),
        Column("drift", "drift of δ", "1/K", _DRIFT),
        Column("sigma", "σ of δ", "1", _NOISE),
        *([Column("readable")] if budget.unread else []),
    )
    values = [budget.noise.tolist(), budget.drift.tolist(), budget.sigma.tolist()]
    if budget.unread:
        values.append([name not in budget.unread for name in budget.states])
    return Table("sigma", "δ of a reading", columns, tuple(zip(budget.states, *values, strict=True)))


def budget_lines(budget: NoiseBudget) -> list[str]:
    """Describe the settings of a budget and its unverified parts."""
    readout, assumed = budget.readout, [cause.name for cause in budget.causes if cause.size == "assumed"]
    lines = [
        f"RCOUNT {readout.rcount}, {readout.conversion_time * 1e3:.3g} ms at {readout.reference * 1e-6:.4g} MHz; plain "
        f"counting would resolve {PER_MILLION.text(readout.counting_limit, '.2')} of f, the resolution above is finer",
        f"σ of δ: {readout.averaged_scans} of a reading and {readout.baseline_scans} scans of L_0, and what changes "
        f"from L_0 to the reading by {readout.temperature_change:g} K and {readout.supply_change * 1e3:g} mV",
    ]
    if budget.reference:
        lines.append(f"less the mean δ of {', '.join(budget.reference)}, which must not be pressed")
    if budget.unread:
        lines.append(f"no LDC1614 can read {', '.join(budget.unread)}, whose noise is of no use: coilarray impedance")
    if assumed:
        lines.append(f"assumed, not verified on a board: {', '.join(assumed)}; change them in [readout]")
    return lines


def stability_table(found: xr.Dataset) -> Table:
    """Return measured noise and drift by state, beside the budget."""
    columns = (
        Column("state"),
        Column("scan_noise", "noise of a scan", "1", _NOISE),
        Column("expected", "budget", "1", _NOISE),
        Column("least", "least deviation", "1", _NOISE),
        Column("least_tau", "averaged over", "s", DisplayUnit("s", 1.0, 3, significant=True)),
        Column("drift", "drift", "1/s", DisplayUnit("10⁻⁶/h", 3.6e9, 3, significant=True)),
        Column("drift_error", "± drift", "1/s", DisplayUnit("10⁻⁶/h", 3.6e9, 2, significant=True)),
    )
    rows: list[tuple[Value, ...]] = []
    for name in found.state.values.tolist():
        one = found.sel(state=name)
        least = int(np.nanargmin(one.deviation.values))
        shown = (one.scan_noise, one.expected, one.deviation[least], one.tau[least])
        numbers = [float(value) for value in (*shown, one.drift, one.drift_error)]
        rows.append((name, *("" if math.isnan(value) else value for value in numbers)))
    return Table("stability", "Noise and drift of δ at rest", columns, tuple(rows))


def allan_table(found: xr.Dataset) -> Table:
    """Return Allan deviations by state and averaging time."""
    columns = (
        Column("state"),
        Column("tau", "averaged over", "s", DisplayUnit("s", 1.0, 4, significant=True)),
        Column("deviation", "", "1", _NOISE),
    )
    rows = [
        (name, float(tau), float(found.deviation.sel(state=name, tau=tau)))
        for name in found.state.values.tolist()
        for tau in found.tau.values
        if np.isfinite(found.deviation.sel(state=name, tau=tau))
    ]
    return Table("allan", "Allan deviation of δ", columns, tuple(rows))


def averages_table(found: xr.Dataset) -> Table:
    """Return Allan deviations over all states by averaging time."""
    columns = (
        Column("tau", "averaged over", "s", DisplayUnit("s", 1.0, 4, significant=True)),
        *(Column(name, f"{name} coil", "1", _NOISE) for name in ("least", "median", "largest")),
        Column("expected", "budget, white", "1", _NOISE),
    )
    expected, first = float(found.expected.median()), float(found.tau[0])
    rows = []
    for tau in found.tau.values.tolist():
        values = found.deviation.sel(tau=tau).values
        white = expected * math.sqrt(first / tau)
        shown = (np.nanmin(values), np.nanmedian(values), np.nanmax(values), white)
        rows.append((tau, *("" if math.isnan(value) else float(value) for value in shown)))
    return Table("averages", "Allan deviation of δ", columns, tuple(rows))


def stability_lines(found: xr.Dataset) -> list[str]:
    """Describe the measuring time and compare noise and budget."""
    lines = [f"{found.attrs['scans']} scans, one every {found.attrs['period']:.4g} s"]
    ratio = (found.scan_noise / found.expected).values
    if np.isfinite(ratio).any():
        lines.append(f"noise of a scan over that of the budget: {np.nanmin(ratio):.2f} to {np.nanmax(ratio):.2f}")
    return lines


def _largest_value(values: FloatArray) -> float:
    return float(values[np.abs(values).argmax()])
