"""
Capacitance and self-resonance against the turns
================================================

Each turn adds inductance and lies over another one: the self-resonance falls, while the frequency with the tank
capacitor must stay well below it.
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
figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
left.plot(turns, capacitance, "o-")
left.set(xlabel="turns on each layer", ylabel="capacitance of the winding (pF)")
right.semilogy(turns, own, "o-", label="self-resonance")
right.semilogy(turns, frequency, "o-", label="with the tank")
right.set(xlabel="turns on each layer", ylabel="frequency (MHz)")
right.legend()
