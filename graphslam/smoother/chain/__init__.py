"""A solver made for one chain of poses and the landmarks seen from it."""

from __future__ import annotations

from graphslam.smoother.chain.engine import ChainMinimum, minimise
from graphslam.smoother.chain.start import started_along

__all__ = ["ChainMinimum", "minimise", "started_along"]
