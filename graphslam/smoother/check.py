"""Checking any factor's Jacobians against central differences."""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np

from graphslam.geometry import Array


@dataclass(frozen=True, slots=True)
class FactorCheck:
    """How a factor's Jacobians compare with central differences.

    Attributes:
        analytic: per variable, the whitened Jacobian that the factor gives, (d, dim).
        numeric: per variable, the same by central differences.
        max_error: largest difference, relative to the largest entry (at least 1).
        ok: whether it is below the tolerance asked for.
    """

    analytic: tuple[Array, ...]
    numeric: tuple[Array, ...]
    max_error: float
    ok: bool


def check_factor(
    factor: gtsam.NoiseModelFactor,
    values: gtsam.Values,
    step: float = 1e-6,
    tolerance: float = 1e-5,
) -> FactorCheck:
    """Returns the comparison of a factor's Jacobians with central differences on the manifold.

    Args:
        factor: any factor with a noise model, of this project or not.
        values: where to compare; must hold all of the factor's variables.
        step: of the differences, in each variable's tangent.
        tolerance: largest difference, relative to the largest entry, that counts as equal.
    """
    A, _ = factor.linearize(values).jacobian()
    analytic, numeric, first = [], [], 0
    for key in list(factor.keys()):
        dim = len(values.zeroVectors().at(key))
        analytic.append(A[:, first : first + dim])
        columns = [_central_difference(factor, values, key, axis, step) for axis in range(dim)]
        numeric.append(np.column_stack(columns))
        first += dim
    scale = max(1.0, float(np.abs(A).max()))
    worst = max(float(np.abs(a - n).max()) for a, n in zip(analytic, numeric, strict=True)) / scale
    return FactorCheck(tuple(analytic), tuple(numeric), worst, worst < tolerance)


def _central_difference(
    factor: gtsam.NoiseModelFactor, values: gtsam.Values, key: int, axis: int, step: float
) -> Array:
    ends = []
    for signed in (step, -step):
        delta = values.zeroVectors()
        moved = np.array(delta.at(key))
        moved[axis] = signed
        delta.update(_one(key, moved))
        ends.append(factor.whitenedError(values.retract(delta)))
    return np.asarray((ends[0] - ends[1]) / (2.0 * step))


def _one(key: int, vector: Array) -> gtsam.VectorValues:
    single = gtsam.VectorValues()
    single.insert(key, vector)
    return single
