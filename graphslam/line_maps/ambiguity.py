"""Which alignments of two maps fit equally well, and what they differ by."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from graphslam.arrays import frozen
from graphslam.geometry import (
    Array,
    compose,
    inverse,
    points_on_line,
    transform_points,
    wrap,
)
from graphslam.line_maps.alignment import Alignment
from graphslam.line_maps.config import AlignmentConfig
from graphslam.line_maps.line_map import LineMap

SAME_TURN_DEG = 5.0
"""Alignments that differ by less than this are shifts of each other."""
CROSSING_DEG = 20.0
"""Two periods have directions that differ by more than this."""
MULTIPLE = 0.15
"""A shift is a multiple of the periods to within this part of the shorter one."""


@dataclass(frozen=True, slots=True)
class Ambiguity:
    """What can be said about which alignment is the right one.

    Attributes:
        ratio: score of the second best alignment over that of the best, 0 without a second.
        equal: rows of all alignments that fit equally well, the best first.
        shifts: (E, 2) what the other equal ones with the same turn are shifted by against the best,
            a's frame, m, at the middle of the lines that it matches.
        turns: (T,) turns of the other equal ones against the best, rad, rounded to whole degrees.
        periods: (p, 2) with p <= 2 the shortest shifts between equal ones, of which all others are
            multiples: the floor's period, as far as these maps tell; a's frame, m.
        slide: (2,) direction along which the best alignment is not fixed at all, or None.
        more: whether there may be further ones: all that the search was to return fit equally well.
    """

    ratio: float
    equal: tuple[int, ...]
    shifts: Array
    turns: Array
    periods: Array
    slide: Array | None
    more: bool

    def __post_init__(self) -> None:
        for name, shape in (("shifts", (None, 2)), ("turns", (None,)), ("periods", (None, 2))):
            object.__setattr__(self, name, frozen(name, getattr(self, name), shape))

    @property
    def unique(self) -> bool:
        """Whether one alignment fits better than all others, and is fixed in every direction."""
        return len(self.equal) == 1 and self.slide is None

    def __str__(self) -> str:
        parts = []
        if self.slide is not None:
            parts.append(f"any shift along {_direction(self.slide)} fits: all lines run that way")
        if len(self.equal) > 1:
            count = f"{'at least ' if self.more else ''}{len(self.equal)}"
            parts.append(f"{count} alignments fit equally well: they {self.differences()}")
        return "; ".join(parts) or (
            f"one alignment fits; the next best has {self.ratio:.0%} of its agreement"
            if self.ratio
            else "one alignment fits, and no other"
        )

    def differences(self) -> str:
        """Returns in words what the equal alignments differ by."""
        found = [f"{math.hypot(*v):.3f} m along {_direction(v)}" for v in self.periods]
        parts = [f"repeat every {' and '.join(found)}"] if found else []
        if len(self.turns):
            names = [_degrees(t) for t in np.degrees(self.turns)]
            parts.append(f"{'also' if parts else 'are'} turned by {', '.join(names)}")
        return ", ".join(parts)


def ambiguity(
    alignments: Sequence[Alignment], b: LineMap, config: AlignmentConfig | None = None
) -> Ambiguity | None:
    """Returns how sure the first of ``alignments`` is; None where there is none.

    Args:
        alignments: of a map ``b`` on another, as `find_alignments` returns them.
        b: the map that moves.
        config: when two fit equally well; None for the defaults.
    """
    config = config or AlignmentConfig()
    if not alignments:
        return None
    best = alignments[0]
    equal = [
        k
        for k, other in enumerate(alignments)
        if other.score_m >= config.equal_score * best.score_m
        and other.consistency >= config.equal_consistency * best.consistency
    ]
    middle = points_on_line(b.lines[best.matches[:, 1]], best.common.mean(axis=1))
    centre = transform_points(best.motion, middle).mean(axis=0)
    motions = np.array([alignments[k].motion for k in equal])
    shifts, turns = _changes(best.motion, motions[1:], centre)
    between = [_changes(motion, motions[k + 1 :], centre)[0] for k, motion in enumerate(motions)]
    return Ambiguity(
        ratio=alignments[1].score_m / best.score_m if len(alignments) > 1 else 0.0,
        equal=tuple(equal),
        shifts=shifts,
        turns=np.unique(turns),
        periods=_periods(np.vstack(between)),
        slide=best.slide,
        more=len(equal) == config.most,
    )


def _changes(first: Array, others: Array, centre: Array) -> tuple[Array, Array]:
    """Returns shifts (n, 2) of those motions that do not turn against the first, and turns (m,).

    Shifts are those of the point ``centre`` (2,), m; turns, of all others, rad, whole degrees.
    """
    change = compose(others, inverse(first))
    turned = np.abs(change[:, 2]) > math.radians(SAME_TURN_DEG)
    shifts = transform_points(change[~turned], centre) - centre
    turns = wrap(np.radians(np.round(np.degrees(change[turned, 2]))))
    return shifts.reshape(-1, 2), np.asarray(turns)


def _periods(shifts: Array) -> Array:
    """Returns the shortest one or two of ``shifts`` (E, 2), fitted to all of their multiples."""
    if not len(shifts):
        return np.zeros((0, 2))
    shifts = shifts[np.argsort(np.hypot(shifts[:, 0], shifts[:, 1]), kind="stable")]
    basis = shifts[:1]
    cross = shifts[:, 0] * basis[0, 1] - shifts[:, 1] * basis[0, 0]
    size = np.hypot(shifts[:, 0], shifts[:, 1]) * np.hypot(*basis[0])
    across = np.flatnonzero(np.abs(cross) > math.sin(math.radians(CROSSING_DEG)) * size)
    if len(across):
        basis = np.vstack([basis, shifts[across[0]]])
    times = np.round(shifts @ np.linalg.pinv(basis))
    fits = np.linalg.norm(shifts - times @ basis, axis=1) <= MULTIPLE * np.hypot(*basis[0])
    used = fits & (times != 0).any(axis=1)
    periods = np.linalg.lstsq(times[used], shifts[used], rcond=None)[0]
    # of the two names of a direction the one with the larger coordinate positive
    largest = periods[np.arange(len(periods)), np.abs(periods).argmax(axis=1)]
    periods = periods * np.sign(largest)[:, None]
    return np.asarray(periods[np.argsort(_angle(periods), kind="stable")])


def _angle(vectors: Array) -> Array:
    """Returns the directions (n,) of vectors (n, 2), rad, modulo pi and next to 0 where near it."""
    return np.asarray(0.5 * wrap(2.0 * np.arctan2(vectors[:, 1], vectors[:, 0])))


def _direction(vector: Array) -> str:
    angle = round(math.degrees(float(_angle(vector[None])[0])))
    return _degrees(90 if angle == -90 else angle)


def _degrees(angle: float) -> str:
    return f"{angle:.0f}°".replace("-", "−")
