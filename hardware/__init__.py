"""Read-out hardware for boards, scans and inductances.

The package opens a real or emulated board, sends it the settings of a scan, and reads inductances from it. `open_board`
opens a board of any kind, and `load_wiring` reads how its switches are wired. `scan_settings` and `design_settings`
make the settings of a scan. `read_scan` converts the results of the board into frequencies and inductances, and
`self_test` checks every switch.

Importing this package opens no port. Each name loads its module when it is first used. `__init__.pyi` lists the names.

Examples
--------
>>> from coilarray.hardware import load_wiring, scan_settings
>>> settings = scan_settings(load_wiring())
>>> len(settings.states)
6
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
