"""One sighting as particles look at it: how far off each is, and where else each could be."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from graphslam.association import mahalanobis
from graphslam.geometry import Array, wrap
from graphslam.measurements import IntArray, LandmarkMap, Measurements, Sightings
from graphslam.models import MODELS, Model

LARGEST_BLOCK = 2**17
"""Pairs of a particle and a landmark looked at at a time."""
CROSSING = math.sin(math.radians(15.0))
"""Sine of the angle from which on two sighted lines fix a position together."""


@dataclass(frozen=True, slots=True)
class Look:
    """One sighting of a node, and the landmarks that it can be of.

    Attributes:
        model: of the sensor.
        z: (d,) the sighting, sensor's frame.
        cov: (d, d) its covariance.
        params: (M, l) the landmarks' parameters, floor frame.
        rows: (M,) their rows in the map; -1 for the one entry of a sensor without landmarks.
        number: which of all sightings it is.
    """

    model: Model
    z: Array
    cov: Array
    params: Array
    rows: IntArray
    number: int

    def distance(self, pose: Array) -> Array:
        """Returns the squared normalised residual (n,) of poses to the nearest landmark."""
        whiten = np.linalg.inv(np.linalg.cholesky(self.cov)).T
        block = max(1, LARGEST_BLOCK // len(self.params))
        out = np.empty(len(pose))
        for first in range(0, len(pose), block):
            part = pose[first : first + block]
            e = self.model.residual(part[:, None], self.params, self.z)[0] @ whiten
            out[first : first + block] = np.sum(e**2, axis=-1).min(axis=1)
        return out

    def drawn(self, count: int, rng: np.random.Generator) -> Array:
        """Returns sightings (count, d) with errors as its covariance states them."""
        error = rng.standard_normal((count, self.model.dim_z)) @ np.linalg.cholesky(self.cov).T
        return np.asarray(self.z + error)


def explainable(table: Sightings, known: LandmarkMap) -> bool:
    """Returns whether a map may explain a table: it has such landmarks, or none are needed."""
    return not MODELS[table.kind].dim_landmark or table.kind in known.kind


def looks_of(measurements: Measurements, known: LandmarkMap) -> Iterator[list[Look]]:
    """Yields, for each node, its sightings that the known map may explain."""
    nodes = len(measurements.t)
    tables = [(first, t) for first, t in measurements.tables() if explainable(t, known)]
    starts = [table.starts(nodes) for _, table in tables]
    landmarks = {}
    for _, table in tables:
        rows, params = known.of_kind(table.kind)
        sensor = np.array([-1]), np.zeros((1, 0))
        landmarks[table.kind] = (rows, params) if MODELS[table.kind].dim_landmark else sensor
    for node in range(nodes):
        looks = []
        for (first, table), start in zip(tables, starts, strict=True):
            rows, params = landmarks[table.kind]
            model = MODELS[table.kind]
            for k in range(start[node], start[node + 1]):
                looks.append(Look(model, table.z[k], table.cov[k], params, rows, first + k))
        yield looks


def crossing_pair(looks: Sequence[Look], one: int) -> list[int]:
    """Returns one sighting, and the first that crosses it where there is any."""
    return [one, *[i for i, look in enumerate(looks) if _crosses(looks[one], look)][:1]]


def put(pose: Array, chosen: Sequence[Look], width: Array, rng: np.random.Generator) -> Array:
    """Returns poses (n, 3) moved, by trigonometry, to where landmarks explain sightings.

    For each sighting a landmark is drawn by how well it fits what is not known yet: everything for
    the first, the position for the second.

    Args:
        pose: (n, 3) floor frame.
        chosen: one sighting, or two that cross.
        width: (3, 3) covariance of the poses, floor frame.
        rng: draws landmarks, and errors of the sightings.
    """
    rows: list[Array] = []
    for look in chosen:
        e, J, _ = look.model.residual(pose[:, None], look.params, look.z)
        cov = J @ width @ np.swapaxes(J, -1, -2) + look.cov
        log_p = -0.5 * mahalanobis(e, cov) + rng.gumbel(size=e.shape[:2])
        rows.append(look.params[np.argmax(log_p, axis=1)])
        parts = [
            earlier.model.residual(pose, row, earlier.drawn(len(pose), rng))[:2]
            for earlier, row in zip(chosen, rows, strict=False)
        ]
        e, J = (np.concatenate(part, axis=1) for part in zip(*parts, strict=True))
        pose = pose - (np.linalg.pinv(J) @ e[..., None])[..., 0]
        pose[:, 2] = wrap(pose[:, 2])
        width = width.copy()
        width[2], width[:, 2] = 0.0, 0.0  # the first sighting has told the heading
    return pose


def sharpness(looks: Sequence[Look]) -> Array:
    """Returns how far off (3,) a pose may be that one node's sightings still allow, m and rad."""
    sigma = np.concatenate([np.sqrt(np.diag(look.cov)) for look in looks])
    angular = np.concatenate([np.array(look.model.angular) for look in looks])
    length, angle = (
        float(own.mean()) if len(own) else 0.0 for own in (sigma[~angular], sigma[angular])
    )
    return np.array([length, length, angle])


def _crosses(one: Look, other: Look) -> bool:
    """Returns whether two sightings are of lines of clearly different directions."""
    if not (one.model.kind == other.model.kind and one.model.angular == (False, True)):
        return False
    return bool(abs(math.sin(one.z[1] - other.z[1])) > CROSSING)
