"""From a candidate motion between two line maps to where it comes to rest."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from graphslam.geometry import Array, distance_from_line, points_on_line, transform_points, wrap
from graphslam.line_maps.config import AlignmentConfig
from graphslam.line_maps.correspondence import (
    Agreement,
    Pairs,
    Side,
    agreement,
    long_enough,
    middle_jacobian,
    one_to_one,
    pairs_at,
    quality,
)
from graphslam.line_maps.coverage import Region
from graphslam.line_maps.fit import motion_basis, slide_direction
from graphslam.line_maps.line_map import LineMap
from graphslam.line_maps.votes import parallel_pairs
from graphslam.measurements import IntArray

WIDENED = (3.0, 1.5, 1.0, 1.0, 1.0)
"""Factors on the tolerances while a motion settles."""
SOFTENED = (2e-3, 1e-3)
"""Added to each pair's sigmas, m and rad, while it settles, so that no single one decides."""


@dataclass(frozen=True, slots=True)
class Both:
    """Two maps to be laid on each other, prepared.

    Attributes:
        a: the map that stays.
        b: the map that moves.
        side_a: the first, as matching needs it.
        side_b: the second, likewise.
        region_a: where the first reaches, a's frame.
        region_b: where the second reaches, b's frame.
        config: tolerances.
    """

    a: LineMap
    b: LineMap
    side_a: Side
    side_b: Side
    region_a: Region
    region_b: Region
    config: AlignmentConfig

    @staticmethod
    def of(a: LineMap, b: LineMap, config: AlignmentConfig) -> Both:
        """Returns two maps, each with at least one line, prepared."""
        side_a, side_b = Side.of(a), Side.of(b)
        region_a = Region(side_a.ends, config.offset_m)
        region_b = Region(side_b.ends, config.offset_m)
        return Both(a, b, side_a, side_b, region_a, region_b, config)

    def parallel(self, theta: float) -> tuple[IntArray, IntArray]:
        """Returns rows (i, j) of all lines that are parallel, within tolerance, after a turn."""
        return parallel_pairs(theta, self.side_a, self.side_b, self.config)


def settle(
    motion: Array, near: tuple[IntArray, IntArray], both: Both, hopeless: float
) -> tuple[Array, Agreement] | None:
    """Returns where a motion comes to rest and what agrees there.

    None where too few lines do, or where less than ``hopeless`` metres do half way.
    """
    before: IntArray | None = None
    for widened in WIDENED:
        pairs = _candidates(motion, near, widened, both)
        good = quality(pairs, widened)
        good *= long_enough(pairs, both.side_a, both.side_b, both.config)
        taken = one_to_one(pairs, length := good * pairs.overlap)
        if len(taken) < both.config.least or length[taken].sum() < hopeless:
            return None
        motion = _step(motion, pairs.take(taken), good[taken], both)
        now = np.column_stack([pairs.i, pairs.j])[taken]
        if widened == WIDENED[-1] and before is not None and np.array_equal(now, before):
            break
        before = now
    found = agreement_at(motion, near, both)
    return (motion, found) if len(found.matched.i) else None


def _candidates(
    motion: Array, near: tuple[IntArray, IntArray], widened: float, both: Both
) -> Pairs:
    """Returns the parallel pairs that may agree at a motion, tolerances widened."""
    i, j = near
    config, b = both.config, both.side_b
    middle = transform_points(motion, b.middle)
    reach = widened * (config.far_m + 0.5 * math.radians(config.angle_deg) * b.length)
    close = np.abs(distance_from_line(both.side_a.lines[i], middle[j])) <= reach[j]
    return pairs_at(motion, both.side_a, b, i[close], j[close], config)


def agreement_at(motion: Array, near: tuple[IntArray, IntArray], both: Both) -> Agreement:
    """Returns what agrees at a motion, among parallel pairs ``near``."""
    pairs = _candidates(motion, near, 2.0, both)
    return agreement(pairs, both.side_a, both.side_b, both.config)


def agreement_of(motion: Array, matches: IntArray, both: Both) -> Agreement:
    """Returns what lines known to be the same, ``matches`` (K, 2), agree by at a motion."""
    a, b = both.side_a, both.side_b
    pairs = pairs_at(motion, a, b, matches[:, 0], matches[:, 1], both.config)
    agree = float(quality(pairs) @ pairs.overlap)
    return Agreement(pairs, np.zeros((0, 2), np.int64), agree, 0.0)


def _step(motion: Array, pairs: Pairs, weight: Array, both: Both) -> Array:
    """Returns the motion after one step of weighted least squares over matched pairs."""
    a, b = both.side_a, both.side_b
    J_middle = middle_jacobian(pairs.middle)
    J = J_middle @ pairs.J_motion
    J_a = J_middle @ pairs.J_a
    cov = J_a @ a.cov[pairs.i] @ np.swapaxes(J_a, 1, 2)
    cov += J_middle @ b.cov[pairs.j] @ np.swapaxes(J_middle, 1, 2) + np.diag(np.square(SOFTENED))
    centre = transform_points(motion, points_on_line(b.lines[pairs.j], pairs.middle)).mean(axis=0)
    basis = motion_basis(motion, centre, slide_direction(a.lines[pairs.i, 1]))
    J = J @ basis
    weighted = weight[:, None, None] * (np.linalg.inv(cov) @ J)
    information = np.einsum("kij,kil->jl", J, weighted)
    gradient = np.einsum("kij,ki->j", weighted, pairs.at_middle)
    moved = motion - basis @ np.linalg.solve(information, gradient)
    moved[2] = wrap(moved[2])
    return np.asarray(moved)
