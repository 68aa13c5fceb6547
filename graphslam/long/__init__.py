"""Logs that are too long for one filter: odometry calibrates itself, loops are searched for."""

from __future__ import annotations

from graphslam.long.chain import close_all_loops, run_window

__all__ = ["close_all_loops", "run_window"]
