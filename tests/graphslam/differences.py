"""Central differences, for checking Jacobians."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np


def central_differences(
    function: Callable[[np.ndarray], np.ndarray], at: np.ndarray, step: float = 1e-6
) -> np.ndarray:
    """Returns the Jacobian (d, n) of ``function`` at the point ``at`` (n,)."""
    columns = []
    for axis in np.eye(len(at)):
        ends = [np.asarray(function(at + sign * step * axis)) for sign in (1.0, -1.0)]
        columns.append((ends[0] - ends[1]) / (2 * step))
    return np.stack(columns, -1)
