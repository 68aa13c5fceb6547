"""Ranges of colour: hue, saturation and value from a low to a high limit."""

from __future__ import annotations

from graphslam.errors import BadConfig

Hsv = tuple[int, int, int]
"""Hue 0 to 179 (two degrees each), saturation and value 0 to 255, as OpenCV has them."""
LARGEST_HSV = (179, 255, 255)


def check_range(low: Hsv, high: Hsv, called: tuple[str, str] = ("low", "high")) -> None:
    """Raises BadConfig unless both are colours, and ``high`` is above ``low`` but for the hue.

    Args:
        low: smallest hue, saturation and value.
        high: the largest.
        called: what messages call the two.
    """
    for name, limit in zip(called, (low, high), strict=True):
        if any(not 0 <= v <= most for v, most in zip(limit, LARGEST_HSV, strict=True)):
            raise BadConfig(
                f"{name} = {list(limit)}: hue is 0 to 179 (two degrees each), saturation and "
                "value are 0 to 255"
            )
    if low[1] > high[1] or low[2] > high[2]:
        raise BadConfig(
            f"{called[0]} = {list(low)}: saturation or value is above that of {called[1]}; "
            "exchange them"
        )
