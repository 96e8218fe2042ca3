"""
What makes a reading scatter and drift
======================================

The noise of one scan and the drift per kelvin of the six-coil sensor, cause by cause. Hatched: sizes that no public
source or device has confirmed; `coilarray noise` says where the others are from.
"""

import matplotlib.pyplot as plt
import numpy as np

import coilarray as ca

budget = ca.noise_budget(ca.load_design("gast2020"))
print(f"one scan {budget.scan_noise[0]:.1e}, drift {budget.drift[0]:.1e} per K, δ of a reading {budget.sigma[0]:.1e}")
figure, axes = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
for ax, kind, label in zip(axes, ("noise", "drift"), ("noise of one scan", "drift (1/K)"), strict=True):
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
