"""Videos with time stamps: frames are decoded one after the other and never held for long."""

from __future__ import annotations

import hashlib
import os
from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frontend.log import DEFAULT_CAMERA
from frontend.log_parts import ImageList
from frontend.table import read_table
from graphslam.errors import BadLog

KEPT_FRAMES = 24
"""Decoded frames at hand, so that threads may ask for neighbours out of order."""
LONGEST = 10_000_000
"""Frames of a video that has no video.csv: what a damaged header declares is not believed."""
QUIET = ("OPENCV_FFMPEG_LOGLEVEL", "-8")  # its own complaints on standard error


@dataclass(frozen=True, slots=True)
class VideoImage:
    """A frame of a video.

    Attributes:
        video: the video.
        frame: its number, from 0.
    """

    video: Video
    frame: int

    @property
    def name(self) -> str:
        """File and number."""
        return f"{self.video.path.name} frame {self.frame}"

    @property
    def digest(self) -> str:
        """SHA-256, hexadecimal, of the file and the frame's number."""
        return hashlib.sha256(f"{self.video.digest} {self.frame}".encode()).hexdigest()

    def grey(self) -> NDArray[np.uint8] | None:
        """Returns (H, W) grey levels, or None where the video does not reach so far."""
        return self.video.grey(self.frame)

    def bgr(self) -> NDArray[np.uint8] | None:
        """Returns (H, W, 3) colours, BGR, or None where the video does not reach so far."""
        return self.video.bgr(self.frame)

    def packed(self) -> bytes | None:
        """Returns None: a frame of a video is no file."""
        return None


class Video:
    """A video file whose frames are read mostly in their order.

    Frames are counted by decoding: seeking by number is wrong in many files, by a frame or more.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            with path.open("rb") as stream:
                self.digest = hashlib.file_digest(stream, "sha256").hexdigest()
        except OSError as reason:
            raise BadLog(f"{path}: cannot be read ({reason.strerror}); check it") from None
        self._lock = Lock()
        self._capture: Any = None
        self._next = 0
        self._frames: OrderedDict[int, NDArray[np.uint8]] = OrderedDict()
        if not self._rewind():
            raise BadLog(
                f"{path}: is no video that can be decoded: it is cut off, damaged, or of a codec "
                "that OpenCV does not know; copy it again, or convert it (ffmpeg -i OLD NEW.mp4)"
            )

    def grey(self, number: int) -> NDArray[np.uint8] | None:
        """Returns a frame as (H, W) grey levels, or None where the video does not reach so far."""
        import cv2

        picture = self._picture(number)
        if picture is None or picture.ndim == 2:
            return picture
        return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.uint8)

    def bgr(self, number: int) -> NDArray[np.uint8] | None:
        """Returns a frame as (H, W, 3) colours, BGR, or None where the video ends before it."""
        import cv2

        picture = self._picture(number)
        if picture is None or picture.ndim == 3:
            return picture
        return np.asarray(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR), np.uint8)

    def _picture(self, number: int) -> NDArray[np.uint8] | None:
        """Returns a frame as it is decoded, or None where the video does not reach so far."""
        with self._lock:
            if number in self._frames:
                return self._frames[number]
            if number < self._next and not self._rewind():
                return None
            while self._next < number:
                if not self._capture.grab():
                    self._next = LONGEST  # the next request begins anew
                    return None
                self._next += 1
            return self._decode()

    def times(self) -> list[float]:
        """Returns the video's own times of its frames, s from the first."""
        import cv2

        times: list[float] = []
        with self._lock:
            self._rewind()
            while len(times) < LONGEST and self._capture.grab():
                times.append(self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3)
            self._next = LONGEST
        return [t - times[0] for t in times]

    def _rewind(self) -> bool:
        os.environ.setdefault(*QUIET)
        import cv2

        if self._capture is not None:
            self._capture.release()
        self._capture, self._next = cv2.VideoCapture(str(self.path)), 0
        return bool(self._capture.isOpened())

    def _decode(self) -> NDArray[np.uint8] | None:
        whole, picture = self._capture.read()
        if not whole:
            self._next = LONGEST
            return None
        picture.flags.writeable = False
        self._frames[self._next] = picture
        self._next += 1
        while len(self._frames) > KEPT_FRAMES:
            self._frames.popitem(last=False)
        return np.asarray(picture, np.uint8)


def read_video(video: Path, table: Path) -> tuple[ImageList, tuple[str, ...]]:
    """Returns the frames of a video that a table lists, and what the user should know.

    Args:
        video: the video file.
        table: ``video.csv``: columns t (s, increasing) and frame (number in the video, from 0,
            increasing). Where it is absent, the video's own times count, from 0.

    Raises:
        BadLog: either contradicts its format; the message names file, line and cure.
    """
    source = Video(video)
    if not (table.exists() or table.is_symlink()):
        own = source.times()
        steps = np.diff(own)
        if len(own) < 2 or not np.all(steps > 0):
            raise BadLog(
                f"{video}: has no times of its own that increase; write video.csv beside it, with "
                "the columns t,frame"
            )
        images = tuple(VideoImage(source, k) for k in range(len(own)))
        note = (
            f"{video.name}: there is no video.csv; the video's own times count, from t = 0: the "
            "clocks of wheels and camera may differ, see `graphslam calibrate --time-offset`"
        )
        return ImageList(np.array(own), images, (DEFAULT_CAMERA,) * len(own)), (note,)
    rows = read_table(table, ("t", "frame"), whole=("frame",), least=1)
    rows.check_times()
    frame = rows.numbers["frame"]
    rows.check(frame < 0, "frame = {frame} is negative; number the frames from 0")
    back = np.diff(frame, prepend=-1.0) <= 0
    rows.check(back, "frame = {frame} is not after the frame above; list frames in their order")
    images = tuple(VideoImage(source, int(k)) for k in frame.tolist())
    return ImageList(rows.numbers["t"], images, (DEFAULT_CAMERA,) * len(images)), ()
