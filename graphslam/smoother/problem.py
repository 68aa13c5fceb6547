"""What there is to minimise, and what a minimum offers, whichever engine finds it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from graphslam.arrays import frozen
from graphslam.baseline import propagate
from graphslam.errors import BadMeasurements, UnderConstrained
from graphslam.estimate import Estimate
from graphslam.geometry import Array
from graphslam.landmarks import known_count, padded
from graphslam.measurements import IntArray, Measurements, Sightings
from graphslam.models import MODELS
from graphslam.models.base import Delayed

MOST_FOR_START = 20
"""Sightings that start a landmark which one does not."""
NOT_DETERMINED = "the measurements do not determine every pose and landmark: "


@dataclass(frozen=True, slots=True)
class Problem:
    """A non-linear least-squares problem: a chain of poses, landmarks, and who saw which.

    The cost is half the sum of squared normalised residuals: the start's, the increments' (each
    times its ``odometry_weight``) and those of all sightings in use (each times its ``weight``).

    Attributes:
        measurements: nodes, start, odometry and sightings with their covariances.
        match: (K,) landmark of each sighting over all tables in order, numbered from 0; -1 leaves
            it out (sightings of kinds without landmarks always count).
        kinds: (M,) kind of each landmark.
        fixed: (M,) whether a landmark stays at ``params``; it is then no variable.
        pose: (N, 3) where to start, floor frame.
        params: (M, l) where landmarks start, floor frame, padded with NaN.
        weight: (K,) factor on each sighting's information; 1 unless a robust method lowers it, 0
            switches the sighting off.
        odometry_weight: (N-1,) the same for each increment.
    """

    measurements: Measurements
    match: IntArray
    kinds: tuple[str, ...]
    fixed: NDArray[np.bool_]
    pose: Array
    params: Array
    weight: Array
    odometry_weight: Array

    def __post_init__(self) -> None:
        count, nodes = self.measurements.sighting_count, len(self.measurements.t)
        shapes: dict[str, tuple[tuple[int | None, ...], type, bool]] = {
            "match": ((count,), int, False),
            "fixed": ((len(self.kinds),), bool, False),
            "pose": ((nodes, 3), float, False),
            "params": ((len(self.kinds), None), float, True),
            "weight": ((count,), float, False),
            "odometry_weight": ((nodes - 1,), float, False),
        }
        for name, (shape, dtype, nan) in shapes.items():
            value = frozen(f"problem.{name}", getattr(self, name), shape, dtype, nan)
            object.__setattr__(self, name, value)
        if np.any(self.weight < 0) or np.any(self.odometry_weight <= 0):
            raise BadMeasurements("weights must not be negative, nor 0 for odometry")

    def dims(self) -> list[int]:
        """Returns the number of parameters of each landmark, fixed ones included."""
        return [MODELS[kind].dim_landmark for kind in self.kinds]

    def of_kind(self, kind: str) -> IntArray:
        """Returns the landmarks of one kind."""
        return np.flatnonzero(np.array(self.kinds, dtype=object) == kind)


class Minimum(Protocol):
    """Where an engine ended, and how uncertain it is there.

    Attributes:
        pose: (N, 3) poses, floor frame.
        params: (M, l) landmarks, floor frame, padded with NaN, not made canonical.
        cost: half the weighted sum of squared normalised residuals.
        iterations: linear systems solved.
        converged: whether the tolerance was met.
    """

    @property
    def pose(self) -> Array: ...
    @property
    def params(self) -> Array: ...
    @property
    def cost(self) -> float: ...
    @property
    def iterations(self) -> int: ...
    @property
    def converged(self) -> bool: ...

    def covariances(self) -> tuple[Array, Array]:
        """Returns those of all poses (N, 3, 3) and of last pose and map (3 + L, 3 + L).

        Floor frame; landmarks in the problem's order, rows and columns of fixed ones 0.

        Raises:
            UnderConstrained: the system is singular.
        """
        ...

    def pair_covariances(self, node: IntArray, landmark: IntArray) -> Array:
        """Returns joint covariances (k, 3 + l, 3 + l) of poses and landmarks, floor frame.

        Args:
            node: (k,) nodes.
            landmark: (k,) landmarks of one number l of parameters; fixed ones get zeros.
        """
        ...

    def map_log_det(self) -> float:
        """Returns the logarithm of the determinant of the free landmarks' joint covariance."""
        ...


def state_problem(
    measurements: Measurements,
    matches: IntArray,
    initial: Estimate | None = None,
    weight: Array | None = None,
    odometry_weight: Array | None = None,
) -> Problem:
    """Returns the problem that measurements and matches pose, started from an estimate.

    Args:
        measurements: nodes, odometry, sightings; the rows of ``known`` are the first landmarks.
        matches: (K,) landmark of each sighting over all tables in order, numbered from 0 without
            gaps (known landmarks need no sighting); -1 leaves a sighting out.
        initial: path and map to start from, its map in the numbering of ``matches``; without it,
            dead reckoning and each landmark's first sighting.
        weight: (K,) factors on the sightings' information; 1 where not given.
        odometry_weight: (N-1,) factors on the increments' information; 1 where not given.

    Raises:
        BadMeasurements: ``matches`` or ``initial`` do not belong to the measurements.
        UnderConstrained: a landmark cannot be started from its sightings.
    """
    matches = np.asarray(matches)
    kinds = _kinds(measurements, matches)
    if initial is None:
        pose, _ = propagate(measurements)
        params = _first_guess(measurements, matches, pose, len(kinds))
    else:
        if len(initial.pose) != len(measurements.t) or initial.map.kind != kinds:
            raise BadMeasurements("initial is an estimate of another path or another map")
        pose, params = initial.pose, initial.map.params
    fixed = np.arange(len(kinds)) < known_count(measurements)
    if weight is None:
        weight = np.ones(len(matches))
    if odometry_weight is None:
        odometry_weight = np.ones(len(pose) - 1)
    return Problem(measurements, matches, kinds, fixed, pose, params, weight, odometry_weight)


def _kinds(measurements: Measurements, matches: IntArray) -> tuple[str, ...]:
    if matches.shape != (measurements.sighting_count,):
        raise BadMeasurements(
            f"matches has shape {matches.shape}; there are {measurements.sighting_count} sightings"
        )
    known = measurements.known.kind if measurements.known is not None else ()
    count = int(matches.max(initial=-1)) + 1
    kinds = [*known, *[""] * (count - len(known))]
    for first, table in measurements.tables():
        for landmark in np.unique(matches[first : first + len(table)]):
            if landmark >= 0:
                if kinds[landmark] not in ("", table.kind):
                    raise BadMeasurements(f"landmark {landmark} is matched by two kinds")
                kinds[landmark] = table.kind
    if "" in kinds:
        raise BadMeasurements(f"no sighting is matched to landmark {kinds.index('')}")
    return tuple(kinds)


def _first_guess(measurements: Measurements, matches: IntArray, pose: Array, count: int) -> Array:
    params: list[Array | None] = [None] * count
    known = measurements.known
    if known is not None:
        dims = [MODELS[kind].dim_landmark for kind in known.kind]
        params[: len(known)] = [row[:d] for row, d in zip(known.params, dims, strict=True)]
    for first, table in measurements.tables():
        of = matches[first : first + len(table)]
        for landmark in np.unique(of[of >= 0]).tolist():
            if params[landmark] is None:
                params[landmark] = _started(table, np.flatnonzero(of == landmark), pose)
    found = [p for p in params if p is not None]
    if len(found) < count:
        raise UnderConstrained(
            f"{count - len(found)} of {count} landmarks cannot be started from their sightings; "
            "give an initial estimate or leave their matches out"
        )
    return padded(found)


def _started(table: Sightings, rows: IntArray, pose: Array) -> Array | None:
    """Returns a landmark from its first sighting, else from several; None where none suffice."""
    model, first = MODELS[table.kind], rows[0]
    started = model.initialise(pose[table.node[first]], table.z[first], table.cov[first])
    if started is not None:
        return started[0]
    if not isinstance(model, Delayed):
        return None
    some = rows[np.unique(np.linspace(0, len(rows) - 1, MOST_FOR_START).astype(int))]
    return model.initialise_from(pose[table.node[some]], None, table.z[some], table.cov[some])
