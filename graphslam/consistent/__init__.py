"""Filters whose covariance does not gain information that no sighting holds."""

from __future__ import annotations

from graphslam.consistent.first_estimates import run_first_estimates
from graphslam.consistent.robot_centred import run_robot_centred

__all__ = ["run_first_estimates", "run_robot_centred"]
