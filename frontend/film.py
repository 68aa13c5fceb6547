"""Where a show is played: a window, or a video file."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from frontend.screen import SIZE, Screen
from frontend.show import Show
from graphslam.errors import BadConfig

Progress = Callable[[int, int], None]

CODECS = {".mp4": ("avc1", "mp4v"), ".avi": ("MJPG",), ".webm": ("VP80",)}
"""Codecs to try, best first, by the ending of the file."""
FPS = 25.0
LONGEST_FILM = 100_000  # pictures
TITLE = "graphslam play: space pauses, left and right go 1 s, + and - faster and slower, q ends"
SLOWEST, FASTEST = 1.0 / 64.0, 64.0
STEP_S = 1.0


def write_film(show: Show, out: Path, speed: float = 1.0, progress: Progress | None = None) -> int:
    """Writes a video of a show; returns how many pictures it has, at `FPS` a second.

    Args:
        show: what to play.
        out: file to write; its ending says how: .mp4, .avi or .webm.
        speed: seconds of the log in a second of the video.
        progress: called with (pictures done, pictures in all).

    Raises:
        BadConfig: the ending is another, no codec of OpenCV writes it, or the film is too long.
    """
    check_film(show, out, speed)
    screen, count = Screen(show), _pictures(show, speed)
    writer: Any = _writer(out)
    try:
        for k in range(count):
            t = min(show.t[0] + k * speed / FPS, show.t[-1])
            writer.write(screen.at(float(t), f"x {speed:g}"))
            if progress is not None:
                progress(k + 1, count)
    finally:
        writer.release()
    return count


def check_film(show: Show, out: Path, speed: float) -> None:
    """Raises BadConfig where no video can be written."""
    if out.suffix.lower() not in CODECS:
        known = ", ".join(CODECS)
        raise BadConfig(f"{out}: a video ends in one of {known}; a page in .html")
    if _pictures(show, speed) > LONGEST_FILM:
        raise BadConfig(
            f"{out}: would have {_pictures(show, speed)} pictures; play it faster (--speed), or a "
            "part of it (--from, --to)"
        )


def _pictures(show: Show, speed: float) -> int:
    return 1 + int(np.ceil((show.t[-1] - show.t[0]) / speed * FPS))


def _writer(out: Path) -> Any:
    """Returns a writer that is open."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    level = cv2.getLogLevel() if hasattr(cv2, "getLogLevel") else None
    if level is not None:
        cv2.setLogLevel(0)  # a codec that is missing is no error: the next one is tried
    try:
        for codec in CODECS[out.suffix.lower()]:
            with _Silence():
                writer = cv2.VideoWriter(str(out), cv2.VideoWriter_fourcc(*codec), FPS, SIZE)
            if writer.isOpened():
                return writer
    finally:
        if level is not None:
            cv2.setLogLevel(level)
    raise BadConfig(
        f"{out}: cannot be written: no folder there, or OpenCV here has no codec for it; try .avi, "
        "or a page (.html)"
    )


class _Silence:
    """Keeps what codecs say on standard error away from the user."""

    def __enter__(self) -> None:
        sys.stderr.flush()
        self._kept, self._null = os.dup(2), os.open(os.devnull, os.O_WRONLY)
        os.dup2(self._null, 2)

    def __exit__(self, *_: object) -> None:
        os.dup2(self._kept, 2)
        os.close(self._kept)
        os.close(self._null)


def has_window() -> bool:
    """Returns whether a window can be opened: there is a display, and OpenCV has windows."""
    display = sys.platform in ("win32", "darwin") or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")
    )
    if not display:
        return False
    for line in cv2.getBuildInformation().splitlines():
        if line.strip().startswith("GUI:"):
            return "NONE" not in line
    return False


class Player:
    """The clock of a window: plays, pauses, seeks, goes faster and slower."""

    def __init__(self, begin: float, end: float, speed: float) -> None:
        self.begin, self.end, self.speed = begin, end, speed
        self.t, self.paused, self.over = begin, False, False

    def advance(self, seconds: float) -> None:
        """Lets so much of the viewer's time pass."""
        if not self.paused:
            self.seek(self.t + seconds * self.speed)
            self.paused = self.t >= self.end

    def seek(self, t: float) -> None:
        """Goes to a time of the log, s."""
        self.t = min(max(t, self.begin), self.end)

    def press(self, key: int) -> None:
        """Does what a key of OpenCV's `waitKeyEx` stands for."""
        if key in (ord(" "), ord("p")):
            if self.paused and self.t >= self.end:
                self.t = self.begin
            self.paused = not self.paused
        elif key in (ord("q"), 27):
            self.over = True
        elif key in (ord("+"), ord("=")):
            self.speed = min(2.0 * self.speed, FASTEST)
        elif key == ord("-"):
            self.speed = max(0.5 * self.speed, SLOWEST)
        elif key in (81, 65361, 2424832, 63234, ord(",")):  # left on GTK, Qt, Windows, macOS
            self.seek(self.t - STEP_S)
        elif key in (83, 65363, 2555904, 63235, ord(".")):
            self.seek(self.t + STEP_S)


def play_in_window(show: Show, speed: float = 1.0) -> None:
    """Plays a show in a window until it is closed: keys as `TITLE` says, a slider to seek with."""
    screen, player = Screen(show), Player(float(show.t[0]), float(show.t[-1]), speed)
    cv2.namedWindow(TITLE, cv2.WINDOW_NORMAL | cv2.WINDOW_KEEPRATIO)
    cv2.resizeWindow(TITLE, *SIZE)
    tenths = max(1, round(10.0 * (player.end - player.begin)))
    moved = {"by us": False}

    def slide(value: int) -> None:
        if not moved["by us"]:
            player.seek(player.begin + value / 10.0)

    cv2.createTrackbar("0.1 s", TITLE, 0, tenths, slide)
    last = time.perf_counter()
    while not player.over:
        state = "paused" if player.paused else f"x {player.speed:g}"
        cv2.imshow(TITLE, screen.at(player.t, state))
        moved["by us"] = True
        cv2.setTrackbarPos("0.1 s", TITLE, round(10.0 * (player.t - player.begin)))
        moved["by us"] = False
        player.press(cv2.waitKeyEx(15))
        now = time.perf_counter()
        player.advance(now - last)
        last = now
        player.over |= cv2.getWindowProperty(TITLE, cv2.WND_PROP_VISIBLE) < 1
    cv2.destroyWindow(TITLE)
