"""Ranges of colour: hue, saturation and value from a low to a high limit."""

from __future__ import annotations

from graphslam.errors import BadConfig

Hsv = tuple[int, int, int]
"""Hue 0 to 179 (two degrees each), saturation and value 0 to 255, as OpenCV has them."""
LARGEST_HSV = (179, 255, 255)


def check_range(low: Hsv, high: Hsv) -> None:
    """Raises BadConfig unless both are colours, and ``high`` is above ``low`` but for the hue."""
    for limit in (low, high):
        if any(not 0 <= v <= most for v, most in zip(limit, LARGEST_HSV, strict=True)):
            raise BadConfig(
                f"low or high = {list(limit)}: hue is 0 to 179 (two degrees each), saturation "
                "and value are 0 to 255"
            )
    if low[1] > high[1] or low[2] > high[2]:
        raise BadConfig(
            f"low = {list(low)}: saturation or value is above that of high; exchange them"
        )
