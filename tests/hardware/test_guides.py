"""The guides of `docs/hardware`: their programs run, and their commands print what they show."""

import csv
import re
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

DOCS = Path(__file__).parents[2] / "docs" / "hardware"


def _blocks(page, language):
    return re.findall(rf"```{language}\n(.*?)```", (DOCS / page).read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.filterwarnings("default")  # whatever the framework has
def test_a_procedure_of_pymeasure_writes_the_inductances_of_every_scan(tmp_path, monkeypatch):
    pytest.importorskip("pymeasure", reason="pymeasure is not installed")
    monkeypatch.chdir(tmp_path)
    (program,) = _blocks("lab_frameworks.md", "python")
    exec(program, {"__name__": "__main__"})
    lines = [line for line in (tmp_path / "inductances.csv").read_text().splitlines() if not line.startswith("#")]
    rows = list(csv.DictReader(lines))
    assert len(rows) == 5
    assert list(rows[0]) == ["Time (s)", *[f"coil{k} (H)" for k in range(1, 7)]]
    # 107.6 µH in the README, which counts the switches; the same 120 pF here
    assert all(float(row["coil1 (H)"]) == pytest.approx(107.6e-6, rel=1e-3) for row in rows)
