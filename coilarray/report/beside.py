"""Report of two designs side by side."""

from collections.abc import Sequence
from concurrent.futures import Future
from pathlib import Path

from coilarray.circuit.coupling import provenance
from coilarray.compute.display_units import number_text
from coilarray.compute.files import write_text
from coilarray.compute.table import Group, Picture, Section, Table, leaves, text_table
from coilarray.compute.threads import Progress
from coilarray.design.model import DesignFile
from coilarray.errors import DesignError
from coilarray.report.page import html_page, now, provenance_section, require_own
from coilarray.report.tables import design_table
from coilarray.report.write import Report, write_report

_PICTURES = (
    "coupling", "currents", "field_line", "apparent_inductance", "response_maps", "response_profile", "position_bounds",
    "target", "ports",
)  # fmt: skip


def write_beside(files: Sequence[DesignFile], where: Path, progress: Progress | None = None) -> tuple[Report, ...]:
    """Write the reports of two designs, and a page that compares them.

    The page is ``report.html`` in the folder `where`, and each report is in a folder there of the
    design's name. Raises DesignError if both designs have one name, else as `write_report`.
    """
    first, second = (file.design for file in files)
    if first.name == second.name:
        raise DesignError(f"two designs in one report must have different names; both are {first.name}.")
    target = where / "report.html"
    require_own(target)

    def of(number: int) -> Progress | None:
        return None if progress is None else lambda done, total: progress(number * total + done, 2 * total)

    reports = tuple(write_report(file, where / file.design.name, progress=of(k)) for k, file in enumerate(files))
    names = (first.name, second.name)
    titles = [f"**[{name}]({name}/report.html)** {file.design.title}" for name, file in zip(names, files, strict=True)]
    top = Group("two", tuple(
        Group("half", (title, *report.first_page)) for title, report in zip(titles, reports, strict=True)
    ))  # fmt: skip
    pictures = [
        {
            one.name: one
            for block in leaves(block for section in report.sections for block in section.blocks)
            for one in (block.result() if isinstance(block, Future) else [block])
            if isinstance(one, Picture)
        }
        for report in reports
    ]
    pairs = [
        Group("two", tuple(of_one[name] for of_one in pictures))
        for name in _PICTURES
        if all(name in of_one for of_one in pictures)
    ]
    made = {f"design {k + 1}": f"{file.design.name}, {file.design.digest}" for k, file in enumerate(files)}
    html = html_page(
        f"{names[0]} beside {names[1]}",
        [top],
        [
            Section("Numbers", (_numbers(names, [report.summary for report in reports]),)),
            Section("Inputs that differ", (Group("text keys", (_inputs(names, files),)),)),
            *([Section("Pictures", tuple(pairs))] if pairs else []),
            provenance_section({**made, "coilarray_version": provenance(first)["coilarray_version"], "date": now()}),
        ],
        contents=True,
    )
    write_text(target, html)
    return reports


def _numbers(names: Sequence[str], summaries: Sequence[Table | None]) -> Table:
    found: list[dict[str, tuple[str, float]]] = []
    for summary in summaries:
        assert summary is not None  # of a report that was just made
        at = [column.name for column in summary.columns]
        ends, unit = [k for k, name in enumerate(at) if name in ("least", "most")], at.index("unit")
        of_one: dict[str, tuple[str, float]] = {}
        for texts, row in zip(summary.cells(), summary.rows, strict=True):
            shown = " to ".join(filter(None, (texts[k] for k in ends)))
            numbers = [value for k in ends if isinstance(value := row[k], float)]
            of_one[texts[0]] = f"{shown} {texts[unit]}".strip(), max(numbers, key=abs, default=0.0)
        found.append(of_one)
    rows = []
    for quantity in dict.fromkeys([*found[0], *found[1]]):
        (first, a), (second, b) = (of.get(quantity, ("–", 0.0)) for of in found)
        rows.append((quantity, first, second, f"{number_text(100 * (b / a - 1), 1, '+')} %" if a and b else ""))
    return text_table(("quantity", *names, "change of the largest"), rows, "Numbers of both designs")


def _inputs(names: Sequence[str], files: Sequence[DesignFile]) -> Table:
    of = [{str(row[0]): str(row[1]) for row in design_table(file).rows} for file in files]
    keys = [key for key in dict.fromkeys([*of[0], *of[1]]) if of[0].get(key) != of[1].get(key)]
    return text_table(
        ("key", *names), [(key, *(one.get(key, "–") for one in of)) for key in keys], "Inputs that differ"
    )
