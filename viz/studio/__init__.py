"""Web page with sliders for a design and live results.

It shows the numbers, pictures and positions of the design as the sliders move.

The results of a design are computed by modules without any page: `work`, `entries`, `numbers`, `switching`, `touch`,
`top_view`, `runs`, `shelf`. `page` and the panels show them. `server` serves one session for each open page.

Importing it loads neither trame nor VTK.
"""

from coilarray.viz.studio.services import BoardFrame, BoardRequest, Services

__all__ = ["BoardFrame", "BoardRequest", "Services"]
