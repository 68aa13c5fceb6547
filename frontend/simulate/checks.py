"""Ranges of the numbers in a scenario."""

from __future__ import annotations

import math
from typing import Protocol

from graphslam.errors import BadConfig

MOST_PX = 10_000
"""Largest width and height of an image, pixels."""


def positive(name: str, value: float) -> None:
    """Raises BadConfig unless the value is finite and above 0."""
    if not (math.isfinite(value) and value > 0):
        raise BadConfig(f"{name} = {value}: must be above 0")


def not_negative(name: str, value: float) -> None:
    """Raises BadConfig unless the value is finite and not below 0."""
    if not (math.isfinite(value) and value >= 0):
        raise BadConfig(f"{name} = {value}: must be 0 or more")


class Imaging(Protocol):
    """A camera of a scenario, whatever it looks at."""

    image_size: tuple[int, int]
    rate: float
    noise: float
    blur: float
    jpeg_quality: int


def imaging(camera: Imaging, fewest_px: int = 1) -> None:
    """Raises BadConfig unless there can be images of this size, rate, noise, blur and quality."""
    positive("rate", camera.rate)
    for name in ("noise", "blur"):
        not_negative(name, getattr(camera, name))
    between("jpeg_quality", camera.jpeg_quality, 0, 100)
    if any(not fewest_px <= n <= MOST_PX for n in camera.image_size):
        raise BadConfig(
            f"image_size = {list(camera.image_size)}: must be {fewest_px} to {MOST_PX} pixels"
        )


def stretch(value: tuple[float, float] | None) -> None:
    """Raises BadConfig unless the stretch is None, endless, or begins before it ends."""
    if value is not None and not value[0] < value[1]:
        raise BadConfig(f"stretch = {list(value)}: needs its beginning before its end, in metres")


def between(name: str, value: float, low: float, high: float) -> None:
    """Raises BadConfig unless the value lies in [low, high]."""
    if not low <= value <= high:
        raise BadConfig(f"{name} = {value}: must be between {low:g} and {high:g}")
