"""
Coils at the channels of a converter
====================================

An LDC1612 or LDC1614 with a coil at each channel needs no switches. Here the emulated Grove board is pressed above
its first coil after a hundred scans; ``i2c:1:0x2B?channels=0,1&clock=40MHz`` reads a real one (not tried on a device).
"""

import matplotlib.pyplot as plt
import numpy as np

import coilarray as ca
from coilarray.hardware import design_settings, open_board, read_scan

design = ca.vary(ca.load_design_file("starter"), {"array.columns": 2})
with open_board("emulator?channels=0,1&clock=40MHz", design=design) as board:
    settings = design_settings(design, board.wiring)
    board.reader.configure(settings)
    scans = [board.reader.scan() for _ in range(100)]
    board.emulator.indenter.press(*design.array.centres[0], 0.5e-3)
    scans += [board.reader.scan() for _ in range(100)]
found = [read_scan(scan, settings, design.circuit.capacitance).inductances for scan in scans]
inductance = np.array([list(one.values()) for one in found])
figure, ax = plt.subplots(figsize=(7, 3.6), layout="constrained")
ax.plot([scan.time for scan in scans], (inductance / inductance[:100].mean(axis=0) - 1) * 1e6, label=list(found[0]))
ax.set(xlabel="time (s)", ylabel="δ (10⁻⁶)")
ax.legend()
