"""What is shown of a log as it plays: paths, images, and where each is in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from frontend.log import Log
from frontend.marks import Shot
from graphslam.geometry import Array
from graphslam.measurements import IntArray


@dataclass(frozen=True, slots=True)
class Track:
    """One path.

    Attributes:
        name: of the method.
        colour: "#rrggbb".
        causal: whether a pose uses only what was known at its time.
        pose: (N, 3) at the nodes, floor frame, m and rad.
        half: (N, 2) half axes of the position's ellipse of 95 %, long one first, m.
        angle: (N,) direction of the long one, rad, floor frame.
        sigma_heading: (N,) rad.
        shown: (N,) whether the method has a pose of its own there; elsewhere it only goes on.
        dots: whether its poses are single ones, not a path.
        lines: (L, 4) ends of the lines of its final map, m; NaN where their stretch is unknown.
        line_from: (L,) node that saw each line first.
    """

    name: str
    colour: str
    causal: bool
    pose: Array
    half: Array
    angle: Array
    sigma_heading: Array
    shown: IntArray
    dots: bool
    lines: Array
    line_from: IntArray


@dataclass(frozen=True, slots=True)
class Show:
    """Everything that is shown of a log.

    Attributes:
        name: of the log.
        t: (N,) times of the nodes, s, as recorded.
        tracks: one for each method.
        truth: (N, 2) true positions, m; NaN where unknown; None without truth.
        box: smallest x, smallest y, largest x, largest y of the plan, m.
        shots: images at the nodes, with what was seen in them, by time.
        warnings: what the user should know.
        log: the recording, for the images themselves.
    """

    name: str
    t: Array
    tracks: tuple[Track, ...]
    truth: Array | None
    box: tuple[float, float, float, float]
    shots: tuple[Shot, ...]
    warnings: tuple[str, ...]
    log: Log

    def node_at(self, t: float) -> int:
        """Returns the last node that is not after ``t``, s; the first one before all."""
        return max(0, int(np.searchsorted(self.t, t, side="right")) - 1)

    @property
    def cameras(self) -> tuple[str, ...]:
        """The cameras of the shots, in the order of their first ones."""
        return tuple(dict.fromkeys(shot.camera for shot in self.shots))

    def shots_of(self, camera: str) -> tuple[IntArray, Array]:
        """Returns the rows (S,) of a camera's shots, and their times (S,), s."""
        rows = np.array([k for k, s in enumerate(self.shots) if s.camera == camera], np.int64)
        return rows, np.array([self.shots[k].t for k in rows.tolist()])
