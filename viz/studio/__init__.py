"""The studio: a web page with sliders for a design, and everything that follows from it as they move.

What follows from a design is computed by modules that know nothing of any page: `work`, `entries`, `numbers`,
`switching`, `touch`, `top_view`, `runs`, `shelf`. The page is put together from them in `page` and the panels, and
`server` serves it: one session with values of its own for each page that is opened.

Importing it loads neither trame nor VTK.
"""

from coilarray.viz.studio.services import BoardFrame, BoardRequest, Services

__all__ = ["BoardFrame", "BoardRequest", "Services"]
