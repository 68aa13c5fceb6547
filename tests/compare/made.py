"""Logs and estimates made to measure: what a comparison is given, with known errors."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from frontend.camera import Camera
from frontend.log import Log
from frontend.log_parts import ImageList, PoseTrack, Wheels
from graphslam.estimate import Estimate
from graphslam.geometry import (
    compose,
    line_to_floor,
    points_on_line,
    position_along,
    transform_points,
)
from graphslam.landmarks import finish_map
from graphslam.measurements import LandmarkMap, Measurements
from graphslam.models.line import LINE
from graphslam.models.wheels import DifferentialDrive


def true_map(lines: np.ndarray, extent: np.ndarray | None = None) -> LandmarkMap:
    """Returns a map of true lines with identities 0, 1, ..."""
    count = len(lines)
    extent = np.full((count, 2), np.nan) if extent is None else extent
    return LandmarkMap(np.arange(count), ("line",) * count, lines, extent, np.zeros(count, int))


def log_with(
    t: np.ndarray,
    truth: np.ndarray | None,
    lines: np.ndarray | None,
    camera: Camera | None = None,
    frames: np.ndarray | None = None,
    extent: np.ndarray | None = None,
) -> Log:
    """Returns a log that starts, exactly known, where its truth does."""
    images = None
    if frames is not None:
        assert camera is not None
        names = tuple(Path(f"{i}.png") for i in range(len(frames)))
        images = ImageList(frames, names, (camera.name,) * len(frames))
    return Log(
        name="made",
        folder=Path(),
        robot=DifferentialDrive(0.042, 0.042, 0.2),
        cameras={} if camera is None else {camera.name: camera},
        start_pose=np.zeros(3) if truth is None else truth[0],
        start_sigma=np.zeros(3),
        start_given=truth is not None,
        wheels=Wheels(t, np.zeros((len(t), 2))),
        odometry=None,
        images=images,
        sightings=None,
        pose_fixes=None,
        truth=None if truth is None else PoseTrack(t, truth),
        map=None if lines is None else true_map(lines, extent),
        warnings=(),
        digest="",
    )


def estimate_of(
    measurements: Measurements,
    pose: np.ndarray,
    lines: np.ndarray,
    match: np.ndarray,
    cov_joint: np.ndarray | None = None,
    method: str = "made",
    causal: bool = False,
) -> Estimate:
    """Returns an estimate with this path and map; covariances are small and round by default."""
    size = 3 + 2 * len(lines)
    cov_joint = 1e-4 * np.eye(size) if cov_joint is None else cov_joint
    kinds = ["line"] * len(lines)
    landmarks, joint = finish_map(measurements, pose, kinds, lines, match, cov_joint)
    return Estimate(
        method=method,
        causal=causal,
        t=measurements.t,
        pose=pose,
        cov_floor=np.broadcast_to(1e-4 * np.eye(3), (len(pose), 3, 3)),
        map=landmarks,
        cov_joint=joint,
        match=match,
        used=match >= 0,
        nis=np.where(match >= 0, 2.0, np.nan),
        weight=np.ones(len(match)),
    )


def moved(estimate: Estimate, motion: np.ndarray) -> Estimate:
    """Returns path and map after a rigid motion; covariances stay as they are."""
    landmarks = estimate.map
    lines = line_to_floor(landmarks.params, motion)
    ends = transform_points(motion, points_on_line(landmarks.params[:, None], landmarks.extent))
    stretch = position_along(lines[:, None], ends)
    lines, stretch, _ = LINE.canonical(lines, stretch)
    return replace(
        estimate,
        pose=compose(motion, estimate.pose),
        map=replace(landmarks, params=lines, extent=stretch),
    )


def relabelled(measurements: Measurements, truth: np.ndarray) -> Measurements:
    """Returns the measurements with other true identities of their line sightings."""
    table = measurements.sightings["line"]
    return replace(measurements, sightings={"line": replace(table, truth=truth)})
