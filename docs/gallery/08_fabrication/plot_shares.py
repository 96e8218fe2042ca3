"""
Which tolerance matters?
========================

The linearised spread of L and k over the boards of a typical board house, split into the shares of its causes. With
`samples`, whole boards are drawn at random as well.
"""

import coilarray as ca
from coilarray.studies.tolerance import analyse, load_tolerances
from coilarray.viz import plot_shares

quantities = ["inductance_uH[coil1]", "k[coil1,coil2]"]
spread = analyse(ca.load_design("starter"), load_tolerances(), quantities=quantities, samples=0)
for name, nominal, deviation in zip(quantities, spread.nominal.values, spread.linear_deviation.values, strict=True):
    print(f"{name}: {nominal:.4g} ± {deviation:.2g}")
plot_shares(spread)
