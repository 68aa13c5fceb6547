"""Masks by colour, and the blobs in them."""

from __future__ import annotations

import cv2
import numpy as np

from frontend.colours import cleaned, colour_mask, find_blobs, to_hsv

BLUE = ((100, 120, 60), (130, 255, 255))
RED = ((170, 120, 60), (10, 255, 255))


def disc(centre: tuple[float, float], radius: float, size: tuple[int, int]) -> np.ndarray:
    """A mask (H, W) of the pixels whose middle lies in a disc."""
    v, u = np.mgrid[: size[1], : size[0]]
    inside = np.hypot(u - centre[0], v - centre[1]) <= radius
    return np.where(inside, 255, 0).astype(np.uint8)


def test_a_mask_takes_what_is_within_all_three_limits() -> None:
    rng = np.random.default_rng(0)
    hsv = rng.integers(0, 256, (200, 200, 3), np.uint8)
    hsv[..., 0] %= 180
    low, high = BLUE
    within = np.all((hsv >= low) & (hsv <= high), axis=2)
    assert np.array_equal(colour_mask(hsv, low, high) > 0, within)
    assert within.mean() < 0.1


def test_red_goes_over_the_end_of_the_hue_circle() -> None:
    bgr = np.zeros((1, 4, 3), np.uint8)
    bgr[0] = [(0, 0, 200), (40, 0, 200), (0, 40, 200), (200, 0, 0)]  # three reds and a blue
    assert (colour_mask(to_hsv(bgr), *RED)[0] > 0).tolist() == [True, True, True, False]


def test_opening_removes_specks_and_closing_fills_holes() -> None:
    mask = disc((30.0, 20.0), 9.0, (60, 40))
    spoiled = mask.copy()
    spoiled[5, 50] = 255
    spoiled[20, 30] = 0
    assert np.array_equal(cleaned(spoiled, 1, 3), np.where(spoiled | mask, 255, 0))
    after = cleaned(cleaned(spoiled, 1, 3), 3, 1)
    assert len(find_blobs(after)) == 1
    assert np.array_equal(cleaned(mask, 0, 0), mask)


def test_blobs_come_largest_first_with_box_and_border() -> None:
    mask = disc((30.0, 20.0), 9.0, (60, 40)) | disc((1.0, 35.0), 3.0, (60, 40))
    mask[2, 50] = 255
    blobs = find_blobs(mask, min_area_px=2.0)
    assert len(blobs) == 2
    assert blobs.area[0] > blobs.area[1]
    assert np.allclose(blobs.centre[0], (30.0, 20.0))
    assert blobs.box[0].tolist() == [21, 11, 39, 29]
    assert blobs.at_border.tolist() == [False, True]
    assert len(find_blobs(np.zeros((5, 5), np.uint8))) == 0


def test_the_centroid_errs_by_what_whole_pixels_do_to_its_border() -> None:
    rng = np.random.default_rng(1)
    for radius in (4.0, 9.0):
        centres = rng.uniform(19.0, 21.0, (400, 2))
        found = [find_blobs(disc((u, v), radius, (40, 40))) for u, v in centres.tolist()]
        error = np.array([blobs.centre[0] for blobs in found]) - centres
        stated = np.array([blobs.sigma_px[0] for blobs in found])
        assert 0.5 < np.sqrt(np.mean(error**2)) / np.mean(stated) < 1.2
        assert np.abs(error.mean(axis=0)).max() < 0.02


def test_blobs_of_a_noisy_picture_are_found_to_a_tenth_of_a_pixel() -> None:
    rng = np.random.default_rng(2)
    errors = []
    for _ in range(40):
        centre = rng.uniform(25.0, 35.0, 2)
        fine = cv2.resize(disc((0, 0), 0, (60, 60)), None, fx=8, fy=8)
        cv2.circle(fine, tuple(np.round(8 * centre + 3.5).astype(int).tolist()), 72, 255, -1)
        centre = (np.round(8 * centre + 3.5) - 3.5) / 8
        cover = cv2.resize(fine, (60, 60), interpolation=cv2.INTER_AREA)[..., None] / 255.0
        picture = (1 - cover) * (150, 150, 150) + cover * (190, 60, 20)
        noisy = np.clip(picture + 6.0 * rng.standard_normal(picture.shape), 0, 255)
        hsv = to_hsv(noisy.astype(np.uint8))
        blobs = find_blobs(cleaned(colour_mask(hsv, *BLUE), 3, 3), 30.0)
        assert len(blobs) == 1
        errors.append(blobs.centre[0] - centre)
    assert np.sqrt(np.mean(np.square(errors))) < 0.1
