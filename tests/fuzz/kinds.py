"""Every kind of file that the package reads: good examples, their mutations, what reads them and what that may answer.

A reader does with a file what the commands do that take it, and returns what was read and computed: a design its
values, the vertices of its conductors and the margins of its rules; a board of another program the conductors of the
design that is imported; a recording its summary, series and response; a response a model and a position, its ellipses,
or a comparison. Meshes and pictures are written, never read.

An answer is silently wrong where

- a number in it is infinite, or NaN in a kind without gaps. Kinds with gaps are recordings and logs (readings that
  failed), fits of ellipses (levels without one) and comparisons (what is unknown): their documentation says so;
- the inductance matrix of an accepted design is not positive definite, or a coupling coefficient is not below 1;
- it is another one than that for the good file, in a kind of text file that the package writes with a checksum.

A changed number of any other text file is a good number all the same: people write them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import tomli_w
import xarray as xr
from support.board_text import board as kicad_text
from support.board_text import path as tracks
from support.emulated_reader import settings_of
from support.made_up import made_up_distortion
from support.plot_results import response, target
from support.recorded_boards import WIRING_TEXT, board_calibration, campaign_file, stream_file, two_coils_document

import coilarray.studies.comparison
from coilarray import load_design
from coilarray.cli.position import read_readings
from coilarray.cli.shared import read_ellipses, read_response
from coilarray.compute.netcdf import read_checked, save_dataset
from coilarray.design import bundled
from coilarray.design.model import load_design_file, parse_design, parse_design_file
from coilarray.design.write import design_text
from coilarray.errors import CoilarrayError, RuleViolationError
from coilarray.fabrication.gerber_reader import read_gerbers
from coilarray.fabrication.gerber_writer import write_gerbers
from coilarray.fabrication.kicad_reader import read_kicad
from coilarray.fabrication.tracing import trace_coils, traced_array
from coilarray.geometry import check_rules, require_rules
from coilarray.hardware.record.calibration import calibration_to_toml, load_calibration, save_calibration
from coilarray.hardware.record.campaign import Campaign
from coilarray.hardware.record.recorded_response import recorded_response, recorded_series, series_csv
from coilarray.hardware.record.recorder import file_temperature
from coilarray.hardware.record.recording import open_recording, summarize_recording
from coilarray.hardware.scan.settings import ScanSettings
from coilarray.hardware.scan.wiring import load_wiring, parse_wiring
from coilarray.localize.forward import forward_model
from coilarray.localize.inverse import locate_all
from coilarray.paper.distortion import DISTORTION
from coilarray.paper.ellipse import fit_ellipses
from coilarray.paper.ellipse_model import ellipse_model, locate_x, model_to_json, published_map, published_model
from coilarray.report.position import cause_table, distortion_table, indenter_table, residual_table
from coilarray.response.dataset import on_board
from coilarray.studies.calibrate.calibration import CALIBRATION, calibrated_imperfections, posterior_draws
from coilarray.studies.calibrate.plan import PLANS, load_plan
from coilarray.studies.comparison import compare_responses
from coilarray.studies.optimize.goal import GOALS, axes_of, parse_goal
from coilarray.studies.tolerance.tolerances import contributors, load_tolerances, typical_text
from fuzz import mutations as change


@dataclass(frozen=True)
class Kind:
    """One kind of file.

    `examples` makes good files in an empty folder. `read` answers for a file, or raises a CoilarrayError. `wrong` says
    in what an answer contradicts itself, empty for nothing, and `gaps` whether its numbers may be NaN. `keyed` kinds
    name a key in every error, and `sealed` kinds give no other answer than that for the good file. `share` is the part
    of all cases.
    """

    name: str
    suffix: str
    examples: Callable[[Path], Iterable[Path]]
    mutations: Sequence[change.Mutation]
    read: Callable[[Path], Any]
    wrong: Callable[[Any], str] = lambda answer: ""
    gaps: bool = False
    keyed: bool = False
    sealed: bool = False
    share: int = 1


_TEXT = (change.toml_changed, change.toml_changed, change.toml_changed, change.text_changed, change.bytes_changed)
_NETCDF = (change.dataset_changed, change.dataset_changed, change.dataset_changed, change.bytes_changed, change.one_bit)


def numbers_of(answer: Any) -> Iterable[float]:
    """Give every number in an answer: arrays, datasets, dataclasses, mappings and sequences."""
    if isinstance(answer, xr.Dataset | xr.DataArray):
        parts = answer.variables.values() if isinstance(answer, xr.Dataset) else [answer]
        for part in parts:
            yield from numbers_of(part.values)
    elif isinstance(answer, np.ndarray):
        if answer.dtype.kind in "fciu":
            yield from np.asarray(answer, dtype=np.complex128).ravel().view(np.float64).tolist()
    elif isinstance(answer, bool | str | bytes) or answer is None:
        return
    elif isinstance(answer, int | float):
        yield float(answer)
    elif is_dataclass(answer):
        for one in fields(answer):
            yield from numbers_of(getattr(answer, one.name))
    elif isinstance(answer, Mapping):
        for value in answer.values():
            yield from numbers_of(value)
    elif isinstance(answer, Sequence | set | frozenset):
        for value in answer:
            yield from numbers_of(value)


def _written(folder: Path, suffix: str, texts: Mapping[str, str]) -> list[Path]:
    paths = []
    for name, text in texts.items():
        paths.append(folder / f"{name}{suffix}")
        paths[-1].write_text(text, encoding="utf-8", newline="")
    return paths


def _saved(folder: Path, **datasets: xr.Dataset) -> list[Path]:
    paths = []
    for name, dataset in datasets.items():
        paths.append(folder / f"{name}.nc")
        save_dataset(dataset, paths[-1])
    return paths


# designs


SMALL = """
schema = 1
name = "small"
[stackup]
layers = ["L1", "L2"]
copper_thickness_um = [35, 35]
dielectric_thickness_mm = [0.8]
dielectric_epsilon_r = [4.5]
[coils.a]
shape = "polygon"
sides = 6
outer_across_flats_mm = 8.0
turns_per_layer = 3
winding_layers = 2
trace_width_mm = 0.2
gap_mm = 0.2
[coils.a.via]
drill_mm = 0.25
pad_mm = 0.5
[coils.a.leads]
length_mm = 2.0
spacing_mm = 1.5
pad_mm = 1.0
drill_mm = 0.5
[array]
lattice = "linear"
coil = "a"
columns = 2
pitch_mm = 14.0
layers = [["L1", "L2"]]
[[elastomer]]
name = "base"
thickness_mm = 6.0
youngs_modulus_kPa = 55
[[elastomer]]
name = "magnetic"
thickness_mm = 2.0
relative_permeability = 2.7
youngs_modulus_kPa = 166
[indenter]
shape = "hemisphere"
radius_mm = 2.5
[indentation]
depths_mm = [0.5, 1.0]
x_mm = [-6, 6]
y_mm = [-4, 4]
step_mm = 2.0
[circuit]
capacitance_pF = 330
[fab]
min_trace_mm = 0.1
min_gap_mm = 0.1
min_drill_mm = 0.2
min_annular_ring_mm = 0.1
min_edge_clearance_mm = 0.3
"""


def _designs(folder: Path) -> list[Path]:
    texts = {name: bundled.DESIGNS.read(name) for name in bundled.DESIGNS.names()}
    return _written(folder, ".toml", {**texts, "two_coils": tomli_w.dumps(two_coils_document()), "small": SMALL})


def _design(path: Path) -> Any:
    file = load_design_file(path)
    margins = check_rules(file.design.array, file.design.rules)
    paths = [(one.vertices, one.widths, one.areas) for one in file.design.array.conductors()]
    return file.values, paths, [(one.rule, one.layer, one.value, one.limit) for one in margins]


def _small_designs(folder: Path) -> list[Path]:
    return _written(folder, ".toml", {"small": SMALL})


def _coupled(path: Path) -> Any:
    from coilarray.circuit.coupling import couple_design

    design = load_design(path)
    try:
        require_rules(design.array, design.rules)
    except RuleViolationError as error:  # names coils and the place, which no key of the file does
        return str(error)
    return couple_design(design)


def _uncoupled(answer: xr.Dataset | str) -> str:
    if isinstance(answer, str):
        return ""
    L = answer.inductance.values
    if not np.linalg.eigvalsh((L + L.T) / 2).min() > 0:
        return "L is not positive definite"
    k = L / np.sqrt(np.outer(np.diag(L), np.diag(L)))
    return "" if (np.abs(k[~np.eye(len(k), dtype=bool)]) < 1).all() else "|k| is not below 1"


# studies


_GOALS = {
    "short": """
schema = 1
title = "small and far apart"
variable = [{entry = "array.pitch_mm", low = 8, high = 13}]
objective = [{quantity = "worst_k", direction = "minimize"}, {quantity = "span_mm", direction = "maximize"}]
""",
    "long": """
schema = 1
title = "all tables"
[[variable]]
entry = "array.pitch_mm"
low = 11.0
high = 16.0
[[variable]]
entry = "coils.a.turns_per_layer"
low = 2
high = 6
step = 1
[[objective]]
quantity = "worst_k"
direction = "minimize"
[[constraint]]
quantity = "span_mm"
at_most = 90.0
[search]
trials = 20
seed = 3
""",
}


@cache
def _small() -> Any:
    return parse_design_file(SMALL, "small")


def _goal(path: Path) -> Any:
    goal = parse_goal(GOALS.text(path), str(path))
    return goal.model_dump(), axes_of(goal, _small())


def _goals(folder: Path) -> list[Path]:
    return _written(folder, ".toml", _GOALS)


def _tolerances(folder: Path) -> list[Path]:
    return _written(folder, ".toml", {"typical": typical_text()})


def _tolerance(path: Path) -> Any:
    found = load_tolerances(path)
    return found, contributors(_small().design, found)


def _plan(path: Path) -> Any:
    return load_plan(path).model_dump()


def _plans(folder: Path) -> list[Path]:
    return _written(folder, ".toml", {name: PLANS.read(name) for name in PLANS.names()})


# the board


def _wirings(folder: Path) -> list[Path]:
    from coilarray.hardware.scan.wiring import WIRINGS

    return _written(folder, ".toml", {"two": WIRING_TEXT, **{name: WIRINGS.read(name) for name in WIRINGS.names()}})


def _wiring(path: Path) -> Any:
    found = load_wiring(path)
    return repr(found), settings_of(found).to_json()


def _calibrations(folder: Path) -> list[Path]:
    return _written(folder, ".toml", {"board": f'checksum = "none"\n{calibration_to_toml(board_calibration())}'})


def _sealed_calibrations(folder: Path) -> list[Path]:
    save_calibration(board_calibration(), folder / "board.toml")
    return [folder / "board.toml"]


def _settings_files(folder: Path) -> list[Path]:
    return _written(folder, ".json", {"two": settings_of(parse_wiring(WIRING_TEXT)).to_json()})


def _settings(path: Path) -> Any:
    return repr(ScanSettings.from_json(_text(path)))


def _campaigns(folder: Path) -> list[Path]:
    return _written(folder, ".json", {"grid": Campaign(x=(0.0, 1e-3), y=(0.0,), depths=(1e-3,), repeats=2).to_json()})


def _campaign(path: Path) -> Any:
    found = Campaign.from_json(_text(path))
    return found, found.size, found.to_record()


def _text(path: Path) -> str:
    """A text as a database holds it."""
    return path.read_bytes().decode("utf-8", "replace")


def _recordings(folder: Path) -> list[Path]:
    small = Campaign(x=(-6e-3, 0.0, 6e-3, 12e-3), y=(-4e-3, 0.0, 4e-3), depths=(1e-3,))
    return [campaign_file(folder / "campaign.sqlite", small), stream_file(folder / "stream.sqlite", 12)]


def _recording(path: Path) -> Any:
    with open_recording(path) as recording:
        recording.check()
        summary = summarize_recording(recording)
        series = recorded_series(recording)
        response = None if recording.campaign is None else recorded_response(recording, partial=True)
        return {key: value for key, value in summary.items() if key != "file"}, series, response


def _streams(folder: Path) -> list[Path]:
    with open_recording(stream_file(folder / "stream.sqlite", 12)) as recording:
        return _written(folder, ".csv", {"stream": series_csv(recorded_series(recording))})


def _temperatures(folder: Path) -> list[Path]:
    slave = "91 01 4b 46 7f ff 0c 10 25 : crc=25 YES\n91 01 4b 46 7f ff 0c 10 25 t=25062\n"
    return _written(folder, ".txt", {"kernel": "42375\n", "degrees": "21.5\n", "slave": slave})


# responses


def _with_noise(dataset: xr.Dataset) -> xr.Dataset:
    spread = dataset.delta * 0 + 1e-6
    return dataset.assign(delta_std=spread).assign_attrs(repeats=2, noise=1e-6, origin="board", emulated=0)


def _responses(folder: Path) -> list[Path]:
    common = (("drift_cause", "state"), np.full((2, 2), 1e-7))
    bells = response().assign(common_noise=common, base_inductance=("state", [5e-5, 5e-5]))
    bells = bells.assign_attrs(noise=1e-6, origin="coil1", origin_x=1e-3, origin_y=0.0, design_hash="abc")
    return _saved(folder, bells=bells, published=published_map(), measured=_with_noise(response()))


def _positions(path: Path) -> Any:
    table = on_board(read_response(path, target=True))
    model = forward_model(table)
    middle = model.delta((model.lower + model.upper) / 2)
    places = locate_all(model, [(0.9 * middle).tolist()]) if len(model.states) >= model.unknowns else []
    return model.x, model.y, model.depth, model.noise, model.common, model.errors, middle, repr(places)


def _ellipses(path: Path) -> Any:
    found = fit_ellipses(read_response(path))
    return found, ellipse_model(found)


@cache
def _simulated() -> xr.Dataset:
    return response()


def _comparison(path: Path) -> Any:
    given = read_response(path)
    other = published_map() if "coil3" in given.state.values.tolist() else _simulated()
    with patch.object(coilarray.studies.comparison, "REPLICATES", 0):  # noisy copies take longest
        return compare_responses(given, other)


def _targets(folder: Path) -> list[Path]:
    along = np.linspace(-6e-3, 6e-3, 5)
    single = target((1e-3, 2e-3, 4e-3))
    near = np.exp(-(np.add.outer(along**2, along**2) / 8e-3**2))[None, :, :, None]
    delta = single.delta.values * np.ones((1, 5, 5, 1)) * near
    wide = single.drop_dims(("y", "x")).assign_coords(y=along, x=along)
    return _saved(folder, target=wide.assign(delta=(("distance", "y", "x", "state"), delta)))


def _calibration_results(folder: Path) -> list[Path]:
    names = ["elastomer.0.youngs_modulus_kPa", "imperfections.depth_error_mm"]
    draws = np.random.default_rng(0).normal([55.0, 0.0], [2.0, 0.05], (1, 12, 2))
    data = {
        "value": (("combination", "unknown"), draws.mean(axis=1)),
        "posterior": (("combination", "draw", "unknown"), draws),
        "correlation": (("combination", "unknown", "other"), np.eye(2)[None]),
    }
    coords = {"combination": ["one"], "unknown": names, "other": names, "entries": ("unknown", names)}
    return _saved(folder, calibration=xr.Dataset(data, coords))


def _posterior(path: Path) -> Any:
    found = read_checked(path, CALIBRATION)
    drawn = posterior_draws(_small(), found, 2)
    return [(design.digest, errors) for design, errors in drawn], calibrated_imperfections(found)


def _distortions(folder: Path) -> list[Path]:
    return _saved(folder, distortion=made_up_distortion(load_design("gast2020"), ["coil1", "coil2"]))


def _distortion(path: Path) -> Any:
    found = read_checked(path, DISTORTION)
    return [table(found).csv() for table in (cause_table, indenter_table, residual_table, distortion_table)]


def _models(folder: Path) -> list[Path]:
    return _written(folder, ".json", {"table_a1": model_to_json(published_model())})


def _model(path: Path) -> Any:
    model = read_ellipses(path)
    try:
        place: Any = locate_x(model, {"coil1": 2.1125e-4, "coil2": 1.7582e-3, "coil3": 1.6317e-4})
    except CoilarrayError as error:
        place = str(error)
    return model, place


def _readings_files(suffix: str, text: str) -> Callable[[Path], list[Path]]:
    return lambda folder: _written(folder, suffix, {"readings": text})


def _readings(path: Path) -> Any:
    found = read_readings(str(path))
    model = published_model()
    answers = []
    for one in found:
        if isinstance(one, CoilarrayError):
            answers.append(str(one))
            continue
        try:
            answers.append(locate_x(model, one if isinstance(one, dict) else dict(zip(model.names, one, strict=False))))
        except CoilarrayError as error:
            answers.append(str(error))
    return answers


# boards of other programs


def _kicad_boards(folder: Path) -> list[Path]:
    spiral = [(0, 0), (4, 0), (4, 4), (0, 4), (0, 1), (3, 1), (3, 3), (1, 3), (1, 2)]
    text = kicad_text(tracks(*spiral), tracks(*[(x + 8, y) for x, y in spiral], net="2"))
    return _written(folder, ".kicad_pcb", {"two": text})


def _gerber_zips(folder: Path) -> list[Path]:
    write_gerbers(_small().design.array, folder / "board.zip", name="small")
    return [folder / "board.zip"]


def _imported(path: Path) -> Any:
    copper = read_kicad(path) if path.suffix == ".kicad_pcb" else read_gerbers(path)
    traced = trace_coils(copper)
    from coilarray.design.model import Design

    found = traced_array(copper, traced.coils)
    text = design_text(Design(found.array, name="board"), found.assumed)
    return [one.vertices for one in parse_design(text, "board").array.conductors()]


_LINES = (change.text_changed, change.bytes_changed, change.lines_changed, change.cut)
_CSV = (change.text_changed, change.text_changed, change.bytes_changed)
_DATABASE = (change.database_changed, change.database_changed, change.bytes_changed)
_ZIP = (change.zip_changed, change.zip_changed, change.bytes_changed)
_OF_CSV = "coil1,coil2,coil3\n2.1e-4,1.7e-3,1.6e-4\n1e-4,1e-4,1e-4\n"
_READING = '{"coil1": 2.1e-4, "coil2": 1.7e-3, "coil3": 1.6e-4}'
_JSON = (change.json_changed, change.json_changed, change.text_changed, change.bytes_changed)

KINDS = (
    Kind("design", ".toml", _designs, _TEXT, _design, keyed=True, share=6),
    Kind("coupling of a design", ".toml", _small_designs, _TEXT[:1], _coupled, _uncoupled, keyed=True),
    Kind("goal", ".toml", _goals, _TEXT, _goal, keyed=True, share=2),
    Kind("tolerances", ".toml", _tolerances, _TEXT, _tolerance, keyed=True, share=2),
    Kind("calibration plan", ".toml", _plans, _TEXT, _plan, keyed=True, share=2),
    Kind("wiring", ".toml", _wirings, _TEXT, _wiring, keyed=True, share=2),
    Kind("board calibration", ".toml", _calibrations, _TEXT, load_calibration, keyed=True, share=2),
    Kind("board calibration, sealed", ".toml", _sealed_calibrations, _LINES, load_calibration, sealed=True),
    Kind("scan settings", ".json", _settings_files, _JSON, _settings, keyed=True),
    Kind("campaign plan", ".json", _campaigns, _JSON, _campaign),
    Kind("recording", ".sqlite", _recordings, _DATABASE, _recording, gaps=True, share=4),
    Kind("temperature", ".txt", _temperatures, _CSV, file_temperature),
    Kind("response, positions", ".nc", _responses, _NETCDF, _positions, share=3),
    Kind("response, ellipses", ".nc", _responses, _NETCDF, _ellipses, gaps=True, share=3),
    Kind("response, comparison", ".nc", _responses, _NETCDF, _comparison, gaps=True, share=3),
    Kind("target map", ".nc", _targets, _NETCDF, _positions),
    Kind("calibration result", ".nc", _calibration_results, _NETCDF, _posterior),
    Kind("distortion", ".nc", _distortions, _NETCDF, _distortion),
    Kind("ellipse model", ".json", _models, _JSON, _model, share=2),
    Kind("readings, CSV of a stream", ".csv", _streams, _LINES, _readings, sealed=True),
    Kind("readings, CSV", ".csv", _readings_files(".csv", _OF_CSV), _CSV, _readings),
    Kind("readings, JSON lines", ".jsonl", _readings_files(".jsonl", f"{_READING}\n[1, 2, 3]\n"), _CSV, _readings),
    Kind("KiCad board", ".kicad_pcb", _kicad_boards, _CSV, _imported, share=2),
    Kind("Gerber archive", ".zip", _gerber_zips, _ZIP, _imported, share=2),
)  # fmt: skip
"""Every kind, in the order of the table."""
