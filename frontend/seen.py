"""What images and scans show at the nodes: each sort of sensor's search, as tables of sightings."""

from __future__ import annotations

from collections import Counter

import numpy as np

from frontend.config import ExtractConfig
from frontend.detected import DetectedLines
from frontend.log import Log
from frontend.nodes import Nodes, velocities
from frontend.search import Found, Progress, received
from frontend.sighting_tables import table
from frontend.truth import true_lamps, true_lines, true_points
from graphslam.geometry import Array
from graphslam.measurements import IntArray, Odometry, Sightings

UNREADABLE = "image that cannot be read"
UNREADABLE_OMNI = "omnidirectional image that cannot be read"
UNREADABLE_CEILING = "image of the ceiling that cannot be read"
UNREADABLE_SCAN = "scan that cannot be read"
SAME_TIME = "scan of the same time as the one before it"


def seen_bearings(
    log: Log, nodes: Nodes, config: ExtractConfig, rejected: Counter[str], progress: Progress | None
) -> Sightings | None:
    """Returns the directions of landmarks that images at the nodes show, ordered by node."""
    from frontend.image_cones import bearings_in_images

    numbers = _at_nodes(log, "omni", nodes)
    if numbers is None:
        return None
    found = bearings_in_images(log, numbers, config, progress)
    rejected.update({**found.seen.rejected, UNREADABLE_OMNI: found.unreadable})
    seen, times = found.seen, _times(log)[found.source]
    return table(
        "bearing",
        np.searchsorted(nodes.t, times),
        seen.z,
        seen.cov,
        received(log, found.source),
        quality=seen.area,
        source=found.source,
        truth=true_points(log, times, seen.z[:, 0], seen.label),
        label=seen.label,
    )


def seen_lamps(
    log: Log,
    nodes: Nodes,
    odometry: Odometry,
    config: ExtractConfig,
    rejected: Counter[str],
    progress: Progress | None,
) -> Sightings | None:
    """Returns the lamps that the images at the nodes show, ordered by node."""
    from frontend.image_lamps import lamps_in_images
    from frontend.lamps import motion_covariance

    numbers = _at_nodes(log, "ceiling", nodes)
    if numbers is None:
        return None
    found = lamps_in_images(log, numbers, config, progress)
    rejected.update({**found.seen.rejected, UNREADABLE_CEILING: found.unreadable})
    seen, times = found.seen, _times(log)[found.source]
    node = np.searchsorted(nodes.t, times)
    speed = velocities(nodes.t, odometry)[node]
    return table(
        "lamp",
        node,
        seen.z,
        seen.cov + motion_covariance(seen.z, speed, config.lamps.timing_s),
        received(log, found.source),
        quality=seen.visible,
        source=found.source,
        truth=true_lamps(log, times, seen.z),
    )


def seen_lines(
    log: Log, nodes: Nodes, config: ExtractConfig, rejected: Counter[str], progress: Progress | None
) -> Sightings | None:
    """Returns the lines that the images at the nodes show, ordered by node."""
    from frontend.image_lines import lines_in_images

    numbers = _at_nodes(log, "floor", nodes)
    if numbers is None:
        return None
    found = lines_in_images(log, numbers, config, progress)
    rejected.update({**found.seen.rejected, UNREADABLE: found.unreadable})
    times = _times(log)[found.source]
    return _line_table(log, nodes, found, times, received(log, found.source))


def seen_walls(
    log: Log, nodes: Nodes, config: ExtractConfig, rejected: Counter[str], progress: Progress | None
) -> Sightings | None:
    """Returns the walls that the scans at the nodes show, ordered by node."""
    if log.scans is None or not log.has_walls():
        return None
    from frontend.walls import walls_in_scans

    times = log.scans.t
    # of scans that share a time the first stands for its node
    first = np.concatenate([[True], np.diff(times) > 0])
    numbers = np.flatnonzero(first & np.isin(times, np.intersect1d(nodes.t, nodes.of_lines)))
    found = walls_in_scans(log, numbers, config.walls, progress)
    rejected.update({**found.seen.rejected, UNREADABLE_SCAN: found.unreadable})
    rejected[SAME_TIME] += int(np.sum(~first))
    times = times[found.source]
    return _line_table(log, nodes, found, times, times)


def _line_table(
    log: Log, nodes: Nodes, found: Found[DetectedLines], times: Array, received_at: Array
) -> Sightings:
    """Returns lines, or walls, that were seen at times (K,), s, as sightings at the nodes."""
    seen = found.seen
    return table(
        "line",
        np.searchsorted(nodes.t, times),
        seen.z,
        seen.cov,
        received_at,
        extent=seen.extent,
        quality=seen.quality,
        source=found.source,
        truth=true_lines(log, times, seen.z, seen.extent),
    )


def _at_nodes(log: Log, where: str, nodes: Nodes) -> IntArray | None:
    """Returns the numbers of the images at nodes that show what lies ``where``.

    None where there is no image of that sort at all, not even away from the nodes.
    """
    numbers = log.images_of(where)
    if not len(numbers):
        return None
    at_nodes = np.isin(_times(log)[numbers], np.intersect1d(nodes.t, nodes.of_lines))
    return np.asarray(numbers[at_nodes])


def _times(log: Log) -> Array:
    assert log.images is not None, "only images are searched"
    return log.images.t
