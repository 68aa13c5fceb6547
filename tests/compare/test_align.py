"""Rigid motions from points and from lines."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from compare.align import (
    line_differences,
    rigid_from_lines,
    rigid_from_points,
    unobserved_direction,
)
from graphslam.geometry import (
    compose,
    inverse,
    line_to_floor,
    line_to_robot,
    points_on_line,
    transform_points,
    twin,
    wrap,
)
from tests.graphslam.differences import central_differences

metres = st.floats(-20.0, 20.0)
angles = st.floats(-np.pi, np.pi)
motions = st.tuples(metres, metres, angles).map(np.array)
seeds = st.integers(0, 2**32 - 1)

CROSSING = np.array([[0.4, 0.0], [1.5, 0.1], [2.0, np.pi / 2], [0.7, -2.5]])
MIDDLE = np.array([1.0, -2.0, 0.5, 3.0])


def assert_same_motion(a: np.ndarray, b: np.ndarray, atol: float = 1e-9) -> None:
    np.testing.assert_allclose(a[:2], b[:2], atol=atol)
    assert abs(wrap(a[2] - b[2])) < atol


# ---- points ------------------------------------------------------------------------------------


@given(motions, seeds)
def test_points_give_back_the_motion_that_moved_them(motion: np.ndarray, seed: int) -> None:
    p = np.random.default_rng(seed).normal(0.0, 2.0, (5, 2))
    assert_same_motion(rigid_from_points(p, transform_points(motion, p)), motion, 1e-8)


def test_no_nearby_motion_fits_noisy_points_better() -> None:
    rng = np.random.default_rng(1)
    p, weights = rng.normal(size=(20, 2)), rng.uniform(0.1, 2.0, 20)
    q = transform_points(np.array([1.0, -2.0, 2.5]), p) + 0.3 * rng.normal(size=(20, 2))

    def cost(motion: np.ndarray) -> float:
        return float(weights @ ((transform_points(motion, p) - q) ** 2).sum(axis=1))

    best = rigid_from_points(p, q, weights)
    for step in np.vstack([np.eye(3), -np.eye(3)]) * 1e-4:
        assert cost(best + step) > cost(best)


def test_a_point_without_weight_has_no_say() -> None:
    p = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [5.0, 5.0]])
    q = transform_points(np.array([1.0, 2.0, 0.3]), p)
    q[3] += 100.0
    weights = np.array([1.0, 1.0, 1.0, 0.0])
    assert_same_motion(rigid_from_points(p, q, weights), np.array([1.0, 2.0, 0.3]))


def test_points_on_one_straight_line_still_fix_the_turn() -> None:
    p = np.column_stack([np.arange(4.0), np.zeros(4)])
    motion = np.array([1.0, 2.0, -2.0])
    assert_same_motion(rigid_from_points(p, transform_points(motion, p)), motion)


def test_without_points_the_motion_is_the_identity() -> None:
    np.testing.assert_array_equal(
        rigid_from_points(np.zeros((0, 2)), np.zeros((0, 2))), np.zeros(3)
    )


@pytest.mark.parametrize("count", [1, 4])
def test_points_in_one_place_are_moved_but_not_turned(count: int) -> None:
    p = np.tile([0.1, 0.7], (count, 1))
    q = np.random.default_rng(0).normal(5.0, 1.0, (count, 2))
    motion = rigid_from_points(p, q)
    assert motion[2] == 0.0
    np.testing.assert_allclose(motion[:2], q.mean(axis=0) - p[0])


# ---- differences of lines ----------------------------------------------------------------------


def test_an_offset_is_taken_where_it_is_asked_for() -> None:
    line, angle = np.array([2.0, 0.0]), 0.01
    pivot = points_on_line(line, np.array(10.0))
    turned = np.array([pivot @ [np.cos(angle), np.sin(angle)], angle])
    s = -pivot[0] * np.sin(angle) + pivot[1] * np.cos(angle)
    e, _ = line_differences(np.zeros(3), turned, np.array([s, s - 10.0]), line)
    np.testing.assert_allclose(e[0], [0.0, angle], atol=1e-12)
    np.testing.assert_allclose(e[1], [10.0 * np.sin(angle), angle], atol=1e-12)


@given(motions, metres, angles, metres, st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_naming_either_line_by_its_twin_keeps_the_size_of_the_difference(
    frame: np.ndarray, rho: float, alpha: float, s: float, d_rho: float, d_alpha: float
) -> None:
    line = np.array([rho, alpha])
    true = line_to_floor(np.array([rho + d_rho, alpha + d_alpha]), frame)
    e, _ = line_differences(frame, line, np.array(s), true)
    same, _ = line_differences(frame, line, np.array(s), twin(true))
    mirrored, _ = line_differences(frame, twin(line), np.array(-s), true)
    np.testing.assert_allclose(same, e, atol=1e-9)
    np.testing.assert_allclose(mirrored, e * [-1.0, 1.0], atol=1e-9)


@pytest.mark.parametrize(
    ("frame", "line", "true"),
    [
        ([1.0, -2.0, 0.4], [0.8, 0.3], [1.0, 0.9]),
        ([0.0, 0.0, np.pi], [0.0, 0.0], [0.0, np.pi]),  # rho 0 and the wrap
        ([3.0, 1.0, -3.1], [1.0, 3.1], [-2.0, 0.1]),
    ],
)
def test_the_jacobian_of_line_differences_equals_central_differences(
    frame: list[float], line: list[float], true: list[float]
) -> None:
    s = np.array(0.7)
    _, J = line_differences(np.array(frame), np.array(line), s, np.array(true))
    numeric = central_differences(
        lambda f: line_differences(f, np.array(line), s, np.array(true))[0], np.array(frame)
    )
    np.testing.assert_allclose(J, numeric, atol=1e-8)


# ---- lines -------------------------------------------------------------------------------------


@given(
    st.tuples(metres, metres, st.floats(-np.pi, np.pi)).map(np.array),
    st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-0.5, 0.5)).map(np.array),
    st.lists(st.booleans(), min_size=4, max_size=4),
)
def test_lines_give_back_the_motion_that_moved_them(
    motion: np.ndarray, off: np.ndarray, flips: list[bool]
) -> None:
    true = line_to_floor(CROSSING, motion)
    true = np.where(np.array(flips)[:, None], twin(true), true)
    found = rigid_from_lines(CROSSING, MIDDLE, true, compose(motion, off))
    assert_same_motion(found, motion, 1e-8)


def test_no_nearby_motion_fits_noisy_lines_better() -> None:
    rng = np.random.default_rng(2)
    motion = np.array([0.5, -1.0, 0.2])
    true = line_to_floor(CROSSING + 0.05 * rng.normal(size=(4, 2)), motion)

    def cost(at: np.ndarray) -> float:
        return float((line_differences(at, CROSSING, MIDDLE, true)[0] ** 2).sum())

    best = rigid_from_lines(CROSSING, MIDDLE, true, np.zeros(3))
    assert cost(best) > 0.0
    for step in np.vstack([np.eye(3), -np.eye(3)]) * 1e-4:
        assert cost(best + step) > cost(best)


def test_parallel_lines_leave_the_motion_along_them_to_the_path() -> None:
    lines = np.array([[1.0, 0.0], [2.0, 0.01], [3.0, -0.01]])
    middle = np.array([5.0, 6.0, 7.0])
    true = np.array([[1.1, 0.0], [2.1, 0.0], [-3.1, np.pi]])
    path = np.array([0.0, 0.4, 0.02])
    found = rigid_from_lines(lines, middle, true, path)
    centre = points_on_line(lines, middle).mean(axis=0)
    by_path, by_lines = transform_points(path, centre), transform_points(found, centre)
    assert by_lines[1] == pytest.approx(by_path[1], abs=1e-12)
    e, _ = line_differences(found, lines, middle, true)
    assert e[:, 0].mean() == pytest.approx(0.0, abs=1e-12)


def test_lines_that_are_parallel_but_for_noise_do_not_fix_the_motion_along_them() -> None:
    """Their small angles would turn millimetres across into decimetres along."""
    true = np.array([[1.0, 0.0], [2.0, 0.02], [3.0, -0.02]])
    lines = true + np.array([[0.0, 0.0], [0.005, 0.0], [-0.005, 0.0]])
    blind = unobserved_direction(true)
    assert blind is not None
    found = rigid_from_lines(lines, np.zeros(3), true, np.zeros(3))
    centre = points_on_line(lines, np.zeros(3)).mean(axis=0)
    assert (transform_points(found, centre) - centre) @ blind == pytest.approx(0.0, abs=1e-12)


def test_one_line_is_laid_on_its_true_line() -> None:
    line, true = np.array([[1.0, 0.3]]), np.array([[2.0, 0.5]])
    found = rigid_from_lines(line, np.array([4.0]), true, np.zeros(3))
    np.testing.assert_allclose(line_to_robot(true, found), line, atol=1e-12)


def test_without_lines_the_map_moves_as_the_path() -> None:
    path, none = np.array([1.0, 2.0, 3.0]), np.zeros((0, 2))
    np.testing.assert_array_equal(rigid_from_lines(none, np.zeros(0), none, path), path)


def test_the_motion_from_lines_does_not_depend_on_the_frame_they_stand_in() -> None:
    rng = np.random.default_rng(3)
    true = CROSSING + 0.02 * rng.normal(size=(4, 2))
    points = points_on_line(CROSSING, MIDDLE)
    there = np.array([4.0, -7.0, 0.3])
    lines = line_to_robot(CROSSING, there)
    middle = transform_points(inverse(there), points)
    middle = -middle[:, 0] * np.sin(lines[:, 1]) + middle[:, 1] * np.cos(lines[:, 1])
    here = rigid_from_lines(CROSSING, MIDDLE, true, np.zeros(3))
    moved = rigid_from_lines(lines, middle, true, there)
    assert_same_motion(compose(moved, inverse(there)), here, 1e-8)


@pytest.mark.parametrize(
    ("alphas", "along"),
    [([0.0, np.pi], [0, 1]), ([0.3], None), ([0.0, np.radians(4.0)], None)],
)
def test_lines_of_one_direction_leave_one_direction_open(
    alphas: list[float], along: list[float] | None
) -> None:
    lines = np.column_stack([np.ones(len(alphas)), alphas])
    direction = unobserved_direction(lines)
    assert direction is not None
    if along is not None:
        assert abs(direction @ along) == pytest.approx(1.0)


@pytest.mark.parametrize("others", [1, 200])
def test_one_crossing_line_among_many_fixes_both_directions(others: int) -> None:
    lines = np.column_stack([np.ones(others + 1), [*np.zeros(others), np.radians(15.0)]])
    assert unobserved_direction(lines) is None
