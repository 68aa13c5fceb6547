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
        if self._nodes * (state.size - 3) > LARGEST_HISTORY:
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
        return out


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
    own = zip(roster.offset[kept[roster.known :]], dims[roster.known :], strict=True)
    given = [row[:d] for row, d in zip(run.known, dims, strict=False)]
    params = padded([*given, *(run.state.mean[o : o + d] for o, d in own)])
    joint = run.state.joint(3, sum(dims[: roster.known]))
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
