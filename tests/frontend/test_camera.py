"""Floor to pixel and back, what is in view, and cameras that cannot be used."""

from __future__ import annotations

import pickle

import cv2
import numpy as np
import pytest

from frontend.camera import FARTHEST_VIEW, Camera
from graphslam.errors import BadConfig
from graphslam.geometry import points_on_line, position_along

SIZE = (320, 240)


def pinhole_homography(
    pitch_deg: float, height: float = 0.6, forward: float = 0.0, focal: float = 330.0
) -> tuple[np.ndarray, np.ndarray]:
    """A camera ``height`` above the floor that looks ahead and down; and its camera matrix."""
    matrix = np.array([[focal, 0, (SIZE[0] - 1) / 2], [0, focal, (SIZE[1] - 1) / 2], [0, 0, 1.0]])
    pitch = np.radians(pitch_deg)
    ahead = np.array([np.cos(pitch), 0.0, -np.sin(pitch)])
    right = np.array([0.0, -1.0, 0.0])
    axes = np.stack([right, np.cross(ahead, right), ahead])
    centre = np.array([forward, 0.0, height])
    return matrix @ np.column_stack([axes[:, :2], -axes @ centre]), matrix


def camera(pitch_deg: float = 47.0, scale: float = 1.0, forward: float = 0.0) -> Camera:
    homography, _ = pinhole_homography(pitch_deg, forward=forward)
    return Camera("floor", "floor", SIZE, scale * homography)


def fisheye() -> Camera:
    homography, matrix = pinhole_homography(47.0)
    return Camera("bent", "floor", SIZE, homography, matrix, np.array([-0.25, 0.05, 1e-3, -1e-3]))


def test_pixels_go_to_the_floor_and_back() -> None:
    pixels = np.random.default_rng(0).uniform((0, 0), SIZE, (7, 11, 2))
    floor = camera().pixel_to_floor(pixels)
    assert floor.shape == pixels.shape
    np.testing.assert_allclose(camera().floor_to_pixel(floor), pixels, atol=1e-9)


def test_the_middle_of_the_image_shows_the_floor_straight_ahead() -> None:
    middle = camera(45.0).pixel_to_floor((np.array(SIZE) - 1) / 2)
    np.testing.assert_allclose(middle, (0.6, 0.0), atol=1e-12)


def test_the_left_of_the_image_shows_the_left_of_the_robot() -> None:
    assert camera().pixel_to_floor([0.0, 120.0])[1] > 0.1


@pytest.mark.parametrize("scale", [-1.0, 1e-3, -250.0])
def test_the_scale_and_sign_of_the_homography_do_not_matter(scale: float) -> None:
    floor = np.array([[0.5, 0.1], [0.9, -0.2]])
    wanted = camera().floor_to_pixel(floor)
    np.testing.assert_allclose(camera(scale=scale).floor_to_pixel(floor), wanted)


def test_a_camera_ahead_of_the_robot_does_not_see_the_robot() -> None:
    ahead = camera(20.0, forward=2.0)
    as_calibrated = ahead.homography / ahead.homography[2, 2]  # h33 = 1 at a point behind it
    again = Camera("ahead", "floor", SIZE, as_calibrated)
    assert np.isnan(again.floor_to_pixel([0.0, 0.0])).all()
    assert np.isfinite(again.floor_to_pixel([4.0, 0.0])).all()


def test_behind_the_horizon_there_is_no_pixel_and_above_it_no_floor() -> None:
    level = camera(10.0)
    assert np.isnan(level.floor_to_pixel([[-1.0, 0.0], [-5.0, 2.0]])).all()
    above, below = level.pixel_to_floor([[160.0, 0.0], [160.0, 239.0]])
    assert np.isnan(above).all()
    assert np.isfinite(below).all()


def test_a_pixel_covers_what_moving_the_edge_by_a_pixel_shows() -> None:
    seen = camera()
    rng = np.random.default_rng(1)
    points = rng.uniform((20, 20), (300, 220), (50, 2))
    angle = rng.uniform(-np.pi, np.pi, 50)
    normals = np.column_stack([np.cos(angle), np.sin(angle)])
    tangents = np.column_stack([-np.sin(angle), np.cos(angle)])
    step = 1e-4
    here, beside = seen.pixel_to_floor(points), seen.pixel_to_floor(points + step * tangents)
    along = (beside - here) / np.linalg.norm(beside - here, axis=1)[:, None]
    moved = seen.pixel_to_floor(points + step * normals) - here
    across = np.abs(moved[:, 0] * along[:, 1] - moved[:, 1] * along[:, 0]) / step
    np.testing.assert_allclose(seen.pixel_size(points, normals), across, rtol=1e-3)


def test_above_the_horizon_a_pixel_covers_infinitely_much() -> None:
    assert camera(10.0).pixel_size([160.0, 0.0], [0.0, 1.0]) == np.inf


def test_undistorting_inverts_the_lens() -> None:
    bent = fisheye()
    raw = np.array([[[0.0, 0.0], [319.0, 0.0]], [[160.0, 120.0], [40.0, 230.0]]])
    ideal = bent.undistort(raw)
    assert ideal.shape == raw.shape
    assert np.abs(ideal - raw).max() > 5.0
    rays = np.column_stack([ideal.reshape(-1, 2), np.ones(4)]) @ np.linalg.inv(bent.matrix).T
    again, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), bent.matrix, bent.distortion)
    np.testing.assert_allclose(again.reshape(raw.shape), raw, atol=1e-6)


def test_without_a_lens_pixels_stay_where_they_are() -> None:
    raw = np.array([[3.0, 4.0]])
    np.testing.assert_array_equal(camera().undistort(raw), raw)


def test_the_view_is_the_image_on_the_floor() -> None:
    corners = np.array([[-0.5, -0.5], [319.5, -0.5], [319.5, 239.5], [-0.5, 239.5]])
    view = camera().view()
    assert {tuple(p) for p in view.round(9)} == {
        tuple(p) for p in camera().pixel_to_floor(corners).round(9)
    }


@pytest.mark.parametrize("seen", [camera(), camera(10.0), fisheye()], ids=["down", "level", "bent"])
def test_the_view_is_convex_finite_and_counter_clockwise(seen: Camera) -> None:
    view = seen.view()
    edge = np.roll(view, -1, axis=0) - view
    following = np.roll(edge, -1, axis=0)
    turn = edge[:, 0] * following[:, 1] - edge[:, 1] * following[:, 0]
    assert np.isfinite(view).all()
    assert (turn > -1e-12).all()


def test_a_horizon_ends_the_view_at_a_multiple_of_the_nearest_depth() -> None:
    level = camera(10.0)
    depth = level.view() @ level.homography[2, :2] + level.homography[2, 2]
    assert depth.max() / depth.min() == pytest.approx(FARTHEST_VIEW)


def test_a_lens_that_pulls_corners_in_shows_more_floor() -> None:
    straight, bent = camera().view(), fisheye().view()
    assert bent[:, 0].max() > straight[:, 0].max() + 0.05


@pytest.mark.parametrize("seen", [camera(), camera(10.0), fisheye()], ids=["down", "level", "bent"])
def test_the_visible_stretch_is_where_points_of_the_line_are_in_view(seen: Camera) -> None:
    rng = np.random.default_rng(2)
    lines = np.column_stack([rng.uniform(-1.5, 1.5, 200), rng.uniform(-np.pi, np.pi, 200)])
    stretch = seen.visible_stretch(lines)
    view = seen.view()
    edge = np.roll(view, -1, axis=0) - view
    inward = np.column_stack([-edge[:, 1], edge[:, 0]])
    s = np.linspace(-60.0, 60.0, 24001)
    for line, (enter, leave) in zip(lines, stretch, strict=True):
        offset = points_on_line(line[None], s)[:, None] - view
        inside = s[(np.sum(offset * inward, axis=2) >= 0).all(axis=1)]
        if np.isnan(enter):
            assert len(inside) <= 1
        elif len(inside):
            assert abs(inside[0] - enter) <= 0.01
            assert abs(inside[-1] - leave) <= 0.01
        else:
            assert leave - enter < 0.01
    assert 20 < np.isnan(stretch[:, 0]).sum() < 180


def test_the_visible_stretch_of_a_line_along_the_view_depends_on_its_side() -> None:
    near = camera().view()[:, 0].min()
    inside, outside = camera().visible_stretch([[near + 1e-6, 0.0], [near - 1e-6, 0.0]])
    ends = points_on_line(np.array([[near, 0.0]] * 2), inside)
    assert np.ptp(position_along(np.array([near, 0.0]), ends)) > 0.5
    assert np.isnan(outside).all()


def test_no_lines_have_no_stretch() -> None:
    assert camera().visible_stretch(np.zeros((0, 2))).shape == (0, 2)


def test_a_camera_survives_the_way_to_another_process() -> None:
    again = pickle.loads(pickle.dumps(fisheye()))
    np.testing.assert_array_equal(again.view(), fisheye().view())


def test_a_camera_does_not_change() -> None:
    with pytest.raises(ValueError, match="read-only"):
        camera().homography[0, 0] = 1.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"looks_at": "sideways"}, "looks_at"),
        ({"image_size": (320, 0)}, "image_size"),
        ({"image_size": (320,)}, "image_size"),
        ({"homography": np.eye(2)}, "shape"),
        ({"homography": np.full((3, 3), np.nan)}, "NaN"),
        ({"homography": [["a", 0, 0]] * 3}, "numbers"),
        ({"homography": np.ones((3, 3))}, "inverted"),
        ({"homography": np.linalg.inv([[1, 0, 0], [0, 1, 0], [0, 1, -239]])}, "horizon"),
        ({"distortion": np.zeros(4)}, "matrix"),
        ({"matrix": np.diag([-1.0, 1.0, 1.0]), "distortion": np.zeros(4)}, "focal"),
        ({"matrix": np.eye(3), "distortion": np.zeros(3)}, "coefficients"),
        ({"matrix": np.eye(3), "distortion": [np.inf, 0, 0, 0]}, "distortion"),
    ],
)
def test_a_camera_that_cannot_be_used_says_why(change: dict[str, object], message: str) -> None:
    values: dict[str, object] = {
        "name": "front",
        "looks_at": "floor",
        "image_size": SIZE,
        "homography": pinhole_homography(47.0)[0],
    }
    with pytest.raises(BadConfig, match=message) as caught:
        Camera(**{**values, **change})
    assert "'front'" in str(caught.value)
