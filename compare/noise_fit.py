"""Fitting noise: factors on assumed standard deviations that make what was seen most likely."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from frontend.config import NoiseConfig
from graphslam.geometry import Array, offset_error
from graphslam.measurements import Measurements, Sightings
from graphslam.models.line import LINE

if TYPE_CHECKING:
    from compare.truth import Truth
    from frontend.log import Log

GROUPS = ("rho", "alpha", "wheels", "slip")
"""What has a factor of its own: rho and alpha of line sightings, wheel noise, slip."""

PRIOR = math.log(10.0)
"""Standard deviation of a log factor beforehand: holds what the log does not determine near what
was assumed, and bounds what goes to zero."""
FEWEST = 30
"""Fewest sightings of true lines, and fewest increments, that noise is taken from truth for."""
BLUNDER_SIGMAS = 10.0
"""A sighting further than `frontend.truth` allows from its true line is a blunder, and not counted,
where it is also beyond this multiple of the median-based sigma."""
ENOUGH = 0.03
"""A step that gains less log-likelihood than this, that of a quarter of a sigma, is the last."""

Criterion = Callable[[Array], float]


@dataclass(frozen=True, slots=True)
class NoiseParts:
    """Measurements and the parts of their odometry's covariances.

    Attributes:
        measurements: as they were extracted.
        wheels: (N-1, 3, 3) part of the covariances that wheel noise makes, frame of node i.
        slip: (N-1, 3, 3) part that slip makes.
        rest: (N-1, 3, 3) the numerical floor.
    """

    measurements: Measurements
    wheels: Array
    slip: Array
    rest: Array

    def scaled(self, log_factors: Array) -> Measurements:
        """Returns the measurements with other noise; ``log_factors`` (4,) in order of `GROUPS`."""
        rho, alpha, wheels, slip = np.exp(log_factors)
        m = self.measurements
        cov = wheels**2 * self.wheels + slip**2 * self.slip + self.rest
        sightings = dict(m.sightings)
        if LINE.kind in sightings:
            table = sightings[LINE.kind]
            by = np.outer([rho, alpha], [rho, alpha])
            sightings[LINE.kind] = replace(table, cov=table.cov * by)
        return replace(m, odometry=replace(m.odometry, cov=cov), sightings=sightings)


def noise_parts(log: Log, measurements: Measurements, noise: NoiseConfig) -> NoiseParts:
    """Returns measurements in parts: the odometry's covariances are linear in the variances.

    Args:
        log: the recording.
        measurements: what was extracted from it with ``noise``.
        noise: what was assumed in place of the log's own.
    """
    from frontend.nodes import odometry_at

    still = {"noise_left": 0.0, "noise_right": 0.0}
    none = (0.0, 0.0, 0.0)
    rest = odometry_at(log, measurements.t, replace(noise, **still, slip=none)).cov
    wheels = odometry_at(log, measurements.t, replace(noise, slip=none)).cov - rest
    slip = odometry_at(log, measurements.t, replace(noise, **still)).cov - rest
    return NoiseParts(measurements, wheels, slip, rest)


def fit_factors(unlikely: Criterion, begin: Array) -> tuple[Array, Array]:
    """Returns log factors (4,) that minimise a negative log-likelihood, and their sigmas (4,).

    Args:
        unlikely: the negative log-likelihood of log factors (4,).
        begin: (4,) where to begin.
    """
    from scipy.optimize import minimize

    def cost(x: Array) -> float:
        return unlikely(x) + 0.5 * float(x @ x) / PRIOR**2

    bound = 2.0 * PRIOR
    limits = [(-bound, bound)] * len(GROUPS)
    first = np.clip(begin, -bound, bound)
    options = {"eps": 1e-3, "ftol": ENOUGH / max(1.0, abs(cost(first)))}
    x = minimize(cost, first, method="L-BFGS-B", bounds=limits, options=options).x
    variance = np.diag(np.linalg.pinv(_curvature(cost, x)))
    return x, np.sqrt(np.where(variance > 0.0, np.minimum(variance, PRIOR**2), PRIOR**2))


def _curvature(cost: Criterion, x: Array, step: float = 0.05) -> Array:
    """Returns the matrix of second differences (n, n) of ``cost`` at ``x`` (n,)."""
    n = len(x)
    moves = step * np.eye(n)
    here = cost(x)
    up = np.array([cost(x + move) for move in moves])
    down = np.array([cost(x - move) for move in moves])
    H = np.diag(up + down - 2.0 * here)
    for i in range(n):
        for j in range(i):
            H[i, j] = H[j, i] = cost(x + moves[i] + moves[j]) - up[i] - up[j] + here
    return np.asarray(H / step**2)


# ---- from truth --------------------------------------------------------------------------------


def truth_criterion(parts: NoiseParts, truth: Truth) -> Criterion | None:
    """Returns the negative log-likelihood of all residuals against truth; None for want of it.

    Args:
        parts: the measurements; sightings of no true line do not count, nor do blunders.
        truth: the true path and lines, in one frame, whichever.
    """
    from graphslam.models.odometry import odometry_residual

    m = parts.measurements
    pose, covered = truth.at(m.t)
    moved = np.flatnonzero(covered[:-1] & covered[1:])
    found = [(first, t) for first, t in m.tables() if t.kind == LINE.kind]
    if not found or len(moved) < FEWEST or not len(truth.line_id):
        return None
    first, table = found[0]
    landmark = truth.landmark[first : first + len(table)]
    rows = np.flatnonzero(np.isin(landmark, truth.line_id) & covered[table.node])
    if len(rows) < FEWEST:
        return None
    order = np.argsort(truth.line_id)
    line = truth.lines[order[np.searchsorted(truth.line_id, landmark[rows], sorter=order)]]
    e = LINE.residual(pose[table.node[rows]], line, table.z[rows])[0]
    kept = ~_blunders(e, table.select(rows))
    e, rows = e[kept], rows[kept]
    e_odometry = odometry_residual(pose[moved], pose[moved + 1], m.odometry.increment[moved])[0]

    def unlikely(x: Array) -> float:
        scaled = parts.scaled(x)
        return _unlikelihood(e, scaled.sightings[LINE.kind].cov[rows]) + _unlikelihood(
            e_odometry, scaled.odometry.cov[moved]
        )

    return unlikely


def _blunders(e: Array, table: Sightings) -> NDArray[np.bool_]:
    """Returns which residuals (K, 2) are of no sighting of their line at all."""
    from frontend.truth import LARGEST_OFFSET, LARGEST_TURN

    w = np.abs(e) / np.sqrt(np.diagonal(table.cov, axis1=1, axis2=2))
    outlying = w > BLUNDER_SIGMAS * 1.4826 * np.median(w, axis=0)
    offset = np.abs(offset_error(e, np.nan_to_num(table.extent.mean(axis=1))))
    far = (offset > LARGEST_OFFSET) | (np.abs(e[:, 1]) > LARGEST_TURN)
    return np.asarray(far & outlying.any(axis=1))


def _unlikelihood(e: Array, cov: Array) -> float:
    """Returns -log N(e; 0, cov), summed over residuals (K, d), but for a constant."""
    squares = np.einsum("ki,ki->", e, np.linalg.solve(cov, e[..., None])[..., 0])
    return float(0.5 * np.linalg.slogdet(cov)[1].sum() + 0.5 * squares)
