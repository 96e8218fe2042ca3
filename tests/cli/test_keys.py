"""``coilarray keys``: every key of a design file with its unit, allowed values, default and meaning."""

from support.command_line import runner, successes

from coilarray import load_design_file

_, refused = runner("keys")
text, keys = successes("keys")


def test_every_value_of_a_design_has_its_key(capsys):
    known = {key["key"]: key for key in keys(capsys)}
    assert all(key["meaning"] for key in known.values())
    for name, value in load_design_file("starter").values.items():
        parts = ["N" if part.isdecimal() else part for part in name.split(".")]
        parts[1:2] = ["NAME"] if parts[0] == "coils" else parts[1:2]
        assert value == [] or ".".join(parts) in known
    assert known["coils.NAME.via.pad_mm"] == {
        "key": "coils.NAME.via.pad_mm", "kinds": [], "unit": "mm", "allowed": "number, above 0, at most 10\u202f000",
        "default": "0.45", "meaning": "Diameter of the copper around it.",
    }  # fmt: skip


def test_a_word_chooses_keys_by_name_or_meaning(capsys):
    assert [key["key"] for key in keys(capsys, "Oscillator")] == ["readout.external_clock"]
    assert {key["key"] for key in keys(capsys, "sides")} > {"coils.NAME.sides", "indentation.sample_x_mm"}
    line = next(line for line in text(capsys, "capacitance_pF").splitlines() if line.startswith("circuit.cap"))
    assert line.split()[:2] == ["circuit.capacitance_pF", "pF"]
    assert "did you mean pitch_mm?" in refused(capsys, "pitch_m_m")
