"""What images and scans show at the nodes: each sort of sensor's search, as tables of sightings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import numpy as np

from frontend.columns import later
from frontend.config import ExtractConfig
from frontend.log import Log
from frontend.nodes import Nodes, velocities
from frontend.sighting_tables import table
from frontend.truth import true_lamps, true_lines, true_points
from graphslam.geometry import Array
from graphslam.measurements import IntArray, Odometry, Sightings

Progress = Callable[[int, int], None]

UNREADABLE = "image that cannot be read"
UNREADABLE_OMNI = "omnidirectional image that cannot be read"
UNREADABLE_CEILING = "image of the ceiling that cannot be read"
UNREADABLE_SCAN = "scan that cannot be read"
SAME_TIME = "scan of the same time as the one before it"


def seen_bearings(
    log: Log, nodes: Nodes, config: ExtractConfig, rejected: Counter[str]
) -> Sightings | None:
    """Returns the directions of landmarks that images at the nodes show, ordered by node."""
    from frontend.cones import bearings_in_images

    numbers = _at_nodes(log, log.omni_images(), nodes)
    if numbers is None:
        return None
    found, source, unreadable = bearings_in_images(log, numbers, config)
    rejected.update({**found.rejected, UNREADABLE_OMNI: unreadable})
    times = _times(log)[source]
    return table(
        "bearing",
        np.searchsorted(nodes.t, times),
        found.z,
        found.cov,
        times,
        quality=found.area,
        source=source,
        truth=true_points(log, times, found.z[:, 0], found.label),
        label=found.label,
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

    numbers = _at_nodes(log, log.ceiling_images(), nodes)
    if numbers is None:
        return None
    found, source, unreadable = lamps_in_images(log, numbers, config, progress)
    rejected.update({**found.rejected, UNREADABLE_CEILING: unreadable})
    times = _times(log)[source]
    node = np.searchsorted(nodes.t, times)
    speed = velocities(nodes.t, odometry)[node]
    return table(
        "lamp",
        node,
        found.z,
        found.cov + motion_covariance(found.z, speed, config.lamps.timing_s),
        _received(log, source),
        quality=found.visible,
        source=source,
        truth=true_lamps(log, times, found.z),
    )


def _received(log: Log, source: IntArray) -> Array:
    """Returns when what each of the images ``source`` (K,) shows is known, s."""
    assert log.images is not None, "sightings come from images"
    cameras = {**log.cameras, **log.ceiling}
    names = [log.images.camera[number] for number in source.tolist()]
    delay = np.array([cameras[name].delay_s for name in names], float)
    t = log.images.t[source]
    return np.where(delay > 0, later(t, delay), t)


def seen_lines(
    log: Log, nodes: Nodes, config: ExtractConfig, rejected: Counter[str], progress: Progress | None
) -> Sightings | None:
    """Returns the lines that the images at the nodes show, ordered by node."""
    from frontend.image_lines import lines_in_images

    numbers = _at_nodes(log, log.floor_images(), nodes)
    if numbers is None:
        return None
    lines, source, unreadable = lines_in_images(log, numbers, config, progress)
    rejected.update({**lines.rejected, UNREADABLE: unreadable})
    times = _times(log)[source]
    return table(
        "line",
        np.searchsorted(nodes.t, times),
        lines.z,
        lines.cov,
        _received(log, source),
        extent=lines.extent,
        quality=lines.quality,
        source=source,
        truth=true_lines(log, times, lines.z, lines.extent),
    )


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
    walls, source, unreadable = walls_in_scans(log, numbers, config.walls, progress)
    rejected.update({**walls.rejected, UNREADABLE_SCAN: unreadable})
    rejected[SAME_TIME] += int(np.sum(~first))
    return table(
        "line",
        np.searchsorted(nodes.t, times[source]),
        walls.z,
        walls.cov,
        times[source],
        extent=walls.extent,
        quality=walls.quality,
        source=source,
        truth=true_lines(log, times[source], walls.z, walls.extent),
    )


def _at_nodes(log: Log, numbers: IntArray, nodes: Nodes) -> IntArray | None:
    """Returns those of the images ``numbers`` that were taken at nodes; None where there are none.

    Of no image at all, not even away from the nodes, that is: a sort of camera that is not there.
    """
    if not len(numbers):
        return None
    at_nodes = np.isin(_times(log)[numbers], np.intersect1d(nodes.t, nodes.of_lines))
    return np.asarray(numbers[at_nodes])


def _times(log: Log) -> Array:
    assert log.images is not None, "only images are searched"
    return log.images.t
