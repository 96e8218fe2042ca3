"""
Coils at the channels of a converter
====================================

An LDC1612 or LDC1614 with a coil at each channel needs no switches. This is the emulator of the Grove board; a real one
is read with ``i2c:1?board=grove-ldc1612`` in its place (not tried on a device).
"""

import tempfile

from coilarray.cli.main import main

PORT = "emulator?board=grove-ldc1612"
with tempfile.TemporaryDirectory() as folder:
    command = ["measure", "starter", "--port", PORT, "--coils", "coil1,coil2", "--scans", "20"]
    main([*command, "--out", f"{folder}/rest.sqlite"])
