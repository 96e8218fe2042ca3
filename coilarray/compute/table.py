"""Tables for terminals and files, and sections of pages.

Numbers are in SI in rows and files, and in customary units where people read them.
"""

from __future__ import annotations

import base64
import csv
import io
import itertools
import math
import re
import textwrap
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from html import escape
from typing import TYPE_CHECKING, Union

from coilarray.compute.display_units import KILOHM, PER_MILLION, DisplayUnit, display_unit

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt
    import xarray as xr

_MANY_COLUMNS = 11  # from which a page prints them smaller
# notebooks set all cells to the right
_STYLE = "<style>.coilarray th, .coilarray td { text-align: left; } .coilarray img { max-width: 100%; }</style>"
Value = str | float | bool
"""Cell of a table: text, number in SI, or truth. "" for none."""
_POSITION = ("x", "y")  # columns that are kept even if they have equal numbers
_TRUTH = {True: "yes", False: "no"}
_FOUR_DIGITS = {*map(display_unit, ("H", "Hz", "ohm")), KILOHM, PER_MILLION}  # as L is known to 10⁻⁴
_ALIKE, _ALIKE_RATIOS = 1e-4, 0.01  # to which inductances are known, and differences and ratios of them
_GAP = 2  # blanks between columns
_MOST_KEYS = 3  # first columns that name a row, and are repeated in every block
_MOST_LINES = 3  # of a cell, before texts stand below their rows
_NARROWEST = 10  # characters of a column before its heading or text is wrapped
_RED, _PLAIN = "\x1b[1;31m", "\x1b[0m"
_SYMBOLS = {
    "frequency": "f", "effective_inductance": "L_eff", "effective_resistance": "R_eff", "resistance_ratio": "R/R_dc",
    "quality_factor": "Q", "loaded_quality_factor": "Q_tank", "parallel_resistance": "R_p", "part_frequency": "f_part",
    "ac_resistance_frequency": "f_R", "ac_resistance": "R", "winding_capacitance": "C",
    "self_resonance": "f_self", "resistance_model": "model of R", "bare_winding_capacitance": "C_bare",
    "elastomer_delta": "δ_C", "dent_delta_bound": "δ_dent",
    "base_inductance": "L_0", "base_frequency": "f_0", "base_effective_resistance": "R_0",
    "base_quality_factor": "Q_0", "base_parallel_resistance": "R_p0", "distance_deviation": "σ_d", "amplitude": "U",
    "series_capacitance": "C_s", "input_resistance": "R_in", "input_reactance": "X_in", "efficiency": "η",
    "available_efficiency": "η_av", "voltage_ratio": "U_2/U_1", "kq": "kQ", "best_efficiency": "η_max",
    "best_load_resistance": "R_best", "best_load_reactance": "X_best", "depth": "depth", "force": "F",
    "contact_radius": "a", "ring_height": "h_ring", "ring_radius": "r_ring",
}  # fmt: skip
"""Headings of a narrow terminal, by the name of the quantity."""
# a number and its unit stay together
_UNIT = re.compile(r"(?<=\d) (?=(?:%|[kMmµnp]?(?:[mHΩFVAWNTK]|Hz|Pa)²?|ppm|°C|ohm)(?![\w·]))")
_TEX = {
    "µ": r"\textmu{}", "−": "$-$", "–": "--", "\\": r"\textbackslash{}",
    "Ω": r"$\Omega$", "δ": r"$\delta$", "σ": r"$\sigma$", "ω": r"$\omega$", "Δ": r"$\Delta$", "χ": r"$\chi$",
    "ε": r"$\varepsilon$", "°": r"$^\circ$", "±": r"$\pm$", "·": r"$\cdot$", "×": r"$\times$", "√": r"$\surd$",
    "≤": r"$\le$", "≥": r"$\ge$", **{character: f"\\{character}" for character in "&%$#_{}"},
}  # fmt: skip
_RAISED = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")


def html_table(
    headers: Sequence[str],
    rows: Iterable[Sequence[str]],
    mark: str = "",
    *,
    caption: str = "",
    more: Container[int] = (),
) -> str:
    """Return a table as HTML, rows with `mark` in its class.

    Columns of the numbers `more` are folded on a page.
    """

    def line(tag: str, texts: Sequence[str], kind: str = "") -> str:
        shown = map(_subscripts if tag != "td" else escape, texts)
        cells = (f"<{tag}{' class=more' * (k in more)}>{text}</{tag[:2]}>" for k, text in enumerate(shown))
        return f"<tr{kind}>{''.join(cells)}</tr>"

    many = ' class="many"' if sum(k not in more for k in range(len(headers))) > _MANY_COLUMNS else ""
    head = f"\n<thead>{line('th scope=col', headers)}</thead>" if headers else ""
    title = f"\n<caption>{_subscripts(caption)}</caption>" if caption else ""
    lines = "".join(line("td", row, ' class="mark"' if mark and mark in row else "") + "\n" for row in rows)
    return f"<table{many}>{title}{head}\n<tbody>\n{lines}</tbody></table>"


def html_card(title: str, *parts: str) -> str:
    """Return a notebook's display of a value as HTML."""
    return f'<div class="coilarray">{_STYLE}<strong>{escape(title)}</strong>{"".join(parts)}</div>'


def data_url(image: bytes, kind: str = "png") -> str:
    """Return a PNG, JPEG or SVG file as a data URL."""
    return f"data:image/{kind};base64,{base64.b64encode(image).decode('ascii')}"


@dataclass(frozen=True)
class Column:
    """Column of a table.

    `unit` is the SI unit of the values, empty for text, "1" for a pure number. `shown` is the unit
    for people, by default the customary unit. `meaning` explains the quantity in a sentence.
    """

    name: str
    label: str = ""
    unit: str = ""
    shown: DisplayUnit | None = None
    meaning: str = ""

    @property
    def key(self) -> str:
        """Name and SI unit in files, such as "force_N_per_m"."""
        unit = "" if self.unit in ("", "1", "A/A") else "_" + self.unit.replace("/", "_per_")
        return self.name + unit

    @property
    def header(self) -> str:
        """Heading with the unit that people see."""
        return self.unit_shown.label(self._words)

    @property
    def symbol(self) -> tuple[str, str]:
        """Short heading with the unit, and its words if it is a symbol."""
        symbol = _SYMBOLS.get(self.name, "")
        return (self.unit_shown.label(symbol), f"{symbol} {self._words}") if symbol else (self.header, "")

    @property
    def _words(self) -> str:
        return self.label or self.name.replace("_", " ")

    @property
    def unit_shown(self) -> DisplayUnit:
        """Unit that people see."""
        return self.shown or display_unit(self.unit)

    def texts(self, values: Sequence[Value]) -> list[str]:
        """Return values as people see them."""
        numbers = iter(self.unit_shown.texts([value for value in values if not isinstance(value, (str, bool))]))
        return [
            _TRUTH[value] if isinstance(value, bool) else value if isinstance(value, str) else next(numbers)
            for value in values
        ]


@dataclass(frozen=True)
class Table:
    """Table with a name for files and a title.

    `row_units` are shown in the column "unit", and apply to the pure numbers before it. Rows with a
    cell that begins with the word `mark` stand out. `notes` are sentences below the table. A page shows the
    columns named in `main` first and folds the others, if any are named.
    """

    name: str
    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Value, ...], ...]
    row_units: tuple[DisplayUnit, ...] = ()
    mark: str = ""
    notes: tuple[str, ...] = ()
    main: tuple[str, ...] = ()

    @property
    def headers(self) -> list[str]:
        """Headings of the columns."""
        return [column.header for column in self.columns]

    def csv(self) -> str:
        """Return a CSV in SI with full precision."""
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        writer.writerow(column.key for column in self.columns)
        writer.writerows(self.rows)
        return buffer.getvalue().replace("−", "-")

    def records(self) -> list[dict[str, Value]]:
        """Return the rows in SI as mappings for JSON, with the minus of a CSV."""
        keys = [column.key for column in self.columns]
        plain = ([one.replace("−", "-") if isinstance(one, str) else one for one in row] for row in self.rows)
        return [dict(zip(keys, row, strict=True)) for row in plain]

    def cells(self) -> list[list[str]]:
        """Return the rows as people see them."""
        if not self.rows:
            return []
        columns = [c.texts(values) for c, values in zip(self.columns, zip(*self.rows, strict=True), strict=True)]
        for k, unit in enumerate(self.row_units):
            end = [column.name for column in self.columns].index("unit")
            columns[end][k] = unit.symbol
            for texts, column, value in zip(columns[:end], self.columns, self.rows[k], strict=False):
                if column.unit == "1":
                    texts[k] = Column("", shown=unit).texts([value])[0]
        return [list(row) for row in zip(*columns, strict=True)]

    def html(self) -> str:
        """Return the table and its notes as HTML, with digits that are known."""
        notes = "".join(f"<p>{html_text(note)}</p>" for note in self.notes)
        more = [k for k, column in enumerate(self.columns) if column.name in self._folded]
        known = self.known()
        shown = html_table(known.headers, known.cells(), self.mark, caption=self.title, more=more)
        return f'<div class="wide" data-file="{self.name}">{shown}</div>{notes}'

    def latex(self) -> str:
        """Return the table for LaTeX, of its main columns, with booktabs."""
        table = self.known().without(*self._folded)
        lines = [" & ".join(map(_latex, texts)) + r" \\" for texts in (table.headers, *table.cells())]
        aligned = "".join("r" if isinstance(value, float) else "l" for value in table.rows[0])
        return "\n".join([
            r"\begin{table}", r"\centering", rf"\caption{{{_latex(self.title)}}}", rf"\label{{tab:{self.name}}}",
            rf"\begin{{tabular}}{{{aligned}}}", r"\toprule", lines[0], r"\midrule", *lines[1:],
            r"\bottomrule", r"\end{tabular}", r"\end{table}", "",
        ])  # fmt: skip

    def alike(self, *keys: str) -> Table:
        """Join rows whose numbers agree to what is known into one.

        The first column names all of them. The columns `keys`, such as places, do not count and are left out if rows
        were joined.
        """
        kept = [k for k, column in enumerate(self.columns) if k and column.name not in keys]
        groups: list[tuple[tuple[Value, ...], list[str]]] = []
        for row in self.rows:
            for other, names in groups:
                if all(_close(row[k], other[k], self.columns[k].unit) for k in kept):
                    names.append(str(row[0]))
                    break
            else:
                groups.append((row, [str(row[0])]))
        if len(groups) == len(self.rows):
            return self
        rows = tuple((joined_names(names), *row[1:]) for row, names in groups)
        return replace(self, rows=rows).without(*keys)

    def with_common_note(self) -> Table:
        """Return the table with columns of one value in all of its several rows as a note."""
        rows = self.known().cells()
        same = [k for k in range(1, len(self.columns)) if len(rows) > 1 and len({row[k] for row in rows}) == 1]
        shown = [(self.columns[k].header, rows[0][k]) for k in same]
        of_all = "; ".join(_valued(label, value) for label, value in shown)
        notes = (f"In all rows: {of_all}.", *self.notes) if same else self.notes
        return replace(self._with_columns([k for k in range(len(self.columns)) if k not in same]), notes=notes)

    def text(self, width: int | None = None, *, title: bool = True) -> str:
        """Return the table for a terminal of `width` characters.

        Numbers have the digits that are known, are never cut, and stand with their decimal points
        below each other. In a narrow terminal headings are symbols, explained below, and texts are
        wrapped. Long texts of the last column stand below their rows. Columns that still do not fit
        follow below, with the first columns repeated.
        """
        known = self.known()
        rows, headers, notes = known.cells(), known.headers, list(self.notes)
        columns = [[row[k] for row in rows] for k in range(len(headers))]
        numeric = [any(texts) and all(map(_is_number, filter(None, texts))) for texts in columns]
        columns = [_aligned(texts) if number else texts for texts, number in zip(columns, numeric, strict=True)]
        full = sum(max(map(len, (header, *texts))) + _GAP for header, texts in zip(headers, columns, strict=True))
        if width is not None and full - _GAP > width:
            headers, words = map(list, zip(*(column.symbol for column in self.columns), strict=True))
            notes[:0] = ["; ".join(filter(None, words))] if any(words) else []
        columns = [[header, *texts] for header, texts in zip(headers, columns, strict=True)]
        below: list[str] = []
        if width is not None and full - _GAP > width and len(columns) > 1 and not numeric[-1]:
            others = sum(max(map(len, texts)) + _GAP for texts in columns[:-1])
            room = max(width - others, _NARROWEST)
            if max((len(_wrapped(text, room)) for text in columns[-1][1:]), default=0) > _MOST_LINES:
                *columns, below = columns
        lines = [fill(self.title, width)] if title and self.title else []
        for number, (block, widths) in enumerate(_blocks(columns, width or 10**6)):
            lines += [""] * bool(number)
            for n, texts in enumerate(zip(*(columns[k] for k in block), strict=True)):
                wrapped = [
                    [text] if numeric[k] and n else _wrapped(text, max(w, 1)) or [""]
                    for text, w, k in zip(texts, widths, block, strict=True)
                ]
                if n == 0 and not any(texts):
                    continue
                if n == 0:  # the last lines of headings stand beside each other
                    wrapped = [[""] * (max(map(len, wrapped)) - len(parts)) + parts for parts in wrapped]
                marked = n > 0 and bool(self.mark) and any(one.split(" ")[0] == self.mark for one in rows[n - 1])
                for parts in itertools.zip_longest(*wrapped, fillvalue=""):
                    placed = zip(parts, widths, block, strict=True)
                    line = (" " * _GAP).join(part.rjust(w) if numeric[k] else part.ljust(w) for part, w, k in placed)
                    lines.append(f"{_RED}{line.rstrip()}{_PLAIN}" if marked else line.rstrip())
                if below and n > 0 and below[n] and block[-1] == len(columns) - 1:
                    lines += _wrapped(f"    {below[n]}", width or 80)
        return "\n".join([*lines, *(fill(note, width) for note in notes)])

    def without_empty_columns(self) -> Table:
        """Return the table without columns that are empty everywhere."""
        return self._with_columns([k for k in range(len(self.columns)) if any(row[k] != "" for row in self.rows)])

    def without(self, *names: str) -> Table:
        """Return the table without some columns."""
        return self._with_columns([k for k, column in enumerate(self.columns) if column.name not in names])

    def brief(self) -> Table:
        """Return the table without redundant columns.

        They are empty or zero in every row, or repeat an earlier column of the same unit, but not x or y.
        """
        values = list(zip(*self.rows, strict=True))
        units = [column.unit for column in self.columns]

        kept = []
        for k, own in enumerate(values):
            same = [values[j] for j in range(k) if units[j] == units[k]]
            nothing = all(value == "" or (value == 0 and not isinstance(value, bool)) for value in own)
            repeats = self.columns[k].name not in _POSITION and any(_equal(own, other) for other in same)
            if not (nothing or repeats):
                kept.append(k)
        return self._with_columns(kept)

    @property
    def _folded(self) -> list[str]:
        """Names of the columns that a page folds."""
        return [column.name for column in self.columns if self.main and column.name not in self.main]

    def known(self) -> Table:
        """Return the table with the digits that are known."""
        columns = tuple(replace(column, shown=_known(column.unit_shown)) for column in self.columns)
        return replace(self, columns=columns, row_units=tuple(map(_known, self.row_units)))

    def _with_columns(self, kept: Sequence[int]) -> Table:
        rows = tuple(tuple(row[k] for k in kept) for row in self.rows)
        return replace(self, columns=tuple(self.columns[k] for k in kept), rows=rows)


def text_table(headers: Sequence[str], rows: Sequence[Sequence[str]], title: str = "") -> Table:
    """Return a table of texts."""
    return Table("", title, tuple(Column(header, header) for header in headers), tuple(map(tuple, rows)))


def dataset_table(
    name: str, title: str, dataset: xr.Dataset, variables: Sequence[str], shown: Mapping[str, DisplayUnit] | None = None
) -> Table:
    """Make a table of variables of a dataset in SI.

    There is a row for each combination of their coordinates, the first dimension slowest. `shown`
    has units for people if the customary units do not fit, such as %.

    >>> import xarray as xr
    >>> R = ("coil", [14.2, 14.1], {"long_name": "DC resistance", "units": "ohm"})
    >>> coils = xr.Dataset({"resistance": R}, {"coil": ["a", "b"]})
    >>> table = dataset_table("coils", "Coils", coils, ["coil", "resistance"])
    >>> table.headers, table.csv().splitlines()[0]
    (['coil', 'DC resistance (Ω)'], 'coil,resistance_ohm')
    >>> print(table.text(80))
    Coils
    coil  DC resistance (Ω)
    a                 14.20
    b                 14.10
    """
    import xarray as xr

    arrays = [dataset[variable] for variable in variables]
    columns = []
    for variable, array in zip(variables, arrays, strict=True):
        unit = str(array.attrs.get("units", "1")) if array.dtype.kind in "fiu" else ""
        columns.append(Column(variable, str(array.attrs.get("long_name", "")), unit, (shown or {}).get(variable)))
    values = (array.values.ravel().tolist() for array in xr.broadcast(*arrays))
    return Table(name, title, tuple(columns), tuple(tuple(map(cell, row)) for row in zip(*values, strict=True)))


def cell(value: object) -> Value:
    """Return a value of a table, empty if not finite."""
    if isinstance(value, (str, bool, int)):
        return value
    number = float(value)  # type: ignore[arg-type]
    return number if math.isfinite(number) else ""


def root_mean_square(values: npt.NDArray[np.float64]) -> Value:
    """Return the root mean square of finite numbers, if any."""
    import numpy as np

    return cell(np.hypot.reduce(values / np.sqrt(len(values)))) if len(values) else ""  # avoids squares that overflow


@dataclass(frozen=True)
class Picture:
    """Picture with name, caption, and its image as HTML.

    `axes` is JSON about its axes, from which a page reads values under the mouse.
    """

    name: str
    caption: str
    image: str
    axes: str = ""

    def html(self) -> str:
        """Return the picture with its caption."""
        quoted = escape(self.axes, quote=False).replace("'", "&#39;")
        axes = f" data-axes='{quoted}'" if quoted else ""
        caption = html_text(self.caption)
        return f'<figure id="{self.name}"{axes}>{self.image}<figcaption>{caption}</figcaption></figure>'


@dataclass(frozen=True)
class Group:
    """Blocks in one element, such as pictures side by side."""

    kind: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Warn:
    """Sentence that stands out, of the kind ok, warn or bad."""

    text: str
    kind: str = "warn"


@dataclass(frozen=True)
class Card:
    """Number that decides, with its name and a remark."""

    name: str
    value: str
    remark: str = ""

    def html(self) -> str:
        """Return the card as HTML."""
        remark = f"<small>{html_text(self.remark)}</small>"
        return f'<div class="card"><h3>{html_text(self.name)}</h3><p>{html_text(self.value)}</p>{remark}</div>'


@dataclass(frozen=True)
class Details:
    """Blocks that open with a click on their summary."""

    summary: str
    blocks: tuple[Block, ...]
    open: bool = False
    id: str = ""


Block = Union[str, Warn, Card, Table, Picture, "Future[list[Picture]]", Group, Details]
"""Part of a section. A string is a paragraph with `code`, **bold**, B_z and [links](address)."""


@dataclass(frozen=True)
class Section:
    """Part of a report: title, paragraphs, tables and pictures.

    `files` are tables for the files that are not among the blocks, or are shown there in a shorter
    form.
    """

    title: str
    blocks: tuple[Block, ...]
    files: tuple[Table, ...] = ()

    def tables(self) -> dict[str, Table]:
        """Return all tables with a name, tables for files last."""
        found = [block for block in leaves(self.blocks) if isinstance(block, Table)]
        return {table.name: table for table in (*found, *self.files) if table.name}


def leaves(blocks: Iterable[Block]) -> Iterator[Block]:
    """Yield the blocks, and in the place of groups and details those that they hold."""
    for block in blocks:
        if isinstance(block, (Group, Details)):
            yield from leaves(block.blocks)
        else:
            yield block


def html_blocks(blocks: Sequence[Block]) -> str:
    """Return blocks as HTML."""
    parts = []
    for block in blocks:
        if isinstance(block, str):
            parts.append(f"<p>{html_text(block)}</p>")
        elif isinstance(block, Warn):
            parts.append(f'<p class="{block.kind}">{html_text(block.text)}</p>')
        elif isinstance(block, Future):
            parts.append(html_blocks(block.result()))
        elif isinstance(block, Group):
            parts.append(f'<div class="{block.kind}">{html_blocks(block.blocks)}</div>')
        elif isinstance(block, Details):
            place = f' id="{block.id}"' if block.id else ""
            opened = f"<details{place}{' open' if block.open else ''}>"
            inside = f"{html_text(block.summary)}</summary>\n{html_blocks(block.blocks)}\n"
            parts.append(f"{opened}<summary>{inside}</details>")
        else:
            parts.append(block.html())
    return "\n".join(parts)


def html_text(text: str) -> str:
    """Return a paragraph's text as HTML.

    >>> html_text("**3** limits of L_0, see `check` & [docs](https://a.b)")
    '<strong>3</strong> limits of L<sub>0</sub>, see <code>check</code> &amp; <a href="https://a.b">docs</a>'
    """
    parts = re.split(r"`(.+?)`", text)  # every second one is code
    text = "".join(f"<code>{escape(part)}</code>" if k % 2 else _subscripts(part) for k, part in enumerate(parts))
    text = re.sub(r"\*\*(.+?)\*\*", r"<strong>\1</strong>", text)
    return re.sub(r"\[([^\]]+)\]\((#?[^)\s]+)\)", r'<a href="\2">\1</a>', text)


def _subscripts(text: str) -> str:
    """Escape a text for HTML, with subscripts of single letters."""
    return re.sub(r"(?<![\w/])([A-Za-zδσ])_(\w+)(?![\w/.])", r"\1<sub>\2</sub>", escape(text))


def plain_text(text: str) -> str:
    """Return a paragraph's text without marks and links.

    >>> plain_text("**3** limits, see [docs](https://a.b)")
    '3 limits, see docs'
    """
    return re.sub(r"\[([^\]]+)\]\([^)\s]+\)", r"\1", text.replace("**", ""))


def fill(text: str, width: int | None) -> str:
    """Wrap lines at a width, further lines indented, between words and never before a unit."""
    if width is None:
        return text
    return "\n".join("\n".join(_wrapped(line, max(width, 20), "  ")) for line in text.split("\n"))


def _wrapped(text: str, width: int, indent: str = "") -> list[str]:
    """Lines of at most `width` characters, longer words whole."""
    held = _UNIT.sub("\u00a0", text)
    own = re.match(" *", text)[0]  # type: ignore[index]
    lines = textwrap.wrap(
        held.lstrip(" "),
        width,
        initial_indent=own,
        subsequent_indent=own + indent,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [line.replace("\u00a0", " ") for line in lines]


def _aligned(texts: Sequence[str]) -> list[str]:
    """Numbers with blanks at their end that bring their decimal points below each other."""
    tails = [len(re.sub(r"^[^.·]*", "", text)) for text in texts]
    return [text + " " * (max(tails) - tail) if text else "" for text, tail in zip(texts, tails, strict=True)]


def _valued(label: str, value: str) -> str:
    """Write a heading with its value, such as "R (Ω)" and "2" as "R = 2 Ω"."""
    words, _, unit = label.removesuffix(")").partition(" (")
    return f"{words} = {value} {unit}".rstrip()


def _known(unit: DisplayUnit) -> DisplayUnit:
    """Limit a unit to four digits of the largest number, if known no better."""
    return replace(unit, digits=None) if unit in _FOUR_DIGITS else unit


def joined_names(names: Sequence[str]) -> str:
    """Join names, of one start and many numbers only the first whole.

    >>> joined_names(["coil6", "coil7", "coil10"]), joined_names(["a", "b2"])
    ('coil6, 7, 10', 'a, b2')
    """
    start = re.sub(r"\d+$", "", names[0])
    short = all(re.fullmatch(re.escape(start) + r"\d+", name) for name in names)
    return ", ".join([names[0], *(name.removeprefix(start) if short else name for name in names[1:])])


def _close(a: Value, b: Value, unit: str) -> bool:
    """Test whether two cells agree to what is known, pure numbers to 1 %."""
    if isinstance(a, float) and isinstance(b, float):
        return math.isclose(a, b, rel_tol=_ALIKE if unit not in ("", "1") else _ALIKE_RATIOS)
    return a == b


def _latex(text: str) -> str:
    r"""Write a text for LaTeX.

    >>> print(_latex("L_eff, 4 % of 10⁻⁶ Ω"))
    L\_eff, 4 \% of 10$^{-6}$ $\Omega$
    """
    plain = "".join(_TEX.get(character, character) for character in text)
    return re.sub("[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+", lambda found: f"$^{{{found[0].translate(_RAISED)}}}$", plain)


def _equal(values: Sequence[Value], others: Sequence[Value]) -> bool:
    return all(
        isinstance(a, float) and isinstance(b, float) and math.isclose(a, b, rel_tol=1e-12)
        for a, b in zip(values, others, strict=True)
    )


def _blocks(columns: Sequence[Sequence[str]], width: int) -> list[tuple[list[int], list[int]]]:
    """Return blocks of columns that fit, with their widths."""
    full = [max(map(len, texts)) for texts in columns]
    words = [
        [len(word) for text in texts for word in ([text] if _is_number(text) else _UNIT.sub("\u00a0", text).split(" "))]
        for texts in columns
    ]
    least = [max([min(most, _NARROWEST), *lengths]) for most, lengths in zip(full, words, strict=True)]
    whole = list(zip(*columns, strict=True))
    keys = next((k for k in range(1, _MOST_KEYS) if len({row[:k] for row in whole}) == len(whole)), _MOST_KEYS)
    blocks = [list(range(min(keys, len(columns))))]
    for k in range(keys, len(columns)):
        if sum(least[j] + _GAP for j in (*blocks[-1], k)) - _GAP > width and len(blocks[-1]) > keys:
            blocks.append(list(range(keys)))
        blocks[-1].append(k)
    found = []
    for block in blocks:
        widths = [least[k] for k in block]
        spare = width - sum(widths) - _GAP * (len(block) - 1)
        # the smallest wish for more first
        for place, j in enumerate(sorted(range(len(block)), key=lambda j: full[block[j]] - widths[j])):
            more = max(0, min(full[block[j]] - widths[j], spare // (len(block) - place)))
            widths[j] += more
            spare -= more
        found.append((block, widths))
    return found


def _is_number(text: str) -> bool:
    try:
        float(re.sub("·10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+ *$", "", text).replace("−", "-"))
    except ValueError:
        return False
    return True
