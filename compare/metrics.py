"""Errors of a path, and whether covariances are as large as the errors are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from compare.align import line_normals, rigid_from_points
from compare.arrays import freeze_arrays
from compare.truth import Truth
from graphslam.estimate import Estimate
from graphslam.geometry import Array, compose, wrap

FEWEST_POSES = 3
"""True poses below which alignment leaves nothing to judge."""
START_TOLERANCE = 1e-5
"""Truth at the first node equals the start pose up to this, m and rad."""
RANK_TOLERANCE = 1e-6
"""Share of the largest singular value below which a rigid motion changes no line."""


@dataclass(frozen=True, slots=True)
class TrajectoryMetrics:
    """Errors of a path against ground truth.

    Attributes:
        nodes: how many nodes the true path covers; only they are scored.
        nodes_outside: how many it does not cover.
        rmse_m: root mean square position error, true path moved to begin at the start pose, m.
        final_error_m: position error at the last scored node, moved likewise, m.
        heading_rmse_deg: root mean square heading error, moved likewise, degrees.
        aligned_rmse_m: as `rmse_m`, after the one rigid motion that fits all node positions best.
        aligned_final_error_m: as `final_error_m`, after that motion.
        aligned_heading_rmse_deg: as `heading_rmse_deg`, after that motion.
        truth_T_estimate: (3,) that motion, m and rad.
    """

    nodes: int
    nodes_outside: int
    rmse_m: float
    final_error_m: float
    heading_rmse_deg: float
    aligned_rmse_m: float
    aligned_final_error_m: float
    aligned_heading_rmse_deg: float
    truth_T_estimate: Array

    def __post_init__(self) -> None:
        freeze_arrays(self)


def rms(values: Array) -> float:
    """Returns the root mean square of all entries; NaN where there are none."""
    values = np.asarray(values, float)
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def trajectory(estimate: Estimate, truth: Truth) -> TrajectoryMetrics | None:
    """Returns the path's errors, or None where fewer than `FEWEST_POSES` nodes have a true pose.

    The aligned figures are evo's absolute pose error with alignment and without scale. Where all
    positions coincide the motion does not turn (see `rigid_from_points`).
    """
    true_pose, covered = truth.at(estimate.t)
    if np.count_nonzero(covered) < FEWEST_POSES:
        return None
    pose, true_pose = estimate.pose[covered], true_pose[covered]
    motion = rigid_from_points(pose[:, :2], true_pose[:, :2])
    return TrajectoryMetrics(
        int(covered.sum()),
        int(np.sum(~covered)),
        *_path_errors(pose, true_pose, truth.truth_T_start),
        *_path_errors(pose, true_pose, motion),
        motion,
    )


def _path_errors(pose: Array, true_pose: Array, motion: Array) -> tuple[float, float, float]:
    """Returns RMS and last position error (m) and RMS heading error (degrees) of a moved path."""
    moved = compose(motion, pose)
    distance = np.hypot(*(moved - true_pose)[:, :2].T)
    heading = np.degrees(wrap(moved[:, 2] - true_pose[:, 2]))
    return rms(distance), float(distance[-1]), rms(heading)


def pose_nees(estimate: Estimate, truth: Truth, known_start: Array | None) -> float:
    """Returns the mean over nodes 1..N-1 of e' C^-1 e / 3, floor frame, without any alignment.

    1 is right on average over runs, more is overconfident. Nodes that the true path does not cover
    are left out. NaN where it is not defined: the start is not known exactly, the true path does
    not begin there to `START_TOLERANCE`, or a covariance is not positive definite.

    Args:
        estimate: path and covariances.
        truth: the true path.
        known_start: (3,) start pose that the log gives with no uncertainty, or None.
    """
    true_pose, covered = truth.at(estimate.t)
    if known_start is None or not covered[0]:
        return float("nan")
    if np.abs(_difference(true_pose[0], known_start)).max() > START_TOLERANCE:
        return float("nan")
    scored = np.flatnonzero(covered)[1:]
    return mean_nees(
        _difference(estimate.pose[scored], true_pose[scored]), estimate.cov_floor[scored]
    )


def mean_nees(error: Array, cov: Array) -> float:
    """Returns the mean of e' C^-1 e / d over errors (n, d) with covariances (n, d, d).

    NaN for no errors, and where a covariance is not positive definite.
    """
    return float(np.mean(nees(error, cov))) if len(error) else float("nan")


def nees(error: Array, cov: Array) -> Array:
    """Returns e' C^-1 e / d (n,) of errors (n, d) with covariances (n, d, d).

    All are NaN where any covariance is not positive definite.
    """
    try:
        whitened = np.linalg.solve(np.linalg.cholesky(cov), error[..., None])
    except np.linalg.LinAlgError:
        return np.full(len(error), np.nan)
    return np.asarray(np.mean(whitened[..., 0] ** 2, axis=1))


def map_nees(
    difference: Array, true_lines: Array, cov: Array, frame_known: bool = False
) -> tuple[float, int]:
    """Returns the joint NEES per degree of freedom of lines up to a rigid motion, and that number.

    It is the minimum over motions g of (e + J g)' C^-1 (e + J g) / (2 M - rank J), with rows of J
    (cos alpha, sin alpha, 0) and (0, 0, 1): what a choice of frame can explain is no error. 1 is
    right on average over runs.

    Args:
        difference: (M, 2) estimated line minus true line in one frame, twins settled, m and rad.
        true_lines: (M, 2) true lines in that frame; only their angles count.
        cov: (2 M, 2 M) joint covariance of the estimated lines.
        frame_known: whether the frame counts, too: nothing is minimised over.

    Returns:
        NaN and 0 where no degree of freedom is left (one line, or none), or where the covariance
        is not positive definite.
    """
    J = np.zeros((len(true_lines), 2, 3))
    J[:, 0, :2] = line_normals(true_lines)
    J[:, 1, 2] = 1.0
    U, strength, _ = np.linalg.svd(J.reshape(-1, 3), full_matrices=False)
    motions = U[:, strength > RANK_TOLERANCE * strength.max(initial=0.0)]
    motions = motions[:, :0] if frame_known else motions
    freedom = motions.shape[0] - motions.shape[1]
    try:
        root = np.linalg.cholesky(cov)
    except np.linalg.LinAlgError:
        return float("nan"), 0
    if freedom <= 0:
        return float("nan"), 0
    e = np.linalg.solve(root, difference.reshape(-1))
    explained = np.linalg.qr(np.linalg.solve(root, motions))[0]
    left = e - explained @ (explained.T @ e)
    return float(left @ left) / freedom, freedom


def _difference(pose: Array, true_pose: Array) -> Array:
    """Returns pose errors (..., 3), floor frame, with the heading wrapped."""
    error = pose - true_pose
    error[..., 2] = wrap(error[..., 2])
    return np.asarray(error)
