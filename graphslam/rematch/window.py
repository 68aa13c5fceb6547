"""A pass of the filter that forgets: no sighting is matched with what was left behind long ago."""

from __future__ import annotations

import numpy as np

from graphslam.config import EkfConfig
from graphslam.ekf import Filter
from graphslam.estimate import Estimate
from graphslam.geometry import Array
from graphslam.measurements import IntArray, Measurements


def sliding_window(measurements: Measurements, config: EkfConfig, window_m: float) -> Estimate:
    """Returns a filter's estimate that matches only with landmarks seen a short way ago.

    What is met again later starts a second landmark: no loop is closed, rightly or wrongly. Known
    landmarks are never left behind.

    Args:
        measurements: nodes, odometry, sightings.
        config: of the filter.
        window_m: way, m, after which a landmark that was not seen is left behind.
    """
    return _WindowFilter(measurements, config, window_m).run()


def way_of(increments: Array) -> Array:
    """Returns the way (N,) from the first node along increments (N-1, 3), m."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(increments[:, 0], increments[:, 1]))])


class _WindowFilter(Filter):
    """The filter, offered only recent landmarks."""

    def __init__(self, measurements: Measurements, config: EkfConfig, window_m: float) -> None:
        super().__init__(measurements, config, None)
        self.window_m = window_m
        self.way = way_of(measurements.odometry.increment)

    def candidates(self, node: int, kind: str) -> IntArray:
        """Returns the landmarks of a kind that were seen within the window."""
        found = super().candidates(node, kind)
        since = self.way[self.roster.last[found]] >= self.way[node] - self.window_m
        recent: IntArray = found[since | (found < self.roster.known)]
        return recent
