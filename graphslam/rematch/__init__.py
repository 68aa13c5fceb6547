"""Deciding again, after smoothing, which landmark every sighting belongs to."""

from __future__ import annotations

from graphslam.rematch.objective import objective
from graphslam.rematch.rematch import Rematched, rematch, settle

__all__ = ["Rematched", "objective", "rematch", "settle"]
