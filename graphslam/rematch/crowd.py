"""Where a match is worth nothing, because something would fit by chance."""

from __future__ import annotations

import math

import numpy as np

from graphslam.association import gate_for
from graphslam.config import RematchConfig
from graphslam.geometry import Array
from graphslam.models import Model
from graphslam.smoother.problem import Problem

DENSITY = 1.0
"""Landmarks expected for each unit of a residual's space (a line: m times rad) before any is seen.
It is a unit more than a figure: a tenth or ten times as many change a squared distance by 5."""


def most_surprise(S: Array) -> Array:
    """Returns the squared distances (...) beyond which chance explains a near miss better.

    The odds that two things are one, against two of which the second fell there by chance, are
    those of a difference under the covariance against `DENSITY`.

    Args:
        S: (..., d, d) covariances of differences.

    Source: the ratio of two likelihoods; as any textbook has it.
    """
    d = S.shape[-1]
    det = np.maximum(np.linalg.det(S), 1e-300)
    return np.asarray(-2.0 * math.log(DENSITY) - d * math.log(2.0 * math.pi) - np.log(det))


def by_chance(density: float, S: Array, config: RematchConfig) -> Array:
    """Returns how many landmarks (...) would lie within a gate by chance.

    A distance says how well two things fit, not how little else would: after a long stretch without
    a landmark seen twice everything fits something. There only groups of lines tell places apart.

    Args:
        density: of landmarks, see `density_of`.
        S: (..., d, d) covariances of residuals.
        config: the gate.
    """
    d = S.shape[-1]
    root = np.sqrt(np.maximum(np.linalg.det(S), 0.0))
    ball = math.pi ** (d / 2.0) / math.gamma(d / 2.0 + 1.0)
    volume = ball * gate_for(config.gate, d) ** (d / 2.0) * root
    return np.asarray(density * volume)


def density_of(problem: Problem, model: Model) -> float:
    """Returns how many landmarks of a kind there are for each unit of the residual's space.

    As if they were spread evenly over what is seen of them from the middle of the path.
    """
    landmarks = problem.of_kind(model.kind)
    params = problem.params[landmarks, : model.dim_landmark]
    middle = np.array([*problem.pose[:, :2].mean(axis=0), 0.0])
    zero = np.zeros((len(landmarks), model.dim_z))
    e, _, _ = model.residual(np.broadcast_to(middle, (len(landmarks), 3)), params, zero)
    width = math.sqrt(12.0) * e.std(axis=0) + 1e-9
    return len(landmarks) / float(np.prod(width))
