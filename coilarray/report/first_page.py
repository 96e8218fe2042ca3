"""First page of a report: verdicts, cards, drawings, and how far numbers are known."""

from collections import Counter
from collections.abc import Sequence

from coilarray.compute.display_units import KILOHM, MM, PERCENT, PPM, DisplayUnit, display_unit, number_text, span
from coilarray.compute.table import Block, Card, Details, Group, Table, Value, Warn, text_table
from coilarray.design.boards import made_verdict, named_boards
from coilarray.design.model import Design, DesignFile
from coilarray.geometry import Margin
from coilarray.geometry.rules import KEPT_WITHIN, broken_rules
from coilarray.report import page, tables
from coilarray.report.sections import INPUTS, RULES, Results
from coilarray.report.summary import CHECKED_WITHOUT, tightest

_MICROMETRES, _PLAIN = DisplayUnit("µm", 1e6), DisplayUnit()
_LARGE = 1e-3  # relative change from which it is shown in %
_LONG = 1e-4  # m, length from which it is shown in mm
_KNOWN = 1e-4  # of k, as M is known to this part of L
_CARDS = 6  # side by side on paper


def first_page(r: Results, summary: Table, reading: Sequence[str]) -> list[Block]:
    """Return verdicts, cards, drawings and accuracy.

    `reading` are the lines of `coilarray.report.summary.verdicts` about the converter.
    """
    blocks: list[Block] = [*verdict_lines(r.file, r.margins, summary, reading)]
    blocks.append(Group("cards", tuple(cards(summary, r.design))))
    for board in named_boards(r.design):
        own = board is r.design.placed[0]
        which = f" of the board {board.name}" if board.name else ""
        sheets, plates = (r.design.sheets, r.design.plates) if own else ((), ())
        setup = r.design.indentation if own else None
        caption = f"Top view{which}, with its sizes in mm."
        stack = f"Section{which} from the top; thicknesses are written, not to scale."
        blocks.append(Group("two", (
            r.plot("plot_board", page.picture_name("dimensions", board), caption, board.array, width=page.HALF),
            r.plot(
                "plot_stack", page.picture_name("stack", board), stack, board.array.stackup, sheets, plates,
                "" if setup is None else setup.indenter.name, width=page.HALF,
            ),
        )))  # fmt: skip
    return [
        *blocks,
        Details("How far the numbers are known", (Group("text", (_known(r.design, summary),)),), open=True),
    ]


def verdict_lines(file: DesignFile, margins: Sequence[Margin], summary: Table, reading: Sequence[str]) -> list[Warn]:
    """Say whether the board can be made and read, and how much is assumed."""
    made, readout = made_verdict(file, margins), file.design.readout
    short, _, rest = made.text.partition(":")
    beside = f" {' '.join(broken_rules(margins))}" if made.kind == "bad" else _tightest_words(margins)
    lines = [Warn(f"**{short}**:{rest.replace('limits', f'[limits](#{RULES})', 1)}{beside}", made.kind)]
    missed = [line for line in reading if not line.startswith(CHECKED_WITHOUT)]
    if without := tables.converter_line(file.design):
        lines.append(Warn(without))
    elif missed:
        lines.append(Warn(f"**{readout.converter} cannot read all of it.** {' '.join(missed)}", "bad"))
    else:
        Q, R_p = (
            span(_of(summary, key), unit, 2)
            for key, unit in (("loaded_quality_factor", _PLAIN), ("parallel_resistance", KILOHM))
        )
        kept = f"all limits are kept, with Q {Q} and R_p {R_p} of the resonator."
        lines.append(Warn(f"**{readout.converter} can read it**: {kept}", "ok"))
    lines += [Warn(line) for line in reading if line.startswith(CHECKED_WITHOUT)]
    if file.assumed:
        parts = Counter(key.partition(".")[0] for key in file.assumed)
        of = ", ".join(f"{count} in {name}" for name, count in parts.most_common())
        said = f"**{len(file.assumed)} of {len(file.values)} values are assumed**: {of}."
        lines.append(Warn(f"{said} They are marked, with the reason, in the [inputs](#{INPUTS})."))
    return lines


def _tightest_words(margins: Sequence[Margin]) -> str:
    worst = tightest(margins)
    if worst is None:
        return ""
    place = "" if worst.x is None or worst.y is None else f" at ({_mm(worst.x)}, {_mm(worst.y)}) mm"
    limit = "exactly at its limit" if abs(worst.margin) <= KEPT_WITHIN else f"limit {MM.text(worst.limit, '.3')}"
    layer = f" on {worst.layer}" if worst.layer else ""
    return f" Tightest: {worst.rule} {MM.text(worst.value, '.3')}, {limit}, of {worst.feature}{layer}{place}."


def _mm(value: float) -> str:
    return number_text(value * MM.factor, 1)


def _row(summary: Table, key: str) -> tuple[Value, ...]:
    """Row with this key: quantity, least, most, unit and remark, all empty without one."""
    return next((row[1:] for row in summary.rows if row[0] == key), ("",) * 5)


def _of(summary: Table, key: str) -> list[float]:
    """Least and largest value of the row with this key, none without one."""
    return [value for value in _row(summary, key)[1:3] if isinstance(value, float)]


def cards(summary: Table, design: Design) -> list[Card]:
    """Return the numbers that decide, with as many digits as are known."""

    def shown(key: str, unit: DisplayUnit, digits: int, before: str = "", after: str = "") -> str:
        values = _of(summary, key)
        return f"{before}{span(values, unit, digits)}{after}" if values else ""

    H, Hz = display_unit("H"), display_unit("Hz")
    largest = max(map(abs, [*_of(summary, "peak_delta"), *_of(summary, "target_delta")]), default=0.0)
    change = PERCENT if largest > _LARGE else PPM
    tank = display_unit("F").text(design.circuit.capacitance, ".3")
    medians = {axis: _of(summary, f"sigma_{axis}_half") for axis in ("x", "y")}
    sigma = ", ".join(
        f"σ_{axis} {span(found, MM if max(found) >= _LONG else _MICROMETRES, 2)}" if found else f"{axis} unknown"
        for axis, found in medians.items()
    )
    parts = [shown(f"{axis}_not_determined", PERCENT, 2, f"{axis} unknown on ", " of area") for axis in medians]
    parts = list(filter(None, parts)) or [shown("sigma_x_most", MM, 2, "σ_x ≤ ", " on 95 % of area")]
    k = max(_of(summary, "largest_coupling"), default=None)
    x_min, y_min, x_max, y_max = design.array.bounds
    size = " × ".join(number_text(MM.factor * edge, 1) for edge in (x_max - x_min, y_max - y_min))
    stackup = design.array.stackup
    seen = shown("effective_inductance", H, 3, "L_eff ") if design.is_tuned else ""
    peak = str(_row(summary, "peak_delta")[0]).removeprefix("peak δ, ")
    found = [
        Card("Link efficiency", shown("link_efficiency", PERCENT, 3), str(_row(summary, "link_efficiency")[4])),
        Card("Inductance", shown("open_inductance", H, 3), seen),
        Card("Frequency", shown("frequency", Hz, 4), f"tank {tank}"),
        Card("Q of the coil", shown("quality_factor", _PLAIN, 2), shown("parallel_resistance", KILOHM, 2, "R_p ")),
        Card(
            "Coupling", "" if k is None else f"|k| ≤ {span([k], _PLAIN, 2)}" if k >= _KNOWN else f"|k| < {_KNOWN:.4f}",
            str(_row(summary, "largest_coupling")[4]),
        ),
        Card("Response δ", shown("peak_delta", change, 2), peak),
        Card("Target δ", shown("target_delta", change, 2), shown("target_range", MM, 2, "range ")),
        Card("Position", sigma if any(medians.values()) else "", "; ".join(["median", *filter(None, parts)])),
        Card("Self-resonance", shown("state_self_resonance", Hz, 2), "of the coils with their leads"),
        Card("Board", f"{size} mm", f"{len(stackup.names)} layers, {MM.text(stackup.thickness, '.3')}"),
    ]  # fmt: skip
    hidden = () if design.is_tuned else ("Frequency", "Q of the coil")  # of a tank that is not there
    return [card for card in found if card.value and card.name not in hidden][:_CARDS]


def _known(design: Design, summary: Table) -> Table:
    rows = [
        ("L, M and k", "10⁻⁴ of L", "46 measured coils: 0.6 % on average"),
        ("f", "half the error of L, and of the tank", "winding capacitance: 3 %, of few turns 15 %"),
        ("R and Q", "1 % for the given copper", "as its thickness and temperature"),
    ]
    if _of(summary, "peak_delta"):
        rows.append(("δ of a dent", "1 %", "as the elastomer's modulus and permeability"))
    if design.plates or design.target:
        rows.append(("ΔL and ΔR by metal", "as its tables state", "as distance and conductivity"))
    if _of(summary, "sigma_x_best"):
        rows.append(("σ of a position", "two digits", "as the noise, which is computed, not measured"))
    return text_table(("number", "computed to", "on a real board"), rows, "Accuracy of the numbers")
