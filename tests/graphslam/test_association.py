from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from graphslam.association import DROPPED, NEW, match
from graphslam.association.nearest import assign, gate_for
from graphslam.config import MatchingConfig

ANGULAR = (False, True)


def test_the_nearest_pair_is_taken_first_and_each_landmark_once() -> None:
    distance = np.array([[4.0, 9.0], [1.0, 8.0]])
    np.testing.assert_array_equal(assign(distance, 10.0, 50.0), [1, 0])


def test_between_the_two_gates_a_sighting_is_neither_match_nor_new() -> None:
    distance = np.array([[20.0, 30.0], [70.0, 60.0]])
    np.testing.assert_array_equal(assign(distance, 10.0, 50.0), [DROPPED, NEW])


def test_a_second_sighting_of_a_taken_landmark_does_not_become_new() -> None:
    distance = np.array([[1.0, 900.0], [2.0, 900.0]])
    np.testing.assert_array_equal(assign(distance, 10.0, 50.0), [0, DROPPED])


def test_the_gate_keeps_its_probability_in_other_dimensions() -> None:
    probability = chi2.sf(14.0, 2)
    for dim in (1, 2, 3):
        assert chi2.sf(gate_for(14.0, dim), dim) == pytest.approx(probability)


def test_gated_matching_weighs_by_the_covariance() -> None:
    e = np.array([[[0.3, 0.0], [0.2, 0.0]]])
    S = np.array([[np.diag([0.04, 0.01]), np.diag([1e-4, 1e-4])]])
    config = MatchingConfig()
    found = match(e, S, np.array([-1]), np.array([-1, -1]), ANGULAR, config)
    np.testing.assert_array_equal(found, [0])


def test_nearest_matching_knows_lengths_from_angles_and_no_covariance() -> None:
    config = MatchingConfig(method="nearest", nearest_distance_m=0.15, nearest_angle_deg=10.0)
    e = np.array([[[0.3, 0.0], [0.1, 0.1]], [[0.1, 0.3], [0.4, 0.0]]])
    S = np.broadcast_to(np.eye(2), (2, 2, 2, 2))
    found = match(e, S, np.array([-1, -1]), np.array([-1, -1]), ANGULAR, config)
    np.testing.assert_array_equal(found, [1, NEW])


def test_known_matching_uses_every_sighting_that_has_a_line() -> None:
    config = MatchingConfig(method="known")
    truth, identity = np.array([5, 5, 9, -1]), np.array([2, 5])
    e = np.full((4, 2, 2), 100.0)
    S = np.broadcast_to(np.eye(2), (4, 2, 2, 2))
    found = match(e, S, truth, identity, ANGULAR, config)
    np.testing.assert_array_equal(found, [1, 1, NEW, DROPPED])
    nothing = match(e[:, :0], S[:, :0], truth, identity[:0], ANGULAR, config)
    np.testing.assert_array_equal(nothing, [NEW, NEW, NEW, DROPPED])
