"""Where along the way a method becomes surer than it should be: chi-square bands over distance.

Errors are held against covariances (NEES) where the true path is known, innovations against theirs
(NIS) wherever a method predicts what it will see: that needs no truth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.special

from compare.arrays import freeze_arrays
from compare.metrics import RANK_TOLERANCE, nees
from compare.truth import Truth
from graphslam.estimate import Estimate
from graphslam.geometry import Array, compose, inverse, wrap

STATES = ("x", "y", "heading", "pose")
"""What is held against its own covariance; the last is all three jointly."""
FREEDOM = np.array([1, 1, 1, 3])
CHANCE = 0.025
"""Probability on either side beyond which a consistency figure counts as over- or underconfident.
The nodes of one run share their errors, so that a mean over them scatters almost like one node."""
COORDINATE_CHANCE = CHANCE / 30.0
"""The same for each of three coordinates at about ten stretches of the way whose errors are nearly
independent, so that one in forty honest runs shows any."""

SHARES = 16
"""Shares of the way in which innovations are summed up, and points at which studies look."""
LEAST_FACTOR = 1.2
"""Overconfidence below this factor is not spoken of, however many runs prove it."""


@dataclass(frozen=True, slots=True)
class Consistency:
    """Squared errors over covariances along the way, of one run or averaged over several.

    Attributes:
        distance: (n,) metres driven, not decreasing.
        nees: (n, 4) squared error over variance, per degree of freedom, for each of `STATES`; 1 is
            right on average.
        runs: how many runs were averaged.
    """

    distance: Array
    nees: Array
    runs: int

    def __post_init__(self) -> None:
        freeze_arrays(self)


@dataclass(frozen=True, slots=True)
class Overconfidence:
    """A coordinate whose errors exceed what a method claims.

    Attributes:
        state: "x", "y" or "heading".
        factor: RMS of error over claimed standard deviation from there on.
        from_m: distance driven from which on, m.
    """

    state: str
    factor: float
    from_m: float

    def __str__(self) -> str:
        return (
            f"overconfident by a factor {self.factor:.2g} in {self.state} after {self.from_m:.3g} m"
        )


@dataclass(frozen=True, slots=True)
class Innovations:
    """Squared innovations over covariances in equal shares of the way, of one run or of several.

    Those of one node are taken jointly, so that for an honest filter all are independent and each
    sum is chi-square distributed.

    Attributes:
        distance: (n,) metres driven at the end of each share.
        nis: (n,) sum of squared normalised innovations in the share, over its freedom; NaN where
            nothing was seen.
        freedom: (n,) degrees of freedom.
    """

    distance: Array
    nis: Array
    freedom: Array

    def __post_init__(self) -> None:
        freeze_arrays(self)

    @property
    def total(self) -> float:
        """NIS per degree of freedom of the whole way; NaN without any innovation."""
        known = self.freedom > 0
        whole = self.freedom[known].sum()
        return float((self.nis * self.freedom)[known].sum() / whole) if whole else math.nan


@dataclass(frozen=True, slots=True)
class Surprise:
    """Innovations that exceed what a method expects.

    Attributes:
        factor: RMS of innovation over expected standard deviation from there on.
        nis: its square.
        from_m: distance driven from which on, m.
        limit: what the NIS from there on of an honest method does not exceed.
    """

    factor: float
    nis: float
    from_m: float
    limit: float

    def __str__(self) -> str:
        return (
            f"overconfident by a factor {self.factor:.2g} in what it expects to see after "
            f"{self.from_m:.3g} m (NIS {self.nis:.3g} per degree of freedom from there on; up to "
            f"{self.limit:.3g} is unsuspicious)"
        )


def band(freedom: float, runs: int = 1, chance: float = CHANCE) -> tuple[float, float]:
    """Returns the limits of the mean NEES per degree of freedom of honest runs.

    Args:
        freedom: degrees of freedom of one run.
        runs: independent runs.
        chance: probability beyond each limit.
    """
    total = freedom * runs
    low, high = (float(scipy.special.chdtri(total, p)) / total for p in (1.0 - chance, chance))
    return low, high


def consistency(estimate: Estimate, truth: Truth) -> Consistency | None:
    """Returns a run's squared errors over its covariances, floor frame, without any alignment.

    None where a covariance is not positive definite, or too little of the true path is known. The
    caller sees to it that the start is known exactly (see `metrics.pose_nees`).
    """
    true_pose, covered = truth.at(estimate.t)
    scored = np.flatnonzero(covered)[1:]
    if not len(scored):
        return None
    true_pose = compose(inverse(truth.truth_T_start), true_pose[scored])
    error, cov = estimate.pose[scored] - true_pose, estimate.cov_floor[scored]
    error[:, 2] = wrap(error[:, 2])
    joint = nees(error, cov)
    if not np.isfinite(joint).all():
        return None
    single = error**2 / np.diagonal(cov, axis1=1, axis2=2)
    steps = np.hypot(*np.diff(true_pose[:, :2], axis=0).T)
    distance = np.concatenate([[0.0], np.cumsum(steps)])
    return Consistency(distance, np.column_stack([single, joint]), 1)


def sampled(curve: Consistency, points: int) -> Consistency:
    """Returns a curve at so many distances, each at the end of an equal share of the way."""
    wanted = curve.distance[-1] * np.arange(1, points + 1) / points
    near = np.searchsorted(curve.distance, wanted * (1.0 - RANK_TOLERANCE))
    at = np.minimum(near, len(curve.distance) - 1)
    return Consistency(wanted, curve.nees[at], curve.runs)


def mean_of(curves: list[Consistency]) -> Consistency:
    """Returns the mean of curves of one length; distances may differ a little from run to run."""
    return Consistency(
        np.mean([curve.distance for curve in curves], axis=0),
        np.mean([curve.nees for curve in curves], axis=0),
        sum(curve.runs for curve in curves),
    )


def overconfidence(curve: Consistency) -> Overconfidence | None:
    """Returns the coordinate that a method is most overconfident in, and from where on; or None.

    It counts from the first distance at which the squared error lies above its band, provided that
    the mean from there to the end does so, too, and by a factor of `LEAST_FACTOR`.
    """
    _, high = band(1, curve.runs, COORDINATE_CHANCE)
    found = []
    for column, state in enumerate(STATES[:3]):
        values = curve.nees[:, column]
        rest = np.cumsum(values[::-1])[::-1] / np.arange(len(values), 0, -1)
        above = np.flatnonzero((values > high) & (rest > max(high, LEAST_FACTOR**2)))
        if len(above):
            first = int(above[0])
            factor = math.sqrt(rest[first])
            found.append(Overconfidence(state, factor, float(curve.distance[first])))
    return max(found, key=lambda entry: entry.factor, default=None)


def innovations(estimate: Estimate, driven: Array, points: int) -> Innovations | None:
    """Returns a run's innovations in so many equal shares of the way.

    None where the method predicts nothing, or the robot does not move.

    Args:
        estimate: of a method that predicts what it will see.
        driven: (N,) metres driven up to each node.
        points: shares.
    """
    if estimate.innovation is None or not driven[-1] > 0.0:
        return None
    ends = driven[-1] * np.arange(1, points + 1) / points
    share = np.searchsorted(ends[:-1], driven * (1.0 - RANK_TOLERANCE))
    squared, freedom = (np.bincount(share, column, points) for column in estimate.innovation.T)
    with np.errstate(invalid="ignore"):
        return Innovations(ends, squared / freedom, freedom)


def pooled(runs: list[Innovations]) -> Innovations:
    """Returns the innovations of several runs with equal shares, taken together."""
    freedom = np.sum([run.freedom for run in runs], axis=0)
    squared = np.nansum([run.nis * run.freedom for run in runs], axis=0)
    with np.errstate(invalid="ignore"):
        nis = squared / freedom
    return Innovations(np.mean([run.distance for run in runs], axis=0), nis, freedom)


def surprise(found: Innovations) -> Surprise | None:
    """Returns from where on innovations exceed what is expected of them, and by how much; or None.

    It counts from the first share of the way that lies above its band, provided that all from there
    on, taken together, do so, too, and by a factor of `LEAST_FACTOR`. Of honest runs one in forty
    shows any: the shares are independent.
    """
    known = np.flatnonzero(found.freedom > 0)
    nis, freedom = found.nis[known], found.freedom[known]
    chance = CHANCE / max(len(known), 1)
    starts = np.concatenate([[0.0], found.distance])
    for first, share in enumerate(known):
        rest = float(nis[first:] @ freedom[first:] / freedom[first:].sum())
        limit = band(float(freedom[first:].sum()), chance=chance)[1]
        above = nis[first] > band(float(freedom[first]), chance=chance)[1]
        if above and rest > max(limit, LEAST_FACTOR**2):
            return Surprise(math.sqrt(rest), rest, float(starts[share]), limit)
    return None
