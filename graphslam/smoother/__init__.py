"""Smoothing with a GTSAM factor graph: the one part of the project that needs gtsam."""

from __future__ import annotations

from graphslam.smoother.batch import smooth
from graphslam.smoother.check import FactorCheck, check_factor
from graphslam.smoother.factors import (
    landmark_key,
    odometry_factor,
    pose_key,
    residual_factor,
    sighting_factor,
    start_factor,
)
from graphslam.smoother.graph import Problem, build_graph
from graphslam.smoother.optimise import Solution, optimise

__all__ = [
    "FactorCheck",
    "Problem",
    "Solution",
    "build_graph",
    "check_factor",
    "landmark_key",
    "odometry_factor",
    "optimise",
    "pose_key",
    "residual_factor",
    "sighting_factor",
    "smooth",
    "start_factor",
]
