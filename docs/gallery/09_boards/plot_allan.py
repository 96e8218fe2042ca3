"""
How long to average: the Allan deviation
========================================

Two thousand scans of the emulated board at rest, and the Allan deviation of each coil's δ against the averaging time,
beside the white noise of the budget. `coilarray board info --noise` does the same with a recording.
"""

import numpy as np

import coilarray as ca
from coilarray.hardware import design_settings, open_board, read_scan
from coilarray.hardware.record.stability import stability
from coilarray.viz import plot_stability

design = ca.load_design("gast2020")
with open_board("emulator", design=design) as board:
    settings = design_settings(design, board.wiring)
    board.reader.configure(settings)
    scans = [board.reader.scan() for _ in range(2000)]
capacitance = design.circuit.capacitance
inductance = np.array([list(read_scan(scan, settings, capacitance).inductances.values()) for scan in scans])
delta = inductance / inductance.mean(axis=0) - 1
names = [state.name for state in settings.states]
budget = ca.noise_budget(design)
plot_stability(stability([scan.time for scan in scans], delta, names, expected=budget.scan_noise))
