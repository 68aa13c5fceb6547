"""Lamps in images of a ceiling: drawn ones, whose place is known, and real ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.lamp_frames import CAMERA, CONFIG, STEADY_PX, jumps, read_frames, tracks_of
from frontend.lamp_config import LampConfig
from frontend.lamp_shape import moments
from frontend.lamps import (
    BLACK,
    CUT,
    FRAYED,
    HARDLY,
    LARGE,
    NO_FIT,
    ROUND,
    SMALL,
    detect_lamps,
    motion_covariance,
)
from graphslam.errors import BadConfig, BadLog
from graphslam.geometry import Array, compose, wrap
from tests.frontend.ceilings import LAMP, PER_M, SIZE, border, ceiling_camera, picture

SIZED = LampConfig(size_m=LAMP)
PIXEL = 1.0 / PER_M  # m


def error(z: Array, lamp: Array) -> Array:
    """Returns ``z - lamp``, the axis modulo pi."""
    e = z - lamp
    e[2] = 0.5 * wrap(2.0 * e[2])
    return e


@pytest.mark.parametrize("lens", ["none", "plain", "fisheye"])
def test_a_whole_lamp_is_found_to_a_fraction_of_a_pixel(lens: str) -> None:
    camera, rng = ceiling_camera(lens), np.random.default_rng(0)
    for _ in range(6):
        lamp = np.array([*rng.uniform(-0.6, 0.6, 2), rng.uniform(-np.pi / 2, np.pi / 2)])
        found = detect_lamps(picture(camera, lamp[None]), camera, SIZED)
        assert len(found) == 1
        assert found.visible[0] == 1.0
        assert np.all(np.abs(error(found.z[0], lamp)) < [0.08 * PIXEL, 0.08 * PIXEL, 0.004])
        assert found.size[0] == pytest.approx(LAMP, abs=0.5 * PIXEL)


@pytest.mark.parametrize("lens", ["none", "fisheye"])
def test_a_lamp_that_the_border_cuts_is_completed_from_its_edges(lens: str) -> None:
    camera, rng = ceiling_camera(lens), np.random.default_rng(1)
    edge = border(camera)
    completed = 0
    for _ in range(6):
        lamp = np.array([edge - rng.uniform(0.2, 0.35), rng.uniform(-0.3, 0.3), rng.normal(0, 0.3)])
        found = detect_lamps(picture(camera, lamp[None]), camera, SIZED)
        if len(found) and found.visible[0] < 0.97:
            completed += 1
            assert np.all(np.abs(error(found.z[0], lamp)) < [0.2 * PIXEL, 0.2 * PIXEL, 0.006])
    assert completed >= 3


def test_a_cut_lamp_of_unknown_size_or_hardly_in_view_is_left_out() -> None:
    camera = ceiling_camera()
    edge = border(camera)
    cut = picture(camera, np.array([[edge - 0.2, 0.0, 0.0]]))
    assert detect_lamps(cut, camera, LampConfig()).rejected == {CUT: 1}
    hardly = picture(camera, np.array([[edge + 0.1, 0.0, 0.0]]))
    assert detect_lamps(hardly, camera, SIZED).rejected == {HARDLY: 1}


def test_both_ends_out_of_view_leave_a_lamp_uncompleted() -> None:
    camera = ceiling_camera()
    long = LampConfig(size_m=(4.5, 0.3))
    image = picture(camera, np.array([[0.0, 0.0, 0.0]]), size=(4.5, 0.3))
    assert detect_lamps(image, camera, long).rejected == {NO_FIT: 1}


def test_the_threshold_follows_exposure() -> None:
    camera, lamp = ceiling_camera(), np.array([0.3, -0.2, 0.4])
    places = [
        detect_lamps(picture(camera, lamp[None], dark=dark, bright=bright), camera, SIZED).z[0]
        for dark, bright in ((5.0, 60.0), (20.0, 220.0), (120.0, 255.0))
    ]
    assert np.ptp(places, axis=0) == pytest.approx(0.0, abs=0.1 * PIXEL)


def test_black_images_are_normal_and_counted() -> None:
    camera = ceiling_camera()
    noise = np.random.default_rng(2).integers(0, 12, SIZE[::-1], dtype=np.uint8)
    found = detect_lamps(noise, camera, SIZED)
    assert len(found) == 0
    assert found.rejected == {BLACK: 1}


@pytest.mark.parametrize(
    ("size", "reason"),
    [((0.3, 0.1), SMALL), ((1.6, 0.9), LARGE), ((0.5, 0.45), ROUND)],
)
def test_spots_that_are_no_lamps_are_counted_by_reason(
    size: tuple[float, float], reason: str
) -> None:
    camera = ceiling_camera()
    image = picture(camera, np.array([[0.1, 0.1, 0.3]]), size=size)
    assert detect_lamps(image, camera, SIZED).rejected == {reason: 1}


def test_a_bright_spot_that_is_no_rectangle_is_no_lamp() -> None:
    camera = ceiling_camera()
    arms = [np.array([[0.0, 0.0, phi]]) for phi in (0.0, 1.0)]
    image = np.maximum(*(picture(camera, arm, size=(0.9, 0.12)) for arm in arms))
    assert detect_lamps(image, camera, SIZED).rejected == {FRAYED: 1}


def test_fringes_and_a_grid_over_the_lamp_do_not_move_it() -> None:
    camera, lamp = ceiling_camera(), np.array([0.2, 0.1, 0.2])
    clean = picture(camera, lamp[None])
    fringed = clean.copy()
    at = compose(lamp, np.array([0.5 * LAMP[0] + 0.03, 0.0, 0.5 * np.pi]))
    fringed = np.maximum(fringed, picture(camera, at[None], size=(0.2, 0.012)))
    fringed[::7][fringed[::7] > 150] = 90
    found = detect_lamps(fringed, camera, SIZED)
    assert len(found) == 1
    assert np.all(np.abs(error(found.z[0], lamp)) < [PIXEL, PIXEL, 0.01])


def test_moments_of_a_rectangle_are_its_own() -> None:
    place = np.array([3.0, -2.0, 0.7])
    corners = 0.5 * np.array([[2, 1], [-2, 1], [-2, -1], [2, -1]], float)
    outline = compose(place, np.column_stack([corners, np.zeros(4)]))[:, :2]
    for turned in (outline, outline[::-1]):
        seen = moments(turned)
        assert seen.place == pytest.approx(place, abs=1e-12)
        assert (seen.area, seen.length, seen.width, seen.fill) == pytest.approx((2, 2, 1, 1))


def test_noise_grows_with_speed_along_the_motion() -> None:
    z = np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    still = motion_covariance(z, np.zeros((2, 3)), 0.01)
    assert np.all(still == 0.0)
    driving = motion_covariance(z[:1], np.array([[0.5, 0.0, 0.0]]), 0.01)[0]
    assert driving == pytest.approx(np.diag([0.005**2, 0.0, 0.0]))
    turning = motion_covariance(z[1:], np.array([[0.0, 0.0, 1.0]]), 0.01)[0]
    moved = np.array([-0.02, 0.0, 0.01])
    assert turning == pytest.approx(np.outer(moved, moved))


def test_an_image_of_another_size_and_wrong_settings_are_refused() -> None:
    with pytest.raises(BadLog, match="image_size"):
        detect_lamps(np.zeros((10, 10), np.uint8), ceiling_camera(), SIZED)
    with pytest.raises(BadConfig, match="length first"):
        LampConfig(size_m=(0.2, 0.6))
    with pytest.raises(BadConfig, match="least_visible"):
        LampConfig(least_visible=1.5)


def test_lamps_of_a_real_ceiling_move_steadily(shared_data: Path) -> None:
    frames = read_frames(shared_data / "lamps" / "data.raw.gz")[20:100]
    found = [detect_lamps(frame, CAMERA, CONFIG) for frame in frames]
    assert min(map(len, found)) >= 5
    away = jumps(tracks_of(found))["one change of motion"]
    assert len(away) > 500
    assert np.mean(away < STEADY_PX) >= 0.95
