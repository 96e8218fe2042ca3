"""``coilarray init``."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import typer

from coilarray.cli import shared
from coilarray.cli.questions import ask_for_choices, in_si
from coilarray.cli.replacing import remember, require_own
from coilarray.errors import DesignError, OutputError

if TYPE_CHECKING:
    import xarray as xr

    from coilarray.circuit.converter_limits import Limit
    from coilarray.compute.threads import Progress
    from coilarray.design.model import Design, DesignFile

Shape = Literal["hexagon", "square", "circle", "rectangle", "racetrack"]  # not imported: help must stay quick
Overlap = Literal["none", "decoupled"]
Side = Literal["right", "top", "left", "bottom"]
Part = Literal["ADG714", "ADG738", "ADG739"]
_MET = 5e-3  # of the wanted inductance: as near as is not worth a word
_FEW = 2  # layers of a winding: no board has fewer
_HELPS = {
    ("sensor frequency", "high"): "; a larger --capacitance-pF or --inductance-uH lowers it",
    ("frequency over self-resonance", "high"): "; a larger --capacitance-pF lowers it",
    ("R_p", "low"): "; larger coils, more inductance or less capacitance raise it",
    ("R_p", "high"): "; a larger --capacitance-pF lowers it",
    ("amplitude with the smallest drive current", "high"): "; a larger --capacitance-pF lowers it",
    ("quality factor", "low"): "; larger coils and less capacitance raise it",
}
"""What mends a limit of the converter, by its name and the side on which it is broken."""


def init(
    file: Annotated[Path, typer.Argument(metavar="NAME", help="File to write, .toml.")] = Path("design.toml"),
    coils: Annotated[
        str | None,
        typer.Option(help="1, 6 (a row), 4x4 (columns by rows), 3-hex (a triangle), 7-hex or 19-hex; 3 by default."),
    ] = None,
    shape: Annotated[Shape | None, typer.Option(help="Shape of the coils; hexagon by default.")] = None,
    size_mm: Annotated[
        str | None,
        typer.Option(
            help="Width of a coil's copper, of a hexagon across flats, of a circle the diameter at which its outer "
            "edge starts, 16 by default; width and height of a rectangle or racetrack, 20x12 by default."
        ),
    ] = None,
    inductance_uH: Annotated[
        float | None, typer.Option("--inductance-uH", help="Inductance to find turns and trace for.")
    ] = None,
    layers: Annotated[
        int | None, typer.Option(help="Copper layers of the board; by default those of --fab, or as many as needed.")
    ] = None,
    fab: Annotated[
        str | None, typer.Option(metavar="PROFILE", help="Board house to keep the limits of (check --list-fabs).")
    ] = None,
    pitch_mm: Annotated[
        float | None, typer.Option(help="Distance of neighbours; side by side with room for terminals by default.")
    ] = None,
    overlap: Annotated[
        Overlap | None, typer.Option(help="decoupled: neighbours overlap until they do not couple.")
    ] = None,
    frequency_MHz: Annotated[
        float | None, typer.Option("--frequency-MHz", help="Frequency to choose the tank's capacitance for.")
    ] = None,
    capacitance_pF: Annotated[
        float | None,
        typer.Option("--capacitance-pF", help="Capacitance of the tank; chosen for the converter by default."),
    ] = None,
    connector: Annotated[
        Side | None, typer.Option(help="Edge of the board to which the leads of all coils run.")
    ] = None,
    switches: Annotated[
        Part | None,
        typer.Option(help="Part of the switches that select the coils; ideal ones, without resistance, by default."),
    ] = None,
    elastomer: Annotated[
        bool | None,
        typer.Option(
            "--elastomer/--no-elastomer", help="A magnetic elastomer on the board, and what presses on it; by default."
        ),
    ] = None,
    title: Annotated[str | None, typer.Option(help="Title in reports.")] = None,
    copied: Annotated[str | None, typer.Option("--from", help="Copy this bundled design instead.")] = None,
    force: shared.Force = False,
) -> None:
    """Write a commented design file from a few choices.

    Turns, trace, layers, pitch, terminals and the tank's capacitance are found such that the board house can make the
    board and an LDC1614 can read it. On a terminal, without any choice, the choices are asked for. What is not chosen
    has the same default everywhere, also in Python (coilarray.new_design).

    Example: coilarray init pad.toml --coils 4x4 --shape square --size-mm 12

    Example: coilarray init flower.toml --coils 7-hex --overlap decoupled --inductance-uH 18

    Example: coilarray init strip.toml --coils 6 --connector bottom

    Example: coilarray init power.toml --coils 1 --shape circle --size-mm 40 --no-elastomer

    Example: coilarray init starter.toml --from starter
    """
    from coilarray.compute.files import write_text
    from coilarray.design import bundled
    from coilarray.design.write import save_design

    if file.is_dir() and (file.suffix or file.name in ("", "..")):
        raise OutputError(f"{file} is a folder; name a file in it.")
    target = file if file.suffix else file.with_suffix(".toml")
    shared.check_file("NAME", target, (".toml",))
    require_own("init", [target], force=force)
    given = {
        "coils": coils, "shape": shape, "size_mm": size_mm, "inductance_uH": inductance_uH, "layers": layers,
        "fab": fab, "pitch_mm": pitch_mm, "overlap": overlap, "frequency_MHz": frequency_MHz,
        "capacitance_pF": capacitance_pF, "connector": connector, "switches": switches, "elastomer": elastomer,
        "title": title,
    }  # fmt: skip
    chosen: dict[str, Any] = {key: value for key, value in given.items() if value is not None}
    if copied is not None:
        if chosen:
            raise DesignError("--from copies a design as it is; it cannot be given with other choices.")
        if copied not in bundled.names():
            raise DesignError(f"there is no bundled design {copied!r}; there are {', '.join(bundled.names())}.")
        write_text(target, bundled.read(copied))
        remember("init", [target])
        typer.echo(f"wrote {target}; next: coilarray check {shlex.quote(str(target))}")
        return
    if not chosen:
        asking = sys.stdin.isatty() and sys.stdout.isatty()
        chosen = ask_for_choices(get_args(Shape), get_args(Side)) if asking else {}
    with shared.progress_bar("layers, winding, pitch, terminals and tank"):
        made = _made(target.stem, chosen)
        fewer = _fewer_layers(made, chosen)
    with shared.progress_bar("states") as progress:
        described = (*_described(made, chosen, progress), *fewer)  # with what is refused before it is written
    save_design(made, target)
    remember("init", [target])
    for line in (f"wrote {target}: {made.design.title}", *described):
        typer.echo(line)
    quoted = shlex.quote(str(target))
    typer.echo(f"next: coilarray check {quoted}, coilarray report {quoted}")


def _made(name: str, chosen: Mapping[str, Any]) -> DesignFile:
    """Make the design of the choices, by the names of their options."""
    from coilarray.design.write import design_names
    from coilarray.studies.create import new_design

    return new_design(design_names([name])[name], **in_si(chosen))


def _fewer_layers(made: DesignFile, chosen: Mapping[str, Any]) -> list[str]:
    """Say what fewer layers reach, where the wanted inductance is what needs so many."""
    from coilarray.studies.create import Choices, reach_of_fewer_layers

    layers = len(made.design.array.stackup.names)
    (coil,) = made.document["coils"].values()
    choices = Choices(**in_si(chosen))
    if choices.inductance is None or choices.layers or choices.layers_of_fab or coil["winding_layers"] <= _FEW:
        return []
    reach = reach_of_fewer_layers(layers, choices)
    wanted = f"layers: {chosen['inductance_uH']:g} µH takes {layers}"
    if reach is None:
        return [f"{wanted}; on fewer there is no place for the terminals"]
    reached = f"{reach.inductance * 1e6:.3g}"
    return [f"{wanted}; {reach.layers} reach {reached} µH, with --layers {reach.layers} --inductance-uH {reached}"]


def _described(file: DesignFile, chosen: Mapping[str, Any], progress: Progress) -> list[str]:
    """Say what has been found."""
    import numpy as np

    from coilarray.circuit.coupling import design_inductance
    from coilarray.circuit.impedance import scan_design
    from coilarray.compute.display_units import number_text
    from coilarray.geometry.array import copper_words
    from coilarray.studies.create import Choices, broken_limits, is_standard, neighbour_coupling

    design, values = file.design, file.values
    scan = scan_design(design, elastomer=False, accuracy="screen", progress=progress)
    coil = f"coils.{next(iter(file.document['coils']))}"
    turns, trace, gap, on = (
        values[f"{coil}.{key}"] for key in ("turns_per_layer", "trace_width_mm", "gap_mm", "winding_layers")
    )
    L = np.diag(design_inductance(design, accuracy="screen")[0]) * 1e6
    span = f"{L.min():.4g}" if L.max() - L.min() < 5e-4 * L.max() else f"{L.min():.4g} to {L.max():.4g}"
    asked = ""
    if "inductance_uH" in chosen:
        wanted = chosen["inductance_uH"]
        off = float(np.abs(L / wanted - 1).max()) > _MET
        asked = f" ({wanted:g} wanted{_why_not_met(design) if off else ''})"
    size = " × ".join(f"{side * 1e3:g}" for side in dict.fromkeys(Choices(**in_si(chosen)).sides))
    copper = copper_words(design.array.unrouted.placements[0].coil)
    lines = [
        f"coil: {size} mm{copper}, {turns:g} turns on each of {on} layers, trace {trace:g} mm, gap {gap:g} mm",
        f"inductance: {span} µH{asked}",
        _resistance(design, scan),
    ]
    if len(design.array.names) > 1:
        near = neighbour_coupling(design)
        worst = near[np.abs(near).argmax()]
        k = number_text(worst, 4, "+")
        lines.append(f"pitch: {values['array.pitch_mm']:g} mm; largest coupling of neighbours {k}")
    low, high = (f"{float(f) * 1e-6:.4g}" for f in (scan.frequency.min(), scan.frequency.max()))
    f = low if low == high else f"{low} to {high}"
    C, beside_q = values["circuit.capacitance_pF"], design.circuit.switches.beside_q
    tuned = f" ({chosen['frequency_MHz']:g} wanted)" if "frequency_MHz" in chosen else ""
    standard = (
        ""
        if "frequency_MHz" not in chosen or is_standard(design.circuit.capacitance)
        else "; no standard value (E24) comes within 1 % of that"
    )
    lines.append(f"tank: {C:g} pF, {f} MHz{tuned}, Q {float(scan.quality_factor.min()):.3g}{beside_q}{standard}")
    x_min, y_min, x_max, y_max = (edge * 1e3 for edge in design.array.bounds)
    lines.append(
        f"board: {x_max - x_min:.4g} × {y_max - y_min:.4g} mm, {len(design.array.stackup.names)} copper layers; "
        f"every limit of {values['fab.profile']} is kept"
    )
    left_out = scan.attrs["left_out"]
    converter = _read_by_converter(broken_limits(scan), len(scan.state), whole=not left_out)
    return [*lines, *shared.left_out_lines(left_out), converter]


def _why_not_met(design: Design) -> str:
    """Say why coils have another inductance than the wanted one, which a coil alone on the topmost layers has."""
    if design.array.routing is not None:
        return " without the leads to the connector"
    if len({place.layers for place in design.array.placements}) > 1:
        return "; met on the topmost layers, and other distances on the others"
    return "; the nearest that whole turns, and traces that can be made, give"


def _read_by_converter(broken: Sequence[tuple[str, Limit]], states: int, *, whole: bool) -> str:
    """Say as the last word whether an LDC1614 can read the coils, and what would help where it cannot."""
    if not broken:
        kept = "every limit of an LDC1614 is kept"
        return f"converter: {kept if whole else f'as far as these numbers go, {kept}'}"
    state, limit = broken[0]
    too = "low" if limit.value < limit.low else "high"
    which = state if states == 1 else f"{len({name for name, _ in broken})} of {states} coils, as {state}"
    helps = _HELPS.get((limit.name.partition(" (")[0], too), "")
    return f"WARNING: an LDC1614 cannot read {which}: {limit.words}{helps}"


def _resistance(design: Design, scan: xr.Dataset) -> str:
    """Say what the copper resists at the frequency of its use, of the coil where that is the most."""
    from coilarray.electromagnetics.resistance import dc_resistance

    worst = int(scan.ac_resistance.values.argmax())
    R, f = float(scan.ac_resistance[worst]), float(scan.attrs["ac_resistance_frequency_Hz"]) * 1e-6
    ratio = R / float(dc_resistance(design.array)[worst])
    return f"resistance: {R:.3g} ohm at {f:.4g} MHz, {ratio:.2g} times that of direct current"
