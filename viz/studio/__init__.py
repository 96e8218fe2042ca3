"""Web page with sliders for a design and live results.

`server` serves a page for each browser tab. Its panels show one `session`, and know neither the
page nor each other. Importing it loads neither trame nor VTK.
"""

from coilarray.viz.studio.services import BoardFrame, BoardRequest, Services

__all__ = ["BoardFrame", "BoardRequest", "Services"]
