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
# Typical errors come with the package; a file of your own names those of your fabricator. An error has a part that all
# layers of a board share, and one that each layer has for itself. The first table lists the errors, with the standard
# deviations σ of both parts. The second lists the results, computed in two ways: from slopes, as if small errors had
# proportional effects ("linear"), and from 16 boards with errors drawn at random ("drawn").

result = Path(tempfile.mkdtemp()) / "spread.nc"
main(["tolerance", "starter", "--samples", "16", "--workers", "1", "--out", str(result)])

# %%
# Which error matters most for which result, as shares of its variance:

spread = xr.load_dataset(result)
plot_shares(spread)

# %%
# The drawn boards themselves, beside the normal distribution that the slopes predict. ``worst_k`` is the largest
# coupling of all pairs: where an error lowers the coupling of one pair, another pair has the largest, so that most
# boards lie above the prediction.

plot_boards(spread, str(spread.output.values[0]))
