"""Ranges of the numbers in a scenario."""

from __future__ import annotations

import math

from graphslam.errors import BadConfig


def positive(name: str, value: float) -> None:
    """Raises BadConfig unless the value is finite and above 0."""
    if not (math.isfinite(value) and value > 0):
        raise BadConfig(f"{name} = {value}: must be above 0")


def not_negative(name: str, value: float) -> None:
    """Raises BadConfig unless the value is finite and not below 0."""
    if not (math.isfinite(value) and value >= 0):
        raise BadConfig(f"{name} = {value}: must be 0 or more")


def stretch(value: tuple[float, float] | None) -> None:
    """Raises BadConfig unless the stretch is None, endless, or begins before it ends."""
    if value is not None and not value[0] < value[1]:
        raise BadConfig(f"stretch = {list(value)}: needs its beginning before its end, in metres")


def between(name: str, value: float, low: float, high: float) -> None:
    """Raises BadConfig unless the value lies in [low, high]."""
    if not low <= value <= high:
        raise BadConfig(f"{name} = {value}: must be between {low:g} and {high:g}")
