from __future__ import annotations

import math

import numpy as np
import pytest

from graphslam.geometry import wrap
from graphslam.models.base import Delayed
from graphslam.models.bearing import BEARING, LEAST_PARALLAX, SURE_RANGE
from tests.graphslam.differences import central_differences

AWKWARD = {
    "behind, across the wrap": ([1.0, 2.0, 0.0], [-3.0, 2.0 + 1e-9], [-math.pi + 0.01]),
    "heading at pi": ([0.2, -0.4, math.pi], [1.5, -1.2], [2.9]),
    "heading at minus pi": ([0.2, -0.4, -math.pi + 1e-9], [-4.0, 0.5], [0.3]),
    "very near": ([0.0, 0.0, 0.3], [1e-2, -1e-2], [-1.0]),
    "far": ([0.0, 0.0, 0.3], [900.0, 3.0], [-0.2]),
    "reading beyond a turn": ([1.0, 1.0, 1.0], [2.0, 5.0], [0.4 + 4 * math.pi]),
}


def random_cases(count: int = 30) -> list[tuple]:
    rng = np.random.default_rng(3)
    cases = []
    for _ in range(count):
        pose = rng.uniform([-5, -5, -np.pi], [5, 5, np.pi])
        point = rng.uniform(-8, 8, 2)
        cases.append((pose, point, reading(pose, point) + rng.normal(0, 0.1)))
    return cases


def reading(pose: np.ndarray, point: np.ndarray) -> np.ndarray:
    offset = np.asarray(point) - np.asarray(pose)[..., :2]
    return wrap(np.arctan2(offset[..., 1], offset[..., 0]) - np.asarray(pose)[..., 2])[..., None]


@pytest.mark.parametrize("case", [*AWKWARD.values(), *random_cases()])
def test_jacobians_equal_central_differences(case: tuple) -> None:
    pose, point, z = (np.array(v, float) for v in case)
    e, J_pose, J_point = BEARING.residual(pose, point, z)
    step = 1e-6 * max(1e-2, min(1.0, np.hypot(*(point - pose[:2]))))
    by_pose = central_differences(lambda v: BEARING.residual(v, point, z)[0], pose, step)
    by_point = central_differences(lambda v: BEARING.residual(pose, v, z)[0], point, step)
    np.testing.assert_allclose(J_pose, by_pose, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(J_point, by_point, rtol=1e-5, atol=1e-6)
    assert -math.pi < e[0] <= math.pi


def test_directions_count_all_round_and_not_modulo_pi() -> None:
    """Erratum of Kato (1), (3): atan of a quotient turns headings beyond 90 degrees by 180."""
    point = np.array([0.0, 0.0])
    for heading in np.radians([0.0, 60.0, 120.0, 179.0, -150.0]):
        pose = np.array([0.5, 0.35, heading])
        e = BEARING.residual(pose, point, reading(pose, point))[0]
        assert abs(e[0]) < 1e-12
        turned = BEARING.residual(pose, point, reading(pose, point) + math.pi)[0]
        assert abs(turned[0]) == pytest.approx(math.pi)


def test_on_the_point_itself_nothing_is_infinite() -> None:
    values = BEARING.residual(np.array([1.0, 2.0, 0.5]), np.array([1.0, 2.0]), np.array([0.1]))
    assert all(np.isfinite(v).all() for v in values)


def test_one_sighting_starts_nothing() -> None:
    assert BEARING.initialise(np.zeros(3), np.zeros(1), np.eye(1)) is None
    assert isinstance(BEARING, Delayed)


def views(count: int, baseline: float, sigma: float = 1e-3) -> tuple:
    pose = np.column_stack([np.linspace(0, baseline, count), np.zeros(count), np.zeros(count)])
    return pose, np.tile(sigma**2 * np.eye(1), (count, 1, 1))


def test_several_sightings_start_the_point_where_they_cross() -> None:
    point = np.array([1.0, 3.0])
    pose, cov = views(5, 2.0)
    started = BEARING.initialise_from(pose, None, reading(pose, point), cov)
    np.testing.assert_allclose(started, point, atol=1e-9)


def test_a_point_waits_until_parallax_suffices() -> None:
    point = np.array([0.5, 4.0])
    near, far = 4.0 * math.tan(0.5 * LEAST_PARALLAX), 1.5
    pose, cov = views(4, near)
    assert BEARING.initialise_from(pose, None, reading(pose, point), cov) is None
    pose, cov = views(4, far)
    assert BEARING.initialise_from(pose, None, reading(pose, point), cov) is not None
    # the same views, less exact: the distance is not known to its share
    vague = cov * (0.5 * SURE_RANGE / 1e-3) ** 2
    assert BEARING.initialise_from(pose, None, reading(pose, point), vague) is None
    # or from poses that are not known exactly
    pose_cov = np.diag(np.tile([0.3, 0.3, 0.2], 4) ** 2)
    assert BEARING.initialise_from(pose, pose_cov, reading(pose, point), cov) is None


def test_rays_that_part_start_nothing() -> None:
    pose, cov = views(2, 1.0)
    z = np.array([[math.pi / 2 + 0.2], [math.pi / 2 - 0.2]])
    assert BEARING.initialise_from(pose, None, z, cov) is None


def test_what_swings_too_far_is_another_point() -> None:
    pose = np.array([[0.0, 0.0, 0.2], [0.1, 0.0, 0.5]])
    point = np.array([3.0, 2.0])
    z = reading(pose, point)
    assert BEARING.unlike(pose[0], z[0], pose[1], z[1]) < 0.3
    assert BEARING.unlike(pose[0], z[0], pose[1], z[1] + 0.4) > 1.0
