"""How a line is measured: profiles, pairs of edges, joining, the fit, and its covariance."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from frontend.camera import Camera
from frontend.config import DetectorConfig
from frontend.fit_table import Limits
from frontend.lines import detect_lines
from frontend.pairing import DARK, FIRST, SECOND, WIDTH, clearest_first, join_pairs, pair_segments
from frontend.profiles import ACROSS, ALONG, COLUMNS, MOST_BLOCKS, STEP_LOW, read_blocks, to_raw
from frontend.profiles import WIDTH as WIDTH_PX
from frontend.segments import grey_noise
from frontend.sight import region_of
from frontend.straight import fit_straight, keep_strong
from graphslam.geometry import nearest_twin, points_on_line, wrap
from tests.frontend.floors import CAMERAS, Floor

LIMITS = Limits(0.002, 0.025, 0.3, 0.5, np.radians(5.0), 0.12, np.radians(0.5), 0.1, 0.0003, 0.0)


def segment(x_0: float, x_1: float, y: float, left_is_bright: bool) -> list[float]:
    """A segment along x at y, a pixel being 2 mm, as `place_segments` makes it."""
    return [x_0, y, x_1, y, 0.0, 1.0 if left_is_bright else -1.0, abs(x_1 - x_0), 0.002, 50.0]


def pairs_of(*segments: list[float], **limits: float) -> np.ndarray:
    return pair_segments(np.array(segments), LIMITS._replace(**limits))


# ---- pairs --------------------------------------------------------------------------------------


def test_two_edges_that_face_away_from_each_other_are_a_dark_line() -> None:
    (pair,) = pairs_of(segment(0.4, 0.9, 0.004, True), segment(0.5, 0.8, -0.004, False))
    assert pair[DARK] == 1.0
    assert pair[WIDTH] == pytest.approx(0.008)
    np.testing.assert_allclose(np.sort(pair[[0, 2]]), [0.5, 0.8])
    np.testing.assert_allclose(pair[[1, 3]], 0.0, atol=1e-12)


def test_two_edges_that_face_each_other_are_a_bright_line() -> None:
    (pair,) = pairs_of(segment(0.4, 0.9, 0.004, False), segment(0.4, 0.9, -0.004, True))
    assert pair[DARK] == -1.0


@pytest.mark.parametrize(
    "second",
    [
        segment(0.4, 0.9, -0.004, True),  # facing the same way: a step, not a line
        segment(0.4, 0.9, -0.060, False),  # too far
        segment(0.95, 1.4, -0.004, False),  # not beside each other
        [0.4, -0.10, 0.9, 0.09, 0.35, -0.936, 0.53, 0.002, 50.0],  # at an angle
    ],
)
def test_what_does_not_bound_one_line_is_no_pair(second: list[float]) -> None:
    assert len(pairs_of(segment(0.4, 0.9, 0.004, True), second)) == 0


def test_only_the_polarity_asked_for_makes_pairs() -> None:
    dark = segment(0.4, 0.9, 0.004, True), segment(0.4, 0.9, -0.004, False)
    assert len(pairs_of(*dark, sense=1.0)) == 1
    assert len(pairs_of(*dark, sense=-1.0)) == 0


def joined(gap: float, longest: float) -> int:
    segments = [
        segment(0.4, 0.7, 0.004, True),
        segment(0.4, 0.7, -0.004, False),
        segment(0.7 + gap, 1.2, 0.004, True),
        segment(0.7 + gap, 1.2, -0.004, False),
    ]
    pairs = pairs_of(*segments)
    assert {(int(p[FIRST]), int(p[SECOND])) for p in pairs} == {(0, 1), (2, 3)}
    return len(join_pairs(pairs, clearest_first(pairs), np.array(segments), longest))


def test_a_break_is_joined_up_to_the_longest_allowed() -> None:
    assert joined(gap=0.25, longest=0.3) == 1
    assert joined(gap=0.25, longest=0.2) == 2


# ---- profiles and fit ---------------------------------------------------------------------------


def blocks_along(camera: Camera, line: np.ndarray, width: float, grey: float) -> np.ndarray:
    image = Floor(camera).draw(line, width, grey).image(np.random.default_rng(0))
    sight = region_of(camera, 0.03).sight(image)
    ends = camera.floor_to_pixel(points_on_line(line, np.array([-0.75, -0.45])))
    blocks = np.empty((MOST_BLOCKS, COLUMNS))
    dark = 1.0 if grey < 140.0 else -1.0
    return blocks[: read_blocks(sight, ends, width, dark, 2.0, 320.0, blocks)]


@pytest.mark.parametrize("name", ["320x240", "320x240 bent", "320x240 fisheye"])
@pytest.mark.parametrize("grey", [60.0, 220.0])
def test_profiles_find_the_middle_to_a_hundredth_of_a_pixel(name: str, grey: float) -> None:
    blocks = blocks_along(CAMERAS[name], np.array([0.05, 1.8]), 0.010, grey)
    assert len(blocks) > 10
    assert (blocks[:, STEP_LOW] > 20.0).all()
    assert abs(blocks[:, ACROSS].mean()) < 0.02
    assert blocks[:, ACROSS].std() < 0.06
    assert blocks[:, WIDTH_PX].std() < 0.3


def test_profiles_of_the_wrong_polarity_see_no_edges() -> None:
    camera, line = CAMERAS["320x240"], np.array([0.05, 1.8])
    image = Floor(camera).draw(line, 0.010).image(np.random.default_rng(0))
    ends = camera.floor_to_pixel(points_on_line(line, np.array([-0.75, -0.45])))
    blocks = np.empty((MOST_BLOCKS, COLUMNS))
    count = read_blocks(region_of(camera, 0.03).sight(image), ends, 0.01, -1.0, 2.0, 320.0, blocks)
    assert keep_strong(blocks, count, 10.0)[0] < 0.2 * count


@pytest.mark.parametrize("name", ["320x240 bent", "320x240 fisheye"])
def test_the_grid_of_the_lens_is_the_lens_to_thousandths_of_a_pixel(name: str) -> None:
    camera = CAMERAS[name]
    region = region_of(camera, 0.03)
    rng = np.random.default_rng(1)
    pixels = rng.uniform(region.box[:2], region.box[2:], (200, 2))
    raw = np.array([to_raw(u, v, region.lens, region.lens_at) for u, v in pixels])
    np.testing.assert_allclose(raw, camera.distort(pixels), atol=3e-3)


def test_a_third_of_strays_does_not_turn_the_straight_line() -> None:
    rng = np.random.default_rng(2)
    blocks, weight = np.zeros((60, COLUMNS)), np.empty(60)
    along = np.arange(60.0) * 5.0
    blocks[:, ACROSS] = 0.3 + 0.002 * along + rng.normal(0.0, 0.05, 60)
    blocks[40:, ACROSS] += rng.uniform(0.8, 2.0, 20)  # one end runs along a neighbour's edge
    blocks[:, ALONG] = along
    a, b = fit_straight(blocks, 60, weight)
    assert a == pytest.approx(0.3, abs=0.05)
    assert b == pytest.approx(0.002, abs=3e-4)
    assert (weight[40:] == 0.0).mean() > 0.9


@pytest.mark.parametrize("sigma", [0.5, 2.0, 6.0, 12.0])
def test_the_noise_of_an_image_is_measured_whatever_lines_it_shows(sigma: float) -> None:
    camera = CAMERAS["640x480"]
    floor = Floor(camera)
    for k in range(8):
        floor.draw(np.array([0.4 + 0.1 * k, 0.05]))
    image = floor.image(np.random.default_rng(3), sigma)
    assert grey_noise(image) == pytest.approx(np.hypot(sigma, np.sqrt(1.0 / 12.0)), rel=0.1)


# ---- covariance ---------------------------------------------------------------------------------

LINE = np.array([0.55, 0.4])  # far off the origin's foot: rho and alpha are correlated


def test_the_covariance_is_that_of_many_images_correlation_included() -> None:
    camera = CAMERAS["320x240"]
    config = DetectorConfig(calibration_px=0.0, straightness_m=0.0)
    rng = np.random.default_rng(4)
    errors, covariances = [], []
    for _ in range(80):
        line = LINE + rng.uniform(-0.01, 0.01, 2)  # or each image would round its grooves alike
        found = detect_lines(Floor(camera).draw(line, 0.010).image(rng, 4.0), camera, config)
        errors.append(found.z[0] - line)
        covariances.append(found.cov[0])
    e, cov = np.array(errors), np.array(covariances)
    nees = np.einsum("ki,kij,kj->k", e, np.linalg.inv(cov), e) / 2.0
    assert 0.5 < nees.mean() < 1.4
    stated, scattered = cov.mean(axis=0), np.cov(e.T)
    correlation = [c[0, 1] / np.sqrt(c[0, 0] * c[1, 1]) for c in (stated, scattered)]
    assert abs(correlation[1]) > 0.3
    assert correlation[0] == pytest.approx(correlation[1], abs=0.3)


def test_the_calibrations_part_is_what_moving_the_corners_of_the_image_does() -> None:
    sharp = CAMERAS["320x240"]
    image = Floor(sharp).draw(LINE, 0.010).image(np.random.default_rng(5))
    part = {}
    for sigma in (0.0, 1.0):
        config = DetectorConfig(calibration_px=sigma, straightness_m=0.0)
        part[sigma] = detect_lines(image, sharp, config).cov[0]
    stated = part[1.0] - part[0.0]
    corners = np.array([[0, 0], [319, 0], [0, 239], [319, 239]], float)
    floor = sharp.pixel_to_floor(corners)
    rng = np.random.default_rng(6)
    errors = []
    for _ in range(150):
        moved, _ = cv2.findHomography(floor, corners + rng.normal(0.0, 1.0, (4, 2)))
        camera = Camera("floor", "floor", (320, 240), moved)
        error = detect_lines(image, camera, DetectorConfig()).z[0] - nearest_twin(LINE, LINE)
        errors.append([error[0], wrap(error[1])])
    scattered = np.cov(np.array(errors).T)
    ratio = np.linalg.eigvals(np.linalg.solve(stated, scattered)).real
    assert (ratio > 0.5).all()
    assert (ratio < 2.0).all()
