"""Where in its image a sighting lies: the two ends of a stroke for each of them."""

from __future__ import annotations

import numpy as np

from frontend.camera import Camera
from frontend.log import AnyCamera, Log
from frontend.omni import OmniCamera
from graphslam.geometry import Array, points_on_line
from graphslam.measurements import IntArray, Measurements, Sightings

KINDS = {"floor": "line", "ceiling": "lamp", "omni": "bearing"}
"""By where a camera looks: the kind of sightings that have strokes in its images."""
AXIS_M = 0.3
"""Half the length of the stroke along a lamp's axis, m."""


def shown(log: Log, measurements: Measurements, table: Sightings, number: int) -> IntArray:
    """Returns the rows (k,) of the sightings that an image at a node shows.

    Those that name the image, and those of its time that name none.
    """
    assert log.images is not None, "only logs with images show anything"
    node = np.searchsorted(measurements.t, log.images.t[number])
    here = np.arange(*np.searchsorted(table.node, [node, node + 1]))
    return here[np.isin(table.source[here], (number, -1))]


def strokes(camera: AnyCamera, table: Sightings, rows: IntArray) -> tuple[IntArray, Array]:
    """Returns which of the sightings ``rows`` (k,) are in view, and their ends (n, 2, 2), pixels.

    A line along the stretch that was seen, as a lens without distortion shows it; a lamp along its
    axis and a direction across all that the image shows of it, as they were recorded.
    """
    if isinstance(camera, OmniCamera):
        return rows, _rays(camera, table.z[rows, 0])
    assert isinstance(camera, Camera), "an overhead camera sees poses, which are no strokes"
    if camera.looks_at == "ceiling":
        ends = _axes(camera, table.z[rows])
    else:
        inside, stretch = _stretches(camera, table, rows)
        rows = rows[inside]
        ends = camera.floor_to_pixel(points_on_line(table.z[rows][:, None], stretch[inside]))
    known = np.isfinite(ends).all(axis=(1, 2))
    return rows[known], ends[known]


def _stretches(camera: Camera, table: Sightings, rows: IntArray) -> tuple[Array, Array]:
    """Returns which lines are in view, and the stretches (k, 2) that are, m along each."""
    view, extent = camera.visible_stretch(table.z[rows]), table.extent[rows]
    low, high = np.fmax(view[:, 0], extent[:, 0]), np.fmin(view[:, 1], extent[:, 1])
    return np.isfinite(view[:, 0]) & (low < high), np.column_stack([low, high])


def _axes(camera: Camera, lamps: Array) -> Array:
    """Returns the ends (k, 2, 2) of strokes along the axes of lamps (k, 3), pixels."""
    along = AXIS_M * np.column_stack([np.cos(lamps[:, 2]), np.sin(lamps[:, 2])])
    ends = lamps[:, None, :2] + np.array([-1.0, 1.0])[:, None] * along[:, None]
    return camera.distort(camera.floor_to_pixel(ends))


def _rays(camera: OmniCamera, bearing: Array) -> Array:
    """Returns the ends (k, 2, 2) of directions (k,), from inside to outside, pixels."""
    near, far = camera.ring_px or (0.0, 0.5 * min(camera.image_size))
    pair = np.stack([bearing, bearing], axis=-1)
    return camera.pixels(pair, np.broadcast_to([near, far], pair.shape))
