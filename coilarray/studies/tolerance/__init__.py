"""Effect of fabrication errors on coils and located positions."""

from coilarray.studies.tolerance.analysis import analyse, check_analysis
from coilarray.studies.tolerance.tolerances import Spread, Tolerances, load_tolerances, typical_text

__all__ = ["Spread", "Tolerances", "analyse", "check_analysis", "load_tolerances", "typical_text"]
