"""Bill of what a design orders, and how its results are cited."""

import re
from collections.abc import Callable, Sequence
from importlib import resources

from coilarray.compute.display_units import MM, DisplayUnit, display_unit, number_text
from coilarray.compute.table import Table, text_table
from coilarray.design.boards import named_boards
from coilarray.design.body_tables import indenter_entries
from coilarray.design.fabs import load_profile
from coilarray.design.model import Board, DesignFile
from coilarray.geometry import Margin
from coilarray.geometry.copper import drills

_MICROMETRES, _KILOPASCAL, _NANOFARAD = DisplayUnit("µm", 1e6), DisplayUnit("kPa", 1e-3), DisplayUnit("nF", 1e9)
_LARGE = 1e-8  # F, capacitance from which it is in nF
_UNITS = {"mm": " mm", "deg": "°"}  # by the ends of keys
_OUNCE = 34.8e-6  # m of copper, 1 oz on a square foot
_NARROWEST = {  # rules that measure the smallest lengths, and ends of the entries of coils that set them
    "trace": (("trace width",), ("trace_width_mm",)),
    "gap": (("clearance", "spacing within net"), ("gap_mm", "array.pitch_mm")),
    "hole": (("drill",), ("drill_mm",)),
    "annular ring": (("annular ring",), ("drill_mm", "pad_mm")),
}


def order_table(file: DesignFile, margins: Sequence[Margin]) -> Table:
    """Return the parts of a design with all that an order needs and the design knows.

    The last column has the assumed entries that a row depends on. `margins` are those of all boards.
    """
    design, rows = file.design, list[tuple[str, ...]]()

    def add(part: str, what: str, order: str, *entries: str) -> None:
        assumed = [key for key in file.assumed if key.startswith(entries)] if entries else []
        names = dict.fromkeys(re.sub("_(mm|um|pF|kPa|deg)$", "", key.rpartition(".")[2]) for key in assumed)
        rows.append((part, what, order, "assumed" if assumed else "", ", ".join(names).replace("_", " ")))

    for board in named_boards(design):
        own = design.placed[0] is board
        _add_board(board, add if own else lambda part, what, order, *entries: add(part, what, order))
    for words, (rules, ends) in _NARROWEST.items():
        if found := [one.value for one in margins if one.rule in rules]:
            smallest = round(MM.factor * max(min(found), 0.0), 3)  # as rules are kept to 1 µm
            keys = [key for key in file.assumed if key.startswith(("coils.", "array.")) and key.endswith(ends)]
            add("board", f"smallest {words}", f"{smallest:g} mm", *keys)
    if (profile := file.values.get("fab.profile")) is not None:
        add("board", "board house", load_profile(str(profile)).title)
    circuit, several = design.circuit, len(design.coil_names) > 1
    if design.is_tuned:
        where = "at each coil" if file.values.get("circuit.tank") == "coil" and several else "one, at the converter"
        tank = f"{_farad(circuit.capacitance)}, {where}"
        add("tank", "capacitor", tank, "circuit.capacitance", "circuit.tank")
    for port in circuit.ports:
        for name, value in (("series", port.series_capacitance), ("parallel", port.parallel_capacitance)):
            if value is not None:
                add(f"port of {port.coil}", f"{name} capacitor", _farad(value))
    if design.readout.is_judged:
        add("converter", "chip", design.readout.converter, "readout.converter")
    if circuit.part is not None:
        add("switches", "chip", f"{circuit.part}, for {len(design.coil_names)} coils", "circuit.switches")
    bounds = None if design.indentation is None else design.indentation.sample_bounds
    x_min, y_min, x_max, y_max = design.array.bounds if bounds is None else bounds
    size = f"{_mm(x_max - x_min)} × {_mm(y_max - y_min)} mm" + (", to cover the board" if bounds is None else "")
    for k, sheet in enumerate(design.sheets):
        magnetic = f", relative permeability {sheet.relative_permeability:g}" if sheet.magnetic else ""
        stiff = "" if sheet.youngs_modulus is None else f", {_KILOPASCAL.text(sheet.youngs_modulus, '.3')}"
        entries = f"elastomer.{k}.", "indentation.sample" if bounds is not None else "board.margin"
        add("elastomer", sheet.name, f"{MM.text(sheet.thickness, '.3')} thick, {size}{magnetic}{stiff}", *entries)
    if design.indentation is not None:
        entries_of = indenter_entries(design.indentation.indenter, None)
        named = ((*key.rpartition("_")[::2], value) for key, value in entries_of.items() if key != "shape")
        sizes = (f"{name.replace('_', ' ')} {value:.4g}{_UNITS[unit]}" for name, unit, value in named)
        add("indenter", "shape", ", ".join([design.indentation.indenter.name, *sizes]), "indenter.")
    for plate in design.plates:
        add("plate", plate.name, f"{MM.text(plate.thickness, '.3')} of {plate.material.words}", "plate.")
    table = text_table(("part", "property", "order", "origin", "assumed entries"), rows, "What to order")
    return table.without_empty_columns()


def _add_board(board: Board, add: Callable[..., None]) -> None:
    array, stackup = board.array, board.array.stackup
    name = f"board {board.name}" if board.name else "board"
    x_min, y_min, x_max, y_max = array.bounds
    add(name, "size", f"{_mm(x_max - x_min)} × {_mm(y_max - y_min)} mm", "board.margin", "array.pitch", "array.columns")
    weights = {_MICROMETRES.text(t, ".3"): f"{t / _OUNCE:.2g} oz" for t in stackup.copper_thickness}
    copper = ", ".join(f"{thickness} ({ounces})" for thickness, ounces in weights.items())
    add(name, "copper", f"{len(stackup.names)} layers of {copper}", "stackup.layers", "stackup.copper")
    dielectric = ", ".join(MM.text(t, ".3") for t in stackup.dielectric_thickness) or "none"
    epsilon = ", ".join(dict.fromkeys(f"{value:g}" for value in stackup.epsilon_r))
    add(name, "thickness", f"{MM.text(stackup.thickness, '.3')}; dielectric {dielectric}, εr {epsilon}", "stackup.diel")
    holes = [one for one in drills(array) if one.drilled]
    blind = {"–".join((one.layers[0], one.layers[-1])) for one in holes if len(one.layers) < len(stackup.names)}
    kind = f"{len(holes)}, blind or buried from {', '.join(sorted(blind))}" if blind else f"{len(holes)}, all through"
    add(name, "plated holes", kind, "board.through_holes")
    add(name, "finish, solder mask", "not in the design: as the board house has it")


def _mm(length: float) -> str:
    return number_text(length * MM.factor, 2)


def _farad(capacitance: float) -> str:
    return (_NANOFARAD if capacitance >= _LARGE else display_unit("F")).text(capacitance, ".4")


def citations(*, paper: bool) -> list[str]:
    """Return how to cite the package, and the `paper` of the bundled sensor, as ``CITATION.cff`` has them.

    >>> citations(paper=False)
    ['The coilarray developers: coilarray, version 0.1.0. MIT.']
    """
    text = resources.files("coilarray.report").joinpath("CITATION.cff").read_text(encoding="utf-8")
    own, *others = re.split(r"^references:|^  - (?=type:)", text, flags=re.MULTILINE)
    cited = []
    for entry in [own, *(one for one in others if paper and one.strip())]:
        value = dict(re.findall(r"^ *(?:- )?([a-z-]+): *([^>\n]+)$", entry, re.MULTILINE))
        people = re.findall(r"family-names: (.+)\n +given-names: (.+)", entry)
        who = ", ".join(f"{given} {family}" for family, given in people) or value["name"]
        where = f", version {value['version']}. {value['license']}." if "license" in value else (
            f". {value['journal']} {value['volume']} ({value['year']}), {value['start']}–{value['end']}."
        )  # fmt: skip
        cited.append(f"{who}: {value['title']}{where}")
    return cited
