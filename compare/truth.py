"""What is true about a run: the path, the lines, which of them were to be seen, and by whom.

Everything stands in the *truth's frame*, that of the log's ground truth and map. Estimates are
moved into it (see `compare.align`), which is the same as moving the truth.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from frontend.truth import CLOCK_S, true_lines
from graphslam.arrays import frozen
from graphslam.baseline import integrate
from graphslam.geometry import (
    Array,
    compose,
    interpolate_poses,
    inverse,
    line_to_robot,
    position_along,
)
from graphslam.measurements import IntArray, Measurements
from graphslam.models import MODELS
from graphslam.models.line import LINE

if TYPE_CHECKING:
    from frontend.camera import Camera
    from frontend.log import Log

BoolArray = NDArray[np.bool_]

VISIBLE_M = 0.25
"""A frame shows a true line when at least this much of it is in view, m."""
SEEN_FRAMES = 5
"""A true line is seen when at least this many frames show it, or sightings lie near it."""


@dataclass(frozen=True, slots=True)
class Truth:
    """Ground truth as far as there is any; arrays are empty where there is none.

    Attributes:
        t: (K,) times of the true path, s.
        pose: (K, 3) true poses, truth's frame, m and rad.
        truth_T_start: (3,) where the estimates' floor frame lies in the truth's when the true path
            begins at the start pose; the identity without a true path, and on a known map that is
            the true one.
        line_id: (L,) identities of the true lines.
        lines: (L, 2) true lines, truth's frame, canonical.
        extent: (L, 2) stretch of each, m; NaN where unknown.
        seen: (L,) whether each line was to be seen, or None where nothing tells.
        landmark: (S,) identity of the true landmark of each sighting, over all tables in order; -1
            where unknown.
        labelled: whether the lines in `landmark` are the log's own, so that -1 says 'no true line'.
        point_id: (P,) identities of the true points, each once for its kind.
        points: (P, 2) where they are, truth's frame, m.
        point_kind: (P,) kinds of the true points.
    """

    t: Array
    pose: Array
    truth_T_start: Array
    line_id: IntArray
    lines: Array
    extent: Array
    seen: BoolArray | None
    landmark: IntArray
    labelled: bool
    point_id: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    points: Array = field(default_factory=lambda: np.zeros((0, 2)))
    point_kind: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "point_kind", tuple(str(kind) for kind in self.point_kind))
        poses, lines = len(self.t), len(self.line_id)
        shapes: dict[str, tuple[tuple[int | None, ...], type, bool]] = {
            "t": ((poses,), float, False),
            "pose": ((poses, 3), float, False),
            "truth_T_start": ((3,), float, False),
            "line_id": ((lines,), int, False),
            "lines": ((lines, 2), float, False),
            "extent": ((lines, 2), float, True),
            "landmark": ((None,), int, False),
            "point_id": ((len(self.point_kind),), int, False),
            "points": ((len(self.point_kind), 2), float, False),
        }
        if self.seen is not None:
            shapes["seen"] = ((lines,), bool, False)
        for name, (shape, dtype, nan) in shapes.items():
            value = frozen(f"truth.{name}", getattr(self, name), shape, dtype, nan)
            object.__setattr__(self, name, value)

    def at(self, t: Array) -> tuple[Array, BoolArray]:
        """Returns the true poses (N, 3) at times (N,), and whether the true path covers them (N,).

        Poses at times that are not covered are NaN.
        """
        return _path_at(t, self.t, self.pose)


def truth_of(log: Log | None, measurements: Measurements) -> Truth:
    """Returns what is true about measurements.

    The first node that the true path covers is put where odometry takes the start pose, which is
    the start pose itself where the path covers node 0. On a known map that is the true one the
    estimates stand in the truth's frame already, wherever they take the start to be.

    Args:
        log: the recording, or None where only measurements are at hand.
        measurements: what was extracted from it.
    """
    t, pose = np.zeros(0), np.zeros((0, 3))
    if log is not None and log.truth is not None:
        t, pose = log.truth.t, log.truth.pose
    line_id, lines, extent = _lines_of(log)
    landmark, near = _identities(log, measurements)
    return Truth(
        t=t,
        pose=pose,
        truth_T_start=(
            np.zeros(3)
            if _on_true_map(log, measurements, lines) or _placed(log, measurements)
            else _start_in_truth(measurements, *_path_at(measurements.t, t, pose))
        ),
        line_id=line_id,
        lines=lines,
        extent=extent,
        seen=_seen(log, measurements, line_id, near, landmark),
        landmark=landmark,
        labelled=_labelled(log),
        **_points_of(log),
    )


def frames_showing(
    camera: Camera, true_pose: Array, covered: BoolArray, lines: Array, extent: Array
) -> IntArray:
    """Returns (L,) how many frames show at least `VISIBLE_M` of each true line.

    Args:
        camera: sees the floor; its homography says where.
        true_pose: (I, 3) pose at each frame, truth's frame.
        covered: (I,) whether the pose is known.
        lines: (L, 2) true lines, truth's frame.
        extent: (L, 2) their stretches, m; NaN where unknown, taken as endless.
    """
    pose = true_pose[covered][:, None, :]
    shown = camera.visible_stretch(line_to_robot(lines, pose).reshape(-1, 2))
    here = position_along(lines, pose[..., :2])  # the robot's own position along each line
    shown = shown.reshape(len(pose), len(lines), 2) + here[..., None]
    length = np.fmin(shown[..., 1], extent[:, 1]) - np.fmax(shown[..., 0], extent[:, 0])
    length = np.where(np.isnan(shown[..., 0]), 0.0, length)
    return np.asarray((length >= VISIBLE_M).sum(axis=0))


def _path_at(t: Array, known_t: Array, known_pose: Array) -> tuple[Array, BoolArray]:
    if len(known_t) == 0:
        return np.full((len(t), 3), np.nan), np.zeros(len(t), bool)
    covered = (t >= known_t[0] - CLOCK_S) & (t <= known_t[-1] + CLOCK_S)
    pose = interpolate_poses(t, known_t, known_pose)
    return np.where(covered[:, None], pose, np.nan), covered


def _lines_of(log: Log | None) -> tuple[IntArray, Array, Array]:
    if log is None or log.map is None:
        return np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 2))
    rows, lines = log.map.of_kind(LINE.kind)
    lines, extent, _ = LINE.canonical(lines.reshape(-1, 2), log.map.extent[rows])
    return log.map.id[rows], lines, extent


def _points_of(log: Log | None) -> dict[str, Any]:
    """Returns the true points, as the columns of `Truth`."""
    given = None if log is None else log.landmarks
    if given is None:
        return {}
    rows = [row for row, kind in enumerate(given.kind) if kind != LINE.kind]
    kinds = tuple(given.kind[row] for row in rows)
    return {"point_id": given.id[rows], "points": given.params[rows, :2], "point_kind": kinds}


def _start_in_truth(measurements: Measurements, at_nodes: Array, covered: BoolArray) -> Array:
    if not covered.any():
        return np.zeros(3)
    first = int(np.argmax(covered))
    driven = integrate(measurements.start_pose, measurements.odometry.increment[:first])
    return compose(at_nodes[first], inverse(driven[-1]))


def _placed(log: Log | None, measurements: Measurements) -> bool:
    """Returns whether sightings alone say where the path lies: no start is given, and fixes are.

    The estimates then stand in the sensor's own frame, which is that of the truth.
    """
    if log is None or log.start_given:
        return False
    tables = measurements.sightings.items()
    return any(not MODELS[kind].dim_landmark and len(table) for kind, table in tables)


def _on_true_map(log: Log | None, measurements: Measurements, lines: Array) -> bool:
    """Returns whether the known map is the true one, so that its frame is the truth's."""
    known = measurements.known
    if known is None:
        return False
    if log is not None and known is log.landmarks and len(known):
        return True
    if not len(lines):
        return False
    given = known.of_kind(LINE.kind)[1]
    return given.shape == lines.shape and bool(np.allclose(given, lines, rtol=0.0, atol=1e-9))


def _labelled(log: Log | None) -> bool:
    return log is not None and log.sightings is not None and bool((log.sightings.truth >= 0).any())


def _identities(log: Log | None, measurements: Measurements) -> tuple[IntArray, IntArray]:
    """Returns the true landmark (S,) of all sightings, and the true line near line sightings (K,).

    The second is by place alone; the first is what the measurements say, and by place where they
    say nothing.
    """
    landmark = np.concatenate(
        [np.zeros(0, np.int64), *(table.truth for _, table in measurements.tables())]
    )
    near = np.full(0, -1)
    for first, table in measurements.tables():
        if table.kind != LINE.kind or log is None:
            continue
        near = true_lines(log, measurements.t[table.node], table.z, table.extent)
        if not (table.truth >= 0).any():
            landmark[first : first + len(table)] = near
    return landmark, near


def _seen(
    log: Log | None,
    measurements: Measurements,
    line_id: IntArray,
    near: IntArray,
    landmark: IntArray,
) -> BoolArray | None:
    """Returns which true lines were to be seen (L,).

    By the camera where it has frames, by sightings near the lines without one, by the sightings'
    own identities without a true path; None where nothing tells.
    """
    if log is None or len(line_id) == 0:
        return None
    if log.truth is not None and _path_at(measurements.t, log.truth.t, log.truth.pose)[1].any():
        _, lines, extent = _lines_of(log)
        frames = [(camera, t) for camera, t in _frames(log, measurements.t) if len(t)]
        if frames:
            path = log.truth.t, log.truth.pose
            shown = [frames_showing(c, *_path_at(t, *path), lines, extent) for c, t in frames]
            return np.asarray(np.sum(shown, axis=0) >= SEEN_FRAMES)
        return np.array([np.sum(near == name) >= SEEN_FRAMES for name in line_id], bool)
    if (landmark >= 0).any():
        return np.array([np.sum(landmark == name) >= SEEN_FRAMES for name in line_id], bool)
    return None


def _frames(log: Log, node_t: Array) -> Iterator[tuple[Camera, Array]]:
    """Yields each camera that looks at the floor with the times of its frames that are nodes."""
    for name, camera in log.looking_at("floor").items():
        if log.images is None:
            yield camera, node_t
        else:
            t = log.images.t[np.array(log.images.camera, dtype=object) == name]
            yield camera, t[np.isin(t, node_t)]
