"""A loop that closes late: corridors around a block in which no line is seen twice before."""

from __future__ import annotations

import numpy as np

from graphslam.baseline import integrate
from graphslam.geometry import line_to_robot, position_along
from graphslam.measurements import Measurements, Odometry, Sightings

SIDE_M, AFTER_M, STEP_M = 12.0, 14.0, 0.25
SIGHT_M, HALF_M = 0.5, 0.3
SIGMA_STEP, SIGMA_SEEN = np.array([0.004, 0.004, 0.007]), np.array([0.004, 0.006])
DRIFT = np.radians(12.0)


def loop_drive(seed: int, period_m: float | None = None) -> Measurements:
    """Returns measurements of a drive around a block and on, heading off by 12° where it closes.

    Along the way stand pairs of short lines, one across it and one along it, tilted; between them
    nothing is seen.

    Args:
        seed: decides where lines are, how they are tilted, and all noise.
        period_m: all pairs alike and so far apart; None for pairs of random tilts and distances.
    """
    rng = np.random.default_rng(seed)
    ahead, corner = [STEP_M, 0.0, 0.0], [0.0, 0.0, np.pi / 8]
    side = [ahead] * round(SIDE_M / STEP_M) + [corner] * 4
    steps = np.array(side * 4 + [ahead] * round(AFTER_M / STEP_M))
    truth = integrate(np.zeros(3), steps)
    error = SIGMA_STEP * rng.standard_normal(steps.shape)
    error[:, 2] += (DRIFT - error[: len(side) * 4, 2].sum()) / (len(side) * 4)
    lines, middle = _marks(rng, period_m)
    node, z, identity = [], [], []
    for i, pose in enumerate(truth):
        for line in np.flatnonzero(np.hypot(*(middle - pose[:2]).T) < SIGHT_M):
            node.append(i)
            z.append(line_to_robot(lines[line], pose) + SIGMA_SEEN * rng.standard_normal(2))
            identity.append(line)
    here = np.array(
        [
            position_along(v, _seen(middle[k], truth[i]))
            for i, v, k in zip(node, z, identity, strict=True)
        ]
    )
    total = len(node)
    table = Sightings(
        "line",
        np.array(node),
        np.array(z),
        np.broadcast_to(np.diag(SIGMA_SEEN**2), (total, 2, 2)),
        here[:, None] + [-HALF_M, HALF_M],
        np.array(node, float),
        np.ones(total),
        np.array(node),
        np.array(identity),
    )
    odometry = Odometry(steps + error, np.broadcast_to(np.diag(SIGMA_STEP**2), (len(steps), 3, 3)))
    return Measurements(
        np.arange(len(truth), dtype=float),
        np.zeros(3),
        1e-12 * np.eye(3),
        odometry,
        {"line": table},
    )


def _marks(rng: np.random.Generator, period_m: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Returns lines (2 n, 2) and their middles (2 n, 2) around the block."""
    lines, middle = [], []
    for quarter in range(4):
        heading = quarter * np.pi / 2
        corner = SIDE_M * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])[quarter]
        along = np.array([np.cos(heading), np.sin(heading)])
        aside = np.array([-along[1], along[0]])
        at = 1.0
        while at < SIDE_M - 0.9:
            off, tilt = (0.1, 0.3) if period_m else (rng.uniform(-0.2, 0.2), rng.uniform(-0.5, 0.5))
            for centre, alpha in (
                (corner + at * along, heading),
                (corner + at * along + off * aside, heading + np.pi / 2 + tilt),
            ):
                lines.append([centre @ [np.cos(alpha), np.sin(alpha)], alpha])
                middle.append(centre)
            at += period_m or rng.uniform(1.2, 2.2)
    return np.array(lines), np.array(middle)


def _seen(point: np.ndarray, pose: np.ndarray) -> np.ndarray:
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.array([[c, s], [-s, c]]) @ (point - pose[:2])
