"""Images and scans inside a recording: where each is, read only when it is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from frontend.columns import freeze, read_only
from graphslam.errors import BadLog
from graphslam.geometry import Array


class RecordedImage(Protocol):
    """An image inside a bag or a video: where it is, read only when it is asked for."""

    @property
    def name(self) -> str:
        """Where it is, as messages say it."""
        ...

    @property
    def digest(self) -> str:
        """SHA-256, hexadecimal, of what was recorded."""
        ...

    def grey(self) -> NDArray[np.uint8] | None:
        """Returns (H, W) grey levels, or None where it cannot be read whole."""
        ...

    def bgr(self) -> NDArray[np.uint8] | None:
        """Returns (H, W, 3) colours, BGR, or None where it cannot be read whole."""
        ...

    def packed(self) -> bytes | None:
        """Returns the bytes of the image file that was recorded, or None where it is none."""
        ...


@dataclass(frozen=True, slots=True)
class Scan:
    """One turn of a laser.

    Attributes:
        ranges: (B,) distances, m; beams without an echo hold NaN, infinity or a value beyond the
            limits below.
        angle_min: direction of the first beam, rad, in the laser's frame (x forward, y left).
        angle_step: from one beam to the next, rad; negative where the laser turns clockwise.
        range_min: smallest distance that is a measurement, m.
        range_max: largest, m.
        duration: from the first beam to the last, s; 0 where unknown. The time of the scan is that
            of its first beam.
    """

    ranges: Array
    angle_min: float
    angle_step: float
    range_min: float = 0.0
    range_max: float = np.inf
    duration: float = 0.0


class RecordedScan(Protocol):
    """A scan inside a recording, read only when it is asked for."""

    @property
    def name(self) -> str:
        """Where it is, as messages say it."""
        ...

    def scan(self) -> Scan | None:
        """Returns the scan, or None where it cannot be read whole."""
        ...


@dataclass(frozen=True, slots=True)
class ScanList:
    """Scans of one laser, in the order of the log: row number = number of the scan.

    Attributes:
        t: (K,) times, s, not decreasing.
        place: (K,) where each is.
        sensor_pose: (3,) the laser in the robot frame, m and rad.
    """

    t: Array
    place: tuple[RecordedScan, ...]
    sensor_pose: Array

    def __post_init__(self) -> None:
        freeze(self, t=())
        pose = read_only("ScanList.sensor_pose", self.sensor_pose, (3,))
        object.__setattr__(self, "sensor_pose", pose)
        if len(self.t) != len(self.place):
            raise BadLog("scans: t and place must have one entry each for every scan")
