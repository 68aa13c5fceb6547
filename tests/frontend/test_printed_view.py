"""The view that SantanaLoc prints, and the scenarios that drive with it."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from frontend.camera import Camera
from frontend.simulate import Scenario, load_scenario, simulate_log
from frontend.simulate.drive import Drive, plan
from frontend.simulate.printed_view import (
    PRINTED_A,
    PRINTED_IMAGE_SIZE,
    homography_from_printed,
    santana_loc_homography,
)
from frontend.simulate.sensors import CameraSpec
from frontend.simulate.view import camera_of
from graphslam.baseline import integrate
from graphslam.errors import BadConfig
from graphslam.geometry import Array
from graphslam.models.wheels import increments_from_wheels, wheel_increment
from tests.frontend.test_simulate import drive_of

FIRST, SECOND = "santana-loc-1", "santana-loc-2"


def camera_from(A: Array) -> Camera:
    return Camera("floor", "floor", PRINTED_IMAGE_SIZE, homography_from_printed(A))


def dead_reckoned(scenario: Scenario, run: Drive) -> Array:
    """Returns where the wheels alone put the robot at the last frame, (x, y), m."""
    step, _ = increments_from_wheels(run.wheel_t, run.wheel_angle, run.frame_t, scenario.robot)
    pose = run.pose_at_frames()[0]
    heading = pose[2] + np.concatenate([[0.0], np.cumsum(step[:-1, 2])])
    c, s = np.cos(heading), np.sin(heading)
    x, y = step[:, 0], step[:, 1]
    return pose[:2] + np.array([c @ x - s @ y, s @ x + c @ y])


# ---- the view ----------------------------------------------------------------------------------


def test_the_printed_matrix_takes_pixels_to_centimetres_of_frame_m() -> None:
    image = np.array(PRINTED_A) @ [320.0, 240.0, 1.0]
    np.testing.assert_allclose(image[:2] / image[2], [-2.1, 47.9], atol=0.05)


def test_ours_takes_metres_of_the_robot_frame_to_the_same_pixels() -> None:
    camera = camera_from(np.array(PRINTED_A))
    rng = np.random.default_rng(0)
    pixel = rng.uniform((0, 0), PRINTED_IMAGE_SIZE, (50, 2))
    image = np.column_stack([pixel, np.ones(50)]) @ np.array(PRINTED_A).T
    x_M, y_M = (image[:, :2] / image[:, 2:]).T
    robot = np.column_stack([y_M, -x_M]) / 100.0
    np.testing.assert_allclose(camera.floor_to_pixel(robot), pixel, atol=1e-8)
    alpha_M, alpha = np.arctan2(y_M, x_M), np.arctan2(robot[:, 1], robot[:, 0])
    np.testing.assert_allclose(alpha_M - alpha, np.pi / 2)


def test_read_as_the_text_says_it_the_matrix_sees_no_floor_ahead() -> None:
    printed = np.array(PRINTED_A) @ np.diag([100.0, 100.0, 1.0])
    point = printed @ [0.0, 0.5, 1.0]
    u, v = point[:2] / point[2]
    assert not (0 <= u < 640 and 0 <= v < 480)


def test_the_view_is_0_26_to_0_99_m_ahead_and_near_floor_is_low_in_the_image() -> None:
    corners = camera_from(np.array(PRINTED_A)).view()
    assert corners[:, 0].min() == pytest.approx(0.26, abs=0.005)
    assert corners[:, 0].max() == pytest.approx(0.99, abs=0.005)
    pixel = camera_from(np.array(PRINTED_A)).floor_to_pixel(np.array([[0.3, 0.1], [0.9, -0.1]]))
    assert pixel[0, 1] > pixel[1, 1]
    assert pixel[0, 0] < pixel[1, 0]


def test_four_printed_decimals_leave_up_to_3_cm() -> None:
    pixel = np.stack(np.meshgrid([0, 320, 639], [0, 240, 479]), -1).reshape(-1, 2)
    exact, worst = camera_from(np.array(PRINTED_A)).pixel_to_floor(pixel), 0.0
    for signs in itertools.product((-5e-5, 5e-5), repeat=8):
        A = np.array(PRINTED_A) + np.append(signs, 0.0).reshape(3, 3)
        apart = camera_from(A).pixel_to_floor(pixel) - exact
        worst = max(worst, float(np.linalg.norm(apart, axis=1).max()))
    assert worst == pytest.approx(0.03, abs=0.005)


def test_a_scenario_names_the_printed_view() -> None:
    camera = camera_of(CameraSpec(PRINTED_IMAGE_SIZE, 5.0, printed="santana-loc"))
    np.testing.assert_allclose(camera.homography, santana_loc_homography())


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ({"image_size": (320, 240)}, r"pixels of \[640, 480\]"),
        ({"view_far": 1.0}, "not both"),
        ({"homography": PRINTED_A}, "not both"),
        ({"matrix": PRINTED_A}, "need the homography"),
    ],
)
def test_the_printed_view_stands_alone(spec: dict[str, object], message: str) -> None:
    given = {"image_size": PRINTED_IMAGE_SIZE, "rate": 5.0, "printed": "santana-loc", **spec}
    with pytest.raises(BadConfig, match=message):
        CameraSpec(**given)  # type: ignore[arg-type]


# ---- the scenarios -----------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "images", "metres"), [(FIRST, 1962, 60.0), (SECOND, 2220, 50.0)])
def test_paths_and_images_are_the_papers(name: str, images: int, metres: float) -> None:
    scenario = load_scenario(name)
    run = drive_of(scenario)
    assert len(run.frame_t) == images
    assert sum(abs(motion.forward or 0.0) for motion in scenario.path) == metres
    assert np.hypot(*(run.pose[-1, :2] - run.pose[0, :2])) < 0.5
    np.testing.assert_array_equal(run.wheel_t, run.frame_t)


def test_odometry_alone_ends_near_the_papers_0_93_m() -> None:
    scenario = load_scenario(FIRST)
    errors = []
    for seed in range(200):
        run = drive_of(scenario, seed)
        errors.append(np.hypot(*(dead_reckoned(scenario, run) - run.pose[-1, :2])))
    assert np.median(errors) == pytest.approx(0.93, abs=0.15)


def test_experiment_1_has_lines_of_one_direction_each_seen_as_often_a_pass_as_the_papers() -> None:
    log = simulate_log(load_scenario(FIRST))
    assert log.map is not None
    assert log.sightings is not None
    assert len(set(log.map.params[:, 1])) == 1
    views = np.bincount(log.sightings.truth)
    between_the_ends = views[2:-2] / 2.0  # driven over twice
    assert between_the_ends.mean() == pytest.approx(23.0, abs=1.5)


def test_experiment_2_shows_one_line_and_two_as_often_as_the_paper() -> None:
    scenario = load_scenario(SECOND)
    shares = []
    for seed in range(3):
        log = simulate_log(scenario, seed)
        assert log.sightings is not None
        _, lines = np.unique(log.sightings.t, return_counts=True)
        shares.append([np.sum(lines == count) / 2220 for count in (1, 2)])
    one, two = np.median(shares, axis=0)
    assert one == pytest.approx(0.61, abs=0.04)
    assert two == pytest.approx(0.26, abs=0.04)
    assert one + two == pytest.approx(0.87, abs=0.02)


def test_with_quarter_turns_of_one_sense_the_robot_ends_50_m_away() -> None:
    """SantanaLoc gives no senses: with equal ones the last leg leads on instead of back."""
    scenario = load_scenario(FIRST)
    *first, sixth, last = scenario.path
    same = replace(scenario, path=(*first, replace(sixth, turn_deg=90.0), last))
    for driven, away in ((scenario, 0.0), (same, 50.0)):
        moves = wheel_increment(np.diff(plan(driven)[1], axis=0), driven.robot)[0]
        end = integrate(np.zeros(3), moves)[-1, :2]
        assert np.hypot(*end) == pytest.approx(away, abs=1e-6)
