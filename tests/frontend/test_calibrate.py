"""Cameras from known points, chessboards and dots: what is found, how sure, and what is refused."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from frontend.calibrate import (
    CameraCalibration,
    KnownPoints,
    Lens,
    calibrate_camera,
    camera_toml,
)
from frontend.calibrate_dots import find_dots, without_bias
from frontend.calibrate_fit import fit_homography, nominal_matrix
from frontend.calibrate_matching import dots_of_points
from frontend.calibrate_picture import calibration_picture, encoded
from frontend.calibrate_target import Chessboard, chessboard_points, dot_points
from frontend.camera import Camera
from frontend.readers.log_toml import every_camera, read_log_toml
from graphslam.errors import BadConfig, UnderConstrained
from graphslam.geometry import Array
from tests.frontend.targets import CAMERA, chessboard_paint, dots_paint, photograph

SIZE = CAMERA.image_size
MATRIX = nominal_matrix(SIZE)
BENT = Camera("floor", "floor", SIZE, CAMERA.homography, MATRIX, np.array([-0.2, 0.0, 0.0, 0.0]))
DOTS = np.array(
    [[0.3, 0.12], [0.33, -0.1], [0.5, 0.2], [0.52, -0.18], [0.8, 0.25], [0.85, -0.22], [0.6, 0.03]]
)
GRID = np.stack(np.meshgrid([0.35, 0.5, 0.65, 0.8], [-0.15, 0.0, 0.15]), -1).reshape(-1, 2)


def bent(ideal: Array) -> Array:
    """Returns raw pixels of undistorted ones (K, 2) under the lens of `BENT`."""
    offset = (ideal - MATRIX[:2, 2]) / SIZE[0]
    return MATRIX[:2, 2] + SIZE[0] * offset * (1.0 - 0.2 * np.sum(offset**2, 1)[:, None])


def some_points(count: int = 12, noise_px: float = 0.0, seed: int = 0) -> KnownPoints:
    rng = np.random.default_rng(seed)
    pixel = rng.uniform((0, 0), SIZE, (count, 2))
    floor = CAMERA.pixel_to_floor(pixel)
    return KnownPoints(pixel + noise_px * rng.standard_normal(pixel.shape), floor, "points.csv")


def floor_difference(a: Camera, b: Camera) -> float:
    """Returns how far two cameras put the same pixels apart on the floor at most, m."""
    pixel = np.stack(np.meshgrid([0, 100, 200, 319], [0, 80, 160, 239]), -1).reshape(-1, 2)
    apart = a.pixel_to_floor(a.undistort(pixel)) - b.pixel_to_floor(b.undistort(pixel))
    return float(np.linalg.norm(apart, axis=1).max())


# ---- the fit -----------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [4, 5, 12])
def test_exact_points_give_the_camera_back(count: int) -> None:
    found = calibrate_camera(some_points(count), SIZE)
    assert floor_difference(found.camera, CAMERA) < 1e-9
    assert found.mean_error_m < 1e-12


def test_the_fit_is_opencvs_least_squares_fit() -> None:
    points = some_points(20, noise_px=1.0)
    ours = fit_homography(points.floor, points.pixel).homography
    theirs, _ = cv2.findHomography(points.floor, points.pixel)
    np.testing.assert_allclose(ours / ours[2, 2], theirs / theirs[2, 2], rtol=1e-5)


def test_errors_are_those_of_the_camera_and_their_mean_is_the_papers() -> None:
    points = some_points(12, noise_px=0.5)
    found = calibrate_camera(points, SIZE)
    error_m = found.camera.pixel_to_floor(points.pixel) - points.floor
    np.testing.assert_allclose(found.error_m, error_m, atol=1e-12)
    assert found.mean_error_m == pytest.approx(np.hypot(*error_m.T).mean())
    error_px = found.camera.floor_to_pixel(points.floor) - points.pixel
    np.testing.assert_allclose(found.error_px, error_px, atol=1e-9)


def test_left_out_errors_are_larger_and_need_a_fifth_point() -> None:
    found = calibrate_camera(some_points(8, noise_px=0.5), SIZE)
    left, kept = (np.linalg.norm(e, axis=1) for e in (found.left_out_px, found.error_px))
    assert (left > kept).all()
    assert np.isnan(calibrate_camera(some_points(4), SIZE).left_out_m).all()


def test_left_out_errors_are_missing_where_the_others_fix_nothing() -> None:
    row = np.array([[0.4, 0.1], [0.5, 0.1], [0.6, 0.1], [0.7, 0.1], [0.5, -0.1], [0.8, -0.1]])
    points = KnownPoints(CAMERA.floor_to_pixel(row), row, "points.csv")
    found = calibrate_camera(points, SIZE)
    np.testing.assert_array_equal(
        np.isnan(found.left_out_m[:, 0]), [False, False, False, False, True, True]
    )


def test_a_point_measured_wrongly_is_named() -> None:
    points = some_points(10, noise_px=0.3)
    floor = points.floor.copy()
    floor[6, 1] += 0.05
    notes = calibrate_camera(KnownPoints(points.pixel, floor, "points.csv"), SIZE).notes
    assert len(notes) == 1
    assert "Point 7 is" in notes[0]
    assert calibrate_camera(points, SIZE).notes == ()


def test_one_coefficient_of_the_lens_is_found_from_the_same_points() -> None:
    points = some_points(20)
    raw = KnownPoints(bent(points.pixel), points.floor, "points.csv")
    found = calibrate_camera(raw, SIZE, fit_distortion=True)
    assert found.camera.distortion is not None
    np.testing.assert_allclose(found.camera.distortion, [-0.2, 0.0, 0.0, 0.0], atol=1e-9)
    assert floor_difference(found.camera, BENT) < 1e-8
    assert calibrate_camera(raw, SIZE).mean_error_m > 1e-3


def test_a_lens_that_is_known_is_undone_before_the_fit() -> None:
    points = some_points(6)
    raw = KnownPoints(bent(points.pixel), points.floor, "points.csv")
    found = calibrate_camera(raw, SIZE, Lens(MATRIX, np.array([-0.2, 0.0, 0.0, 0.0])))
    assert floor_difference(found.camera, BENT) < 1e-8


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (lambda p: (p.pixel[:3], p.floor[:3]), UnderConstrained, "3 points do not fix"),
        (
            lambda p: (p.pixel, np.arange(24.0).reshape(12, 2) * [1, 0]),
            UnderConstrained,
            "lie on a line",
        ),
        (lambda p: (p.pixel, p.floor * [1, -1]), BadConfig, "mirror image"),
        (lambda p: (p.pixel, p.floor[:, ::-1]), BadConfig, "mirror image"),
        (lambda p: (p.pixel, p.floor * np.nan), BadConfig, "NaN"),
        (lambda p: (p.pixel, p.floor[:5]), BadConfig, "must both"),
    ],
)
def test_points_that_make_no_floor_camera_are_refused(
    change: object, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=f"points.csv.*{message}"):
        calibrate_camera(KnownPoints(*change(some_points()), "points.csv"), SIZE)  # type: ignore[operator]


def test_the_block_for_log_toml_is_read_back_as_the_same_camera(tmp_path: Path) -> None:
    raw = some_points(20, noise_px=0.4)
    for fit_distortion in (False, True):
        found = calibrate_camera(raw, SIZE, fit_distortion=fit_distortion)
        path = tmp_path / "log.toml"
        path.write_text(f'format = "graphslam-log/1"\n{camera_toml(found)}')
        cameras = every_camera(path, read_log_toml(path))
        assert cameras["floor"].image_size == SIZE
        assert floor_difference(cameras["floor"], found.camera) < 1e-7


# ---- targets -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "board",
    [
        Chessboard(5, 7, 0.04, (0.40, -0.13, 0.0)),
        Chessboard(5, 7, 0.04, (0.65, -0.12, 90.0)),
        Chessboard(5, 6, 0.04, (0.40, 0.10, -30.0)),
        Chessboard(6, 6, 0.04, (0.40, -0.10, 0.0)),
        Chessboard(6, 6, 0.04, (0.62, 0.12, 180.0)),
    ],
)
def test_a_chessboard_gives_the_camera_to_a_millimetre_however_it_lies(board: Chessboard) -> None:
    points = chessboard_points(photograph(CAMERA, chessboard_paint(board)), board, "board.png")
    true = CAMERA.floor_to_pixel(board.corners().reshape(-1, 2))
    assert np.sqrt(np.mean((points.pixel - true) ** 2)) < 0.12
    found = calibrate_camera(points, SIZE)
    assert found.mean_error_m < 5e-4
    mid = np.array([[160.0, 120.0]])
    apart = found.camera.pixel_to_floor(mid) - CAMERA.pixel_to_floor(mid)
    assert np.abs(apart).max() < 1e-3


def test_an_image_without_the_board_is_an_error_with_a_cure() -> None:
    grey = photograph(CAMERA, dots_paint(DOTS, 0.012))
    with pytest.raises(BadConfig, match=r"floor.png: no chessboard of 5 x 7 inner corners"):
        chessboard_points(grey, Chessboard(5, 7, 0.04, (0.4, 0.0, 0.0)), "floor.png")


@pytest.mark.parametrize("floor", [DOTS, GRID], ids=["spread", "grid"])
@pytest.mark.parametrize("radius", [0.012, 0.02])
def test_dots_are_found_and_told_apart_to_a_tenth_of_a_pixel(
    floor: Array, radius: float, tmp_path: Path
) -> None:
    table = tmp_path / "dots.csv"
    table.write_text("x,y\n" + "".join(f"{x},{y}\n" for x, y in floor))
    points = dot_points(photograph(CAMERA, dots_paint(floor, radius)), table, "dots.png")
    assert np.abs(points.pixel - CAMERA.floor_to_pixel(floor)).max() < 0.1


def test_the_centroid_of_a_large_dot_is_not_its_centre_and_is_corrected() -> None:
    dots = find_dots(photograph(CAMERA, dots_paint(DOTS, 0.02)))
    pixel, true = dots_of_points(dots, DOTS, SIZE[0], "x"), CAMERA.floor_to_pixel(DOTS)
    area = dots.area[np.linalg.norm(pixel[:, None] - dots.pixel, axis=2).argmin(axis=1)]
    better = without_bias(pixel, area, DOTS)
    assert np.abs(pixel - true).max() > 0.4
    assert np.abs(better - true).max() < 0.1


def test_bright_dots_serve_as_well(tmp_path: Path) -> None:
    table = tmp_path / "dots.csv"
    table.write_text("x,y\n" + "".join(f"{x},{y}\n" for x, y in DOTS))
    grey = 255 - photograph(CAMERA, dots_paint(DOTS, 0.012))
    points = dot_points(grey, table, "dots.png")
    assert np.abs(points.pixel - CAMERA.floor_to_pixel(DOTS)).max() < 0.1


def test_places_measured_to_the_papers_centimetre_still_find_their_dots(tmp_path: Path) -> None:
    measured = DOTS + np.random.default_rng(3).normal(0.0, 0.008, DOTS.shape)
    table = tmp_path / "dots.csv"
    table.write_text("x,y\n" + "".join(f"{x},{y}\n" for x, y in measured))
    points = dot_points(photograph(CAMERA, dots_paint(DOTS, 0.012)), table, "dots.png")
    assert np.abs(points.pixel - CAMERA.floor_to_pixel(DOTS)).max() < 2.0
    assert 0.002 < calibrate_camera(points, SIZE).mean_error_m < 0.015


def test_rough_pixels_say_which_dot_is_which_where_others_lie_about(tmp_path: Path) -> None:
    outside = np.array([[0.9, 0.35], [0.29, 0.19], [0.9, -0.3], [0.95, 0.1]])
    grey = photograph(CAMERA, dots_paint(np.concatenate([DOTS, outside]), 0.012))
    rough = CAMERA.floor_to_pixel(DOTS) + np.array([4.0, -3.0])
    table = tmp_path / "dots.csv"
    rows = (f"{x},{y},{u},{v}\n" for (x, y), (u, v) in zip(DOTS, rough, strict=True))
    table.write_text("x,y,u,v\n" + "".join(rows))
    points = dot_points(grey, table, "dots.png")
    assert np.abs(points.pixel - CAMERA.floor_to_pixel(DOTS)).max() < 0.1


def test_dots_that_do_not_fit_the_points_are_refused(tmp_path: Path) -> None:
    grey = photograph(CAMERA, dots_paint(DOTS, 0.012))
    table = tmp_path / "dots.csv"
    elsewhere = DOTS.copy()
    elsewhere[6] = [0.4, -0.02]
    table.write_text("x,y\n" + "".join(f"{x},{y}\n" for x, y in elsewhere))
    with pytest.raises(BadConfig, match=r"the 7 dots seen do not fit the points; .* columns u,v"):
        dot_points(grey, table, "dots.png")
    table.write_text("x,y\n" + "".join(f"{x},{y}\n" for x, y in GRID))
    with pytest.raises(BadConfig, match="12 points, but 7 dots seen"):
        dot_points(grey, table, "dots.png")


# ---- the picture -------------------------------------------------------------------------------


def calibrated() -> CameraCalibration:
    pixel = CAMERA.floor_to_pixel(DOTS) + np.random.default_rng(0).normal(0.0, 1.0, DOTS.shape)
    return calibrate_camera(KnownPoints(pixel, DOTS, "points.csv"), SIZE)


def test_the_picture_shows_every_point_where_it_was_seen() -> None:
    found = calibrated()
    picture = calibration_picture(found, photograph(CAMERA, dots_paint(DOTS, 0.012)))
    blank = calibration_picture(found, None)
    assert picture.shape == blank.shape
    assert picture.shape[1] == 960
    scale = 960 / SIZE[0]
    for u, v in np.rint(scale * (found.points.pixel + 0.5) - 0.5).astype(int):
        near = blank[max(v - 3, 0) : v + 4, max(u - 3, 0) : u + 4].reshape(-1, 3).astype(int)
        assert np.abs(near - [0, 220, 255]).sum(axis=1).min() < 60


def test_pictures_are_png_or_jpeg() -> None:
    picture = calibration_picture(calibrated(), None)
    assert encoded(picture, Path("a.png")).startswith(b"\x89PNG")
    assert encoded(picture, Path("a.JPG")).startswith(b"\xff\xd8")
    with pytest.raises(BadConfig, match=r"a.gif: a picture's name ends in .png or .jpg"):
        encoded(picture, Path("a.gif"))
