from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from graphslam import geometry as g
from tests.graphslam.differences import central_differences

length = st.floats(-50, 50)
angle = st.floats(-10, 10)
pose = st.tuples(length, length, angle).map(np.array)
line = st.tuples(length, angle).map(np.array)


def same_pose(a: np.ndarray, b: np.ndarray) -> bool:
    return bool(np.allclose(a[:2], b[:2], atol=1e-9) and abs(g.wrap(a[2] - b[2])) < 1e-9)


@given(st.floats(-1e3, 1e3))
def test_wrapped_angle_is_in_range_and_the_same_direction(value: float) -> None:
    wrapped = g.wrap(value)
    assert -np.pi < wrapped <= np.pi
    assert np.cos(wrapped - value) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("turns", [-3, -1, 1, 3])
def test_odd_multiples_of_pi_wrap_to_plus_pi(turns: int) -> None:
    value = turns * np.pi
    for near in (value, np.nextafter(value, np.inf), np.nextafter(value, -np.inf)):
        assert -np.pi < g.wrap(near) <= np.pi


@given(pose, pose)
def test_between_undoes_compose(a: np.ndarray, b: np.ndarray) -> None:
    assert same_pose(g.between(a, g.compose(a, b)), b)


@given(pose)
def test_a_pose_composed_with_its_inverse_is_the_origin(a: np.ndarray) -> None:
    assert same_pose(g.compose(a, g.inverse(a)), np.zeros(3))


@given(pose, pose, pose)
def test_composition_is_associative(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> None:
    assert same_pose(g.compose(g.compose(a, b), c), g.compose(a, g.compose(b, c)))


def test_compose_jacobians_equal_differences() -> None:
    a, b = np.array([1.0, -2.0, 2.5]), np.array([0.3, 0.4, -0.7])
    _, J_a, J_b = g.compose_jacobians(a, b)
    np.testing.assert_allclose(J_a, central_differences(lambda v: g.compose(v, b), a), atol=1e-8)
    np.testing.assert_allclose(J_b, central_differences(lambda v: g.compose(a, v), b), atol=1e-8)


@given(line, pose)
def test_a_line_moved_to_the_robot_and_back_is_itself(ln: np.ndarray, at: np.ndarray) -> None:
    back = g.line_to_floor(g.line_to_robot(ln, at), at)
    assert back[0] == pytest.approx(ln[0], abs=1e-9)
    assert abs(g.wrap(back[1] - ln[1])) < 1e-9


@given(line, pose, length)
def test_points_of_a_line_stay_on_it_in_the_robot_frame(
    ln: np.ndarray, at: np.ndarray, s: float
) -> None:
    seen = g.line_to_robot(ln, at)
    point = g.transform_points(g.inverse(at), g.points_on_line(ln, np.array(s)))
    distance = seen[0] - point @ np.array([np.cos(seen[1]), np.sin(seen[1])])
    assert abs(distance) < 1e-9


@given(line, length)
def test_a_twin_has_the_same_points_at_the_opposite_position(ln: np.ndarray, s: float) -> None:
    there = g.points_on_line(g.twin(ln), np.array(-s))
    np.testing.assert_allclose(there, g.points_on_line(ln, np.array(s)), atol=1e-9)


@given(line)
def test_exactly_one_of_two_twins_is_canonical(ln: np.ndarray) -> None:
    assert g.is_canonical(ln) != g.is_canonical(g.twin(ln))


@given(st.tuples(length, length), st.tuples(length, length))
def test_the_line_through_two_points_holds_both(p: tuple, q: tuple) -> None:
    p, q = np.array(p), np.array(q)
    if np.linalg.norm(p - q) < 1e-3:
        return
    through = g.line_through(p, q)
    normal = np.array([np.cos(through[1]), np.sin(through[1])])
    assert through[0] >= 0
    assert through[0] == pytest.approx(normal @ p, abs=1e-9)
    assert through[0] == pytest.approx(normal @ q, abs=1e-9)


def test_offset_error_is_the_distance_of_the_moved_line_at_the_stretch() -> None:
    ln, d, s = np.array([10.0, 0.3]), np.array([0.004, 0.003]), np.array(-1.5)
    point = g.points_on_line(ln, s)
    moved = ln + d
    distance = moved[0] - point @ np.array([np.cos(moved[1]), np.sin(moved[1])])
    second_order = 0.5 * ln[0] * d[1] ** 2
    assert g.offset_error(d, s) == pytest.approx(distance, abs=1.01 * second_order)


def test_covariance_turned_by_a_quarter_swaps_the_axes() -> None:
    cov = np.diag([0.2, 0.01, 0.05])
    turned = g.rotate_covariance(cov, np.pi / 2)
    np.testing.assert_allclose(np.diag(turned), [0.01, 0.2, 0.05], atol=1e-15)


def test_interpolation_takes_the_shorter_turn_across_pi() -> None:
    poses = np.array([[0.0, 0.0, 3.0], [1.0, 0.0, -3.0]])
    middle = g.interpolate_poses(np.array([0.5]), np.array([0.0, 1.0]), poses)
    assert abs(g.wrap(middle[0, 2] - np.pi)) < 1e-12


@given(line, length, st.floats(-5, 5))
def test_distance_from_a_line_is_signed_along_its_normal(
    ln: np.ndarray, s: float, off: float
) -> None:
    moved = np.array([ln[0] + off, ln[1]])
    point = g.points_on_line(moved, np.array(s))
    assert g.distance_from_line(ln, point) == pytest.approx(off, abs=1e-9)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_no_angle_does_not_become_one(value: float) -> None:
    with np.errstate(invalid="ignore"):
        assert np.isnan(g.wrap(value))


def test_a_twist_turns_everything_about_one_fixed_point() -> None:
    twist = np.array([0.4, -0.7, 1.3])
    centre = np.array([-twist[1], twist[0]]) / twist[2]
    motion = g.twist_motion(twist)
    np.testing.assert_allclose(g.transform_points(motion, centre), centre, atol=1e-15)
    half = g.twist_motion(0.5 * twist)
    np.testing.assert_allclose(g.compose(half, half), motion, atol=1e-15)
    np.testing.assert_allclose(g.twist_motion(np.array([1.0, 2.0, 0.0])), [1.0, 2.0, 0.0])
