"""Which landmark a sighting belongs to."""

from __future__ import annotations

from graphslam.association.nearest import DROPPED, NEW, mahalanobis, match

__all__ = ["DROPPED", "NEW", "mahalanobis", "match"]
