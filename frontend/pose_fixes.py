"""Pose fixes at the nodes of a log: those of tags.csv, or of overhead images; and the start."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator

import numpy as np

from frontend.config import ExtractConfig
from frontend.log import Log
from frontend.nodes import Nodes
from frontend.overhead import APART, NO_POSE
from frontend.plausible import BREAKS, CONTRADICTED, TURNED, plausible_fixes
from frontend.search import received
from frontend.sighting_tables import given, table
from graphslam.geometry import Array, compose, inverse
from graphslam.measurements import Measurements, Odometry, Sightings

KIND = "pose_fix"
UNREADABLE = "overhead image that cannot be read"
FIX_OUTSIDE = "pose fix outside the wheel record"
KNOWN_SIGMA = 1e-6
"""Smallest standard deviation of the start, m and rad: known exactly, yet invertible."""
VAGUE_START = np.array([10.0, 10.0, 1.0])
"""Standard deviations, m and rad, of a start that the first fix has to tell."""
LONG_GAP_S = 5.0
"""Times without a fix from this length on are told."""


def pose_fixes(
    log: Log,
    nodes: Nodes,
    odometry: Odometry,
    config: ExtractConfig,
    rejected: Counter[str],
    progress: Callable[[int, int], None] | None,
) -> Sightings | None:
    """Returns the fixes at the nodes, without those that odometry contradicts; None without any.

    Args:
        log: the recording.
        nodes: its moments.
        odometry: between them.
        config: detector, and whether odometry is asked.
        rejected: takes what is left out, by reason.
        progress: called with (images done, images in all).
    """
    fixes, stated = _given(log, nodes, rejected), None
    if fixes is None:
        found = _seen(log, nodes, config, rejected, progress)
        if found is None:
            return None
        fixes, stated = found
    if config.tags.check and len(fixes):
        start = None
        if log.start_given:
            start = log.start_pose, np.diag(np.maximum(log.start_sigma, KNOWN_SIGMA) ** 2)
        kept, counts, breaks = plausible_fixes(odometry, fixes.node, fixes.z, fixes.cov, start)
        rejected.update(counts)
        rejected[BREAKS] += len(breaks)
        fixes = fixes.select(kept)
        stated = None if stated is None else stated[kept]
    if stated is None:
        return fixes
    columns = {name: getattr(fixes, name) for name in ("node", "z", "t_received", "source")}
    return table(KIND, cov=stated, **columns)


def start_of(log: Log, fixes: Sightings | None, odometry: Odometry) -> tuple[Array, Array]:
    """Returns the pose (3,) at the first node and its covariance (3, 3), floor frame.

    Where the log does not say it and there are fixes, these tell: the start is then vague, and
    stands where the first fix and the odometry until then put it, so that nothing is linearised far
    from the truth.
    """
    if log.start_given or fixes is None or not len(fixes):
        return log.start_pose, np.diag(np.maximum(log.start_sigma, KNOWN_SIGMA) ** 2)
    moved = np.zeros(3)
    for step in odometry.increment[: fixes.node[0]]:
        moved = compose(moved, step)
    return compose(fixes.z[0], inverse(moved)), np.diag(VAGUE_START**2)


def fix_warnings(log: Log, measurements: Measurements) -> Iterator[str]:
    """Yields what the user should know about the fixes of a log."""
    fixes, rejected = measurements.sightings.get(KIND), measurements.rejected
    if fixes is None:
        return
    searched = int(np.isin(log.images_of("overhead"), _at(log, measurements)).sum())
    if searched:
        reasons = [f"{reason}: {rejected[reason]}" for reason in NO_POSE if rejected.get(reason)]
        told = f" ({'; '.join(reasons)})" if reasons else ""
        if reasons or not len(fixes):
            yield (
                f"overhead images searched for tags: {searched}, poses used: {len(fixes)}{told}; "
                "where none was seen, odometry goes on alone"
            )
    if 2 * rejected.get(APART, 0) > searched:
        yield from _apart(log)
    for reason in (TURNED, CONTRADICTED, BREAKS):
        if rejected.get(reason):
            yield f"{reason}: {rejected[reason]}"
    if len(fixes):
        yield from _gaps(measurements, fixes)
    if not log.start_given and len(fixes):
        yield (
            "the log has no [start]: the first pose fix places the robot on the floor; write "
            "[start] into log.toml where it is known better"
        )


def _at(log: Log, measurements: Measurements) -> Array:
    """Returns the numbers of the log's images at the nodes."""
    assert log.images is not None or not len(log.images_of("overhead"))
    if log.images is None:
        return np.zeros(0)
    return np.flatnonzero(np.isin(log.images.t, measurements.t))


def _apart(log: Log) -> Iterator[str]:
    for name, eye in log.looking_at("overhead").items():
        yield (
            f"tags that camera {name!r} saw were not {1e3 * eye.tags.distance:.0f} mm apart, as "
            f"{log.described} says; measure front and centre under [cameras.{name}.tags] again, "
            "and the homography, or raise extract.tags.distance_tolerance_m"
        )


def _gaps(measurements: Measurements, fixes: Sightings) -> Iterator[str]:
    """Yields the longest time without a fix, where it is long."""
    t = np.concatenate([measurements.t[:1], measurements.t[fixes.node], measurements.t[-1:]])
    gap = np.diff(t)
    longest = int(np.argmax(gap))
    if gap[longest] >= LONG_GAP_S:
        yield (
            f"no pose fix from t = {t[longest]:.12g} s to t = {t[longest + 1]:.12g} s "
            f"({gap[longest]:.1f} s): the pose of that time rests on what else was seen and on "
            "odometry"
        )


def _given(log: Log, nodes: Nodes, rejected: Counter[str]) -> Sightings | None:
    if log.pose_fixes is None:
        return None
    fixes, rejected[FIX_OUTSIDE] = given(KIND, log.pose_fixes, nodes.chosen, nodes.t)
    return fixes


def _seen(
    log: Log,
    nodes: Nodes,
    config: ExtractConfig,
    rejected: Counter[str],
    progress: Callable[[int, int], None] | None,
) -> tuple[Sightings, Array | None] | None:
    """Returns the fixes that images show, with their noise as measured, and as it is to be stated.

    The latter is None where it is the same; all is None without overhead images.
    """
    numbers = log.images_of("overhead")
    if log.images is None or not len(numbers):
        return None
    from frontend.image_tags import fixes_in_images
    from frontend.tags import tag_covariance

    numbers = numbers[np.isin(log.images.t[numbers], np.intersect1d(nodes.t, nodes.of_lines))]
    found = fixes_in_images(log, numbers, config, progress)
    rejected.update({**found.seen.rejected, UNREADABLE: found.unreadable})
    node = np.searchsorted(nodes.t, log.images.t[found.source])
    z, cov, when = found.seen.z, found.seen.cov, received(log, found.source)
    fixes = table(KIND, node, z, cov, when, source=found.source)
    law = config.tags.sigma_law
    return fixes, None if law == "measured" else tag_covariance(cov, config.tags)
