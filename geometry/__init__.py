"""Geometry without physics: coils, stack-ups, arrays, copper, rules and solids.

Modules of the names in ``__init__.pyi`` are imported at first use.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
