"""Random plates: whether the stated errors of ΔL and of ΔR cover the true ones, against independent solutions.

Discs and rings on the axis of circular coils are solved by finite elements about the axis, thin plates of any outline
by a stream function of the second order (tests/support); thick ones of any outline by the same solver on finer meshes,
which sees what its mesh errs and not what its model errs. Solutions by other methods are kept in
tests/reference/ref_plates.csv for the default seed, which `--renew` computes again. Done rows are kept in a file, so
that a run that was stopped goes on; the exit code is 1 where fewer than 95 % are covered.
"""

from __future__ import annotations

import argparse
import csv
import io
import math
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from support.references import FOLDER, rows
from support.thin_plates import COLUMNS, OUTLINES, Case, drawn

from coilarray.errors import GeometryError, MetalError
from coilarray.metal.finite_plates import moving_plate

SEED, PLATES, LEAST = 1, 200, 0.95
FINER = 1.25, 1.75
"""Finenesses of the solver's own solutions of thick plates, whose errors fall as their square."""
TRUTH = "dL_nH", "dR_mOhm", "own_dL_nH", "own_dR_mOhm"
HEADER = """\
# Plates before coils in series at z = 0, 1 A: change of inductance and resistance, and the own error of both.
# Coils: regular polygons about the origin of the area of circles of radii_mm, a corner on +x; 360 sides for a circle.
# Outlines and their numbers in mm: disc radius; ring radius;inner; rectangle width;height; slotted radius;inner;slot (a
# ring cut at +x by radial sides, slot at the rim); ell width;height;arm; holed width;height;radius;x;y (a rectangle and
# a hole of 48 corners); comb width;height;slot;depth (a rectangle and a slot down from the middle of its upper side).
# x, y and z_mm: middle of the plate; tilt_deg: its rise towards towards_deg from x. Conductivity in S/m, frequency in
# Hz. axial: finite elements about the axis; thin: a stream function, circles as polygons of 96 corners (tests/support).
# Written by benchmarks/plate_errors.py --renew.
"""


def solved(case: Case) -> tuple[complex, complex]:
    """ΔL − jΔR/ω in H by the package and its stated error, of the real part and of the imaginary one."""
    plate = case.plate
    error = moving_plate(case.paths, plate, [plate.centre], [case.frequency])
    return complex(error.change.sum()), complex(error.absolute.sum())


def truth(case: Case) -> tuple[complex, complex]:
    """ΔL − jΔR/ω in H and its own error; of a thick plate of any outline by finer meshes, extrapolated."""
    if case.method != "thick":
        return case.truth()
    coarse, fine = (
        complex(moving_plate(case.paths, case.plate, [case.plate.centre], [case.frequency], fineness=f).change.sum())
        for f in FINER
    )
    step = (fine - coarse) / ((FINER[1] / FINER[0]) ** 2 - 1)
    return fine + step, complex(abs(step.real), abs(step.imag))


def as_texts(case: Case, value: complex, own: complex) -> list[str]:
    """Columns `TRUTH` of a row."""
    ohms = 2e3 * math.pi * case.frequency
    return [
        f"{value.real * 1e9:.6g}", f"{-value.imag * ohms:.6g}", f"{own.real * 1e9:.3g}", f"{own.imag * ohms:.3g}"
    ]  # fmt: skip


def of_row(case: Case, row: dict[str, str]) -> tuple[complex, complex]:
    """Read the columns `TRUTH`."""
    L, R, own_L, own_R = (float(row[name]) for name in TRUTH)
    ohms = 2e3 * math.pi * case.frequency
    return complex(L * 1e-9, -R / ohms), complex(own_L * 1e-9, own_R / ohms)


def text_of(lines: Sequence[Sequence[str]]) -> str:
    """Lines of CSV."""
    written = io.StringIO()
    csv.writer(written, lineterminator="\n").writerows(lines)
    return written.getvalue()


def renew(cases: Sequence[Case], report: Callable[[str], None]) -> None:
    """Compute tests/reference/ref_plates.csv again."""
    with (FOLDER / "ref_plates.csv").open("w", encoding="utf-8") as file:
        file.write(HEADER + text_of([[*COLUMNS, *TRUTH]]))
        for number, case in enumerate(cases):
            if case.method != "thick":
                file.write(text_of([[*case.row, *as_texts(case, *truth(case))]]))
                file.flush()
            report(f"{number + 1} of {len(cases)}")


def compared(cases: Sequence[Case], kept: Path, report: Callable[[str], None]) -> list[dict[str, str]]:
    """Rows of all cases: their columns, `TRUTH`, ours_dL_nH, ours_dR_mOhm, stated_dL_nH and stated_dR_mOhm."""
    names = [*COLUMNS, *TRUTH, "ours_dL_nH", "ours_dR_mOhm", "stated_dL_nH", "stated_dR_mOhm", "seconds"]
    done: dict[tuple[str, ...], dict[str, str]] = {}
    if kept.exists():
        with kept.open(encoding="utf-8", newline="") as lines:
            done = {tuple(row[name] for name in COLUMNS): row for row in csv.DictReader(lines)}
    else:
        kept.write_text(text_of([names]), encoding="utf-8")
    found = []
    for number, case in enumerate(cases):
        key = tuple(case.row)
        if key not in done:
            start = time.perf_counter()
            try:
                ours = as_texts(case, *solved(case))
                known = {tuple(row[name] for name in COLUMNS): row for row in rows("plates")}
                true = [known[key][name] for name in TRUTH] if key in known else as_texts(case, *truth(case))
            except (GeometryError, MetalError):
                ours = true = [""] * 4
            line = [*case.row, *true, *ours, f"{time.perf_counter() - start:.1f}"]
            with kept.open("a", encoding="utf-8") as file:
                file.write(text_of([line]))
            done[key] = dict(zip(names, line, strict=True))
        found.append(done[key])
        report(f"{number + 1} of {len(cases)}")
    return found


def table(found: Sequence[dict[str, str]]) -> tuple[str, bool]:
    """Write the table by class, and whether at least `LEAST` of both errors are covered of all that are not refused."""
    classes: dict[str, Callable[[dict[str, str]], bool]] = {
        "on the axis, plain": lambda row: row["method"] == "axial" and float(row["permeability"]) == 1,
        "on the axis, magnetic": lambda row: row["method"] == "axial" and float(row["permeability"]) != 1,
        "thin, any outline": lambda row: row["method"] == "thin",
        "thick, any outline (own solver)": lambda row: row["method"] == "thick",
        **{name: lambda row, name=name: row["outline"] == name for name in OUTLINES},  # type: ignore[misc]
        "all": lambda row: True,
    }
    lines = [
        "| plates | number | refused | ΔL covered | ΔR covered | stated, median: ΔL, ΔR "
        "| true/stated, median and 95 %: ΔL | ΔR | own error ≤ stated/10: ΔL, ΔR |",
        "| --- " * 9 + "|",
    ]
    kept = False
    for name, belongs in classes.items():
        some = [row for row in found if belongs(row)]
        solved_rows = [row for row in some if row["ours_dL_nH"]]
        if not solved_rows:
            lines += [f"| {name} | {len(some)} | {len(some)} " + "| " * 7] if some else []
            continue
        parts = []
        for what in ("dL_nH", "dR_mOhm"):
            ours, true, stated, own = (
                np.array([float(row[f"{prefix}{what}"]) for row in solved_rows])
                for prefix in ("ours_", "", "stated_", "own_")
            )
            ratio = np.abs(ours - true) / stated
            parts.append((ratio, np.mean(ratio <= 1), np.median(stated / np.abs(true)), np.mean(own <= stated / 10)))
        kept = all(part[1] >= LEAST for part in parts)
        cells = [f"{part[1]:.1%}" for part in parts]
        cells.append(", ".join(f"{part[2]:.1%}" for part in parts))
        cells += [f"{np.median(part[0]):.2f}, {np.quantile(part[0], 0.95):.2f}" for part in parts]
        cells.append(", ".join(f"{part[3]:.0%}" for part in parts))
        lines.append(f"| {name} | {len(some)} | {len(some) - len(solved_rows)} | " + " | ".join(cells) + " |")
    return "\n".join(lines), kept


def main() -> int:
    """Compare, print the table, and return 1 where too few are covered."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--plates", type=int, default=PLATES)
    options.add_argument("--seed", type=int, nargs="+", default=[SEED])
    options.add_argument(
        "--rows", type=Path, default=Path("build/plate_errors.csv"), help="file of the rows that are done"
    )
    options.add_argument("--renew", action="store_true", help="compute tests/reference/ref_plates.csv again")
    given = options.parse_args()

    def report(done: str) -> None:
        print(f"\r{done} plates", end="", file=sys.stderr, flush=True)

    cases = [drawn(seed, number) for seed in given.seed for number in range(given.plates)]
    if given.renew:
        renew(cases, report)
        return 0
    given.rows.parent.mkdir(parents=True, exist_ok=True)
    found = compared(cases, given.rows, report)
    print(file=sys.stderr)
    text, kept = table(found)
    print(text)
    for row in found:
        for what in ("dL_nH", "dR_mOhm"):
            if row["ours_dL_nH"]:
                ours, true, stated = (float(row[f"{prefix}{what}"]) for prefix in ("ours_", "", "stated_"))
                if abs(ours - true) > stated:
                    print(
                        f"not covered: {what} {ours} for {true}, stated {stated}: {','.join(row[c] for c in COLUMNS)}"
                    )
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
