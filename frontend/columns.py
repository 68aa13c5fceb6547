"""Columns of a recording: checked on entry, and read-only from then on."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from graphslam.errors import BadLog
from graphslam.geometry import Array

NANOSECONDS = 9  # decimals of a time that count


def later(t: Array, delay_s: Array | float) -> Array:
    """Returns times (K,), s, that lie ``delay_s`` later, to the nanosecond.

    What takes a period of the camera is known at its next image, not a rounding error after that.
    """
    return np.asarray(np.round(t + delay_s, NANOSECONDS), float)


def freeze(instance: Any, **shapes: tuple[int, ...]) -> None:
    """Makes columns read-only after checking that they have one row for each entry of ``t``."""
    count = len(instance.t)
    for name, rest in shapes.items():
        label = f"{type(instance).__name__}.{name}"
        column = read_only(label, getattr(instance, name), (count, *rest), name == "extent")
        object.__setattr__(instance, name, column)


def read_only(
    label: str, value: Any, shape: tuple[int, ...], may_be_nan: bool = False
) -> NDArray[Any]:
    whole = label.endswith((".truth", ".label"))
    array: NDArray[Any] = np.array(value, np.int64 if whole else float)
    if array.shape != shape:
        raise BadLog(f"{label} has shape {array.shape}; expected {shape}")
    if not may_be_nan and not np.isfinite(array).all():
        raise BadLog(f"{label} holds NaN or infinity; leave those rows out")
    array.flags.writeable = False
    return array
