"""Walls in a laser's scans, as line sightings in the robot frame."""

from __future__ import annotations

import math
from types import MappingProxyType

import numpy as np

from frontend.config import NoiseConfig
from frontend.detected import NO_LINES, DetectedLines
from frontend.log import Log
from frontend.nodes import odometry_at, odometry_times
from frontend.recorded import Scan
from frontend.search import Found, Progress, gathered
from frontend.wall_config import WallConfig
from frontend.wall_pieces import (
    ALPHA,
    CHI2,
    COV_AA,
    COV_RA,
    COV_RR,
    HIGH,
    LOW,
    POINTS,
    REASONS,
    RHO,
    Limits,
    find_pieces,
)
from graphslam.geometry import Array, is_canonical, transform_points, twin, wrap
from graphslam.measurements import IntArray

SLOW = 1e-3
"""A scan whose robot moves less than this while it turns, m and rad, is taken as of one moment."""


def detect_walls(
    scan: Scan, sensor_pose: Array, config: WallConfig, motion: Array | None = None
) -> DetectedLines:
    """Returns the walls that a scan shows, robot frame at the time of its first beam.

    Args:
        scan: distances by direction.
        sensor_pose: (3,) the laser in the robot frame, m and rad.
        config: thresholds and noise.
        motion: (3,) how the robot moved from the first beam to the last, in its frame at the first,
            m and rad; None where it stood, or the scan takes no time.
    """
    points, beams = _ends(scan, sensor_pose, config, motion)
    rows, counts = find_pieces(points, beams, _limits(config))
    z = np.column_stack([rows[:, RHO], wrap(rows[:, ALPHA])])
    cov = rows[:, [COV_RR, COV_RA, COV_RA, COV_AA]].reshape(-1, 2, 2)
    extent = rows[:, [LOW, HIGH]]
    flip = ~is_canonical(z)
    z[flip], extent[flip] = twin(z[flip]), -extent[flip][:, ::-1]
    cov[flip, 0, 1], cov[flip, 1, 0] = -cov[flip, 0, 1], -cov[flip, 1, 0]
    worst = np.sqrt(rows[:, CHI2] / np.maximum(rows[:, POINTS] - 2.0, 1.0))
    quality = np.clip(1.0 - 0.5 * worst / config.curved, 0.0, 1.0)
    rejected = dict(zip(REASONS, counts.tolist(), strict=True))
    return DetectedLines(z, cov, extent, quality, MappingProxyType(rejected))


def walls_in_scans(
    log: Log,
    numbers: IntArray,
    config: WallConfig,
    progress: Progress | None = None,
) -> Found[DetectedLines]:
    """Returns all walls, scan by scan.

    Args:
        log: with scans.
        numbers: which of the log's scans to search.
        config: thresholds and noise.
        progress: called with (scans done, scans in all).
    """
    walls = (_walls_of(log, number, config) for number in numbers.tolist())
    return gathered(numbers, walls, NO_LINES, progress)


def _walls_of(log: Log, number: int, config: WallConfig) -> DetectedLines | None:
    """Returns the walls that a scan of a log shows; None where it cannot be read."""
    assert log.scans is not None, "only logs with scans are searched"
    scan = log.scans.place[number].scan()
    if scan is None:
        return None
    motion = _motion(log, float(log.scans.t[number]), scan.duration)
    return detect_walls(scan, log.scans.sensor_pose, config, motion)


def _ends(
    scan: Scan, sensor_pose: Array, config: WallConfig, motion: Array | None
) -> tuple[Array, Array]:
    """Returns where beams end (B, 2), NaN without an echo, and their lengths and directions."""
    count = len(scan.ranges)
    direction = scan.angle_min + scan.angle_step * np.arange(count)
    longest = min(scan.range_max, config.max_range_m)
    with np.errstate(invalid="ignore"):
        seen = (scan.ranges > max(scan.range_min, 0.0)) & (scan.ranges < longest)
    length = np.where(seen, scan.ranges, np.nan)
    local = length[:, None] * np.column_stack([np.cos(direction), np.sin(direction)])
    points = transform_points(sensor_pose, local)
    heading = direction + sensor_pose[2]
    if motion is not None and np.max(np.abs(motion)) > SLOW:
        part = np.arange(count) / max(count - 1, 1)
        moved = part[:, None] * motion
        points = transform_points(moved, points)
        heading = heading + moved[:, 2]
    return points, np.column_stack([length, heading])


def _motion(log: Log, t: float, duration: float) -> Array | None:
    """Returns how the robot moved while a scan was taken, as odometry says, or None: no matter."""
    if not duration > 0.0:
        return None
    known = odometry_times(log)
    if t < known[0] or t + duration > known[-1]:
        return None
    moved = odometry_at(log, np.array([t, t + duration]), NoiseConfig())
    return np.asarray(moved.increment[0])


def _limits(config: WallConfig) -> Limits:
    return Limits(
        range_sigma=config.range_sigma_m,
        beam_sigma=math.radians(config.beam_sigma_deg),
        split=config.split_m,
        fewest=config.min_points,
        shortest=config.min_length_m,
        steepest=math.sin(math.radians(config.grazing_deg)),
        straightness=config.straightness_m,
        bent=config.curved,
        vaguest=math.radians(config.vaguest_alpha_deg),
        largest_break=config.max_break_m,
        floor_rho=config.range_bias_m,
        floor_alpha=math.radians(config.direction_floor_deg),
    )
