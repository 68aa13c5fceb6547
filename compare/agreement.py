"""How far two estimates of one run agree: all that can be said where there is no ground truth."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.optimize

from compare.align import line_differences
from compare.arrays import freeze_arrays
from compare.maps import line_sigmas, seen_middles
from compare.matching import assign, near_lines
from compare.metrics import rms
from graphslam.estimate import Estimate
from graphslam.geometry import Array, interpolate_poses, points_on_line, position_along, wrap
from graphslam.measurements import IntArray, Measurements
from graphslam.models.line import LINE


@dataclass(frozen=True, slots=True)
class MapAgreement:
    """Differences of two maps of lines, second minus first, floor frame, without any alignment.

    Attributes:
        row_a: (n,) rows in the first map of the lines that both have.
        row_b: (n,) the same in the second map.
        offset: (n,) difference across the line at the middle of the common stretch, m.
        d_alpha: (n,) difference in angle, rad.
        offset_sigmas: (n,) `offset` in standard deviations, the smaller of the two maps' own.
        alpha_sigmas: (n,) `d_alpha` likewise.
        only_a: lines that only the first map has.
        only_b: lines that only the second map has.
    """

    row_a: IntArray
    row_b: IntArray
    offset: Array
    d_alpha: Array
    offset_sigmas: Array
    alpha_sigmas: Array
    only_a: int
    only_b: int

    def __post_init__(self) -> None:
        freeze_arrays(self)

    @property
    def offset_rms_m(self) -> float:
        """RMS of `offset`, m."""
        return rms(self.offset)

    @property
    def alpha_rms_deg(self) -> float:
        """RMS of `d_alpha`, degrees."""
        return math.degrees(rms(self.d_alpha))

    @property
    def sigmas_rms(self) -> float:
        """RMS of `offset_sigmas` and `alpha_sigmas` together, where defined."""
        sigmas = np.concatenate([self.offset_sigmas, self.alpha_sigmas])
        return rms(sigmas[np.isfinite(sigmas)])


@dataclass(frozen=True, slots=True)
class Agreement:
    """Differences of two estimates, floor frame, without any alignment.

    Attributes:
        first: method of the first estimate.
        second: method of the second.
        nodes: how many nodes are compared.
        position_rms_m: RMS distance of the paths, m; NaN where they share no time.
        position_max_m: largest distance, m.
        heading_rms_deg: RMS difference in heading, degrees.
        last_position_m: distance at the last common node, m.
        map: differences of the maps, or None where one has no lines.
    """

    first: str
    second: str
    nodes: int
    position_rms_m: float
    position_max_m: float
    heading_rms_deg: float
    last_position_m: float
    map: MapAgreement | None


def agreement(a: Estimate, b: Estimate, measurements: Measurements) -> Agreement:
    """Returns how two estimates from the same measurements differ.

    Paths are compared at the nodes of ``a`` that ``b`` covers, interpolating ``b`` where its nodes
    are others.
    """
    common = (a.t >= b.t[0]) & (a.t <= b.t[-1])
    difference = interpolate_poses(a.t[common], b.t, b.pose) - a.pose[common]
    distance = np.hypot(difference[:, 0], difference[:, 1])
    return Agreement(
        first=a.method,
        second=b.method,
        nodes=len(distance),
        position_rms_m=rms(distance),
        position_max_m=float(distance.max(initial=0.0)) if len(distance) else float("nan"),
        heading_rms_deg=math.degrees(rms(wrap(difference[:, 2]))),
        last_position_m=float(distance[-1]) if len(distance) else float("nan"),
        map=_map_agreement(a, b, measurements),
    )


def _map_agreement(a: Estimate, b: Estimate, measurements: Measurements) -> MapAgreement | None:
    rows_a, lines_a = a.map.of_kind(LINE.kind)
    rows_b, lines_b = b.map.of_kind(LINE.kind)
    if len(rows_a) == 0 or len(rows_b) == 0:
        return None
    pairs = _same_sightings(a, b, rows_a, rows_b)
    if pairs is None:
        middle = seen_middles(a, measurements, rows_a)
        stretch_a, stretch_b = a.map.extent[rows_a], b.map.extent[rows_b]
        near = near_lines(np.zeros(3), lines_a, middle, stretch_a, lines_b, stretch_b)
        target, own = assign(near, np.ones(len(rows_b), bool))
        pairs = np.flatnonzero(own), target[own]
    i, j = pairs
    s_a = _common_middles(a, b, measurements, rows_a[i], rows_b[j])
    s_b = position_along(lines_b[j], points_on_line(lines_a[i], s_a))
    e, _ = line_differences(np.zeros(3), lines_a[i], s_a, lines_b[j])
    offset_a, alpha_a = line_sigmas(a, rows_a[i], s_a)
    offset_b, alpha_b = line_sigmas(b, rows_b[j], s_b)
    return MapAgreement(
        row_a=rows_a[i],
        row_b=rows_b[j],
        offset=-e[:, 0],
        d_alpha=-e[:, 1],
        offset_sigmas=_in_sigmas(-e[:, 0], offset_a, offset_b),
        alpha_sigmas=_in_sigmas(-e[:, 1], alpha_a, alpha_b),
        only_a=len(rows_a) - len(i),
        only_b=len(rows_b) - len(j),
    )


def _same_sightings(
    a: Estimate, b: Estimate, rows_a: IntArray, rows_b: IntArray
) -> tuple[IntArray, IntArray] | None:
    """Returns which lines of two maps share most sightings, or None where sightings do not tell.

    Lines that share no sighting are not paired.
    """
    if len(a.match) != len(b.match):
        return None
    both = (a.match >= 0) & (b.match >= 0)
    shared = np.zeros((len(a.map), len(b.map)))
    np.add.at(shared, (a.match[both], b.match[both]), 1.0)
    shared = shared[np.ix_(rows_a, rows_b)]
    if not shared.any():
        return None
    i, j = scipy.optimize.linear_sum_assignment(shared, maximize=True)
    paired = shared[i, j] > 0
    return i[paired], j[paired]


def _common_middles(
    a: Estimate, b: Estimate, measurements: Measurements, rows_a: IntArray, rows_b: IntArray
) -> Array:
    """Returns the middle of the stretch that both maps saw, as positions on the first's lines, m.

    Where the stretches do not meet it is the middle of the gap; where one is unknown it is the
    middle of the other's, and where both are, where the first saw the line.
    """
    lines_a, lines_b = a.map.params[rows_a, :2], b.map.params[rows_b, :2]
    ends_b = points_on_line(lines_b[:, None], b.map.extent[rows_b])
    stretch_b = np.sort(position_along(lines_a[:, None], ends_b), axis=1)
    stretch_a = a.map.extent[rows_a]
    low = np.fmax(stretch_a[:, 0], stretch_b[:, 0])
    high = np.fmin(stretch_a[:, 1], stretch_b[:, 1])
    middle = 0.5 * (low + high)
    return np.where(np.isnan(middle), seen_middles(a, measurements, rows_a), middle)


def _in_sigmas(difference: Array, sigma_a: Array, sigma_b: Array) -> Array:
    """Returns differences over the smaller sigma; NaN where that is 0 (a landmark known before)."""
    sigma = np.minimum(sigma_a, sigma_b)
    out = np.full(len(sigma), np.nan)
    return np.asarray(np.divide(difference, sigma, out=out, where=sigma > 0))
