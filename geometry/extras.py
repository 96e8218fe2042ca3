"""Libraries that only some files need, and that come with an extra of the package."""

from __future__ import annotations

import importlib
import importlib.util
from types import ModuleType

from coilarray.errors import MissingDependencyError


def import_extra(module: str, purpose: str, *, package: str, extra: str) -> ModuleType:
    """Import a module, by its dotted name, of an optional library that `purpose` needs ("STEP files", in the plural).

    MissingDependencyError says how to install it, `package` by the `extra` of coilarray, or why it cannot be loaded.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        if importlib.util.find_spec(module.partition(".")[0]) is None:
            reason = f'is not installed: pip install "coilarray[{extra}]"'
        else:  # an extension module hides what stopped it, even Ctrl-C, behind an ImportError
            cause = error.__cause__ or error
            reason = f"cannot be loaded: {str(cause) or type(cause).__name__}"
        raise MissingDependencyError(f"{purpose} need {package}, which {reason}.") from None
