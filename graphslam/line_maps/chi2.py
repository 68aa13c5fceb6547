"""Are two maps the same map? Differences of their lines, tested against both covariances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.stats

from graphslam.arrays import frozen
from graphslam.geometry import Array
from graphslam.line_maps.alignment import Alignment
from graphslam.line_maps.correspondence import middle_jacobian
from graphslam.line_maps.excess import excess
from graphslam.line_maps.fit import Fit, chi_square, fit_motion, left_over
from graphslam.line_maps.line_map import LineMap, diagonal_blocks
from graphslam.measurements import IntArray

NOTHING_LEFT = 1e-6
"""A difference of which the motion leaves less than this part of its sigma is fitted exactly."""


@dataclass(frozen=True, slots=True)
class MapTest:
    """Differences of matched lines, and whether both maps' covariances explain them.

    Differences are b minus a in b's frame after the motion that fits the lines in least squares,
    by the name that b's line has; at the middle of the stretch that both saw. Standard deviations
    are those of what that motion leaves, NaN where it always fits exactly.

    Attributes:
        matches: (K, 2) rows of a and b, as in the alignment.
        at: (K,) where on b's line they are compared, m.
        d_line: (K, 2) difference of rho (m) and alpha (rad), about b's origin.
        offset: (K,) difference across the line at ``at``, m.
        sigma: (K, 2) standard deviations of ``offset`` (m) and of the difference in alpha (rad), if
            the maps are independent.
        sigma_a: (K, 2) the same from the first map's covariance alone; 0 where it is exact.
        sigma_b: (K, 2) the same from the second map's.
        motion: (3,) ``a_T_b`` that fits offsets (m) and angles (rad) in least squares, all lines
            alike; `Alignment.motion` is the one by the covariances.
        chi2: squared normalised difference of all lines jointly, least over the motion; NaN where
            not defined. Lines that both maps know exactly are left out.
        freedom: its degrees of freedom: two a line less what the motion takes; 0 where nothing is
            left to test.
        probability: that maps of one floor differ at least as much; NaN where not defined.
        scale: factor on the sum of the covariances that the test used: 1 for independent maps, 2
            for maps that may be correlated, which is an upper bound whatever the correlation, so
            that only a small probability says anything.
        excess: standard deviation, m, of the error across each line, independent at either end of
            the common stretch and beyond what the covariances say, that would make `chi2` as large
            as `freedom`; 0 where it is no larger, NaN where not defined or not independent.
        own: (2,) the largest difference of any combination of lines, in standard deviations that
            the first map claims for it, and the second; NaN for a map that is exact.
    """

    matches: IntArray
    at: Array
    d_line: Array
    offset: Array
    sigma: Array
    sigma_a: Array
    sigma_b: Array
    motion: Array
    chi2: float
    freedom: int
    probability: float
    scale: float
    excess: float
    own: Array

    def __post_init__(self) -> None:
        count = len(self.matches)
        object.__setattr__(self, "matches", frozen("matches", self.matches, (count, 2), int))
        shapes: dict[str, tuple[int, ...]] = {
            "at": (count,), "offset": (count,), "d_line": (count, 2), "sigma": (count, 2),
            "sigma_a": (count, 2), "sigma_b": (count, 2), "motion": (3,), "own": (2,),
        }  # fmt: skip
        for name, shape in shapes.items():
            value = frozen(name, getattr(self, name), shape, allow_nan=True)
            object.__setattr__(self, name, value)

    @property
    def per_freedom(self) -> float:
        """`chi2` over `freedom`: about 1 where the covariances are as large as the differences."""
        return self.chi2 / self.freedom if self.freedom else float("nan")


def same_map(a: LineMap, b: LineMap, alignment: Alignment, independent: bool = True) -> MapTest:
    """Returns the differences of the lines that an alignment matches, tested.

    The frames of both maps are free: what a rigid motion explains is no difference. For two
    estimates ``x``, ``y`` of one truth with covariances P and Q and any correlation whatever, the
    covariance of ``x - y`` is at most 2 (P + Q), which is what the test takes where they are not
    independent.

    Args:
        a: the map that stays.
        b: the map that moves.
        alignment: of b on a; its one-to-one matches are compared.
        independent: whether the two maps come from different measurements.
    """
    s = alignment.common.mean(axis=1)
    fit = fit_motion(a, b, alignment.matches, alignment.motion, s)
    plain = _least_squares(a, b, alignment, s)
    scale = 1.0 if independent else 2.0
    tested, common = _tested(a, b, alignment)
    chi2, freedom = (tested.chi2 / scale, tested.freedom) if tested else (float("nan"), 0)
    e, at_middle = plain.residual, middle_jacobian(s) @ plain.residual[..., None]
    own = [
        np.sqrt(chi_square(e.ravel(), plain.J, cov)) if cov.any() and fit.freedom else np.nan
        for cov in (fit.cov_a, fit.cov_b)
    ]
    return MapTest(
        matches=alignment.matches,
        at=s,
        d_line=-e,
        offset=-at_middle[:, 0, 0],
        sigma=_sigmas(plain, fit.cov_a + fit.cov_b, s),
        sigma_a=_sigmas(plain, fit.cov_a, s),
        sigma_b=_sigmas(plain, fit.cov_b, s),
        motion=plain.motion,
        chi2=chi2,
        freedom=freedom,
        probability=float(scipy.stats.chi2.sf(chi2, freedom)) if freedom else float("nan"),
        scale=scale,
        excess=excess(tested, common) if tested and independent else float("nan"),
        own=np.array(own),
    )


def _least_squares(a: LineMap, b: LineMap, alignment: Alignment, s: Array) -> Fit:
    """Returns the fit in which an offset at ``s`` of one metre counts as one radian, all alike."""
    back: Array = np.asarray(np.linalg.inv(middle_jacobian(s)))
    lines = b.select(alignment.matches[:, 1])
    unit = np.asarray(back @ np.swapaxes(back, 1, 2))
    alike = LineMap(lines.lines, unit, lines.extent)
    first = a.select(alignment.matches[:, 0])
    pairs = np.column_stack([np.arange(len(s))] * 2)
    return fit_motion(LineMap.exact(first.lines, first.extent), alike, pairs, alignment.motion, s)


def _sigmas(plain: Fit, cov: Array, s: Array) -> Array:
    """Returns (K, 2) sigmas of offset at ``s`` and angle of what the motion of a fit leaves."""
    if not cov.any():
        return np.zeros((len(s), 2))
    after = _variances(left_over(plain.J, cov, plain.cov_b), s)
    before = _variances(cov, s)
    some = after > NOTHING_LEFT**2 * before
    return np.sqrt(np.where(some | (before == 0.0), np.maximum(after, 0.0), np.nan))


def _variances(cov: Array, s: Array) -> Array:
    """Returns (K, 2) the variances at positions ``s`` (K,) of the joint covariance of (K, 2)."""
    J = middle_jacobian(s)
    return np.diagonal(J @ diagonal_blocks(cov) @ np.swapaxes(J, 1, 2), axis1=1, axis2=2)


def _tested(a: LineMap, b: LineMap, alignment: Alignment) -> tuple[Fit | None, Array]:
    """Returns the fit of the matches that either map is not sure of, and their common stretches.

    No fit where nothing is left to test.
    """
    known = [
        np.diagonal(m.cov).reshape(-1, 2)[alignment.matches[:, column]].max(axis=1) == 0
        for column, m in enumerate((a, b))
    ]
    open_ = ~(known[0] & known[1])
    common = alignment.common[open_]
    if not len(common):
        return None, common
    fit = fit_motion(a, b, alignment.matches[open_], alignment.motion, common.mean(axis=1))
    return (fit if fit.freedom > 0 else None), common
