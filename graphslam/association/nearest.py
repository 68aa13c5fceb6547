"""Where `gate_for` is still imported from; see `graphslam.association`."""

from __future__ import annotations

from graphslam.association.assignment import assign
from graphslam.association.distances import gate_for

__all__ = ["assign", "gate_for"]
