"""How much of one line map lies where the other map reaches."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull

from graphslam.geometry import Array


class Region:
    """The convex hull of a map's stretches, a little widened."""

    def __init__(self, ends: Array, margin: float) -> None:
        """Takes the ends (M, 2, 2) of a map's stretches and a margin, m, in their frame."""
        corners = margin * np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]])
        points = (ends.reshape(-1, 1, 2) + corners).reshape(-1, 2)
        self._facets = ConvexHull(points).equations

    def length_inside(self, ends: Array) -> float:
        """Returns the total length, m, of segments with ``ends`` (M, 2, 2) inside the region."""
        step = ends[:, 1] - ends[:, 0]
        normal, offset = self._facets[:, :2], self._facets[:, 2]
        at_start = ends[:, 0] @ normal.T + offset
        slope = step @ normal.T
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = -at_start / slope
        low = np.where(slope < 0, crossing, 0.0).max(axis=1, initial=0.0)
        high = np.where(slope > 0, crossing, 1.0).min(axis=1, initial=1.0)
        outside = ((slope == 0) & (at_start > 0)).any(axis=1)
        share = np.where(outside, 0.0, np.clip(high - low, 0.0, 1.0))
        return float(share @ np.hypot(step[:, 0], step[:, 1]))
