from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from graphslam.config import EkfConfig, MatchingConfig
from graphslam.errors import BadMeasurements, UnderConstrained
from graphslam.geometry import wrap
from graphslam.memoryless import NOT_DETERMINED, triangulate
from graphslam.triangulation import (
    circle_through,
    fix,
    pose_covariance,
    three_beacons,
    three_cones,
)
from tests.graphslam.test_bearing_model import reading
from tests.worlds import CONES as AROUND
from tests.worlds import bearing_drive

CONES = np.array([[0.0, 0.0], [0.0, 0.7], [1.0, 0.0]])
POINTS = {"A": (0.50, 0.35), "B": (0.50, 0.05), "C": (0.05, 0.35), "D": (0.95, 0.65)}
coordinate = st.floats(-3, 3)


@settings(max_examples=150, deadline=None)
@given(coordinate, coordinate, st.floats(-np.pi, np.pi), st.permutations(range(3)))
def test_closed_forms_return_the_pose_whatever_its_heading_and_the_order(x, y, theta, order):
    pose = np.array([x, y, theta])
    centre, radius = circle_through(CONES)
    assume(abs(np.hypot(*(pose[:2] - centre)) - radius) > 0.02)
    assume(np.linalg.norm(CONES - pose[:2], axis=1).min() > 0.02)
    z = reading(pose, CONES)[:, 0]
    assert np.abs(wrap(three_cones(z, 1.0, 0.7) - pose)).max() < 1e-7
    order = np.array(order)
    assert np.abs(wrap(three_beacons(CONES[order], z[order]) - pose)).max() < 1e-7


def test_headings_beyond_a_quarter_turn_are_not_turned_round() -> None:
    """Erratum of Kato (1), (3): atan where atan2 is right; (2) prints x + W where it is x - W."""
    for heading in np.radians([0, 30, 60, 90, 120, 180, -100]):
        pose = np.array([0.95, 0.65, heading])
        found = three_cones(reading(pose, CONES)[:, 0], 1.0, 0.7)
        assert np.abs(wrap(found - pose)).max() < 1e-9


@pytest.mark.parametrize("angle", np.radians([20.0, 100.0, 200.0, 300.0]))
def test_a_pose_on_the_circle_is_reported_and_not_returned(angle: float) -> None:
    centre, radius = circle_through(CONES)
    pose = np.array([*(centre + radius * np.array([np.cos(angle), np.sin(angle)])), 0.4])
    z = reading(pose, CONES)[:, 0]
    for solve in (
        lambda: three_beacons(CONES, z),
        lambda: three_cones(z, 1.0, 0.7),
        lambda: fix(CONES, z, np.full(3, 1e-6)),
        lambda: fix(CONES, z + np.array([2e-3, -1e-3, 1e-3]), np.full(3, 2e-6)),
    ):
        with pytest.raises(
            UnderConstrained, match=r"circle through the three beacons \(centre 0\.5"
        ):
            solve()
    assert np.all(np.isinf(pose_covariance(pose, CONES, np.full(3, 1e-6))[0, 0]))
    # a fourth beacon off the circle determines it
    four = np.vstack([CONES, [[0.4, 0.4]]])
    found = fix(four, reading(pose, four)[:, 0], np.full(4, 1e-6))
    np.testing.assert_allclose(found.pose, pose, atol=1e-9)


def test_beacons_in_line_with_the_robot_fix_nothing_and_say_so() -> None:
    line = np.array([[0.0, 0.0], [1.0, 0.0], [3.0, 0.0]])
    with pytest.raises(UnderConstrained, match="line through"):
        three_beacons(line, reading(np.array([-1.0, 0.0, 0.3]), line)[:, 0])
    aside = np.array([0.5, 1.0, 0.3])
    np.testing.assert_allclose(three_beacons(line, reading(aside, line)[:, 0]), aside, atol=1e-9)


def test_bearings_of_other_beacons_have_no_place() -> None:
    with pytest.raises(UnderConstrained, match="2 bearings fix no pose"):
        fix(CONES[:2], np.zeros(2), np.ones(2))
    z = reading(np.array([0.5, 0.35, 0.0]), CONES)[:, 0]
    with pytest.raises(UnderConstrained, match="no place sees"):
        three_beacons(CONES, z + np.array([np.pi, 0.0, 0.0]))


def test_errors_spread_as_the_bound_says_and_point_d_is_bad_because_of_the_circle() -> None:
    rng, sigma = np.random.default_rng(0), 1e-4
    spread = {}
    for name, place in POINTS.items():
        pose = np.array([*place, 0.5])
        z = reading(pose, CONES)[:, 0]
        noisy = z + sigma * rng.standard_normal((400, 3))
        error = np.array([fix(CONES, row, np.full(3, sigma**2)).pose for row in noisy]) - pose
        bound = np.sqrt(np.diag(pose_covariance(pose, CONES, np.full(3, sigma**2))))
        spread[name] = error.std(axis=0)
        np.testing.assert_allclose(spread[name] / bound, 1.0, atol=0.15)
    assert spread["D"][0] / spread["A"][0] == pytest.approx(18, rel=0.2)
    assert spread["D"][1] / spread["A"][1] == pytest.approx(34, rel=0.2)
    # as far from the cones on the other side, off the circle, it is not half as bad
    far = pose_covariance(np.array([-0.45, -0.3, 0.0]), CONES, np.full(3, sigma**2))
    assert np.sqrt(far[1, 1]) < 0.25 * spread["D"][1]


def test_least_squares_with_four_beats_any_three() -> None:
    rng, sigma = np.random.default_rng(1), 2e-3
    four = np.vstack([CONES, [[1.0, 0.7]]])
    pose = np.array([0.7, 0.5, 1.0])
    z = reading(pose, four)[:, 0] + sigma * rng.standard_normal((200, 4))
    found = [fix(four, row, np.full(4, sigma**2)) for row in z]
    error = np.array([f.pose for f in found]) - pose
    np.testing.assert_allclose(error.std(axis=0), np.sqrt(np.diag(found[0].cov)), rtol=0.2)
    assert 2 * np.mean([f.cost for f in found]) == pytest.approx(1.0, abs=0.3)


# ---- the method -------------------------------------------------------------------------------

LABELS = np.array([0, 1, 1])  # one blue, two red
BY_TRUTH = EkfConfig(MatchingConfig(method="known"))


def test_colours_tell_who_is_who_where_they_repeat() -> None:
    around = np.array([[-1.0, -1.2], [-0.9, 4.6], [5.0, -1.0]])
    measurements, truth = bearing_drive(0, 60, around, LABELS, known=True, bearing_sigma=1e-3)
    estimate = triangulate(measurements)
    table = measurements.sightings["bearing"]
    assert estimate.used.mean() > 0.9
    assert np.array_equal(estimate.match[estimate.used], table.truth[estimate.used])
    by_truth = triangulate(measurements, BY_TRUTH)
    assert np.abs(by_truth.pose - truth)[:, :2].max() < 0.05


def test_nine_points_of_four_colours_are_told_apart() -> None:
    """Each colour two or three times: 48 ways to name them, of which one gives a pose."""
    points = np.vstack([AROUND, [[2.0, 7.0], [-3.0, 2.0], [7.0, 2.2]]])
    measurements, truth = bearing_drive(
        1, 15, points, np.array([0, 1, 2, 3, 1, 0, 2, 3, 0]), known=True, bearing_sigma=2e-3
    )
    estimate = triangulate(measurements)
    assert estimate.counts == {}
    assert np.array_equal(estimate.match, measurements.sightings["bearing"].truth)
    assert np.abs(estimate.pose - truth)[:, :2].max() < 0.05


def test_nodes_without_three_bearings_go_on_by_odometry_and_are_counted() -> None:
    measurements, truth = bearing_drive(0, 40, known=True, bearing_sigma=1e-3)
    table = measurements.sightings["bearing"]
    sparse = table.select((table.node % 2 == 0) | (table.truth < 2))
    estimate = triangulate(replace(measurements, sightings={"bearing": sparse}), BY_TRUTH)
    assert estimate.counts == {NOT_DETERMINED: 20}
    sigma = np.sqrt(np.trace(estimate.cov_floor[:, :2, :2], axis1=1, axis2=2))
    assert np.all(sigma[3::2] > sigma[2:-1:2])
    assert np.abs(estimate.pose - truth)[:, :2].max() < 0.05


def test_without_known_points_it_is_refused() -> None:
    measurements, _ = bearing_drive(0, 10)
    with pytest.raises(BadMeasurements, match="known points"):
        triangulate(measurements)
