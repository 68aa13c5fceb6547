"""From a recording to measurements: nodes, odometry between them, sightings at them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from frontend.config import ExtractConfig, NoiseConfig
from frontend.log import UNKNOWN_WHEELS, Log
from frontend.truth import true_lines
from graphslam.errors import BadConfig, BadLog
from graphslam.geometry import Array, wrap
from graphslam.measurements import IntArray, Measurements, Odometry, Sightings
from graphslam.models.odometry import (
    DifferentialDrive,
    increments_from_poses,
    increments_from_wheels,
)

Progress = Callable[[int, int], None]

KNOWN_SIGMA = 1e-6
"""Smallest standard deviation of the start, m and rad: known exactly, yet invertible."""

UNREADABLE = "image that cannot be read"
NODE_OUTSIDE = "node outside the wheel record"
LINE_OUTSIDE = "line outside the wheel record"
FIX_OUTSIDE = "pose fix outside the wheel record"

ONE_DIRECTION = np.radians(5.0)  # lines within this angle of each other fix nothing along them


def extract(
    log: Log, config: ExtractConfig | None = None, progress: Progress | None = None
) -> Measurements:
    """Returns what estimators eat.

    Nodes are the distinct times of floor images and of all tables of sightings; without any, of
    the odometry itself. Images are searched for lines in parallel; the result does not depend on
    the number of workers.

    Args:
        log: the recording.
        config: detector, workers, and which part of the log; None for the defaults.
        progress: called with (images done, images in all).

    Raises:
        BadLog: an image has not the size that the log states, or no node lies in the record.
        BadConfig: the chosen part of the log is empty.
    """
    config = config or ExtractConfig()
    rejected: Counter[str] = Counter()
    chosen = _chosen(_node_times(log), log, config)
    t = _recorded(log, chosen, rejected)
    lines = _given_lines(log, chosen, t, rejected)
    if lines is None:
        lines = _seen_lines(log, t, config, rejected, progress)
    tables = (_with_noise(lines, config.noise), _pose_fixes(log, chosen, t, rejected))
    return Measurements(
        t=t,
        start_pose=log.start_pose,
        start_cov=np.diag(np.maximum(log.start_sigma, KNOWN_SIGMA) ** 2),
        odometry=odometry_at(log, t, config.noise),
        sightings={table.kind: table for table in tables if table is not None},
        rejected={reason: count for reason, count in sorted(rejected.items()) if count},
    )


def extraction_warnings(log: Log, measurements: Measurements) -> tuple[str, ...]:
    """Returns what the user should know about measurements extracted from a log."""
    rejected, found = measurements.rejected, []
    lines = measurements.sightings.get("line")
    if UNREADABLE in rejected:
        found.append(
            f"images that could not be read and were left out: {rejected[UNREADABLE]}, first "
            f"{_first_unreadable(log, measurements)}; write them again, or remove their rows from "
            "images.csv"
        )
    used, known, odometry = measurements.t, _odometry_times(log), odometry_file(log)
    if NODE_OUTSIDE in rejected:
        found.append(
            f"nodes outside the wheel record that were dropped: {rejected[NODE_OUTSIDE]}; "
            f"{odometry} lasts from t = {known[0]:.12g} s to {known[-1]:.12g} s: start it before "
            "and stop it after images and sightings"
        )
    first = _node_times(log)[0]
    if log.start_given and used[0] > first:
        found.append(
            f"[start] counts as the pose at t = {used[0]:.12g} s, the first node used, "
            f"though the log begins at t = {first:.12g} s; write that pose into log.toml"
        )
    if lines is not None and not len(lines):
        found.append(
            "no line was seen: only odometry (and pose fixes) remain to estimate from; look at "
            "the picture that `graphslam inspect` writes"
        )
    if lines is not None and len(lines) and _one_direction(measurements, lines):
        found.append(
            "lines of one direction only were seen: the position along them is not observed; "
            "drive where lines cross"
        )
    return tuple(found)


def _first_unreadable(log: Log, measurements: Measurements) -> str:
    """Returns the first image that cannot be read, as images.csv names it."""
    from frontend.images import read_grey

    assert log.images is not None, "only images can be unreadable"
    shown = measurements.sightings["line"].source
    numbers = log.floor_images()
    numbers = numbers[np.isin(log.images.t[numbers], measurements.t) & ~np.isin(numbers, shown)]
    files = (log.images.file[number] for number in numbers)
    root = log.folder.resolve()
    return next(f.relative_to(root).as_posix() for f in files if read_grey(f) is None)


# ---- nodes and odometry -----------------------------------------------------------------------


def _node_times(log: Log) -> Array:
    """Returns the distinct times (N,) of images and sightings; without any, of the odometry."""
    times = [table.t for table in (log.sightings, log.pose_fixes) if table is not None]
    if log.images is not None:
        times.append(log.images.t[log.floor_images()])
    t = np.unique(np.concatenate([np.zeros(0), *times]))
    return t if len(t) else _odometry_times(log)


def odometry_file(log: Log) -> str:
    """Returns the name of the file in a log folder that odometry is taken from."""
    return "wheels.csv" if log.wheels is not None else "odometry.csv"


def _odometry_times(log: Log) -> Array:
    track = log.wheels if log.wheels is not None else log.odometry
    assert track is not None, "a log without odometry cannot be made"
    return track.t


def _chosen(t: Array, log: Log, config: ExtractConfig) -> Array:
    """Returns the part of the node times that the configuration asks for."""
    chosen = t
    if config.from_s is not None:
        chosen = chosen[chosen >= config.from_s]
    if config.to_s is not None:
        chosen = chosen[chosen <= config.to_s]
    chosen = chosen[:: config.every]
    if not len(chosen):
        raise BadConfig(
            f"nothing of {log.name} lies between from_s = {config.from_s} and to_s = "
            f"{config.to_s}; it lasts from t = {t[0]:.12g} s to {t[-1]:.12g} s: choose --from and "
            "--to within"
        )
    return chosen


def _recorded(log: Log, t: Array, rejected: Counter[str]) -> Array:
    """Returns the node times that odometry readings surround."""
    known = _odometry_times(log)
    inside: Array = t[(t >= known[0]) & (t <= known[-1])]
    rejected[NODE_OUTSIDE] += len(t) - len(inside)
    if not len(inside):
        raise BadLog(
            f"{log.folder / odometry_file(log)}: odometry lasts from t = {known[0]:.12g} s to "
            f"{known[-1]:.12g} s, images and sightings from t = {t[0]:.12g} s to {t[-1]:.12g} s; "
            "give both one clock"
        )
    return inside


def assumed_drive(log: Log, noise: NoiseConfig) -> DifferentialDrive:
    """Returns the log's robot with the noise that stands in place of its own."""
    given = {name: getattr(noise, name) for name in ("noise_left", "noise_right", "slip")}
    changed = {name: value for name, value in given.items() if value is not None}
    return replace(log.robot or UNKNOWN_WHEELS, **changed)


def odometry_at(log: Log, t: Array, noise: NoiseConfig) -> Odometry:
    """Returns the odometry between nodes at times (N,), s, increasing, within the wheel record."""
    drive = assumed_drive(log, noise)
    if log.wheels is not None:
        increment, cov = increments_from_wheels(log.wheels.t, log.wheels.angle, t, drive)
        return Odometry(increment, cov, log.wheels.t, log.wheels.angle)
    assert log.odometry is not None, "a log without odometry cannot be made"
    return Odometry(*increments_from_poses(log.odometry.t, log.odometry.pose, t, drive))


# ---- sightings that the log gives -------------------------------------------------------------


def _at_nodes(times: Array, chosen: Array, t: Array) -> tuple[IntArray, IntArray, int]:
    """Returns the rows at nodes, their nodes, and how many were chosen but lie at no node."""
    node = np.minimum(np.searchsorted(t, times), len(t) - 1)
    at_node = t[node] == times
    lost = np.isin(times, chosen) & ~at_node
    return np.flatnonzero(at_node), node[at_node], int(lost.sum())


def _given_lines(log: Log, chosen: Array, t: Array, rejected: Counter[str]) -> Sightings | None:
    given = log.sightings
    if given is None:
        return None
    rows, node, rejected[LINE_OUTSIDE] = _at_nodes(given.t, chosen, t)
    truth = given.truth[rows]
    if not np.any(given.truth >= 0):
        truth = true_lines(log, given.t[rows], given.z[rows], given.extent[rows])
    return _table(
        "line",
        node,
        given.z[rows],
        given.cov[rows],
        given.t_received[rows],
        extent=given.extent[rows],
        truth=truth,
    )


def _with_noise(lines: Sightings | None, noise: NoiseConfig) -> Sightings | None:
    if lines is None or noise.rho_factor == noise.alpha_factor == 1.0:
        return lines
    factors = np.array([noise.rho_factor, noise.alpha_factor])
    return replace(lines, cov=lines.cov * np.outer(factors, factors))


def _pose_fixes(log: Log, chosen: Array, t: Array, rejected: Counter[str]) -> Sightings | None:
    given = log.pose_fixes
    if given is None:
        return None
    rows, node, rejected[FIX_OUTSIDE] = _at_nodes(given.t, chosen, t)
    return _table("pose_fix", node, given.z[rows], given.cov[rows], given.t_received[rows])


def _table(
    kind: str,
    node: IntArray,
    z: Array,
    cov: Array,
    t_received: Array,
    extent: Array | None = None,
    quality: Array | None = None,
    source: IntArray | None = None,
    truth: IntArray | None = None,
) -> Sightings:
    """Returns a table of sightings with 'unknown' in the columns that are not given."""
    count = len(node)
    none = np.full(count, -1, np.int64)
    return Sightings(
        kind,
        node,
        z,
        cov,
        np.full((count, 2), np.nan) if extent is None else extent,
        t_received,
        np.full(count, np.nan) if quality is None else quality,
        none if source is None else source,
        none if truth is None else truth,
    )


def _seen_lines(
    log: Log, t: Array, config: ExtractConfig, rejected: Counter[str], progress: Progress | None
) -> Sightings | None:
    """Returns the lines that the images at the nodes show, ordered by node."""
    from frontend.image_lines import lines_in_images

    numbers = log.floor_images()
    if log.images is None or not len(numbers):
        return None
    numbers = numbers[np.isin(log.images.t[numbers], t)]
    lines, source, unreadable = lines_in_images(log, numbers, config, progress)
    rejected.update({**lines.rejected, UNREADABLE: unreadable})
    times = log.images.t[source]
    return _table(
        "line",
        np.searchsorted(t, times),
        lines.z,
        lines.cov,
        times,
        extent=lines.extent,
        quality=lines.quality,
        source=source,
        truth=true_lines(log, times, lines.z, lines.extent),
    )


def _one_direction(measurements: Measurements, lines: Sightings) -> bool:
    turned = np.concatenate([[0.0], np.cumsum(measurements.odometry.increment[:, 2])])
    return one_direction(lines.z[:, 1] + turned[lines.node])


def one_direction(alpha_floor: Array) -> bool:
    """Returns whether all lines (K,), but a few misread ones, have one direction, modulo pi."""
    double = 2.0 * alpha_floor  # twins have one direction
    main = np.angle(np.mean(np.exp(1j * double)))
    off = np.count_nonzero(np.abs(wrap(double - main)) > 2.0 * ONE_DIRECTION)
    return bool(off <= min(4, len(alpha_floor) // 20))
