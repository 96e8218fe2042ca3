"""Pictures of boards, fields and results.

Scenes in three dimensions, and flat plots. Every ``plot_…`` draws into the Matplotlib axes `ax`, by
default new ones, and returns them. Every ``…_figure`` returns a figure, which its method ``savefig`` writes to a file.

Importing it loads neither VTK nor Matplotlib. The module of a name, as listed in ``__init__.pyi``, is imported when the
name is first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
