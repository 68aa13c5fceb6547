"""The compiled way of a factor against the way that any residual takes."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import gtsam
import numpy as np
import pytest

from graphslam.errors import BadMeasurements
from graphslam.models import MODELS, Model
from graphslam.models.base import Compiled
from graphslam.models.line import LINE
from graphslam.models.odometry import odometry_residual
from graphslam.smoother import landmark_key, odometry_factor, pose_key, residual_factor
from graphslam.smoother.factors import fixed_sighting_factor, sighting_factor

COMPILED = [model for model in MODELS.values() if isinstance(model, Compiled)]


def case(model: Model, seed: int) -> tuple[np.ndarray, ...]:
    """Returns a pose, a landmark, a sighting and its covariance."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((model.dim_z, model.dim_z))
    pose, landmark = rng.uniform(-3, 3, 3), rng.uniform(-3, 3, model.dim_landmark)
    return pose, landmark, rng.uniform(-3, 3, model.dim_z), root @ root.T + np.eye(model.dim_z)


def linear(factor: gtsam.CustomFactor, values: gtsam.Values) -> np.ndarray:
    return np.column_stack(factor.linearize(values).jacobian())


def values_at(pose: np.ndarray, landmark: np.ndarray, after: np.ndarray) -> gtsam.Values:
    values = gtsam.Values()
    for node, (x, y, theta) in enumerate((pose, after)):
        values.insert(pose_key(node), gtsam.Pose2(x, y, theta))
    values.insert(landmark_key(0), landmark)
    return values


def test_line_lamp_and_bearing_are_compiled() -> None:
    assert {"line", "lamp", "bearing"} <= {model.kind for model in COMPILED}


@pytest.mark.parametrize("model", COMPILED, ids=lambda model: model.kind)
@pytest.mark.parametrize("seed", range(8))
def test_a_compiled_factor_equals_that_of_the_same_residual(model: Model, seed: int) -> None:
    pose, landmark, z, cov = case(model, seed)
    values = values_at(pose, landmark, pose)
    keys, dims = [pose_key(0), landmark_key(0)], [3, model.dim_landmark]
    same = residual_factor(
        keys, [True, False], dims, lambda p, params: model.residual(p, params, z), cov
    )
    compiled = sighting_factor(model, z, cov, 0, 0)
    np.testing.assert_array_equal(linear(compiled, values), linear(same, values))
    assert compiled.error(values) == same.error(values)
    known = residual_factor(
        keys[:1], [True], [3], lambda p: model.residual(p, landmark, z)[:2], cov
    )
    fixed = fixed_sighting_factor(model, z, cov, 0, landmark)
    np.testing.assert_array_equal(linear(fixed, values), linear(known, values))


@pytest.mark.parametrize("seed", range(8))
def test_the_odometry_factor_equals_that_of_the_same_residual(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose, after, increment = rng.uniform(-3, 3, (3, 3))
    cov = np.diag(rng.uniform(0.1, 1.0, 3))
    same = residual_factor(
        [pose_key(0), pose_key(1)],
        [True, True],
        [3, 3],
        lambda i, j: odometry_residual(i, j, increment),
        cov,
    )
    values = values_at(pose, np.zeros(2), after)
    ours = odometry_factor(0, increment, cov)
    np.testing.assert_array_equal(linear(ours, values), linear(same, values))


def test_threads_that_linearise_at_once_do_not_mix_their_factors() -> None:
    """Factors of a kind share their arrays within a thread, never across."""
    graphs, starts = [], []
    for k in range(4):
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        values.insert(landmark_key(0), np.array([1.0 + k, 0.2 * k]))
        for node in range(1_500):
            values.insert(pose_key(node), gtsam.Pose2(node, k, 0.1 * k))
            graph.push_back(sighting_factor(LINE, np.array([1.0, 0.1]), np.eye(2), node, 0))
        graphs.append(graph)
        starts.append(values)

    def cost(k: int) -> float:
        zero = starts[k].zeroVectors()
        return float(graphs[k].linearize(starts[k]).error(zero))

    alone = [cost(k) for k in range(4)]
    with ThreadPoolExecutor(4) as threads:
        together = list(threads.map(cost, range(4)))
    assert together == alone


@pytest.mark.parametrize(
    ("z", "cov"), [(np.zeros(3), np.eye(2)), (np.zeros(2), np.eye(3)), (np.zeros(1), np.eye(1))]
)
def test_a_sighting_of_the_wrong_shape_is_refused_when_its_factor_is_made(
    z: np.ndarray, cov: np.ndarray
) -> None:
    for make in (
        lambda: sighting_factor(LINE, z, cov, 0, 0),
        lambda: fixed_sighting_factor(LINE, z, cov, 0, np.zeros(2)),
    ):
        with pytest.raises(BadMeasurements, match=r"kind line has 2 numbers"):
            make()


def test_a_landmark_of_another_length_is_refused_before_gtsam_sees_it() -> None:
    values = values_at(np.zeros(3), np.zeros(3), np.zeros(3))
    factor = sighting_factor(LINE, np.zeros(2), np.eye(2), 0, 0)
    with pytest.raises(BadMeasurements, match="2 parameters; here it has 3"):
        factor.linearize(values)


def test_known_landmark_of_another_length_is_refused() -> None:
    with pytest.raises(BadMeasurements, match="2 parameters; here it has 3"):
        fixed_sighting_factor(LINE, np.zeros(2), np.eye(2), 0, np.zeros(3))
