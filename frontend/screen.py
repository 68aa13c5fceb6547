"""One moment of a log as a picture: images with what was seen, the plan so far, the covariance."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from frontend.marks import RING_PX, Mark, Shot, picture_of
from frontend.show import Show, Track
from graphslam.geometry import Array, transform_points

Picture = NDArray[np.uint8]

SIZE = (1280, 720)
"""Width and height of the picture, pixels."""
LEFT = 640  # width of the images' side
FOOT = 158  # height of the words below the plan
ROOM = 28  # height of the words below an image
HELD = 8  # decoded images kept
PAPER, INK, SOFT, RULE = (255, 255, 255), (38, 33, 28), (110, 101, 92), (225, 226, 226)
USED, PASSED = (60, 200, 60), (60, 120, 255)
FONT = cv2.FONT_HERSHEY_SIMPLEX
ROBOT = np.array([[1.3, 0.0], [-0.8, 0.75], [-0.8, -0.75]])
SHIFT = 4  # OpenCV draws with this many bits of a pixel's fraction
ZOOM = 148  # side of the enlarged ellipse, pixels
COLUMN = 6  # methods in one column of the words


class Screen:
    """Draws a show moment by moment."""

    def __init__(self, show: Show) -> None:
        self.show = show
        self._images: OrderedDict[int, Picture | None] = OrderedDict()
        self._cameras = {camera: show.shots_of(camera) for camera in show.cameras}

    def at(self, t: float, rate: str = "") -> Picture:
        """Returns the picture (H, W, 3), BGR, of a moment.

        Args:
            t: s, on the log's clock.
            rate: how fast it plays, in words.
        """
        canvas: Any = np.full((SIZE[1], SIZE[0], 3), PAPER, np.uint8)
        if self._cameras:
            self._draw_images(canvas, t)
        node = self.show.node_at(t)
        self._draw_plan(canvas, node)
        self._draw_words(canvas, t, node, rate)
        return np.asarray(canvas, np.uint8)

    # ---- images --------------------------------------------------------------------------------

    def _draw_images(self, canvas: Any, t: float) -> None:
        height = SIZE[1] // len(self._cameras)
        for row, (camera, (rows, times)) in enumerate(self._cameras.items()):
            top = row * height
            before = int(np.searchsorted(times, t, side="right"))
            if not before:
                _write(canvas, f"{camera}: no image yet", (12, top + 24), SOFT)
                continue
            shot = self.show.shots[rows[before - 1]]
            picture = self._image(shot.number)
            if picture is not None:
                _paste(canvas, picture, shot, (0, top, LEFT, height - ROOM))
            _write(canvas, f"{camera}  {shot.t - self.show.t[0]:.2f} s  {shot.note}",
                   (12, top + height - 9), INK, 0.42)  # fmt: skip

    def _image(self, number: int) -> Picture | None:
        if number not in self._images:
            self._images[number] = picture_of(self.show.log, number)
            while len(self._images) > HELD:
                self._images.popitem(last=False)
        return self._images[number]

    # ---- the plan ------------------------------------------------------------------------------

    def _area(self) -> tuple[int, int, int, int]:
        left = LEFT if self._cameras else 0
        return left, 0, SIZE[0] - left, SIZE[1] - FOOT

    def _draw_plan(self, canvas: Any, node: int) -> None:
        show, (left, top, width, height) = self.show, self._area()
        plan: Any = canvas[top : top + height, left : left + width]
        x0, y0, x1, y1 = show.box
        scale = min((width - 24) / (x1 - x0), (height - 24) / (y1 - y0))
        middle = np.array([0.5 * (x0 + x1), 0.5 * (y0 + y1)])

        def place(points: Array) -> Array:
            off = scale * (np.asarray(points, float) - middle)
            return np.stack([0.5 * width + off[..., 0], 0.5 * height - off[..., 1]], axis=-1)

        cv2.rectangle(plan, (0, 0), (width - 1, height - 1), RULE, 1)
        if show.truth is not None:
            _curve(plan, place(show.truth[: node + 1]), (200, 200, 200), 5)
        for track in show.tracks:
            self._draw_lines(plan, track, node, place)
        paths = [track for track in show.tracks if not track.dots]
        for left_over, track in zip(range(len(paths) - 1, -1, -1), paths, strict=True):
            # the last path hides none: the one below it is wider
            self._draw_track(plan, track, node, place, scale, 5 if left_over == 1 else 2)
        for track in show.tracks:
            if track.dots:
                for at in place(track.pose[track.shown[track.shown <= node], :2]):
                    colour = _bgr(track.colour)
                    cv2.circle(plan, _fixed(at), 5 << (SHIFT - 1), colour, -1, cv2.LINE_AA, SHIFT)
        _scale_bar(plan, scale)
        self._draw_zoom(canvas, node)

    def _draw_lines(self, plan: Any, track: Track, node: int, place: Any) -> None:
        for ends, first in zip(track.lines, track.line_from.tolist(), strict=True):
            if first <= node and np.isfinite(ends).all():
                _curve(plan, place(ends.reshape(2, 2)), _pale(_bgr(track.colour), 0.5), 1)

    def _draw_track(
        self, plan: Any, track: Track, node: int, place: Any, scale: float, width: int
    ) -> None:
        colour = _bgr(track.colour)
        _curve(plan, place(track.pose[: node + 1, :2]), colour, width)
        x, y, theta = track.pose[node]
        # the plan's y goes down, so that turns go the other way
        body = transform_points(np.array([0.0, 0.0, -theta]), 9.0 * ROBOT) + place(np.array([x, y]))
        cv2.fillPoly(plan, [np.array([_fixed(p) for p in body])], colour, cv2.LINE_AA, SHIFT)
        _ellipse(plan, place(np.array([x, y])), scale * track.half[node], track.angle[node], INK)

    def _draw_zoom(self, canvas: Any, node: int) -> None:
        """Draws the ellipses of the paths around the last one's position, enlarged."""
        paths = [track for track in self.show.tracks if not track.dots]
        if not paths:
            return
        height = SIZE[1] - FOOT
        box: Any = canvas[height + 3 : height + 3 + ZOOM, SIZE[0] - ZOOM : SIZE[0]]
        cv2.rectangle(box, (0, 0), (ZOOM - 1, ZOOM - 1), RULE, 1)
        last = paths[-1]
        half = max(float(last.half[node, 0]), 1e-5) * 1.6
        scale, origin = 0.5 * ZOOM / half, last.pose[node, :2]
        for track in paths:
            off = scale * (track.pose[node, :2] - origin)
            centre = np.array([0.5 * ZOOM + off[0], 0.5 * ZOOM - off[1]])
            if np.abs(centre).max() < 20 * ZOOM and scale * track.half[node, 0] < 40 * ZOOM:
                _ellipse(
                    box, centre, scale * track.half[node], track.angle[node], _bgr(track.colour)
                )
        if self.show.truth is not None and np.isfinite(self.show.truth[node]).all():
            off = scale * (self.show.truth[node] - origin)
            u, v = 0.5 * ZOOM + off[0], 0.5 * ZOOM - off[1]
            if 0 <= u < ZOOM and 0 <= v < ZOOM:
                cv2.drawMarker(box, (round(u), round(v)), INK, cv2.MARKER_TILTED_CROSS, 9, 1)
        _scale_bar(box, scale)

    # ---- words ---------------------------------------------------------------------------------

    def _draw_words(self, canvas: Any, t: float, node: int, rate: str) -> None:
        show, (left, _, width, height) = self.show, self._area()
        top = height + 22
        said = f"{show.name}   {t - show.t[0]:7.2f} of {show.t[-1] - show.t[0]:.2f} s   {rate}"
        _write(canvas, said, (left + 12, top), INK, 0.5)
        for k, track in enumerate(show.tracks):
            at = (left + 12 + 300 * (k // COLUMN), top + 22 + 20 * (k % COLUMN))
            cv2.circle(canvas, (at[0] + 5, at[1] - 5), 5, _bgr(track.colour), -1, cv2.LINE_AA)
            long, short = 1e3 * track.half[node]
            heading = 1.96 * np.degrees(track.sigma_heading[node])
            words = f"{track.name}: 95% {_three(long)} x {_three(short)} mm, {_three(heading)} deg"
            if track.dots and node not in track.shown:
                words = f"{track.name}: not seen"
            if not track.causal:
                words += " (whole run)"
            _write(canvas, words, (at[0] + 16, at[1]), INK, 0.4)
        done = (t - show.t[0]) / max(show.t[-1] - show.t[0], 1e-9)
        foot = SIZE[1] - 3
        cv2.line(canvas, (left, foot), (SIZE[0], foot), RULE, 3)
        cv2.line(canvas, (left, foot), (left + round(width * min(done, 1.0)), foot), SOFT, 3)


def draw_marks(picture: Picture, marks: tuple[Mark, ...], scale: float) -> None:
    """Draws what was seen into a picture (H, W, 3) that is ``scale`` times as large as the image.

    What an estimate rests on is green, what was passed over is orange.
    """
    target: Any = picture
    for mark in marks:
        colour = USED if mark.used else PASSED
        points = scale * (mark.points + 0.5) - 0.5
        if len(points) == 1:
            radius = round(RING_PX * max(scale, 0.5)) << SHIFT
            cv2.circle(target, _fixed(points[0]), radius, colour, 2, cv2.LINE_AA, SHIFT)
        else:
            _curve(target, points, colour, 2)
        if mark.text:
            u, v = points[0] + np.array([9.0, -9.0])
            _write(target, mark.text, (round(u), round(v)), colour, 0.42)


def _paste(canvas: Any, picture: Picture, shot: Shot, area: tuple[int, int, int, int]) -> None:
    """Puts an image with its marks into an area (left, top, width, height) of the canvas."""
    left, top, width, height = area
    rows, columns = picture.shape[:2]
    scale = min(width / columns, height / rows)
    size = (max(1, int(scale * columns)), max(1, int(scale * rows)))
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    small = np.ascontiguousarray(cv2.resize(picture, size, interpolation=method), np.uint8)
    draw_marks(small, shot.marks, scale)
    u, v = left + (width - size[0]) // 2, top + (height - size[1]) // 2
    canvas[v : v + size[1], u : u + size[0]] = small


def _curve(target: Any, points: Array, colour: tuple[int, int, int], width: int) -> None:
    """Draws a curve through points (k, 2), broken where one is NaN."""
    known = np.isfinite(points).all(axis=1) & (np.abs(points) < 1e5).all(axis=1)
    for part in np.split(np.arange(len(points)), np.flatnonzero(~known)):
        part = part[known[part]]
        if len(part) > 1:
            corners = np.round(points[part] * 2**SHIFT).astype(np.int32)
            cv2.polylines(target, [corners], False, colour, width, cv2.LINE_AA, SHIFT)


def _ellipse(
    target: Any, centre: Array, half: Array, angle: float, colour: tuple[int, int, int]
) -> None:
    axes = (max(1, round(float(half[0]) * 2**SHIFT)), max(1, round(float(half[1]) * 2**SHIFT)))
    turn = -float(np.degrees(angle))
    cv2.ellipse(target, _fixed(centre), axes, turn, 0, 360, colour, 1, cv2.LINE_AA, SHIFT)


def _scale_bar(target: Any, pixels_per_m: float) -> None:
    """Draws a length of 1, 2 or 5 times a power of ten into the lower left corner."""
    most = 0.35 * target.shape[1] / pixels_per_m
    power = 10.0 ** np.floor(np.log10(most))
    length = next(n * power for n in (5, 2, 1) if n * power <= most * 1.0001)
    u, v = 8, target.shape[0] - 8
    end = u + round(length * pixels_per_m)
    cv2.polylines(target, [np.array([[u, v - 4], [u, v], [end, v], [end, v - 4]])], False, INK, 1)
    words = f"{length:g} m" if length >= 1 else f"{1e3 * length:g} mm"
    _write(target, words, (u + 4, v - 5), INK, 0.38)


def _write(
    target: Any, words: str, at: tuple[int, int], colour: tuple[int, int, int], size: float = 0.45
) -> None:
    text = words.encode("ascii", "replace").decode()  # OpenCV's letters end there
    cv2.putText(target, text, at, FONT, size, colour, 1, cv2.LINE_AA)


def _fixed(point: Array) -> tuple[int, int]:
    """Returns a pixel with the fraction's bits that OpenCV wants."""
    u, v = np.round(np.clip(point, -1e6, 1e6) * 2**SHIFT).astype(int).tolist()
    return u, v


def _bgr(colour: str) -> tuple[int, int, int]:
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return blue, green, red


def _pale(colour: tuple[int, int, int], share: float) -> tuple[int, int, int]:
    blue, green, red = (round(share * 255 + (1 - share) * c) for c in colour)
    return blue, green, red


def _three(value: float) -> str:
    """Returns a number with three significant digits."""
    return f"{value:.3g}" if value < 1000 else f"{value:.0f}"
