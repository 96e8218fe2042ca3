"""
Which drive current does a coil need?
=====================================

The limits of the LDC1614 for one channel, and its drive current, which has 32 steps, over the parallel resistance of
coil and capacitor.
"""

import matplotlib.pyplot as plt
import numpy as np

from coilarray.circuit.converter_limits import check_channel, drive_for

for limit in check_channel(1.9e6, 33e3, 48.0, 8e6):
    print(limit.words if not limit.kept else f"{limit.name}: kept")
resistance = np.geomspace(1e3, 80e3, 2000)
found = [drive_for(value) for value in resistance]
figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
ax.loglog(resistance / 1e3, [np.nan if drive is None else drive.current * 1e6 for drive in found])
ax.set(xlabel="parallel resistance (kΩ)", ylabel="drive current (µA)")
