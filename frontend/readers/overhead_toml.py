"""Cameras of ``log.toml`` that watch the robot from above: ``looks_at = "overhead"``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from frontend.camera import Camera
from frontend.overhead import OverheadCamera, TagMount

Row = tuple[float, float, float]
Matrix3 = tuple[Row, Row, Row]


@dataclass(frozen=True, slots=True)
class OverheadTable:
    """``[cameras.NAME]`` with ``looks_at = "overhead"``; see `OverheadCamera`."""

    image_size: tuple[int, int]
    homography: Matrix3
    tags: TagMount
    looks_at: str = "overhead"
    position: Row | None = None
    matrix: Matrix3 | None = None
    distortion: tuple[float, ...] | None = None
    lens: str = "plain"
    delay: float = 0.0

    def camera(self, name: str) -> OverheadCamera:
        """Returns the camera; raises BadConfig where its numbers make none."""
        matrix = None if self.matrix is None else np.array(self.matrix)
        distortion = None if self.distortion is None else np.array(self.distortion)
        plane = Camera(
            name,
            self.looks_at,
            self.image_size,
            np.array(self.homography),
            matrix,
            distortion,
            self.lens,
            delay_s=self.delay,
        )
        return OverheadCamera(plane, self.tags, self.position)
