"""Figures and lists as sentences have them."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from graphslam.measurements import Measurements
from graphslam.models import MODELS

LANDMARKS = ("landmark", "landmarks")
"""What landmarks of several kinds are called, one and several."""


def listed(words: Sequence[str]) -> str:
    """Returns words with commas, and "and" before the last."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def metres(value: float) -> str:
    """Returns a length with three significant digits, in mm below 1 m."""
    return f"{value:.3g} m" if abs(value) >= 1.0 else f"{1e3 * value:.3g} mm"


def landmark_kinds(measurements: Measurements) -> tuple[str, ...]:
    """Returns the kinds of landmarks that were seen, of all that sightings could be of."""
    tables = measurements.sightings.items()
    return tuple(kind for kind, table in tables if len(table) and MODELS[kind].dim_landmark)


def noun(kinds: Collection[str]) -> tuple[str, str]:
    """Returns what landmarks of these kinds are called, one and several."""
    return MODELS[next(iter(kinds))].noun if len(kinds) == 1 else LANDMARKS


def capital(text: str) -> str:
    """Returns a text whose first letter is a capital."""
    return text[:1].upper() + text[1:]
