"""What a run of the filter leaves: the estimate, and what was known of each landmark when."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from graphslam.ending import end
from graphslam.estimate import Estimate
from graphslam.geometry import Array
from graphslam.kalman import JointState
from graphslam.landmarks import padded
from graphslam.measurements import IntArray
from graphslam.models import MODELS
from graphslam.roster import GONE, Roster

if TYPE_CHECKING:
    from graphslam.ekf import Filter

LARGEST_HISTORY = 4_000_000
"""Most entries of the landmarks' variances over time that are kept: 32 MB."""


class History:
    """The landmarks' variances at each node, as long as they are few enough to keep."""

    def __init__(self, nodes: int) -> None:
        self._nodes = nodes
        self._entries: list[tuple[IntArray, Array]] | None = []

    def __len__(self) -> int:
        return 0 if self._entries is None else len(self._entries)

    def cut(self, length: int) -> None:
        """Forgets all nodes but the first ``length``."""
        if self._entries is not None:
            del self._entries[length:]

    def remember(self, roster: Roster, state: JointState, others: IntArray) -> None:
        """Keeps the variances of the landmarks: of all entries behind the pose but ``others``."""
        if self._entries is None:
            return
        variances = np.diagonal(state.P).copy()
        kept = np.delete(variances, others) if len(others) else variances
        self._entries.append((roster.free(), kept[3:]))
        left = sum(len(params) for params, _ in roster.left.values())
        if self._nodes * (state.size - 3 + left) > LARGEST_HISTORY:
            self._entries = None

    def table(self, roster: Roster, kept: IntArray) -> Array | None:
        """Returns variances (N, L) of the landmarks ``kept``, NaN before they were started."""
        if self._entries is None:
            return None
        dims = np.array([MODELS[kind].dim_landmark for kind in roster.kinds], np.int64)
        first = np.full(len(roster), -1)
        first[kept] = np.concatenate([[0], np.cumsum(dims[kept])])[:-1]
        out = np.full((len(self._entries), int(dims[kept].sum())), np.nan)
        out[:, : int(dims[: roster.known].sum())] = 0.0
        for entry, (rows, variances) in zip(out, self._entries, strict=True):
            place = np.repeat(first[rows], dims[rows])
            start = np.repeat(np.cumsum(dims[rows]) - dims[rows], dims[rows])
            column = place + np.arange(len(place)) - start
            entry[column[place >= 0]] = variances[place >= 0]
        for row, (params, cov) in roster.left.items():
            own = slice(int(first[row]), int(first[row]) + len(params))
            since = int(np.max(np.flatnonzero(np.isfinite(out[:, own.start])), initial=-1)) + 1
            out[since:, own] = np.diag(cov)
        return out


def _map(run: Filter, kept: IntArray, dims: list[int]) -> tuple[list[Array], Array]:
    """Returns parameters and joint covariance, with the last pose, of landmarks ``kept``.

    What was left behind has its own covariance and none with anything else.
    """
    state, roster = run.state, run.roster
    P = state.symmetric()
    end = np.cumsum([3, *dims])
    joint = np.zeros((end[-1], end[-1]))
    params = [run.known[row, :d] for row, d in zip(range(roster.known), dims, strict=False)]
    inside, outside = [np.arange(3)], [np.arange(3)]
    for k in range(roster.known, len(kept)):
        row, own = int(kept[k]), np.arange(end[k], end[k + 1])
        if row in roster.left:
            values, cov = roster.left[row]
            joint[np.ix_(own, own)] = 0.5 * (cov + cov.T)
        else:
            inside.append(int(roster.offset[row]) + np.arange(dims[k]))
            outside.append(own)
            values = state.mean[inside[-1]]
        params.append(values)
    i, o = np.concatenate(inside), np.concatenate(outside)
    joint[np.ix_(o, o)] = P[np.ix_(i, i)]
    return params, joint


def result(run: Filter, pose: Array, cov: Array) -> Estimate:
    """Returns the estimate of a run.

    Args:
        run: after its last node.
        pose: (N, 3) poses as each was known at its time.
        cov: (N, 3, 3) their covariances.
    """
    m, roster = run.measurements, run.roster
    kept = np.flatnonzero(roster.offset != GONE)
    kinds = [roster.kinds[row] for row in kept]
    dims = [MODELS[kind].dim_landmark for kind in kinds]
    row_of = np.append(np.full(len(roster), -1), -1)
    row_of[kept] = np.arange(len(kept))
    match = row_of[run.match]
    gone = (run.match >= 0) & (match < 0)
    found, joint = _map(run, kept, dims)
    params = padded(found)
    used, cov = run.used & ~gone, 0.5 * (cov + np.swapaxes(cov, 1, 2))
    ending = end(m, pose, cov, kinds, params, match, used, joint)
    return Estimate(
        method=run.name,
        causal=True,
        t=m.t,
        pose=pose,
        cov_floor=cov,
        map=ending.map,
        cov_joint=ending.cov_joint,
        match=match,
        used=used,
        nis=np.where(gone, np.nan, run.nis),
        weight=np.ones(len(match)),
        unobserved=ending.unobserved,
        counts={reason: n for reason, n in sorted(run.counts.items()) if n},
        map_variance=run.history.table(roster, kept),
        innovation=run.innovation if run.innovation.any() else None,
    )
