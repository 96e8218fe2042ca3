"""Pictures of the figures that `benchmarks/run.py` keeps, and a page that says how every reference was made."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from command_pages import write_page
from matplotlib.figure import Figure

if TYPE_CHECKING:
    from sphinx.application import Sphinx

_ROOT = Path(__file__).parents[2]
_FOLDER = "made/validation"
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
    for name, figure in (("accuracy", _accuracy_figure(results)), ("speed", _speed_figure(results))):
        figure.savefig(folder / f"{name}.png", dpi=110)
    write_page(folder / "references.md", references())


def setup(app: Sphinx) -> dict[str, bool]:
    """Write pictures and page before Sphinx looks for them."""
    app.connect("builder-inited", _write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
