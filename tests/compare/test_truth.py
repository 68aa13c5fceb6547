"""Which frame the truth is held against: the known map's own where that is the true one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from compare.comparison import compare
from compare.truth import truth_of
from graphslam.geometry import compose, inverse
from tests.compare.made import estimate_of, log_with
from tests.graphslam.test_localisation import map_of
from tests.worlds import GRID, drive

OFF = np.array([0.6, -0.2, 0.0])
DRIVEN, TRUE_POSE = drive(seed=5, nodes=60)
WRONG_START = replace(DRIVEN, start_pose=TRUE_POSE[0] + OFF)
LOG = log_with(DRIVEN.t, TRUE_POSE, GRID)


def path_error(known: np.ndarray) -> float:
    """Returns the error of a path that is off by `OFF` everywhere, not aligned, m."""
    measurements = replace(WRONG_START, known=map_of(known))
    labels = measurements.sightings["line"].truth
    estimate = estimate_of(measurements, TRUE_POSE + OFF, known, labels, method="ekf", causal=True)
    judged = compare(LOG, measurements, [estimate])["ekf"].trajectory
    assert judged is not None
    return judged.rmse_m


def test_on_the_true_map_a_wrong_start_counts_as_the_error_that_it_is() -> None:
    assert path_error(GRID) == pytest.approx(np.hypot(*OFF[:2]), rel=1e-6)


def test_on_any_other_map_the_start_says_where_the_frames_lie() -> None:
    moved = GRID + np.array([0.01, 0.0])
    assert path_error(moved) == pytest.approx(0.0, abs=1e-9)


def test_the_frame_of_a_true_map_is_the_truths_own_under_either_start() -> None:
    known = replace(WRONG_START, known=map_of(GRID))
    np.testing.assert_array_equal(truth_of(LOG, known).truth_T_start, np.zeros(3))
    expected = compose(TRUE_POSE[0], inverse(WRONG_START.start_pose))
    np.testing.assert_allclose(truth_of(LOG, WRONG_START).truth_T_start, expected, atol=1e-12)
