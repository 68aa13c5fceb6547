"""A cloud of weighted poses: moments, effective number, systematic resampling, densest place."""

from __future__ import annotations

import math

import numpy as np

from graphslam.geometry import Array, wrap
from graphslam.measurements import IntArray

KERNEL = 0.5
"""Width of the kernel that redraws an agreed cloud, as a share of the cloud's own."""
HALVINGS = 20
"""Steps of a bisection; the result is good to a millionth."""
CENTRING = 3
"""Rounds in which the densest cell's mean is moved to where its neighbourhood has it."""


def systematic(weight: Array, count: int, offset: float) -> IntArray:
    """Returns the rows (count,) that systematic resampling keeps: one comb over all weights.

    Args:
        weight: (n,) not negative, of any sum above 0.
        count: teeth of the comb.
        offset: of the comb, in teeth, in [0, 1).
    """
    total = np.cumsum(weight)
    comb = (np.arange(count) + offset) / count * total[-1]
    rows: IntArray = np.minimum(np.searchsorted(total, comb, side="right"), len(weight) - 1)
    return rows


def effective_number(log_weight: Array) -> float:
    """Returns 1 / sum w² of normalised weights: as many equal particles say as much."""
    weight = np.exp(log_weight - log_weight.max())
    return float(weight.sum() ** 2 / (weight**2).sum())


class Cloud:
    """Particles with their weights; see `systematic` for how they are drawn anew.

    Attributes:
        pose: (n, 3) floor frame, m and rad.
        log_weight: (n,) up to a constant.
    """

    def __init__(self, pose: Array, rng: np.random.Generator) -> None:
        self.rng = rng
        self.pose, self.log_weight = pose, np.zeros(len(pose))

    def __len__(self) -> int:
        return len(self.pose)

    @property
    def weight(self) -> Array:
        """(n,) weights that sum to 1."""
        weight = np.exp(self.log_weight - self.log_weight.max())
        return np.asarray(weight / weight.sum())

    def moments(self) -> tuple[Array, Array]:
        """Returns the mean pose (3,), its heading on the circle, and the covariance (3, 3)."""
        weight = self.weight
        theta = self.pose[:, 2]
        mean = weight @ self.pose
        mean[2] = math.atan2(weight @ np.sin(theta), weight @ np.cos(theta))
        off = self.deviation(mean)
        return mean, np.asarray((off * weight[:, None]).T @ off)

    def deviation(self, pose: Array) -> Array:
        """Returns the particles minus ``pose`` (3,), headings wrapped."""
        off = self.pose - pose
        off[:, 2] = wrap(off[:, 2])
        return np.asarray(off)

    def resample(self, count: int) -> None:
        """Draws ``count`` particles of equal weight in proportion to the weights."""
        self.pose = self.pose[systematic(self.weight, count, self.rng.random())]
        self.log_weight = np.zeros(count)

    def redraw(self) -> None:
        """Replaces copies by different particles of the same mean and covariance.

        Each moves towards the mean and gets Gaussian noise (Liu and West's kernel). Only for a
        cloud around one place.
        """
        mean, cov = self.moments()
        noise = self.rng.standard_normal(self.pose.shape) @ _root(cov).T
        off = math.sqrt(1.0 - KERNEL**2) * self.deviation(mean) + KERNEL * noise
        self.pose = mean + off
        self.pose[:, 2] = wrap(self.pose[:, 2])

    def spread(self, sigma: Array) -> None:
        """Adds Gaussian noise of standard deviations ``sigma`` (3,), floor frame."""
        self.pose = self.pose + self.rng.standard_normal(self.pose.shape) * sigma
        self.pose[:, 2] = wrap(self.pose[:, 2])

    def largest_step(self, log_p: Array, left: float, few: float) -> float:
        """Returns the largest power of a likelihood that leaves ``few`` particles effective.

        Args:
            log_p: (n,) its logarithm for each particle.
            left: the largest power.
            few: effective number of particles to keep.
        """
        if effective_number(self.log_weight + left * log_p) >= few:
            return left
        low, high = 0.0, left
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            enough = effective_number(self.log_weight + middle * log_p) >= few
            low, high = (middle, high) if enough else (low, middle)
        return high

    def widen(self, factor: float) -> None:
        """Multiplies the cloud's standard deviations."""
        mean, _ = self.moments()
        self.pose = mean + factor * self.deviation(mean)
        self.pose[:, 2] = wrap(self.pose[:, 2])

    def share_at_one_place(self, distance: float, angle: float) -> float:
        """Returns the share of weight near the densest place.

        Args:
            distance: how far off counts as near, m.
            angle: the same for the heading, rad.
        """
        weight = self.weight
        sides = np.array([2.0 * distance, 2.0 * distance, 2.0 * angle])
        cell = np.floor(self.pose / sides).astype(np.int64)
        cell -= cell.min(axis=0)
        name = np.ravel_multi_index(tuple(cell.T), tuple(cell.max(axis=0) + 1))
        names, row = np.unique(name, return_inverse=True)
        near = row == np.argmax(np.bincount(row, weight, len(names)))
        for _ in range(CENTRING):
            part = Cloud(self.pose[near], self.rng)
            part.log_weight = self.log_weight[near]
            off = self.deviation(part.moments()[0])
            near = (np.hypot(off[:, 0], off[:, 1]) < distance) & (np.abs(off[:, 2]) < angle)
            if not near.any():
                return 0.0
        return float(weight[near].sum())


def _root(cov: Array) -> Array:
    """Returns a square root of a covariance that may be singular."""
    strength, axes = np.linalg.eigh(cov)
    return np.asarray(axes * np.sqrt(np.maximum(strength, 0.0)))
