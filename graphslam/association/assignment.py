"""Which sighting is of which landmark, by distances pair by pair or by known identity."""

from __future__ import annotations

import numpy as np

from graphslam.arrays import AnyArray
from graphslam.association.distances import Compatibility
from graphslam.measurements import IntArray

NEW = -2
DROPPED = -1


def assign(fit: Compatibility, taken: AnyArray | None = None) -> IntArray:
    """Returns for each sighting (k,) its landmark, `NEW`, or `DROPPED`.

    The nearest pair is taken first; each landmark takes one sighting. A sighting that is left over
    starts a landmark only where it lies beyond the second gate of *every* landmark; one in between,
    or second on a landmark that is taken, is dropped.

    Args:
        fit: distances as shares of the gates.
        taken: (M,) landmarks that have their sighting already.
    """
    result = leftover(fit)
    pairs = np.argwhere(fit.match <= 1.0)
    done = set() if taken is None else set(np.flatnonzero(taken).tolist())
    for row, landmark in pairs[np.argsort(fit.match[tuple(pairs.T)], kind="stable")].tolist():
        if result[row] < 0 and landmark not in done:
            result[row] = landmark
            done.add(landmark)
    return result


def leftover(fit: Compatibility) -> IntArray:
    """Returns what sightings (k,) are if none is matched: `NEW` or `DROPPED`."""
    near = (fit.new <= 1.0).any(axis=1) | (fit.match <= 1.0).any(axis=1)
    return np.where(near, DROPPED, NEW)


def by_identity(truth: IntArray, identity: IntArray) -> IntArray:
    """Returns for each sighting (k,) the landmark of its own identity, `NEW`, or `DROPPED`.

    Args:
        truth: (k,) true identity of each sighting; -1, which is dropped, where it has none.
        identity: (M,) true identity that each landmark was started with.
    """
    found = np.full(len(truth), NEW)
    if len(identity):
        same = truth[:, None] == identity[None, :]
        found = np.where(same.any(axis=1), same.argmax(axis=1), NEW)
    return np.where(truth < 0, DROPPED, found)
