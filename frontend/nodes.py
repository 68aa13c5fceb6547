"""The moments whose poses are estimated, and the odometry between them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from frontend.config import ExtractConfig, NoiseConfig
from frontend.log import UNKNOWN_WHEELS, Log
from graphslam.errors import BadConfig, BadLog
from graphslam.geometry import Array
from graphslam.measurements import Odometry
from graphslam.models.odometry import process_covariance
from graphslam.models.wheels import DifferentialDrive, increments_from_poses, increments_from_wheels


@dataclass(frozen=True, slots=True)
class Nodes:
    """Which moments of a log are used.

    Attributes:
        t: (N,) times of the nodes, s, increasing, within the odometry.
        chosen: (C,) the same with those that the odometry does not reach.
        of_lines: (L,) which of ``chosen`` are times of images, of sightings.csv or of scans, after
            ``every``.
    """

    t: Array
    chosen: Array
    of_lines: Array


def choose_nodes(log: Log, config: ExtractConfig) -> Nodes:
    """Returns the nodes of a log, or of the part that is asked for.

    They are the distinct times of images and of sightings.csv, without these of the laser's
    scans, every n-th of them, and those of all other tables of sightings; without any of these, the
    times of the odometry, every n-th.

    Raises:
        BadConfig: the part that is asked for is empty.
        BadLog: no node lies within the time of the odometry.
    """
    main, others = (_within(times, config) for times in line_times(log))
    of_lines = main[:: config.every]
    chosen = np.union1d(of_lines, others)
    if not len(chosen):
        t = np.union1d(*line_times(log))
        raise BadConfig(
            f"nothing of {log.name} lies between from_s = {config.from_s} and to_s = "
            f"{config.to_s}; it lasts from t = {t[0]:.12g} s to {t[-1]:.12g} s: choose --from and "
            "--to within"
        )
    known = odometry_times(log)
    inside = chosen[(chosen >= known[0]) & (chosen <= known[-1])]
    if not len(inside):
        raise BadLog(
            f"{log.where(odometry_part(log))}: odometry lasts from t = {known[0]:.12g} s to "
            f"{known[-1]:.12g} s, images and sightings from t = {chosen[0]:.12g} s to "
            f"{chosen[-1]:.12g} s; give both one clock"
        )
    return Nodes(inside, chosen, of_lines)


def line_times(log: Log) -> tuple[Array, Array]:
    """Returns the distinct times (s) that ``every`` thins, and those of all other sightings.

    The first are of images and sightings.csv, without these of the laser's scans, and in a log
    without any sighting of the odometry.
    """
    seen = [np.zeros(0)]
    if log.images is not None:
        seen.append(log.images.t[log.searched_images()])
    if log.sightings is not None:
        seen.append(log.sightings.t)
    if log.scans is not None and not any(map(len, seen)):
        seen.append(log.scans.t)
    main = np.unique(np.concatenate(seen))
    parts = [part.t for part in (log.pose_fixes, log.bearings, log.lamps) if part is not None]
    others = np.unique(np.concatenate([np.zeros(0), *parts]))
    if not len(main) and not len(others):
        main = odometry_times(log)
    return main, others


def _within(t: Array, config: ExtractConfig) -> Array:
    first = -np.inf if config.from_s is None else config.from_s
    last = np.inf if config.to_s is None else config.to_s
    return t[(t >= first) & (t <= last)]


def odometry_part(log: Log) -> str:
    """Returns the part of a log that odometry is taken from: "wheels" or "odometry"."""
    return "wheels" if log.wheels is not None else "odometry"


def odometry_label(log: Log) -> str:
    """Returns what messages call the part of a log that odometry is taken from."""
    return log.labels[odometry_part(log)]


def odometry_times(log: Log) -> Array:
    """Returns the times (W,) of the odometry's readings, s."""
    track = log.wheels if log.wheels is not None else log.odometry
    assert track is not None, "a log without odometry cannot be made"
    return track.t


def assumed_drive(log: Log, noise: NoiseConfig) -> DifferentialDrive:
    """Returns the log's robot with the noise that stands in place of its own."""
    given = {name: getattr(noise, name) for name in ("noise_left", "noise_right", "slip")}
    changed = {name: value for name, value in given.items() if value is not None}
    return replace(log.robot or UNKNOWN_WHEELS, **changed)


def velocities(t: Array, odometry: Odometry) -> Array:
    """Returns the velocity (N, 3) at nodes by odometry, ``(v_x, v_y, omega)``, robot frame.

    The mean of the motions before and after each node; m/s and rad/s, 0 of a single node.
    """
    rate = odometry.increment / np.diff(t)[:, None]
    c, s = np.cos(odometry.increment[:, 2]), np.sin(odometry.increment[:, 2])
    before = np.column_stack(
        [c * rate[:, 0] + s * rate[:, 1], -s * rate[:, 0] + c * rate[:, 1], rate[:, 2]]
    )
    total, count = np.zeros((len(t), 3)), np.zeros((len(t), 1))
    total[:-1] += rate
    total[1:] += before
    count[:-1] += 1
    count[1:] += 1
    return total / np.maximum(count, 1)


def odometry_at(log: Log, t: Array, noise: NoiseConfig) -> Odometry:
    """Returns the odometry between nodes at times (N,), s, increasing, within the wheel record."""
    drive = assumed_drive(log, noise)
    wheels = log.wheels
    if wheels is not None:
        increment, cov = increments_from_wheels(wheels.t, wheels.angle, t, drive)
        radii = np.array([drive.wheel_radius_left, drive.wheel_radius_right])
        metres = _between_nodes(wheels.t, np.diff(wheels.angle @ radii / 2.0), t)
    else:
        assert log.odometry is not None, "a log without odometry cannot be made"
        increment, cov = increments_from_poses(log.odometry.t, log.odometry.pose, t, drive)
        steps = np.hypot(*np.diff(log.odometry.pose[:, :2], axis=0).T)
        metres = _between_nodes(log.odometry.t, steps, t)
    if noise.process_mps is not None:
        cov = process_covariance(np.diff(t), noise.process_mps)
    if wheels is None:
        return Odometry(increment, cov, metres=metres)
    return Odometry(increment, cov, wheels.t, wheels.angle, metres)


def _between_nodes(reading_t: Array, step: Array, t: Array) -> Array:
    """Returns the metres (N-1,) driven between nodes, of steps (W-1,) between readings (W,)."""
    driven = np.concatenate([[0.0], np.cumsum(np.abs(step))])
    return np.asarray(np.diff(np.interp(t, reading_t, driven)))
