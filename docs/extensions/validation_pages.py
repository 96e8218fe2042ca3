"""Pictures and a summary of what `benchmarks/run.py` keeps, and a page that says how every reference was made."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from command_pages import write_page
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from coilarray.compute.display_units import PERCENT, power_of_ten

if TYPE_CHECKING:
    from sphinx.application import Sphinx

_ROOT = Path(__file__).parents[2]
_FOLDER = "made/validation"
# what, against what, and the quantity of the table whose largest deviation is shown
_SUMMARY = (
    (
        "inductance of spirals of 1 to 4 layers",
        "FastHenry",
        "the same against FastHenry, 5 filaments a trace or 1",
    ),
    ("mutual inductance of circles in any pose", "elliptic integrals (Maxwell, Grover)", "M of circles, from polygons"),
    ("resistance of bundles of traces", "two-dimensional currents in the copper", "AC resistance of a bundle, wider"),
    ("inductance of a loop before copper discs", "axisymmetric finite elements", "ΔL of a loop by copper discs, 2 MHz"),
    ("effect of a dent in a magnetic sheet", "three-dimensional finite elements", "ΔL, ΔM of a dent against a 3-D FEM"),
)
_KEPT, _MISSED = "#2f6fb5", "#c2410c"
# "413 × magpylib 6.2.0, …", "cfsem 267 M pairs/s; …" and "FastHenry 1.5 s on one core; …"
_TIMES_OTHER = re.compile(r"(?P<ratio>[\d.]+) × (?P<other>magpylib)")
_OTHERS_SPEED = re.compile(r"\w+(?:'s \w+)? [\d.]+ (?:M pairs/s|s on one core)")


def speed_ratios(results: Mapping[str, Any]) -> list[tuple[str, float]]:
    """Return what was compared with another program in the same run, and how many times as fast it is."""
    found = []
    for row in results["speed"]:
        if match := _TIMES_OTHER.match(row["note"]):
            found.append((f"{row['what']}, against {match['other']}", float(match["ratio"])))
        elif row["unit"] == "×" and _OTHERS_SPEED.match(row["note"]):
            found.append((row["what"], float(row["value"])))
    return found


def _accuracy_figure(results: Mapping[str, Any]) -> Figure:
    rows = results["accuracy"][::-1]
    figure = Figure(figsize=(9, 0.32 * len(rows) + 1.5), layout="constrained")
    ax = figure.subplots()
    for k, row in enumerate(rows):
        colour = _KEPT if row["worst"] <= row["limit"] else _MISSED
        ax.plot([row["worst"], row["limit"]], [k, k], color=colour, alpha=0.3, linewidth=4, solid_capstyle="butt")
        ax.plot(row["worst"], k, "o", color=colour, label="largest deviation" if k == 0 else None)
        ax.plot(row["limit"], k, "|", color="black", markersize=12, label="limit" if k == 0 else None)
    ax.set_yticks(range(len(rows)), [row["quantity"] for row in rows])
    ax.set(xscale="log", xlabel="relative deviation")
    ax.grid(axis="x", color="0.9")
    figure.legend(loc="outside upper center", ncols=2)
    return figure


def _speed_figure(results: Mapping[str, Any]) -> Figure:
    rows = speed_ratios(results)[::-1]
    figure = Figure(figsize=(9, 0.45 * len(rows) + 0.9), layout="constrained")
    ax = figure.subplots()
    bars = ax.barh([name for name, _ in rows], [ratio for _, ratio in rows], color=_KEPT)
    ax.bar_label(bars, [f"{ratio:.3g} ×" for _, ratio in rows], padding=4)
    ax.axvline(1, color="black", linewidth=0.8)
    ax.set(xscale="log", xlabel="speed relative to the other program", xlim=(0.7, 3 * max(ratio for _, ratio in rows)))
    return figure


def _measured_figure(results: Mapping[str, Any]) -> Figure:
    """Deviation of every measured coil, with the error of the meter as a bar."""
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    ax = figure.subplots()
    coils = results["measured"]
    for board, marker, colour in (("2L", "o", "#0072b2"), ("4L", "s", "#d55e00"), ("6L", "^", "#009e73")):
        some = [coil for coil in coils if coil["board"] == board]
        x = [coil["measured"] for coil in some]
        y = [100 * (coil["computed"] / coil["measured"] - 1) for coil in some]
        ax.errorbar(
            x,
            y,
            yerr=[100 * coil["tolerance"] for coil in some],
            fmt=marker,
            color=colour,
            ecolor=(*to_rgb(colour), 0.25),
            markersize=5,
            label=f"boards of {board[0]} layers, {len(some)} coils",
        )
    ax.axhline(0, color="black", linewidth=0.8)
    ax.set(xscale="log", xlabel="measured inductance (µH)", ylabel="computed less measured (%)", ylim=(-4, 4))
    ax.set_xticks([3, 5, 10, 20, 50], ["3", "5", "10", "20", "50"])
    ax.minorticks_off()
    ax.grid(axis="y", color="0.9")
    figure.legend(loc="outside upper center", ncols=3)
    return figure


def _largest(results: Mapping[str, Any], quantity: str) -> float:
    (row,) = (row for row in results["accuracy"] if row["quantity"] == quantity)
    return float(row["worst"])


def _rounded(value: float) -> str:
    """Return a deviation as a percentage, or as a power of ten where it is small."""
    if value >= 1e-3:
        return PERCENT.text(value, ".1")
    digit, power = f"{value:.0e}".split("e")
    return f"{digit}·{power_of_ten(int(power))}"


def summary(results: Mapping[str, Any]) -> str:
    """Return the eight lines of the page in Markdown: accuracy first, then speed."""
    deviations = [abs(coil["computed"] / coil["measured"] - 1) for coil in results["measured"]]
    faster = dict(speed_ratios(results))
    field, fast_henry = (
        faster[what] for what in ("B, exact segments, against magpylib", "L matrix of six coils, against FastHenry")
    )
    rows = [
        (
            f"inductance of {len(deviations)} coils on printed boards",
            "readings of an LCR meter of 0.7 to 2.5 %",
            f"mean {100 * sum(deviations) / len(deviations):.1f} %, largest {100 * max(deviations):.1f} %",
        ),
        *((what, against, _rounded(_largest(results, quantity))) for what, against, quantity in _SUMMARY),
        ("field of six coils", "magpylib, the same to 10⁻¹⁰", f"{field:.0f} times as fast"),
        (
            "inductance matrix of six coils",
            "FastHenry, the same to 10⁻⁵",
            f"{fast_henry:.0f} times as fast",
        ),
    ]
    lines = ["| what | against | largest deviation, or speed |", "| --- | --- | --- |"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows), ""])


def references() -> str:
    """Return the page of the tables of `tests/reference`: the head of each, and its columns."""
    lines = ["# How the references were made", ""]
    lines += [
        "The numbers that the tests and the benchmarks compare with lie in `tests/reference/`. What stands at the head "
        "of each file says from which formula, program or publication they are: *recomputed* ones are from other "
        "programs, *remembered* ones from a publication, and only what is said to be confirmed was.",
        "",
    ]
    for path in sorted((_ROOT / "tests" / "reference").glob("*.csv")):
        text = path.read_text(encoding="utf-8").splitlines()
        head = [line.removeprefix("#").strip() for line in text if line.startswith("#")]
        columns, *rows = csv.reader(line for line in text if not line.startswith("#"))
        named = ", ".join(f"`{column}`" for column in columns)
        lines += [f"## {path.stem}", "", f"{len(rows)} rows of {named}.", ""]
        lines += ["```{code-block} text", ":class: wrapped", "", *head, "```", ""]
    return "\n".join(lines)


def _write(app: Sphinx) -> None:
    folder = Path(app.srcdir) / _FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    results = json.loads((_ROOT / "benchmarks" / "results.json").read_text(encoding="utf-8"))
    for name, figure in (("accuracy", _accuracy_figure), ("speed", _speed_figure), ("measured", _measured_figure)):
        figure(results).savefig(folder / f"{name}.png", dpi=110)
    write_page(folder / "summary.md", summary(results))
    write_page(folder / "references.md", references())


def setup(app: Sphinx) -> dict[str, bool]:
    """Write pictures and page before Sphinx looks for them."""
    app.connect("builder-inited", _write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
