"""
Two circular loops, compared with Maxwell
=========================================

The mutual inductance of two coaxial circles, approximated by polygons, compared with the closed form with elliptic
integrals. The error falls with the square of the number of sides.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.constants import mu_0
from scipy.special import ellipe, ellipk

import coilarray as ca

a, b, d = 10e-3, 8e-3, 5e-3
m = 4 * a * b / ((a + b) ** 2 + d**2)
exact = mu_0 * np.sqrt(a * b) * ((2 / np.sqrt(m) - np.sqrt(m)) * ellipk(m) - 2 / np.sqrt(m) * ellipe(m))


def circle(radius, height, sides):
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    return ca.Conductor(np.column_stack((radius * np.cos(angle), radius * np.sin(angle), np.full(sides + 1, height))))


sides = np.array([8, 16, 32, 64, 128, 256])
error = [abs(ca.mutual_inductance(circle(a, 0, n), circle(b, d, n)).item() / exact - 1) for n in sides]
figure, ax = plt.subplots(figsize=(6, 4), layout="constrained")
ax.loglog(sides, error, "o", label="polygons")
ax.loglog(sides, error[0] * (sides[0] / sides) ** 2.0, "--", color="grey", label="second order")
ax.set(xlabel="sides", ylabel="relative error of M")
ax.legend()
