"""Motions that many pairs of lines vote for: where the search for an alignment begins."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.ndimage
from numba import njit

from graphslam.geometry import (
    Array,
    distance_from_line,
    points_on_line,
    position_along,
    rotation,
    wrap,
)
from graphslam.line_maps.config import AlignmentConfig
from graphslam.line_maps.correspondence import Side
from graphslam.measurements import IntArray

BIN_DEG = 0.1
"""Bin of the angle histogram."""
NARROWEST_DEG = 0.5
"""Half width of the triangle that spreads a vote for an angle, at least."""
ROTATIONS = 12
"""Peaks of the angle histogram that are followed, each with its opposite."""
WEAKEST_ANGLE, WEAKEST_SHIFT = 0.3, 0.25
"""Peaks below this part of the highest are not followed."""
APART = 2
"""Peaks of the votes for a shift lie more than so many cells apart."""
MOST_CELLS = 1200
"""Cells along each side of the votes for a shift; beyond, cells grow."""


@dataclass(frozen=True, slots=True)
class Near:
    """Where alignments are looked for, when something is known of the motion beforehand.

    Attributes:
        motion: (3,) expected ``a_T_b``, m and rad.
        cov: (3, 3) its covariance, a's frame.
        gate: squared number of standard deviations within which turn and shift lie.
    """

    motion: Array
    cov: Array
    gate: float

    def allows(self, theta: Array, slack: float) -> Array:
        """Returns (R,) which turns lie within the gate or ``slack``, rad, beyond it."""
        reach = math.sqrt(self.gate * self.cov[2, 2]) + slack
        return np.asarray(np.abs(wrap(theta - self.motion[2])) <= reach)

    def box(self, theta: float, point: Array) -> tuple[Array, Array]:
        """Returns the middle (2,) and half sides (2,) of where ``point`` of b comes to lie.

        Args:
            theta: turn that is tried, rad.
            point: (2,) b's frame, m.
        """
        lever = rotation(float(self.motion[2])) @ point
        J = np.array([[1.0, 0.0, -lever[1]], [0.0, 1.0, lever[0]]])
        half = np.sqrt(self.gate * np.diagonal(J @ self.cov @ J.T))
        turned = rotation(theta) @ point
        straight = self.motion[:2] + lever
        bent = self.motion[:2] + turned
        return 0.5 * (straight + bent), half + 0.5 * np.abs(straight - bent)


def hypotheses(a: Side, b: Side, config: AlignmentConfig, near: Near | None = None) -> Array:
    """Returns motions ``a_T_b`` (H, 3), most votes first, at most ``config.hypotheses``.

    Where ``near`` is given, only motions within its gate.
    """
    if not len(a.lines) or not len(b.lines):
        return np.zeros((0, 3))
    found: list[tuple[float, float, float, float]] = []
    turns = rotations(a, b, config)
    if near is not None:
        turns = turns[near.allows(turns, math.radians(config.angle_deg))]
    for theta in turns:
        found += [(votes, x, y, theta) for votes, x, y in _shifts(theta, a, b, config, near)]
    if not found:
        return np.zeros((0, 3))
    table = np.array(found)
    # equal votes are told apart by the smaller turn, then by the shift, never by chance
    order = np.lexsort((table[:, 2], table[:, 1], np.abs(table[:, 3]), -np.round(table[:, 0], 9)))
    table = table[order]
    strong = table[:, 0] >= WEAKEST_SHIFT * table[0, 0]
    return np.asarray(table[strong][: config.hypotheses, 1:])


def rotations(a: Side, b: Side, config: AlignmentConfig) -> Array:
    """Returns turns (R,), rad, that many pairs of lines allow, each with its opposite."""
    turn, weight = _turns(a, b)
    if not weight.any():
        return np.zeros(0)
    spread = np.sqrt(np.median(a.cov[:, 1, 1]) + np.median(b.cov[:, 1, 1]))
    half = float(np.clip(2.0 * np.degrees(spread), NARROWEST_DEG, config.angle_deg))
    bins = round(180.0 / BIN_DEG)
    at = np.floor(np.degrees(turn) / BIN_DEG).astype(np.int64) % bins
    votes = np.bincount(at, weight, bins)
    reach = round(half / BIN_DEG)
    kernel = 1.0 - np.abs(np.arange(-reach, reach + 1)) / (reach + 1.0)
    votes = scipy.ndimage.convolve1d(votes, kernel, mode="wrap")
    ring = scipy.ndimage.maximum_filter1d(votes, 2 * reach + 1, mode="wrap")
    peaks = np.flatnonzero((votes == ring) & (votes >= WEAKEST_ANGLE * votes.max()))
    peaks = peaks[np.lexsort((peaks, -np.round(votes[peaks], 9)))][:ROTATIONS]
    theta = np.array([_mean_turn(turn, weight, (p + 0.5) * BIN_DEG, half) for p in peaks])
    return np.asarray(wrap(np.concatenate([theta, theta + math.pi])))


def _turns(a: Side, b: Side) -> tuple[Array, Array]:
    """Returns the turn in [0, pi) from each line of b to each of a, and its weight, flat."""
    turn = np.mod(a.lines[:, None, 1] - b.lines[None, :, 1], math.pi).ravel()
    return turn, np.minimum(a.length[:, None], b.length[None, :]).ravel()


def _mean_turn(turn: Array, weight: Array, near_deg: float, half_deg: float) -> float:
    """Returns the weighted mean of the turns within ``half_deg`` of an angle, modulo pi."""
    near = math.radians(near_deg)
    away = 0.5 * wrap(2.0 * (turn - near))
    close = np.abs(away) <= math.radians(half_deg)
    total = weight[close].sum()
    return near + float(weight[close] @ away[close] / total) if total > 0 else near


def parallel_pairs(
    theta: float, a: Side, b: Side, config: AlignmentConfig
) -> tuple[IntArray, IntArray]:
    """Returns rows (i, j) of all lines that are parallel, within tolerance, after a turn."""
    away = 0.5 * np.abs(wrap(2.0 * (a.lines[:, None, 1] - b.lines[None, :, 1] - theta)))
    sigma = np.sqrt(a.cov[:, None, 1, 1] + b.cov[None, :, 1, 1])
    i, j = np.nonzero(away <= np.maximum(2.0 * math.radians(config.angle_deg), 2.0 * sigma))
    return i, j


def _shifts(
    theta: float, a: Side, b: Side, config: AlignmentConfig, near: Near | None
) -> list[tuple[float, float, float]]:
    """Returns (votes, x, y) of the shifts that most common length speaks for, after a turn."""
    i, j = parallel_pairs(theta, a, b, config)
    if not len(i):
        return []
    centre = b.middle.mean(axis=0)
    turned = (b.middle - centre) @ rotation(theta).T
    half_b = 0.5 * b.length
    across, along = a.lines[i, 1], position_along(a.lines[i], turned[j])
    shift = -distance_from_line(a.lines[i], turned[j])
    away = np.column_stack([-along - half_b[j], half_b[j] - along])
    span = a.stretch[i] + away
    most = np.minimum(a.length[i], b.length[j])
    line = np.column_stack([shift, across])
    ends = points_on_line(line[:, None], span).reshape(-1, 2)
    low, high = ends.min(axis=0), ends.max(axis=0)
    if near is not None:
        middle, half = near.box(theta, centre)
        low = np.maximum(low, middle - half - config.far_m)
        high = np.minimum(high, middle + half + config.far_m)
        if np.any(high <= low):
            return []
    cell = max(config.cell_m, float((high - low).max()) / MOST_CELLS)
    shape = np.ceil((high - low) / cell).astype(np.int64) + 1
    votes = np.zeros((int(shape[0]), int(shape[1])))
    _vote(votes, line, span, most, low, cell)
    origin = low - rotation(theta) @ centre
    return [
        (count, float(origin[0] + cell * x), float(origin[1] + cell * y))
        for count, x, y in _peaks(votes / cell, config.hypotheses)
    ]


def _peaks(votes: Array, most: int) -> list[tuple[float, int, int]]:
    """Returns (votes, column, row) of the highest cells that are no neighbours of each other."""
    for axis in (0, 1):
        votes = scipy.ndimage.convolve1d(votes, [1.0, 2.0, 1.0], axis, mode="constant")
    ring = scipy.ndimage.maximum_filter(votes, 2 * APART + 1, mode="constant")
    x, y = np.nonzero((votes == ring) & (votes >= WEAKEST_SHIFT * votes.max()))
    x, y = x[votes[x, y] > 0.0], y[votes[x, y] > 0.0]
    found: list[tuple[float, int, int]] = []
    for k in np.lexsort((y, x, -np.round(votes[x, y], 9))):
        here = (float(votes[x[k], y[k]]), int(x[k]), int(y[k]))
        if not any(max(abs(here[1] - p[1]), abs(here[2] - p[2])) <= APART for p in found):
            found.append(here)
        if len(found) == most:
            break
    return found


@njit(cache=True)
def _vote(votes, line, span, most, low, cell):  # type: ignore[no-untyped-def]
    """Adds to each cell the length that pairs of lines would share at its shift.

    A pair fixes the shift across itself; along itself every shift between the ends of ``span``
    leaves a common stretch, longest in the middle.
    """
    for k in range(len(line)):
        c, s = math.cos(line[k, 1]), math.sin(line[k, 1])
        u = span[k, 0]
        while u <= span[k, 1]:
            x = line[k, 0] * c - u * s
            y = line[k, 0] * s + u * c
            shared = min(u - span[k, 0], span[k, 1] - u, most[k])
            column = round((x - low[0]) / cell)
            row = round((y - low[1]) / cell)
            if 0 <= column < votes.shape[0] and 0 <= row < votes.shape[1]:
                votes[column, row] += shared * cell
            u += cell
