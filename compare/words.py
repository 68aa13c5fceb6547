"""Figures and lists as sentences have them."""

from __future__ import annotations

from collections.abc import Sequence


def listed(words: Sequence[str]) -> str:
    """Returns words with commas, and "and" before the last."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def metres(value: float) -> str:
    """Returns a length with three significant digits, in mm below 1 m."""
    return f"{value:.3g} m" if abs(value) >= 1.0 else f"{1e3 * value:.3g} mm"
