"""The Santana papers as printed: a switch for every erratum that changes what a filter gives.

Nothing else uses this package: the rest of the project has the right forms. It is there to see what
each misprint costs (`compare.errata`).
"""

from graphslam.printed.registry import ERRATA, Erratum
from graphslam.printed.run import run_printed

__all__ = ["ERRATA", "Erratum", "run_printed"]
