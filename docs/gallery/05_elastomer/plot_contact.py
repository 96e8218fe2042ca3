"""
A ball pressed into two sheets
==============================

Large deformations of two soft sheets on a seat, the upper one magnetic: the faces in section, force and contact.
"""

import coilarray as ca
from coilarray.viz import indentation_figure

setup = ca.load_design("gast2020").indentation
sheets = ca.load_design("gast2020").sheets
pressed = ca.indent(sheets, setup.indenter, [0.25e-3, 0.5e-3, 0.75e-3, 1e-3], base=setup.base)
indentation_figure(pressed, setup.indenter)
