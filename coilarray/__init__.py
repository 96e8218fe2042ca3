"""Planar coil arrays: geometry, inductance, coupling, sensor response and report.

A design comes from a file (`load_design`) or is made in Python (`Design`). Arguments and results
are in SI units. Keys of design files, as `sweep` and `vary` take them, carry the unit in their
name. `coilarray.errors` holds the exceptions, `coilarray.viz` pictures, `coilarray.hardware`
boards, and `coilarray.fabrication` files of boards. The module of a name, as ``__init__.pyi`` lists
them, is imported when the name is first used.

- A board: load_design, load_design_file, parse_design, save_design, design_document, new_design,
  vary, Design, Board, Pose, Circuit, Indentation, Readout, ScanState, Switches
- Coils: Spiral, RoundedSpiral, path_coil, Coil, PlatedHole, Array, Lattice, Placement,
  lattice_array, Stackup, FabRules, check_rules, export, Conductor
- Bodies: Sheet, Hemisphere, Target, Ball, Plate, FinitePlate, Disc, Rectangle, Material, MATERIALS
- Fields and matrices: magnetic_field, inductance_matrix, coupling_matrix,
  self_inductance, mutual_inductance, dc_resistance
- Circuit: couple_design, operating_field, scan_design, sweep_design, noise_budget
- Responses and positions: response_map, Imperfections, target_map, indent, forward_model, locate
- Studies: sweep, calibrate, write_report, errors

More is in the modules: other indenters, plates and connectors in `coilarray.geometry`, the models
of the papers of 2020 in `coilarray.paper`, and closed forms for textbook cases in
`coilarray.electromagnetics.inductance` and `coilarray.circuit.network`.
"""

import lazy_loader

_lazy_name, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    if name != "__version__":
        return _lazy_name(name)
    from importlib import metadata  # takes as long as all else of ``import coilarray``

    return metadata.version("coilarray")
