"""What several tests of board files share."""

import pytest

from coilarray.fabrication.kicad_reader import read_kicad


@pytest.fixture
def read(tmp_path):
    """Write a text as a KiCad board and read it."""

    def _read(text, *arguments):
        file = tmp_path / "b.kicad_pcb"
        file.write_text(text, encoding="utf-8")
        return read_kicad(file, *arguments)

    return _read
