"""A map of lines as arrays: all that is needed to lay it on another."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from graphslam.arrays import frozen
from graphslam.errors import BadMeasurements
from graphslam.estimate import Estimate
from graphslam.geometry import Array, points_on_line, position_along, wrap
from graphslam.measurements import IntArray, LandmarkMap
from graphslam.models.line import LINE

CROSSING_DEG = 20.0
"""Lines that meet at a smaller angle than this tell nothing about where a map ends."""
NOMINAL_M = 1.0
"""Half length of a line of which nothing tells how long it is, m."""


@dataclass(frozen=True, slots=True)
class LineMap:
    """Lines with their joint covariance and the stretches that were seen, in a frame of its own.

    Attributes:
        lines: (M, 2) (rho, alpha), m and rad; need not be canonical.
        cov: (2 M, 2 M) joint covariance of all lines, in their order; may be given as (M, 2, 2)
            where lines are taken as independent. 0 where a line is known exactly.
        extent: (M, 2) stretch of each along itself, m; NaN where unknown.
    """

    lines: Array
    cov: Array
    extent: Array

    def __post_init__(self) -> None:
        lines = frozen("lines", self.lines, (None, 2))
        count = len(lines)
        cov = np.asarray(self.cov, float)
        if cov.ndim == 3:
            cov = block_diagonal(frozen("cov", cov, (count, 2, 2)))
        cov = frozen("cov", cov, (2 * count, 2 * count))
        if count and np.linalg.norm(cov - cov.T) > 1e-9 * np.linalg.norm(cov):
            raise BadMeasurements("cov is not symmetric")
        _check_blocks(diagonal_blocks(cov))
        extent = frozen("extent", self.extent, (count, 2), allow_nan=True)
        if np.any(extent[:, 0] > extent[:, 1]):
            raise BadMeasurements("extent has a stretch that ends before it begins")
        for name, value in (("lines", lines), ("cov", cov), ("extent", extent)):
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.lines)

    @staticmethod
    def exact(lines: Array, extent: Array) -> LineMap:
        """Returns a map without uncertainty: a survey, or a simulation's truth."""
        return LineMap(lines, np.zeros((2 * len(lines), 2 * len(lines))), extent)

    @staticmethod
    def of_landmarks(landmarks: LandmarkMap, cov_joint: Array) -> LineMap:
        """Returns the lines among landmarks.

        Args:
            landmarks: of any kinds.
            cov_joint: (3 + L, 3 + L) covariance of a pose and all landmarks, as in an `Estimate`;
                the pose is marginalised.
        """
        rows, lines = landmarks.of_kind(LINE.kind)
        place = (landmarks.offsets()[rows][:, None] + np.arange(LINE.dim_landmark)).ravel()
        cov = cov_joint[np.ix_(place, place)]
        return LineMap(lines.reshape(-1, 2), 0.5 * (cov + cov.T), landmarks.extent[rows])

    @staticmethod
    def of_estimate(estimate: Estimate) -> LineMap:
        """Returns the lines of an estimate's map, in its order."""
        return LineMap.of_landmarks(estimate.map, estimate.cov_joint)

    def blocks(self) -> Array:
        """Returns the covariance (M, 2, 2) of each line."""
        return diagonal_blocks(self.cov)

    def select(self, rows: IntArray) -> LineMap:
        """Returns the lines that ``rows`` names, in that order."""
        place = (2 * np.asarray(rows)[:, None] + np.arange(2)).ravel()
        return LineMap(self.lines[rows], self.cov[np.ix_(place, place)], self.extent[rows])

    def stretches(self) -> Array:
        """Returns the stretches (M, 2), m, with assumed ones where unknown.

        An unknown stretch reaches as far as the rest of the map does: over all known ends and all
        crossings of lines. Where there are none, it is `NOMINAL_M` to both sides of the foot.
        """
        extent = np.array(self.extent)
        unknown = np.isnan(extent).any(axis=1)
        if not unknown.any():
            return extent
        ends = points_on_line(self.lines[~unknown][:, None], extent[~unknown]).reshape(-1, 2)
        marks = np.concatenate([ends, _crossings(self.lines)])
        for row in np.flatnonzero(unknown):
            s = position_along(self.lines[row], marks) if len(marks) else np.zeros(1)
            middle, half = 0.5 * (s.min() + s.max()), 0.5 * (s.max() - s.min())
            extent[row] = middle + max(half, NOMINAL_M) * np.array([-1.0, 1.0])
        return extent


def diagonal_blocks(cov: Array) -> Array:
    """Returns the covariance (M, 2, 2) of each line from that of all, (2 M, 2 M)."""
    count = len(cov) // 2
    return np.array(np.einsum("iaib->iab", cov.reshape(count, 2, count, 2)))


def _check_blocks(blocks: Array) -> None:
    """Raises BadMeasurements where the covariance of a line has a negative direction."""
    smallest, largest = np.linalg.eigvalsh(blocks).T if len(blocks) else np.zeros((2, 0))
    bad = np.flatnonzero(smallest < -1e-9 * largest)
    if len(bad):
        raise BadMeasurements(f"cov of line {bad[0]} is not positive definite")


def block_diagonal(blocks: Array) -> Array:
    """Returns blocks (M, d, d) as one matrix (M d, M d) with nothing beside them."""
    count, d = blocks.shape[:2]
    out = np.zeros((count, d, count, d))
    out[np.arange(count), :, np.arange(count), :] = blocks
    return out.reshape(count * d, count * d)


def _crossings(lines: Array) -> Array:
    """Returns the points (n, 2) in which lines (M, 2) cross, nearly parallel ones left out."""
    i, j = np.triu_indices(len(lines), 1)
    turn = wrap(lines[j, 1] - lines[i, 1])
    steep = np.abs(np.sin(turn)) > math.sin(math.radians(CROSSING_DEG))
    i, j, turn = i[steep], j[steep], turn[steep]
    s = (lines[j, 0] - lines[i, 0] * np.cos(turn)) / np.sin(turn)
    return points_on_line(lines[i], s)
