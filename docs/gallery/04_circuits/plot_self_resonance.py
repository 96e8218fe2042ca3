"""
Capacitance and self-resonance against the turns
================================================

With each turn the inductance and the capacitance of the winding rise, so that the self-resonance falls. The frequency
with the tank capacitor must stay well below it.
"""

import matplotlib.pyplot as plt

import coilarray as ca

turns = [4, 6, 8, 10, 12]
frequency, own, capacitance = [], [], []
for count in turns:
    scan = ca.scan_design(ca.vary(ca.load_design("starter"), {"coils.hexagon.turns_per_layer": count}))
    frequency.append(float(scan.frequency[0]) / 1e6)
    own.append(float(scan.state_self_resonance[0]) / 1e6)
    capacitance.append(float(scan.bare_winding_capacitance[0]) * 1e12)
figure, (above, below) = plt.subplots(2, 1, figsize=(7, 6), sharex=True, layout="constrained")
above.plot(turns, capacitance, "o-")
above.set(ylabel="capacitance of the winding (pF)")
below.plot(turns, own, "o-", label="self-resonance")
below.plot(turns, frequency, "o-", label="with the tank")
below.set(xlabel="turns on each layer", ylabel="frequency (MHz)", ylim=(0, None))
below.legend()
