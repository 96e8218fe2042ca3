"""Pictures of boards, fields and results, flat and in 3-D.

Every ``plot_…`` draws into the Matplotlib axes `ax`, by default new ones, and returns them. Every
``…_figure`` returns a figure, which its method ``savefig`` writes to a file. Modules of the names
in ``__init__.pyi`` are imported at first use, VTK and Matplotlib only by them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
