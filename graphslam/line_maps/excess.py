"""How large an error beyond the covariances would explain what two maps differ by."""

from __future__ import annotations

import math

import numpy as np
import scipy.optimize

from graphslam.geometry import Array
from graphslam.line_maps.correspondence import middle_jacobian
from graphslam.line_maps.fit import Fit, chi_square
from graphslam.line_maps.line_map import block_diagonal

SHORTEST_M = 0.1
"""Common stretches count as at least this long, m: errors at the ends turn a short line a lot."""
SMALLEST_M, LARGEST_M = 1e-7, 1e2
"""Between these the error is sought, m."""


def excess(fit: Fit, common: Array) -> float:
    """Returns the standard deviation, m, of the further error that would explain a fit's residual.

    It is the error across each line, independent at either end of the stretch that both maps have,
    with which chi-square is as large as its degrees of freedom; 0 where it is no larger without.

    Args:
        fit: of K matched lines.
        common: (K, 2) the stretches, along the second map's lines, m.
    """
    s = common.mean(axis=1)
    half = 0.5 * np.maximum(common[:, 1] - common[:, 0], SHORTEST_M)
    at_middle = np.zeros((len(s), 2, 2))
    at_middle[:, 0, 0], at_middle[:, 1, 1] = 0.5, 0.5 / half**2
    back = np.linalg.inv(middle_jacobian(s))
    unit = block_diagonal(back @ at_middle @ np.swapaxes(back, 1, 2))
    e, cov = fit.residual.ravel(), fit.cov_a + fit.cov_b

    def beyond(log_sigma: float) -> float:
        return chi_square(e, fit.J, cov + math.exp(2.0 * log_sigma) * unit) - fit.freedom

    low, high = math.log(SMALLEST_M), math.log(LARGEST_M)
    if beyond(low) <= 0.0:
        return 0.0
    return math.exp(float(scipy.optimize.brentq(beyond, low, high, xtol=1e-6)))
