"""Two maps of one floor fused into one, by their joint covariances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from graphslam.arrays import frozen
from graphslam.geometry import Array, line_to_floor, wrap
from graphslam.line_maps.alignment import Alignment
from graphslam.line_maps.fit import MAX_STEPS, TOLERANCE, covariance_root
from graphslam.line_maps.line_map import LineMap, block_diagonal
from graphslam.models.line import LINE

PART_SIGMAS = 3.0
"""A further part of a matched line is fused with it when it lies within so many sigma of it."""
EXACT = (1e-6, 1e-6)
"""Standard deviations, m and rad, that stand for 0 where a map knows a line exactly."""


@dataclass(frozen=True, slots=True)
class Merged:
    """One map made of two, in the first's frame.

    Attributes:
        map: the fused lines, canonical, with the joint covariance of all; first those of the first
            map in its order, then those that only the second has. The first map's frame is exact
            by definition, the second's is estimated and marginalised.
        rows_a: for each line the rows of the first map that it is made of; may be none.
        rows_b: the same of the second.
        motion: (3,) ``a_T_b`` as estimated together with the lines.
        cov_motion: (3, 3) its covariance, a's frame.
    """

    map: LineMap
    rows_a: tuple[tuple[int, ...], ...]
    rows_b: tuple[tuple[int, ...], ...]
    motion: Array
    cov_motion: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "motion", frozen("motion", self.motion, (3,)))
        object.__setattr__(self, "cov_motion", frozen("cov_motion", self.cov_motion, (3, 3)))


def merge_line_maps(a: LineMap, b: LineMap, alignment: Alignment) -> Merged:
    """Returns two independent maps of one floor as one.

    Unknown are the lines in a's frame and the motion ``a_T_b``, of which nothing is known
    beforehand: each map's frame is known only by its own start. Least squares over all of them take
    both maps for measurements with their joint covariances; then the motion is marginalised.

    Args:
        a: whose frame is kept.
        b: independent of the first.
        alignment: of b on a, fixed in both directions.
    """
    rows_a, rows_b = _groups(a, b, alignment)
    motion = np.array(alignment.motion)
    lines = np.array(
        [
            a.lines[i[0]] if i else line_to_floor(b.lines[j[0]], motion)
            for i, j in zip(rows_a, rows_b, strict=True)
        ]
    )
    of_a, of_b = _group_of(rows_a, len(a)), _group_of(rows_b, len(b))
    root_a, root_b = covariance_root(a.cov, EXACT), covariance_root(b.cov, EXACT)
    cost = np.inf
    for _ in range(MAX_STEPS):
        e_a, J_a = _rows(np.zeros(3), lines, a.lines, of_a, root_a, moves=False)
        e_b, J_b = _rows(motion, lines, b.lines, of_b, root_b, moves=True)
        J, e = np.vstack([J_a, J_b]), np.concatenate([e_a, e_b])
        step = np.linalg.lstsq(J, -e, rcond=None)[0]
        motion, lines = motion + step[:3], lines + step[3:].reshape(-1, 2)
        now = float(np.sum((e + J @ step) ** 2))
        if cost - now <= TOLERANCE * (1.0 + now):
            break
        cost = now
    # by QR: the information itself would square the spread between exact and uncertain lines
    inner = np.linalg.inv(np.linalg.qr(J, mode="r"))
    cov = inner @ inner.T
    extent = _extents(a, b, lines, rows_a, rows_b, motion)
    fused = _canonical(lines, cov[3:, 3:], extent, _exact(a, rows_a))
    motion[2] = wrap(motion[2])
    return Merged(fused, rows_a, rows_b, motion, 0.5 * (cov[:3, :3] + cov[:3, :3].T))


Rows = tuple[tuple[int, ...], ...]


def _groups(a: LineMap, b: LineMap, alignment: Alignment) -> tuple[Rows, Rows]:
    """Returns for each line of the result the rows of both maps that it is made of."""
    partner = {int(i): [int(j)] for i, j in alignment.matches}
    owner = {int(j): int(i) for i, j in alignment.matches}
    joined: dict[int, list[int]] = {}
    for i, j in (pair for pair in alignment.parts.tolist() if _consistent(a, b, alignment, pair)):
        if i in partner and j not in owner:
            partner[i].append(j)
            owner[j] = i
        elif j in owner and i not in partner:
            joined.setdefault(owner[j], []).append(i)
    taken = {i for rows in joined.values() for i in rows}
    rows_a = [(i, *joined.get(i, ())) for i in range(len(a)) if i not in taken]
    rows_b = [tuple(partner.get(rows[0], ())) for rows in rows_a]
    alone = [j for j in range(len(b)) if j not in owner]
    return (*rows_a, *(() for _ in alone)), (*rows_b, *((j,) for j in alone))


def _consistent(a: LineMap, b: LineMap, alignment: Alignment, pair: Sequence[int]) -> bool:
    """Returns whether a part lies on its line to within `PART_SIGMAS` of both covariances."""
    i, j = pair
    e, _, J_a = LINE.residual(alignment.motion, a.lines[i], b.lines[j])
    cov = J_a @ a.blocks()[i] @ J_a.T + b.blocks()[j]
    white = np.linalg.solve(covariance_root(cov, EXACT), e)
    return bool(white @ white <= 2.0 * PART_SIGMAS**2)


def _group_of(groups: Rows, count: int) -> list[int]:
    """Returns for each row of a map the line of the result that it goes into."""
    owner = {row: g for g, rows in enumerate(groups) for row in rows}
    return [owner[row] for row in range(count)]


def _rows(
    pose: Array, lines: Array, measured: Array, group: Sequence[int], root: Array, moves: bool
) -> tuple[Array, Array]:
    """Returns whitened residuals (2 n,) of one map's lines, and their Jacobian.

    Columns of the Jacobian are the motion, then all lines of the result.
    """
    count = len(measured)
    at = np.broadcast_to(pose, (count, 3))
    e, J_pose, J_line = LINE.residual(at, lines[group], measured)
    J = np.zeros((count, 2, 3 + 2 * len(lines)))
    if moves:
        J[:, :, :3] = J_pose
    for row, g in enumerate(group):
        J[row, :, 3 + 2 * g : 5 + 2 * g] = J_line[row]
    white_J = np.linalg.solve(root, J.reshape(2 * count, -1))
    return np.asarray(np.linalg.solve(root, e.ravel())), np.asarray(white_J)


def _extents(
    a: LineMap, b: LineMap, lines: Array, rows_a: Rows, rows_b: Rows, motion: Array
) -> Array:
    """Returns (U, 2) from the first to the last end of all parts; NaN where none is known."""
    out = np.full((len(lines), 2), np.nan)
    frames = ((a, rows_a, np.zeros(3)), (b, rows_b, motion))
    for source, groups, pose in frames:
        for g, rows in enumerate(groups):
            for row in rows:
                one = slice(row, row + 1)
                laid = LINE.extent_on_landmark(
                    pose[None], lines[g : g + 1], source.lines[one], source.extent[one]
                )[0]
                out[g] = np.fmin(out[g, 0], laid[0]), np.fmax(out[g, 1], laid[1])
    return out


def _exact(a: LineMap, rows_a: Rows) -> Array:
    """Returns (U,) which lines of the result the first map knows exactly."""
    known = np.diagonal(a.cov).reshape(-1, 2).max(axis=1) == 0 if len(a) else np.zeros(0, bool)
    return np.array([any(known[i] for i in rows) for rows in rows_a], bool)


def _canonical(lines: Array, cov: Array, extent: Array, exact: Array) -> LineMap:
    lines, extent, blocks = LINE.canonical(lines, extent)
    J = block_diagonal(np.where(exact[:, None, None], 0.0, blocks))
    cov = J @ cov @ J.T
    return LineMap(lines, 0.5 * (cov + cov.T), extent)
