"""What a sensor has in view, learned from where its sightings lie."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from graphslam.geometry import Array

DIRECTIONS = 24
FEWEST = 20
"""Sightings before the view is known well enough to expect anything in it."""
SHRINK = 0.9
"""The view is taken so much smaller than what was seen of it, about its middle."""
ENOUGH = 0.5
"""What is in view is expected to be seen from this share of the mean length seen on."""


class FieldOfView:
    """The hull of all stretches seen, in the robot frame, as far as it reaches in each direction.

    A camera's view of the floor is convex, and sightings lie inside it: the hull never shows more
    than the camera does.
    """

    def __init__(self) -> None:
        angle = np.arange(DIRECTIONS) * (2.0 * math.pi / DIRECTIONS)
        self._normal = np.column_stack([np.cos(angle), np.sin(angle)])
        self._reach = np.full(DIRECTIONS, -np.inf)
        self._count, self._length = 0, 0.0

    @property
    def learned(self) -> bool:
        """Whether enough has been seen to expect anything."""
        return self._count >= FEWEST

    def see(self, ends: Array) -> None:
        """Widens the view by stretches with these ends (k, 2, 2), robot frame; NaN is ignored."""
        ends = ends[~np.isnan(ends).any(axis=(1, 2))]
        if len(ends):
            reach = (ends.reshape(-1, 2) @ self._normal.T).max(axis=0)
            self._reach = np.maximum(self._reach, reach)
            self._count += len(ends)
            self._length += float(np.hypot(*(ends[:, 1] - ends[:, 0]).T).sum())

    def shows(self, ends: Array) -> Array:
        """Returns which stretches with these ends (M, 2, 2), robot frame, should be seen (M,).

        None before enough has been seen, and none whose ends are NaN.
        """
        if not self.learned:
            return np.zeros(len(ends), bool)
        opposite = np.roll(self._reach, DIRECTIONS // 2)
        middle, half = 0.5 * (self._reach - opposite), 0.5 * (self._reach + opposite)
        length = _length_inside(ends, self._normal, middle + SHRINK * half)
        return np.asarray(length >= ENOUGH * self._length / self._count)


@njit(cache=True)
def _length_inside(ends, normal, reach):  # type: ignore[no-untyped-def]
    """Returns how much (M,) of segments lies where ``normal @ p <= reach`` throughout; 0 for NaN.

    Args:
        ends: (M, 2, 2) segments.
        normal: (n, 2) unit vectors.
        reach: (n,) bounds, m.
    """
    out = np.zeros(len(ends))
    for m in range(len(ends)):
        x, y = ends[m, 0, 0], ends[m, 0, 1]
        dx, dy = ends[m, 1, 0] - x, ends[m, 1, 1] - y
        low, high = 0.0, 1.0
        for k in range(len(normal)):
            start = normal[k, 0] * x + normal[k, 1] * y - reach[k]
            slope = normal[k, 0] * dx + normal[k, 1] * dy
            if slope > 0.0:
                high = min(high, -start / slope)
            elif slope < 0.0:
                low = max(low, -start / slope)
            elif not start <= 0.0:
                high = -1.0
        if high > low:
            out[m] = (high - low) * math.hypot(dx, dy)
    return out
