"""
The bell curve moves as a neighbour closes
==========================================

Two coils of the paper's board that overlap by two thirds, k = 0.35. One is measured while the ball passes over both,
and the switch of the other closes: from open to 5 Ω. Its current then pushes the field away, and with it the bell
curve. On the paper's own board, with k = 0.08, the curve moves by less than 1 % of its height.
"""

# %%
# The same as a film:
#
# .. film::
#
#    import matplotlib.pyplot as plt
#    import numpy as np
#    from matplotlib.animation import FuncAnimation, PillowWriter
#
#    import coilarray as ca
#    from coilarray.response.map import respond
#
#    design = ca.vary(ca.load_design("gast2020"), {"array.columns": 2, "array.pitch_mm": 8})
#    x = np.linspace(-30e-3, 22e-3, 105)
#    response = ca.response_map(design, x=x, y=[0.0])
#    ohms = np.geomspace(20e3, 5, 28)
#    plan = [ca.ScanState(f"{R:.2g}", (("coil2", 1),), others="load", load_resistance=R) for R in ohms]
#    delta = respond(design, response, plan=plan).delta[0, 0].values * 1e3
#    figure, ax = plt.subplots(figsize=(8, 4.5), layout="constrained")
#    ax.plot(x * 1e3, delta[:, 0], color="#909090", linestyle=":", label="neighbour open")
#    (curve,) = ax.plot([], [], color="#D55E00", linewidth=2.5, label="neighbour closing")
#    (peak,) = ax.plot([], [], "o", color="#D55E00")
#    for name, centre in (("neighbour", -8), ("measured coil", 0)):
#        ax.plot([centre - 11.5, centre + 11.5], [-0.08 - 0.05 * centre / 8] * 2, linewidth=5, label=name)
#    ax.set(xlabel="x of the ball (mm)", ylabel="δ of the measured coil (10⁻³)", ylim=(-0.2, 1.6))
#    ax.legend(loc="upper left", frameon=False)
#
#    def show(frame):
#        k = min(frame, len(ohms) - 1)  # stays for a while at the end
#        top = delta[:, k].argmax()
#        curve.set_data(x * 1e3, delta[:, k])
#        peak.set_data([x[top] * 1e3], [delta[top, k]])
#        ax.set_title(f"neighbour through {float(f'{ohms[k]:.2g}'):g} Ω: δ at most {delta[top, k]:.2f} · 10⁻³")
#
#    FuncAnimation(figure, show, frames=len(ohms) + 8).save("closing.gif", PillowWriter(fps=8), dpi=90)
#    plt.close(figure)

import matplotlib.pyplot as plt
import numpy as np

import coilarray as ca
from coilarray.response.map import respond

design = ca.vary(ca.load_design("gast2020"), {"array.columns": 2, "array.pitch_mm": 8})
x = np.linspace(-30e-3, 22e-3, 105)
response = ca.response_map(design, x=x, y=[0.0])
ohms = (20e3, 2e3, 1e3, 500, 5)
plan = [ca.ScanState(f"{R:g}", (("coil2", 1),), others="load", load_resistance=R) for R in ohms]
delta = respond(design, response, plan=plan).delta[0, 0].values * 1e3
figure, ax = plt.subplots(figsize=(8, 4.5), layout="constrained")
for k, R in enumerate(ohms):
    top = delta[:, k].argmax()
    colour = plt.get_cmap("viridis")(0.9 * k / (len(ohms) - 1))
    ax.plot(x * 1e3, delta[:, k], color=colour, linewidth=2, label=f"neighbour through {R:g} Ω")
    ax.plot(x[top] * 1e3, delta[top, k], "o", color=colour)
for name, centre in (("neighbour", -8), ("measured coil", 0)):
    ax.plot([centre - 11.5, centre + 11.5], [-0.08 - 0.05 * centre / 8] * 2, linewidth=5, label=name)
ax.set(xlabel="x of the ball (mm)", ylabel="δ of the measured coil (10⁻³)", ylim=(-0.2, 1.6))
ax.legend(loc="upper left", frameon=False)
