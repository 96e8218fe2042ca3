"""
What a fabricator's errors do
=============================

No two boards are alike: etching takes more or less copper away, layers are shifted against each other, dielectrics are
thicker or thinner. ``coilarray tolerance`` says what that does to inductances, couplings and positions.
"""

import tempfile
from pathlib import Path

import xarray as xr

from coilarray.cli.main import main
from coilarray.viz import plot_boards, plot_shares

# %%
# Typical errors come with the package; a file of your own names those of your fabricator. Each error is drawn for a
# whole board or for each layer, as it happens in the making.

result = Path(tempfile.mkdtemp()) / "spread.nc"
main(["tolerance", "starter", "--samples", "16", "--workers", "1", "--out", str(result)])

# %%
# Which error matters most for which result:

spread = xr.load_dataset(result)
plot_shares(spread)

# %%
# The drawn boards themselves:

plot_boards(spread, str(spread.output.values[0]))
