"""
Fitting a design to a measurement
=================================

What a data sheet does not say, a measurement can: here the permeability of the magnetic sheet and its distance from the
coils. The measurement is simulated with other values and with noise, so that the answer is known.
"""

import numpy as np

import coilarray as ca
from coilarray.viz import posterior_figure

# %%
# A "measured" map
# ----------------

design = ca.load_design_file("starter")
truth = ca.vary(design, {"elastomer.1.relative_permeability": 2.2, "elastomer.0.thickness_mm": 2.8})
x, y = np.linspace(-12e-3, 12e-3, 7), np.linspace(-6e-3, 6e-3, 3)
measured = ca.response_map(truth, depths=[0.5e-3], x=x, y=y)
noise = 2e-6
generator = np.random.default_rng(1)
measured["delta"] = measured.delta + noise * generator.standard_normal(measured.delta.shape)

# %%
# The fit
# -------
#
# Unknowns are entries of the design between bounds (``coilarray calibrate DESIGN DATA --unknown KEY=LOW:HIGH``). The
# result should be 2.2 and 2.8 mm, within about two of the standard deviations given after ±:

found = ca.calibrate(
    design, measured, {"elastomer.1.relative_permeability": (1.5, 4.0), "elastomer.0.thickness_mm": (2.0, 4.0)}
)
errors = found.dataset["std"][0].values
for (name, value), error in zip(found.values.items(), errors, strict=True):
    print(f"{name}: {value:.3f} ± {error:.3f}")

# %%
# Each dot is a pair of values that the measurement allows; the histograms show one value at a time. A change of one
# value can be compensated by the other with similar readings, so that the dots form a tilted cloud.

posterior_figure(found.dataset)
