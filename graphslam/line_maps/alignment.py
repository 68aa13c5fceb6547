"""Every rigid motion that lays one line map on another, found without a start value."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from graphslam.arrays import frozen
from graphslam.geometry import Array, inverse, transform_points
from graphslam.line_maps.config import AlignmentConfig
from graphslam.line_maps.correspondence import Agreement
from graphslam.line_maps.fit import Fit, fit_motion, slide_direction
from graphslam.line_maps.line_map import LineMap
from graphslam.line_maps.settle import Both, agreement_at, agreement_of, settle
from graphslam.line_maps.votes import Near, hypotheses
from graphslam.measurements import IntArray

HOPELESS = 0.25
"""A motion that holds less than this part of the best one's score is given up half way."""
REFUSED = 0.9
"""Where the fit by joint covariances keeps less than this part of the score it is not taken."""
UNKNOWN_SIGMA = 1e3
"""Standard deviation, m, along a direction that is not fixed."""


@dataclass(frozen=True, slots=True)
class Alignment:
    """One way to lay the second map, b, on the first, a.

    Attributes:
        motion: (3,) ``a_T_b``: `geometry.line_to_floor` with it takes b's lines into a's frame.
        cov: (3, 3) its covariance in a's frame, as good as both maps' covariances are;
            `UNKNOWN_SIGMA` along ``slide``.
        information: (3, 3) its inverse, exactly singular where the motion is not fixed.
        slide: (2,) unit vector in a's frame along which the lines fix no shift; None where both
            directions are fixed. The turn is always fixed.
        matches: (K, 2) rows of a and of b that are the same line, one to one, sorted.
        parts: (S, 2) further rows that agree: one of the two has its own match in `matches`, the
            other is a part of the same line.
        common: (K, 2) stretch of each match that both maps have, along b's line, m.
        agree_m: length in agreement, m, each match weighted by how well it agrees.
        conflict_m: length of unmatched lines that lie just beside a line of the other map, m.
        expected_m: length of either map, on average, where the other one reaches, m.
    """

    motion: Array
    cov: Array
    information: Array
    slide: Array | None
    matches: IntArray
    parts: IntArray
    common: Array
    agree_m: float
    conflict_m: float
    expected_m: float

    def __post_init__(self) -> None:
        count = len(self.matches)
        shapes: dict[str, tuple[tuple[int | None, ...], type]] = {
            "motion": ((3,), float),
            "cov": ((3, 3), float),
            "information": ((3, 3), float),
            "matches": ((count, 2), int),
            "parts": ((None, 2), int),
            "common": ((count, 2), float),
        }
        if self.slide is not None:
            shapes["slide"] = ((2,), float)
        for name, (shape, dtype) in shapes.items():
            value = frozen(f"alignment.{name}", getattr(self, name), shape, dtype)
            object.__setattr__(self, name, value)

    @property
    def score_m(self) -> float:
        """Length in agreement less length in conflict, m: what alignments are ranked by."""
        return self.agree_m - self.conflict_m

    @property
    def fixed(self) -> bool:
        """Whether the lines fix the shift in both directions."""
        return self.slide is None

    @property
    def consistency(self) -> float:
        """Score as a share of what both maps would have if neither missed a line."""
        return self.score_m / self.expected_m if self.expected_m > 0 else 0.0


def find_alignments(
    a: LineMap, b: LineMap, config: AlignmentConfig | None = None, within: Near | None = None
) -> tuple[Alignment, ...]:
    """Returns the ways to lay map ``b`` on map ``a``, best first; none where nothing agrees.

    Turns come from a histogram of differences in angle, shifts from votes weighted by common
    length; each candidate is refined by weighted least squares with the covariances of both lines
    and then judged by the length in agreement. On a periodic floor many alignments fit equally
    well: see `ambiguity`. The result depends on nothing but the arguments.

    Args:
        a: the map that stays.
        b: the map that moves.
        config: tolerances; None for the defaults.
        within: what is known of the motion beforehand; None where nothing is. The search takes less
            time within it; what it finds may settle a little beyond.
    """
    config = config or AlignmentConfig()
    if not len(a) or not len(b):
        return ()
    both = Both.of(a, b, config)
    found: list[tuple[Array, Agreement]] = []
    near: dict[float, tuple[IntArray, IntArray]] = {}
    best = 0.0
    for start in hypotheses(both.side_a, both.side_b, config, within):
        theta = float(start[2])
        if theta not in near:
            near[theta] = both.parallel(theta)
        settled = settle(start, near[theta], both, HOPELESS * best)
        if settled is not None and settled[1].score_m > 0:
            found.append(settled)
            best = max(best, settled[1].score_m)
    found.sort(key=lambda entry: _order(entry[1].score_m, entry[0]))
    kept = _distinct(found, both)[: config.most]
    finished = [_finish(motion, what, both) for motion, what in kept]
    return tuple(sorted(finished, key=lambda entry: _order(entry.score_m, entry.motion)))


def refine_alignment(
    a: LineMap, b: LineMap, start: Array, config: AlignmentConfig | None = None
) -> Alignment | None:
    """Returns the alignment near a motion ``start`` (3,); None where nothing agrees there."""
    config = config or AlignmentConfig()
    if not len(a) or not len(b):
        return None
    both = Both.of(a, b, config)
    near = both.parallel(float(start[2]))
    settled = settle(np.array(start, float), near, both, 0.0)
    return None if settled is None else _finish(*settled, both)


def align_matches(
    a: LineMap,
    b: LineMap,
    matches: IntArray,
    start: Array,
    config: AlignmentConfig | None = None,
) -> Alignment:
    """Returns the alignment of lines that are known to be the same, however far off they lie.

    Args:
        a: the map that stays.
        b: the map that moves.
        matches: (K, 2) rows of both, one to one, K >= 1.
        start: (3,) ``a_T_b`` to start from.
        config: tolerances by which the agreement is measured; None for the defaults.
    """
    both = Both.of(a, b, config or AlignmentConfig())
    rough = agreement_of(np.array(start, float), matches, both)
    fit = _fit(np.array(start, float), rough, both)
    return _alignment(fit.motion, agreement_of(fit.motion, matches, both), fit, both)


def _order(score: float, motion: Array) -> tuple[float, float, float, float]:
    """Orders by score; equal ones by the smaller turn and shift, so that chance decides nothing."""
    turn, shift = round(abs(float(motion[2])), 6), round(math.hypot(*motion[:2]), 6)
    return -round(score, 6), turn, shift, float(motion[0])


def _distinct(found: list[tuple[Array, Agreement]], both: Both) -> list[tuple[Array, Agreement]]:
    """Returns the entries that are not an earlier one again: other lines matched, and elsewhere."""
    ends = both.side_b.ends.reshape(-1, 2)
    kept: list[tuple[Array, Agreement]] = []
    places: list[Array] = []
    names: set[bytes] = set()
    for motion, what in found:
        place = transform_points(motion, ends)
        name = np.column_stack([what.matched.i, what.matched.j]).tobytes()
        near = (np.abs(place - p).max() <= both.config.offset_m for p in places)
        if name not in names and not any(near):
            kept.append((motion, what))
            places.append(place)
            names.add(name)
    return kept


def _finish(motion: Array, rough: Agreement, both: Both) -> Alignment:
    """Returns the alignment at a settled motion, fitted by the joint covariances."""
    fit = _fit(motion, rough, both)
    near = both.parallel(float(fit.motion[2]))
    fine = agreement_at(fit.motion, near, both)
    if fine.score_m < REFUSED * rough.score_m:
        return _alignment(motion, rough, fit, both)
    if not np.array_equal(fine.rows, rough.rows):
        again = _fit(fit.motion, fine, both)
        return _alignment(fit.motion, fine, again, both)
    return _alignment(fit.motion, fine, fit, both)


def _fit(motion: Array, found: Agreement, both: Both) -> Fit:
    return fit_motion(both.a, both.b, found.rows, motion, found.matched.middle)


def _alignment(motion: Array, found: Agreement, fit: Fit, both: Both) -> Alignment:
    slide = slide_direction(both.a.lines[found.matched.i, 1])
    in_a = both.region_a.length_inside(transform_points(motion, both.side_b.ends))
    in_b = both.region_b.length_inside(transform_points(inverse(motion), both.side_a.ends))
    return Alignment(
        motion=motion,
        cov=_covariance(fit, slide),
        information=fit.information,
        slide=slide,
        matches=found.rows,
        parts=found.parts,
        common=found.matched.common,
        agree_m=found.agree_m,
        conflict_m=found.conflict_m,
        expected_m=0.5 * (in_a + in_b),
    )


def _covariance(fit: Fit, slide: Array | None) -> Array:
    inner = np.linalg.inv(fit.basis.T @ fit.information @ fit.basis)
    cov = fit.basis @ inner @ fit.basis.T
    if slide is not None:
        along = np.array([*slide, 0.0])
        cov = cov + UNKNOWN_SIGMA**2 * np.outer(along, along)
    return np.asarray(0.5 * (cov + cov.T))
