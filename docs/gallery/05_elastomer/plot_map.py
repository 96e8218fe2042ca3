"""
Response of a coil to an indentation
====================================

δ, the relative change of the inductance that the converter sees, over the position of a ball pressed in 1 mm deep.
"""

import numpy as np

import coilarray as ca
from coilarray.viz import plot_response

design = ca.load_design("gast2020")
response = ca.response_map(design, x=np.linspace(-26e-3, 26e-3, 27), y=np.linspace(-10e-3, 10e-3, 11))
plot_response(response, "coil2")
