"""Smoothing with a GTSAM factor graph: the one part of the project that needs gtsam."""

from __future__ import annotations

from graphslam.smoother.agreement import EngineAgreement, engines_agree
from graphslam.smoother.batch import smooth
from graphslam.smoother.check import FactorCheck, check_factor
from graphslam.smoother.factors import (
    fixed_sighting_factor,
    landmark_key,
    odometry_factor,
    pose_key,
    residual_factor,
    sighting_factor,
    start_factor,
)
from graphslam.smoother.graph import FactorGraph, build_graph, graph_of
from graphslam.smoother.incremental import run_fixed_lag, run_isam2
from graphslam.smoother.optimise import Solution, optimise
from graphslam.smoother.problem import Minimum, Problem, state_problem

__all__ = [
    "EngineAgreement",
    "FactorCheck",
    "FactorGraph",
    "Minimum",
    "Problem",
    "Solution",
    "build_graph",
    "check_factor",
    "engines_agree",
    "fixed_sighting_factor",
    "graph_of",
    "landmark_key",
    "odometry_factor",
    "optimise",
    "pose_key",
    "residual_factor",
    "run_fixed_lag",
    "run_isam2",
    "sighting_factor",
    "smooth",
    "start_factor",
    "state_problem",
]
