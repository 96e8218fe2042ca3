"""
The paper's ellipses
====================

Curves of equal δ of three coils are nearly ellipses; their fits give the position in the paper of Gast and Zimmermann.
"""

import numpy as np

import coilarray as ca
from coilarray.paper.ellipse import fit_ellipses
from coilarray.paper.ellipse_model import ellipse_model
from coilarray.viz import ellipse_parameter_figure

design = ca.load_design("gast2020")
response = ca.response_map(design, x=np.linspace(-26e-3, 26e-3, 27), y=np.linspace(-6e-3, 6e-3, 7))
fits = fit_ellipses(response)
ellipse_parameter_figure(fits, ellipse_model(fits))
