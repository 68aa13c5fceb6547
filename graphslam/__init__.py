"""Measurements to estimates: line models, EKF-SLAM and factor-graph smoothing.

Names are imported when they are first used, so that importing the package costs nothing and the
filter works where gtsam is not installed.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_HOME = {
    "BadConfig": "graphslam.errors",
    "BadLog": "graphslam.errors",
    "BadMeasurements": "graphslam.errors",
    "DifferentialDrive": "graphslam.models.wheels",
    "EkfConfig": "graphslam.config",
    "Estimate": "graphslam.estimate",
    "GraphSlamError": "graphslam.errors",
    "LandmarkMap": "graphslam.measurements",
    "MatchingConfig": "graphslam.config",
    "Measurements": "graphslam.measurements",
    "Odometry": "graphslam.measurements",
    "Sightings": "graphslam.measurements",
    "SmootherConfig": "graphslam.config",
    "UnderConstrained": "graphslam.errors",
    "build_graph": "graphslam.smoother",
    "check_factor": "graphslam.smoother",
    "dead_reckoning": "graphslam.baseline",
    "run_ekf": "graphslam.ekf",
    "smooth": "graphslam.smoother",
}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'graphslam' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return __all__
