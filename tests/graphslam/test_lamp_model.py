from __future__ import annotations

import math

import numpy as np
import pytest

from graphslam.geometry import between, compose, wrap
from graphslam.models.lamp import LAMP
from tests.graphslam.differences import central_differences

AWKWARD = {
    "axis on the other side of the wrap": ([0, 0, 0], [1, 1, math.pi - 0.01], [1, 1, 0.01]),
    "heading at pi": ([0.2, -0.4, math.pi], [1.5, -1.2, 0.3], [-1.0, 1.0, -2.5]),
    "straight above": ([1.0, 2.0, 0.5], [1.0, 2.0, -1.0], [0.0, 0.0, 1.5]),
    "far": ([0.0, 0.0, 0.3], [900.0, 3.0, 9.0], [850.0, -200.0, -7.0]),
}


def random_cases(count: int = 30) -> list[tuple]:
    rng = np.random.default_rng(3)
    cases = []
    for _ in range(count):
        pose, lamp = rng.uniform([-5, -5, -np.pi], [5, 5, np.pi], (2, 3))
        cases.append((pose, lamp, between(pose, lamp) + rng.normal(0, 0.1, 3)))
    return cases


@pytest.mark.parametrize("case", [*AWKWARD.values(), *random_cases()])
def test_jacobians_equal_central_differences(case: tuple) -> None:
    pose, lamp, z = (np.array(v, float) for v in case)
    e, J_pose, J_lamp = LAMP.residual(pose, lamp, z)
    by_pose = central_differences(lambda v: LAMP.residual(v, lamp, z)[0], pose)
    by_lamp = central_differences(lambda v: LAMP.residual(pose, v, z)[0], lamp)
    np.testing.assert_allclose(J_pose, by_pose, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(J_lamp, by_lamp, rtol=1e-5, atol=1e-6)
    assert -0.5 * math.pi < e[2] <= 0.5 * math.pi


@pytest.mark.parametrize("turns", [-3, -1, 1, 2])
def test_an_axis_is_known_modulo_half_a_turn(turns: int) -> None:
    """Erratum of Bellini (7): a plain difference takes a lamp seen from behind for a turned one."""
    pose, lamp, z = (np.array(v, float) for v in random_cases(1)[0])
    e = LAMP.residual(pose, lamp, z)[0]
    half = np.array([0.0, 0.0, turns * math.pi])
    np.testing.assert_allclose(LAMP.residual(pose, lamp, z + half)[0], e, atol=1e-12)
    np.testing.assert_allclose(LAMP.residual(pose, lamp + half, z)[0], e, atol=1e-12)


def test_a_new_lamp_is_where_it_was_seen_and_its_jacobians_are_right() -> None:
    pose, z = np.array([1.0, -2.0, 2.5]), np.array([0.4, 0.3, -1.2])
    lamp, J_pose, J_z = LAMP.initialise(pose, z, np.eye(3))
    np.testing.assert_allclose(LAMP.residual(pose, lamp, z)[0], 0.0, atol=1e-12)
    by_pose = central_differences(lambda v: compose(v, z), pose)
    by_z = central_differences(lambda v: compose(pose, v), z)
    np.testing.assert_allclose(J_pose, by_pose, atol=1e-8)
    np.testing.assert_allclose(J_z, by_z, atol=1e-8)


def test_a_lamp_has_one_name() -> None:
    lamps = np.array([[1.0, 2.0, 3.0], [1.0, 2.0, -0.5 * math.pi], [0.0, 0.0, 20.0]])
    named, _, J = LAMP.canonical(lamps, np.full((3, 2), np.nan))
    assert np.all(named[:, 2] > -0.5 * math.pi)
    assert np.all(named[:, 2] <= 0.5 * math.pi)
    np.testing.assert_allclose(wrap(2 * (named[:, 2] - lamps[:, 2])), 0.0, atol=1e-12)
    np.testing.assert_array_equal(J, np.tile(np.eye(3), (3, 1, 1)))
