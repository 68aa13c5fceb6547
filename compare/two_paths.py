"""Two paths held against each other at common times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from compare.align import rigid_from_points
from compare.arrays import freeze_arrays
from compare.metrics import rms
from compare.two_maps_relation import Relation
from compare.two_maps_sources import Source
from graphslam.geometry import Array, compose, interpolate_poses, wrap

FEWEST_POSES = 3
"""Common times below which paths are not compared."""


@dataclass(frozen=True, slots=True)
class PathDifference:
    """How two paths differ at common times, second minus first.

    Attributes:
        t: (n,) common times: those of the first that the second covers, s.
        difference: (n, 3) in the first's frame, m and rad, heading wrapped; frames tied as the
            maps' are.
        sigma: (n, 3) standard deviations of the first's poses, NaN where unknown.
        sigma_second: (n, 3) of the second's.
        aligned_rms_m: RMS distance after the rigid motion that lays the paths best on each other.
    """

    t: Array
    difference: Array
    sigma: Array
    sigma_second: Array
    aligned_rms_m: float

    def __post_init__(self) -> None:
        freeze_arrays(self)

    @property
    def distance(self) -> Array:
        """(n,) distance of the two positions, m."""
        return np.hypot(self.difference[:, 0], self.difference[:, 1])


def common_times(a: Source, b: Source) -> Array:
    """Returns the times (n,) of the first path that the second covers, s."""
    if not len(a.t) or not len(b.t):
        return np.zeros(0)
    return a.t[(a.t >= b.t[0]) & (a.t <= b.t[-1])]


def path_difference(
    a: Source, b: Source, common: Relation, motion: Array
) -> tuple[PathDifference | None, str]:
    """Returns how two paths differ, or None and the reason.

    Args:
        a: the first, whose frame is kept.
        b: the second.
        common: what they have in common.
        motion: (3,) ``a_T_b`` that ties their frames.
    """
    without = [source.label for source in (a, b) if not len(source.t)]
    if without:
        return None, f"{' and '.join(without)} has no path" if len(without) == 1 else "no paths"
    files = "path file" in (a.what, b.what)
    if not common.same_log and not files:
        return None, "the logs differ, so that their clocks have nothing in common"
    t = common_times(a, b)
    if len(t) < FEWEST_POSES:
        return None, f"{len(t)} common times are too few"
    first = interpolate_poses(t, a.t, a.pose)
    second = compose(motion, interpolate_poses(t, b.t, b.pose))
    if files and not common.same_log:
        second = compose(rigid_from_points(second[:, :2], first[:, :2]), second)
    difference = second - first
    difference[:, 2] = wrap(difference[:, 2])
    best = rigid_from_points(second[:, :2], first[:, :2])
    left = (compose(best, second) - first)[:, :2]
    return (
        PathDifference(
            t, difference, _sigma_at(t, a), _sigma_at(t, b), rms(np.hypot(left[:, 0], left[:, 1]))
        ),
        "",
    )


def _sigma_at(t: Array, source: Source) -> Array:
    """Returns (n, 3) standard deviations of a source's poses at times; NaN where unknown."""
    if source.cov_floor is None:
        return np.full((len(t), 3), np.nan)
    sigma = np.sqrt(np.diagonal(source.cov_floor, axis1=1, axis2=2))
    return np.column_stack([np.interp(t, source.t, column) for column in sigma.T])
