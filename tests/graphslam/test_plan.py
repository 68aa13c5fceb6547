"""The plan of the floor, as polylines and as SVG."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from graphslam.geometry import distance_from_line
from graphslam.measurements import LandmarkMap
from graphslam.plan import (
    ELLIPSE_PROBABILITY,
    Layer,
    covariance_ellipse,
    line_segments,
    plan_svg,
)


def test_the_ellipse_holds_its_share_of_a_gaussian() -> None:
    cov = np.array([[0.04, 0.015], [0.015, 0.01]])
    ellipse = covariance_ellipse(np.array([1.0, 2.0]), cov) - [1.0, 2.0]
    assert_allclose(ellipse[0], ellipse[-1], atol=1e-12)
    squared = np.einsum("ki,ij,kj->k", ellipse, np.linalg.inv(cov), ellipse)
    assert_allclose(squared, squared[0])
    assert_allclose(1.0 - np.exp(-0.5 * squared[0]), ELLIPSE_PROBABILITY)


def test_lines_go_over_their_stretch_or_right_across_the_plan() -> None:
    lines = np.array([[0.5, 0.3], [0.5, 0.3]])
    extent = np.array([[-1.0, 2.0], [np.nan, np.nan]])
    none = np.zeros(2, np.int64)
    landmarks = LandmarkMap(np.arange(2), ("line", "line"), lines, extent, none)
    low, high = np.array([10.0, 0.0]), np.array([13.0, 4.0])
    segments = line_segments(landmarks, low, high)
    assert_allclose(distance_from_line(lines[:, None], segments), 0.0, atol=1e-12)
    assert_allclose(np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1), [3.0, 5.0])
    middle = segments[1].mean(axis=0) - 0.5 * (low + high)
    assert_allclose(middle @ (segments[1, 1] - segments[1, 0]), 0.0, atol=1e-12)


def test_a_small_plan_draws_every_kth_point_and_a_tall_one_keeps_its_size() -> None:
    path = np.column_stack([np.zeros(1000), np.linspace(0.0, 20.0, 1000)])
    layer = Layer("path", (path,), ("",), "#000000")
    assert plan_svg([layer], most_points=100).count(",") < plan_svg([layer]).count(",") / 9
    assert 'height="640"' in plan_svg([layer], size=640)


def test_a_plan_of_one_point_is_drawn() -> None:
    layer = Layer("path", (np.array([[3.0, 4.0]]),), ("",), "#000000")
    assert "nan" not in plan_svg([layer])
