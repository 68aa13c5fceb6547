"""Deciding again, after smoothing, which landmark every sighting belongs to."""

from __future__ import annotations

from graphslam.rematch.objective import objective
from graphslam.rematch.rematch import rematch, settle
from graphslam.rematch.rounds import Rematched

__all__ = ["Rematched", "objective", "rematch", "settle"]
