"""Turning seen by the wheels against turning seen by the lines: clocks, turn sense and scale."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graphslam.geometry import Array, wrap
from graphslam.measurements import IntArray

LARGEST_SHIFT_S = 2.0
"""Shifts between the clocks of wheels and images that are tried, s, either way."""
LARGEST_FACTOR = 2.0
"""Factors on the turns by the wheels that are tried, either way, also negative."""

UNSHIFTED = 100  # where 0 stands in SHIFTS
SHIFTS = LARGEST_SHIFT_S * np.arange(-UNSHIFTED, UNSHIFTED + 1) / UNSHIFTED
FACTORS = np.concatenate([s * LARGEST_FACTOR ** (np.arange(-14, 15) / 14) for s in (-1.0, 1.0)])

AGREES_SIGMAS = 2.0  # a line that turns as predicted does so within about this
TURNS_RAD = math.radians(3.0)  # turns between two frames that tell anything
FEWEST_TURNS = 12  # lines seen turning, below which nothing is said
CLEARLY, CLEARLY_SHARE = 5.0, 0.02  # lines more that a value must explain to count as better
LONGEST_STEP_S = 1.0  # frames further apart are not compared


@dataclass(frozen=True, slots=True)
class TurnCheck:
    """How the turning by the wheels agrees with that by the lines.

    Attributes:
        turned: how many times a line was seen while the wheels turned, or would have, shifted.
        agree: share of the lines seen turning that turn as the wheels say, as the log has it; NaN
            where the wheels turn at none of its frames.
        shift_s: what to add to the times of the images to fit the wheels best, s; 0 where no other
            value fits clearly better.
        factor: factor on the turns by the wheels that fits best, negative where they turn the other
            way; 1 where no other value fits clearly better.
        agree_best: the same share with this shift and factor.
    """

    turned: int
    agree: float
    shift_s: float
    factor: float
    agree_best: float


def check_turns(
    wheel_t: Array,
    heading: Array,
    frame_t: Array,
    alphas: Sequence[Array],
    sigma_alpha: float,
) -> TurnCheck | None:
    """Returns how well wheels and lines agree, and the shift and factor that fit best.

    The direction of a line in the robot frame turns against the robot. Each line of a frame counts
    as the line of the frame before whose direction is nearest to where the wheels say, modulo half
    a turn, and scores by how near that is. The shift and the factor with the highest score win,
    if they explain clearly more lines than none.

    Args:
        wheel_t: (W,) s.
        heading: (W,) by the wheels, rad, not wrapped.
        frame_t: (F,) times of one camera's frames, s, increasing.
        alphas: (F,) directions (K,) of each frame's lines, robot frame, rad.
        sigma_alpha: standard deviation of a line's direction, rad.

    Returns:
        None where too few lines were seen turning to tell anything.
    """
    pairs = _pairs(wheel_t, frame_t, alphas, AGREES_SIGMAS * sigma_alpha)
    turn = [pairs.turn(wheel_t, heading, shift) for shift in SHIFTS]
    turned = pairs.turned(np.max(np.abs(turn), axis=0))
    if np.count_nonzero(turned) < FEWEST_TURNS:
        return None
    score = np.array([[pairs.scores(f * row)[turned].sum() for row in turn] for f in FACTORS])
    clearly = max(CLEARLY, CLEARLY_SHARE * np.count_nonzero(turned))

    ahead, against = score[FACTORS > 0].max(), score[FACTORS < 0].max()
    sign = -1.0 if against > ahead + clearly else 1.0
    straight = FACTORS.tolist().index(sign)
    row = int(np.argmax(np.where(sign * FACTORS > 0, score.max(axis=1), -np.inf)))
    if score[row].max() < score[straight].max() + clearly:
        row = straight
    column = int(score[row].argmax())
    if score[row, column] < score[row, UNSHIFTED] + clearly:
        column = UNSHIFTED
    agree, agree_best = map(pairs.agreement, (turn[UNSHIFTED], FACTORS[row] * turn[column]))
    if not agree_best > agree and not math.isnan(agree):
        row, column, agree_best = FACTORS.tolist().index(1.0), UNSHIFTED, agree
    return TurnCheck(
        turned=int(np.count_nonzero(turned)),
        agree=agree,
        shift_s=float(SHIFTS[column]),
        factor=float(FACTORS[row]),
        agree_best=agree_best,
    )


@dataclass(frozen=True, slots=True)
class _Pairs:
    """Pairs of a line and a line of the frame before, grouped by the later line.

    Attributes:
        t: (P, 2) times of the two frames, s.
        turn_seen: (P,) by how much the direction fell, rad.
        first: (G,) first pair of each group.
        tolerance: a line that turns as predicted does so within about this, rad.
    """

    t: Array
    turn_seen: Array
    first: IntArray
    tolerance: float

    def turn(self, wheel_t: Array, heading: Array, shift: float) -> Array:
        """Returns (P,) the turns by the wheels, frames moved by ``shift`` s."""
        at = np.interp(self.t + shift, wheel_t, heading)
        return np.asarray(at[:, 1] - at[:, 0])

    def turned(self, turn: Array) -> NDArray[np.bool_]:
        """Returns (G,) whether ``turn`` (P,) turns a line enough to tell anything."""
        return np.abs(turn[self.first]) > TURNS_RAD

    def scores(self, turn: Array) -> Array:
        """Returns (G,) how well each line turns by ``turn`` (P,): 1 perfectly, 0 not at all."""
        off = 0.5 * np.abs(wrap(2.0 * (self.turn_seen - turn)))
        nearest = np.minimum.reduceat(off, self.first) if len(off) else off
        return np.exp(-0.5 * (nearest / self.tolerance) ** 2)

    def agreement(self, turn: Array) -> float:
        """Returns the mean score of the lines that ``turn`` (P,) turns; NaN where there is none."""
        scores = self.scores(turn)[self.turned(turn)]
        return float(scores.mean()) if len(scores) else math.nan


def _pairs(wheel_t: Array, frame_t: Array, alphas: Sequence[Array], tolerance: float) -> _Pairs:
    """Returns the pairs of frames that the wheel record surrounds under every shift."""
    t, seen, first, count = [], [], [], 0
    for i in range(len(frame_t) - 1):
        begin, end = frame_t[i], frame_t[i + 1]
        inside = begin - LARGEST_SHIFT_S >= wheel_t[0] and end + LARGEST_SHIFT_S <= wheel_t[-1]
        before, after = len(alphas[i]), len(alphas[i + 1])
        if not (inside and end - begin <= LONGEST_STEP_S and before and after):
            continue
        first += list(range(count, count + before * after, before))
        seen.append((alphas[i][None, :] - alphas[i + 1][:, None]).ravel())
        t.append(np.tile([begin, end], (before * after, 1)))
        count += before * after
    if not count:
        return _Pairs(np.zeros((0, 2)), np.zeros(0), np.zeros(0, np.int64), tolerance)
    return _Pairs(np.concatenate(t), np.concatenate(seen), np.array(first, np.int64), tolerance)
