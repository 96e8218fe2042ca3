"""
Response along the row of coils
===============================

δ of every coil over the position of the ball: each coil responds when the ball is near it.
"""

import numpy as np

import coilarray as ca
from coilarray.viz import plot_response_profile

design = ca.load_design("gast2020")
response = ca.response_map(design, x=np.linspace(-40e-3, 40e-3, 81), y=[0.0])
plot_response_profile(response)
