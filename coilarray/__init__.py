"""Planar coil arrays: geometry, inductance, coupling, sensor response and report.

A design comes from a file (`load_design`) or is made in Python (`Design`). Everything takes and returns SI units. The
module of a name, as ``__init__.pyi`` lists them, is imported when the name is first used, so that ``import coilarray``
stays quick. Closed forms and other helpers for textbook cases are in the modules themselves, such as
`coilarray.electromagnetics.inductance` and `coilarray.circuit.active_coil`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
