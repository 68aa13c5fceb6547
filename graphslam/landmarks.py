"""From the variables of an estimator to the map that is returned: extents, counts, one name."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from graphslam.geometry import Array
from graphslam.measurements import IntArray, LandmarkMap, Measurements, Sightings
from graphslam.models import MODELS, Model


def empty_map() -> LandmarkMap:
    """Returns a map without landmarks."""
    none = np.zeros(0, np.int64)
    return LandmarkMap(none, (), padded([]), np.zeros((0, 2)), none)


def padded(params: Sequence[Array]) -> Array:
    """Returns landmark parameters of any lengths as one array (M, l), padded with NaN."""
    width = max((len(p) for p in params), default=2)
    out = np.full((len(params), width), np.nan)
    for row, p in zip(out, params, strict=True):
        row[: len(p)] = p
    return out


def known_count(measurements: Measurements) -> int:
    """Returns how many landmarks are known; they are the first rows of every estimate's map."""
    return 0 if measurements.known is None else len(measurements.known)


@dataclass(frozen=True, slots=True)
class Used:
    """The sightings of one kind that an estimate uses, with their landmarks.

    Attributes:
        model: of the kind.
        table: all sightings of the kind.
        rows: (k,) rows of ``table`` that are used.
        index: (k,) the same, counted over all tables in order.
        landmark: (k,) row of each one's landmark in the map, -1 for kinds without landmarks.
        params: (k, l) parameters of those landmarks; l = 0 for kinds without landmarks.
    """

    model: Model
    table: Sightings
    rows: IntArray
    index: IntArray
    landmark: IntArray
    params: Array


def used_sightings(measurements: Measurements, match: IntArray, params: Array) -> Iterator[Used]:
    """Yields per kind the sightings that count: those with a match, and all that need none.

    Args:
        measurements: the tables of sightings.
        match: (K,) landmark of each sighting over all tables in order, -1 where it has none.
        params: (M, l) landmark parameters, padded with NaN.
    """
    for first, table in measurements.tables():
        model = MODELS[table.kind]
        landmark = match[first : first + len(table)]
        rows = np.flatnonzero(landmark >= 0) if model.dim_landmark else np.arange(len(table))
        own = np.zeros((len(rows), 0))
        if model.dim_landmark:
            own = params[landmark[rows], : model.dim_landmark]
        if len(rows):
            yield Used(model, table, rows, first + rows, landmark[rows], own)


def finish_map(
    measurements: Measurements,
    pose: Array,
    kinds: Sequence[str],
    params: Array,
    match: IntArray,
    cov_joint: Array,
) -> tuple[LandmarkMap, Array]:
    """Returns the canonical map with extents and counts, and the covariance that belongs to it.

    Args:
        measurements: the sightings behind the map; known landmarks keep their ids and extents,
            the latter widened by what was seen.
        pose: (N, 3) path from which the sightings' stretches are laid on the landmarks.
        kinds: (M,) kind of each landmark.
        params: (M, l) estimated parameters, padded with NaN, not yet canonical.
        match: (K,) landmark of each sighting, -1 where it has none.
        cov_joint: (3 + L, 3 + L) covariance of last pose and ``params``, floor frame.
    """
    count, known = len(kinds), measurements.known
    names = np.arange(count)
    if known is not None and len(known):
        names = np.concatenate([known.id, 1 + known.id.max() + names[: count - len(known)]])
    extent = stretches_seen(measurements, pose, params, match)
    sightings = np.bincount(match[match >= 0], minlength=count)
    label = labels_seen(measurements, match, count)
    draft = LandmarkMap(names, tuple(kinds), params, extent, sightings, label)
    return _canonical(draft, cov_joint)


def stretches_seen(
    measurements: Measurements, pose: Array, params: Array, match: IntArray
) -> Array:
    """Returns the stretch (M, 2) of each landmark that was seen or is known, m; NaN where neither.

    Args:
        measurements: the sightings, and the known landmarks with their extents.
        pose: (N, 3) path from which the sightings' stretches are laid on the landmarks.
        params: (M, l) landmarks, padded with NaN.
        match: (K,) landmark of each sighting, -1 where it has none.
    """
    extent, known = np.full((len(params), 2), np.nan), measurements.known
    if known is not None:
        extent[: len(known)] = known.extent
    for used in used_sightings(measurements, match, params):
        if used.model.dim_landmark:
            table, rows = used.table, used.rows
            seen = used.model.extent_on_landmark(
                pose[table.node[rows]], used.params, table.z[rows], table.extent[rows]
            )
            np.fmin.at(extent[:, 0], used.landmark, seen[:, 0])
            np.fmax.at(extent[:, 1], used.landmark, seen[:, 1])
    return extent


def labels_seen(measurements: Measurements, match: IntArray, count: int) -> IntArray:
    """Returns the label (M,) of each of ``count`` landmarks: known, or that of its sightings."""
    label, known = np.full(count, -1), measurements.known
    for first, table in measurements.tables():
        of = match[first : first + len(table)]
        np.maximum.at(label, of[of >= 0], table.label[of >= 0])
    if known is not None:
        label[: len(known)] = known.label
    return label


def _canonical(draft: LandmarkMap, cov_joint: Array) -> tuple[LandmarkMap, Array]:
    params, extent = draft.params.copy(), draft.extent.copy()
    offsets = draft.offsets()
    J = np.eye(len(cov_joint))
    for kind in sorted(set(draft.kind)):
        rows, values = draft.of_kind(kind)
        values, extent[rows], blocks = MODELS[kind].canonical(values, draft.extent[rows])
        params[rows, : values.shape[1]] = values
        for row, block in zip(rows, blocks, strict=True):
            at = slice(offsets[row], offsets[row + 1])
            J[at, at] = block
    named = LandmarkMap(draft.id, draft.kind, params, extent, draft.sightings, draft.label)
    return named, J @ cov_joint @ J.T
