"""Planar coil arrays: geometry, inductance, coupling, sensor response and report.

A design comes from a file (`load_design`) or is made in Python (`Design`). Arguments and results are in SI units. Keys
of design files, as `sweep` and `vary` take them, carry the unit in their name. `coilarray.errors` holds the exceptions,
`coilarray.viz` pictures, `coilarray.hardware` boards, and `coilarray.fabrication` files of boards. The module of a
name, as ``__init__.pyi`` lists them, is imported when the name is first used, so that ``import coilarray`` stays quick.
Closed forms and other helpers for textbook cases are in the modules themselves, such as
`coilarray.electromagnetics.inductance` and `coilarray.circuit.network`.
"""

import lazy_loader

_lazy_name, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    if name != "__version__":
        return _lazy_name(name)
    from importlib import metadata  # takes as long as all else of ``import coilarray``

    return metadata.version("coilarray")
