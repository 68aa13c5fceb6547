"""A solver made for one chain of poses and the landmarks seen from it."""

from __future__ import annotations

from graphslam.smoother.chain.engine import ChainMinimum, at_start, minimise
from graphslam.smoother.chain.start import started_along

__all__ = ["ChainMinimum", "at_start", "minimise", "started_along"]
