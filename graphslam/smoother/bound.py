"""How well path and map can be known at all: the Bayesian Cramer-Rao bound."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from graphslam.config import Engine
from graphslam.estimate import Estimate
from graphslam.geometry import Array
from graphslam.measurements import IntArray, Measurements
from graphslam.smoother.batch import at_start, finish
from graphslam.smoother.problem import state_problem


def cramer_rao(
    measurements: Measurements,
    matches: IntArray,
    pose: Array,
    params: Array,
    engine: Engine = "auto",
) -> Estimate:
    """Returns path and map as given, with the covariances that no estimator can undercut.

    They are the inverse of the information of start, odometry and sightings, linearised at the
    given point. At the truth this is the bound; at a smoothed estimate it is the smoother's own
    covariance. Measured values do not enter, only what their covariances say. The mean over what
    can happen is left to the caller: over seeds of one scenario the information hardly varies.

    Args:
        measurements: their covariances, and which node saw what.
        matches: (K,) landmark of each sighting over all tables in order, numbered from 0 without
            gaps, known ones first; -1 leaves a sighting out.
        pose: (N, 3) path to linearise at, floor frame.
        params: (M, l) landmarks to linearise at, floor frame.
        engine: who eliminates.

    Raises:
        BadMeasurements: matches do not belong to the measurements.
        UnderConstrained: the measurements do not determine every pose and landmark.

    Source: Van Trees 1968, section 2.4, for Gaussian noise that does not depend on the state.
    """
    problem = replace(state_problem(measurements, matches), pose=pose, params=params)
    found = finish(problem, at_start(problem, engine))
    return replace(found, method="bound", nis=np.full(len(matches), np.nan))
