"""
A proximity sensor
==================

One circular coil, and an aluminium target that comes nearer. Most inductive sensing is of this kind.
"""

import numpy as np

import coilarray as ca
from coilarray.viz import plot_target, target_figure

# %%
# The bundled design ``proximity``; ``coilarray target proximity --plot target.png`` is the same in the terminal.

design = ca.load_design("proximity")
print(design.title)
print(f"{design.target.body.material.name}, {design.target.body.thickness * 1e3:g} mm thick")

# %%
# Eddy currents in the target push the field away: the inductance falls, the losses rise. Thin dotted lines are the
# values without a target.

response = ca.target_map(design)
target_figure(response)

# %%
# How far does it see? δ, the relative change of the inductance, falls off with the distance. The dotted line is
# the noise of the readings; at the farthest distance of this design, 26 mm, δ is still far above it:

plot_target(response, "delta")

# %%
# A small change of the distance is resolved as long as it changes δ by more than the noise. "At least" says that this
# holds at the largest distance that was computed, and perhaps further:

for step, resolved, beyond in zip(
    response.step.values,
    response.resolved_distance.values[:, 0],
    response.resolved_is_least.values[:, 0],
    strict=True,
):
    text = "at no distance" if np.isnan(resolved) else f"up to {resolved * 1e3:.1f} mm{' at least' if beyond else ''}"
    print(f"a step of {step * 1e6:g} µm is resolved {text}")

# %%
# Aluminium or steel
# ------------------
#
# Steel is magnetic, and conducts less: its larger losses distinguish it from aluminium.

for material in ("aluminium", "steel"):
    other = ca.vary(ca.load_design_file("proximity"), {"target.material": material})
    near = ca.target_map(other, distances=[2e-3])
    L, Q = (float(values.squeeze()) for values in (near.effective_inductance, near.quality_factor))
    print(f"{material}: L {L * 1e6:.3f} µH, Q {Q:.1f}")
