"""Odometry that drifts: what is wrong with it systematically, and how much it errs besides.

Four numbers turn increments of someone else's odometry into those of the sensor: a scale of
distances, a scale of turns, a curvature (turn for each metre), and how far before the centre of
turning the sensor sits. They and the noise are fitted to a path that the sensor determined.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from graphslam.geometry import Array, between, rotation, wrap

NAMES = ("distance scale", "turn scale", "curvature, rad/m", "centre of turning to sensor, m")
FLOOR = 3e-4
"""Standard deviation of an increment that odometry says is none, m and rad."""
TURN_M = 0.5
"""Metres that turning by one radian counts as, where increments are weighted for the fit."""
OUTLIER = 4.0
"""Standard deviations beyond which an increment takes no part in the fit."""
TAIL, TAIL_SIGMAS = 0.99, 2.576
"""The noise is widened until this share of residuals lies where a Gaussian has it: wheels that bump
and slip make tails, and a gate has to hold there."""


@dataclass(frozen=True, slots=True)
class Drift:
    """What is wrong with odometry.

    Attributes:
        values: (4,) in the order of `NAMES`; 1, 1, 0, 0 where nothing is.
        sigma: (4,) their standard deviations.
        rates: (3, 2) noise along x, y (m) and of the heading (rad): for the square root of a metre
            driven, and for the square root of a radian turned; their squares add up.
    """

    values: Array
    sigma: Array
    rates: Array


UNKNOWN = Drift(
    np.array([1.0, 1.0, 0.0, 0.0]),
    np.full(4, np.inf),
    np.array([[0.05, 0.02], [0.05, 0.02], [0.10, 0.05]]),
)
"""Before anything is known: odometry as it is, with noise that leaves room for its drift."""


def corrected(increment: Array, drift: Drift) -> tuple[Array, Array]:
    """Returns increments (n, 3) of the sensor, and their covariances (n, 3, 3), frame of node i.

    Args:
        increment: (n, 3) of odometry, m and rad.
        drift: what is wrong with it.
    """
    scale, _, _, before = drift.values
    driven, turned = _way(increment)
    turn = _turn(increment, drift.values)
    xy = scale * _along(increment, turn)
    out = np.column_stack(
        [
            xy[:, 0] + before * (np.cos(turn) - 1.0),
            xy[:, 1] + before * np.sin(turn),
            wrap(turn),
        ]
    )
    size = np.abs(np.column_stack([driven, turned]))
    variance = size @ (drift.rates**2).T + FLOOR**2
    return out, variance[:, :, None] * np.eye(3)


def fit_drift(increment: Array, pose: Array) -> Drift:
    """Returns the drift that explains a path best, by least squares without outliers.

    Args:
        increment: (n, 3) of odometry, m and rad.
        pose: (n + 1, 3) path that the sensor determined.
    """
    seen = between(pose[:-1], pose[1:])
    driven, turned = _way(increment)
    size = np.abs(driven) + TURN_M * np.abs(turned)
    weight = np.where(size > 1e-3, 1.0 / np.sqrt(size + 1e-3), 0.0)
    extra = np.asarray(wrap(seen[:, 2] - turned))
    of_turn, sigma_turn = _robust(np.column_stack([turned, driven]), extra, weight)
    values = np.array([1.0, 1.0 + of_turn[0], of_turn[1], 0.0])
    turn = _turn(increment, values)
    xy = _along(increment, turn)
    A = np.concatenate(
        [np.column_stack([xy[:, 0], np.cos(turn) - 1.0]), np.column_stack([xy[:, 1], np.sin(turn)])]
    )
    of_way, sigma_way = _robust(A, np.concatenate([seen[:, 0], seen[:, 1]]), np.tile(weight, 2))
    values[[0, 3]] = of_way
    sigma = np.array([sigma_way[0], *sigma_turn, sigma_way[1]])
    plain = Drift(values, sigma, np.zeros((3, 2)))
    left = seen - corrected(increment, plain)[0]
    left[:, 2] = wrap(left[:, 2])
    return Drift(values, sigma, _noise(np.abs(np.column_stack([driven, turned])), left))


def _way(increment: Array) -> tuple[Array, Array]:
    """Returns metres driven, negative backwards, and radians turned, of each increment."""
    sign = np.where(increment[:, 0] < 0, -1.0, 1.0)
    return sign * np.hypot(increment[:, 0], increment[:, 1]), np.asarray(wrap(increment[:, 2]))


def _turn(increment: Array, values: Array) -> Array:
    driven, turned = _way(increment)
    return np.asarray(values[1] * turned + values[2] * driven)


def _along(increment: Array, turn: Array) -> Array:
    """Returns shifts (n, 2) of increments with another turn: a chord turns by half of it."""
    half = 0.5 * wrap(turn - increment[:, 2])
    return np.asarray(np.einsum("nij,nj->ni", rotation(half), increment[:, :2]))


def _robust(A: Array, y: Array, weight: Array) -> tuple[Array, Array]:
    """Returns the weighted least-squares solution (p,) without outliers, and its sigmas (p,)."""
    keep = weight > 0
    x: Array = np.zeros(A.shape[1])
    cov: Array = np.zeros((A.shape[1], A.shape[1]))
    for _ in range(10):
        B = A[keep] * weight[keep, None]
        information = B.T @ B + 1e-12 * np.eye(A.shape[1])
        x = np.asarray(np.linalg.solve(information, B.T @ (y[keep] * weight[keep])), float)
        left = np.abs((y - A @ x) * weight)
        scale = 1.4826 * float(np.median(left[weight > 0])) + 1e-12
        cov = np.linalg.inv(information) * np.mean(left[keep] ** 2)
        keep = (weight > 0) & (left <= OUTLIER * scale)
    return x, np.sqrt(np.diag(cov))


def _noise(size: Array, left: Array) -> Array:
    """Returns rates (3, 2) from ways (n, 2) and residuals (n, 3)."""
    rates = np.zeros((3, 2))
    moved = size.sum(axis=1) > 1e-3
    B, scale = size[moved], size[moved].sum(axis=1) + 1e-3
    for axis in range(3):
        square = left[moved, axis] ** 2
        limit = np.full(len(square), np.inf)
        found = np.zeros(2)
        for _ in range(5):
            found = nnls(B / scale[:, None], np.minimum(square, limit) / scale)[0]
            limit = OUTLIER**2 * (B @ found + FLOOR**2)
        share = np.sqrt(square / (B @ found + FLOOR**2))
        rates[axis] = np.sqrt(found) * max(1.0, float(np.quantile(share, TAIL)) / TAIL_SIGMAS)
    return rates
