"""A pass of the filter that forgets: no sighting is matched with what was left behind long ago."""

from __future__ import annotations

import numpy as np

from graphslam.config import EkfConfig
from graphslam.ekf import Filter
from graphslam.estimate import Estimate
from graphslam.geometry import Array
from graphslam.late import Arrivals
from graphslam.measurements import IntArray, Measurements
from graphslam.models import MODELS

LOST = "lost: most sightings rejected for several nodes, so that a new map was begun"


def sliding_window(
    measurements: Measurements, config: EkfConfig, window_m: float, anew: bool = False
) -> Estimate:
    """Returns a filter's estimate that matches only with landmarks seen a short way ago.

    What is met again later starts a second landmark: no loop is closed, rightly or wrongly. Known
    landmarks are never left behind. A landmark left behind is in the map as it was known then, its
    covariance with all else is given as zero; the time a node takes does not grow with the log.

    Args:
        measurements: nodes, odometry, sightings.
        config: of the filter.
        window_m: way, m, after which a landmark that was not seen is left behind.
        anew: where the filter is lost it leaves its whole map behind and trusts odometry, instead
            of widening the covariance of its pose until something fits.
    """
    return _WindowFilter(measurements, config, window_m, anew).run()


def way_of(increments: Array) -> Array:
    """Returns the way (N,) from the first node along increments (N-1, 3), m."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(increments[:, 0], increments[:, 1]))])


class _WindowFilter(Filter):
    """The filter, with only recent landmarks in its state."""

    def __init__(
        self, measurements: Measurements, config: EkfConfig, window_m: float, anew: bool
    ) -> None:
        super().__init__(measurements, config, None)
        self.window_m, self.anew = window_m, anew
        self.way = way_of(measurements.odometry.increment)

    def take_node(self, node: int, arrivals: Arrivals, now: int) -> None:
        """Leaves behind what was not seen within the window, then takes the node."""
        free = self.roster.free()
        self.leave(free[self.way[self.roster.last[free]] < self.way[node] - self.window_m])
        super().take_node(node, arrivals, now)

    def widen(self) -> None:
        """Where it is lost: begins a new map, if that is the way.

        A filter that widens its covariance long enough finds some walls that fit, turned by a
        right angle as like as not. Where a map goes on is for whole groups of lines to tell.
        """
        if not self.anew:
            super().widen()
            return
        self.counts[LOST] += 1
        self.rejected_in_a_row = 0
        self.state.add_pose_noise(4.0 * self.config.lost_after * self.last_Q)
        self.leave(self.roster.free())

    def leave(self, rows: IntArray) -> None:
        """Leaves landmarks behind; those that do not count yet are removed."""
        for row in rows.tolist():
            if not self.roster.confirmed[row]:
                self.remove(row)
                continue
            at = int(self.roster.offset[row])
            self.roster.leave(row, self.state)
            self.waiting.close_gap(at, MODELS[self.roster.kinds[row]].dim_landmark)
