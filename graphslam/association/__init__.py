"""Which landmark a sighting belongs to."""

from __future__ import annotations

from graphslam.association.assignment import DROPPED, NEW, assign, by_identity, leftover
from graphslam.association.distances import (
    Compatibility,
    compatibility,
    gate_for,
    labels_agree,
    mahalanobis,
    same_label,
    stretch_gap,
)
from graphslam.association.joint import jcbb

__all__ = [
    "DROPPED",
    "NEW",
    "Compatibility",
    "assign",
    "by_identity",
    "compatibility",
    "gate_for",
    "jcbb",
    "labels_agree",
    "leftover",
    "mahalanobis",
    "same_label",
    "stretch_gap",
]
