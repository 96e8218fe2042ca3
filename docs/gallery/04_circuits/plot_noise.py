"""
What makes a reading scatter and drift
======================================

The noise of one scan and the drift per kelvin of the six-coil sensor, cause by cause. Hatched: assumed sizes, which no
public source or device has confirmed; `coilarray impedance --noise` names the sources of the others.
"""

import matplotlib.pyplot as plt
import numpy as np

import coilarray as ca

budget = ca.noise_budget(ca.load_design("gast2020"))
scan, drift, delta = (1e6 * sizes[0] for sizes in (budget.scan_noise, budget.drift, budget.sigma))
print(f"in parts per million: one scan {scan:.2g}, drift {drift:.2g} per K, δ of a reading {delta:.2g}")
figure, axes = plt.subplots(2, 1, figsize=(7, 5), layout="constrained")
for ax, kind, label in zip(
    axes, ("noise", "drift"), ("noise of one scan, relative to L", "drift, relative to L (1/K)"), strict=True
):
    sizes = {cause: np.abs(getattr(cause, kind)).max() for cause in budget.causes}
    for cause in sorted((one for one in sizes if sizes[one] > 0), key=sizes.__getitem__):
        ax.barh(
            cause.name,
            sizes[cause],
            color="tab:blue",
            hatch="//" if cause.size == "assumed" else None,
            edgecolor="white",
        )
    ax.set(xscale="log", xlabel=label)
