"""Where a robot was on the map of corridors, by name, from an estimate of its path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from compare.places.building import Building
from graphslam.estimate import Estimate
from graphslam.geometry import Array

NOWHERE = "off the map"
SIGMAS = 2.0
RING = 8
"""Points of the ellipse of `SIGMAS` that must be in the same place for it to be sure."""


@dataclass(frozen=True, slots=True)
class Visit:
    """A stay in one place.

    Attributes:
        place: its name, or `NOWHERE`.
        t_from: s.
        t_to: s.
        sure: share of the time in which the ellipse of two sigma (86 %) lies in that place alone.
    """

    place: str
    t_from: float
    t_to: float
    sure: float


def place_at(building: Building, points: Array) -> NDArray[np.object_]:
    """Returns the names (...) of the places that hold points (..., 2), floor frame, m.

    Corners, doors and ends come before the corridors that they lie on; of several, that whose
    border is farthest.
    """
    points = np.asarray(points, float)
    inside = np.stack([place.holds(points) for place in building.places], axis=-1)
    corridor = np.array([place.kind == "corridor" for place in building.places])
    far = 1e6
    rank = np.where(inside >= 0, np.where(corridor, inside, inside + far), -np.inf)
    names = np.array([*(place.name for place in building.places), NOWHERE], object)
    found = np.where((inside >= 0).any(axis=-1), rank.argmax(axis=-1), len(building.places))
    return np.asarray(names[found])


def visits(building: Building, estimate: Estimate) -> tuple[Visit, ...]:
    """Returns where the robot was, one stay after the other."""
    here = place_at(building, estimate.pose[:, :2])
    around = place_at(building, _ellipses(estimate))
    sure = (around == here[:, None]).all(axis=1)
    starts = np.flatnonzero(np.concatenate([[True], here[1:] != here[:-1]]))
    ends = np.append(starts[1:], len(here))
    return tuple(
        Visit(
            str(here[a]),
            float(estimate.t[a]),
            float(estimate.t[min(b, len(here) - 1)]),
            float(sure[a:b].mean()),
        )
        for a, b in zip(starts.tolist(), ends.tolist(), strict=True)
    )


def _ellipses(estimate: Estimate) -> Array:
    """Returns points (N, RING, 2) on the ellipses of `SIGMAS` around all positions, m."""
    angle = 2.0 * np.pi * np.arange(RING) / RING
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    value, vector = np.linalg.eigh(estimate.cov_floor[:, :2, :2])
    axes = vector * np.sqrt(np.maximum(value, 0.0))[:, None, :]
    offset = SIGMAS * np.einsum("nij,kj->nki", axes, circle)
    return np.asarray(estimate.pose[:, None, :2] + offset)
