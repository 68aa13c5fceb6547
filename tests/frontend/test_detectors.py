"""Every detector on clean and on messy floors: what is found, what is left out, and why."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.detectors import CONDITIONS, SIZES, Score, frames
from benchmarks.photograph import camera_of, lattice_of
from frontend.config import DetectorConfig
from frontend.ignored import is_ignored
from frontend.images import read_grey
from frontend.lines import detect_lines
from frontend.view import view_of
from tests.frontend.floors import CAMERAS, LINES, Floor, assert_found, floor_with_lines, pinhole

METHODS = ("lsd", "hough-p", "hough")
EXACT = {"calibration_px": 0.0, "straightness_m": 0.0}  # as cameras and floors of a simulator are


def score(condition: str, method: str, count: int, size: str = "640x480") -> Score:
    config = DetectorConfig(method=method, **EXACT)
    found = Score()
    for image, true, camera in frames(CONDITIONS[condition], SIZES[size], count):
        found.add(detect_lines(image, camera, config), true, camera)
    return found


def figures(found: Score) -> tuple[float, float, float, float]:
    """Recall, false lines a frame, bias of rho (m), NEES per dimension."""
    errors, cov = np.array(found.errors), np.array(found.covariances)
    nees = np.einsum("ki,kij,kj->k", errors, np.linalg.inv(cov), errors).mean() / 2.0
    return found.seen / found.wanted, found.false / found.frames, errors[:, 0].mean(), nees


@pytest.mark.parametrize("method", ["lsd", "hough-p"])
def test_lines_of_moderate_quality_are_found_unbiased_with_honest_noise(method: str) -> None:
    recall, false, bias, nees = figures(score("moderate", method, 24))
    assert recall >= 0.98
    assert false <= 0.02
    assert abs(bias) < 0.2e-3
    assert 0.7 < nees < 1.4


def test_shadows_and_dirt_hide_few_lines_and_make_none() -> None:
    found = score("shadows, dirt", "lsd", 24)
    recall, false, _, _ = figures(found)
    assert recall >= 0.95
    assert false <= 0.05
    assert found.rejected["one edge only"] > 100
    assert found.rejected["too short"] > 0


def test_things_that_stand_on_the_floor_make_no_lines() -> None:
    recall, false, _, _ = figures(score("furniture legs", "lsd", 16))
    assert recall >= 0.95
    assert false <= 0.05


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ["320x240", "320x240 bent", "320x240 fisheye"])
def test_every_detector_finds_grooves_through_every_lens(name: str, method: str) -> None:
    camera = CAMERAS[name]
    found = detect_lines(floor_with_lines(camera), camera, DetectorConfig(method=method))
    assert_found(found, LINES, offset_m=2e-3, angle_deg=0.5)


@pytest.mark.parametrize("method", METHODS)
def test_every_detector_keeps_to_the_polarity_asked_for(method: str) -> None:
    camera = CAMERAS["320x240"]
    floor = Floor(camera).draw(LINES[0], 0.01, 40.0).draw(LINES[1], 0.01, 230.0)
    image = floor.image(np.random.default_rng(1))
    for polarity, true in (("dark", LINES[:1]), ("bright", LINES[1:2]), ("both", LINES[:2])):
        found = detect_lines(image, camera, DetectorConfig(method=method, polarity=polarity))
        assert_found(found, true)


@pytest.mark.parametrize("method", METHODS)
def test_nothing_is_looked_for_where_the_robot_itself_is(method: str) -> None:
    chassis = ((40.0, 160.0, 130.0, 239.0), (200.0, 239.0, 250.0, 150.0, 319.0, 239.0))
    camera = pinhole((320, 240), 330.0, ignore_px=chassis)
    image = floor_with_lines(camera)
    for corners in ([[60, 165], [110, 235]], [[250, 165], [252, 235]], [[240, 175], [238, 235]]):
        cv2.line(image, *corners, 20, 3, cv2.LINE_AA)  # a cable, wheels
    found = detect_lines(image, camera, DetectorConfig(method=method))
    assert_found(found, LINES)
    bare = detect_lines(image, CAMERAS["320x240"], DetectorConfig(method=method))
    assert len(bare) > len(found)
    assert view_of(camera, 0.03).usable < view_of(CAMERAS["320x240"], 0.03).usable


def test_rectangles_hold_their_border_and_polygons_may_be_hollow() -> None:
    hollow = (10.0, 10.0, 30.0, 10.0, 30.0, 30.0, 20.0, 15.0, 10.0, 30.0)
    camera = pinhole((160, 120), 165.0, ignore_px=((100.0, 50.0, 90.0, 40.0), hollow))
    points = np.array([[90, 40], [100, 50], [101, 50], [12, 12], [28, 12], [20, 25], [5, 12.0]])
    assert is_ignored(camera, points).tolist() == [True, True, False, True, True, False, False]


def test_a_wide_band_is_no_line_and_a_speckled_row_is_none() -> None:
    camera = CAMERAS["320x240"]
    floor = Floor(camera).draw(np.array([0.0, np.pi / 2]), 0.06)  # a shadow of a table's leg
    found = detect_lines(floor.image(np.random.default_rng(3)), camera, DetectorConfig())
    assert len(found) == 0
    assert found.rejected["one edge only"] >= 2


def test_words_on_the_floor_are_no_lines_and_are_counted() -> None:
    camera = CAMERAS["640x480"]
    image = Floor(camera).draw(LINES[1]).image(np.random.default_rng(4))
    for row, text in enumerate(("KEEP CLEAR", "EMERGENCY EXIT", "Fire door 17")):
        cv2.putText(image, text, (20, 120 + 130 * row), cv2.FONT_HERSHEY_SIMPLEX, 2.0, 40, 5)
    found = detect_lines(image, camera, DetectorConfig())
    assert_found(found, LINES[1:2])
    assert sum(found.rejected.values()) > 20


def test_light_that_varies_across_the_frame_hides_no_line() -> None:
    camera = CAMERAS["320x240"]
    slope = np.linspace(0.25, 1.6, 320) * np.linspace(1.2, 0.7, 240)[:, None]
    image = np.clip(floor_with_lines(camera) * slope, 0, 255).astype(np.uint8)
    for method in METHODS:
        assert_found(detect_lines(image, camera, DetectorConfig(method=method)), LINES)


@pytest.mark.parametrize("method", METHODS)
def test_the_grooves_of_a_photograph_form_one_square_lattice(
    shared_data: Path, method: str
) -> None:
    grey = read_grey(shared_data / "photos" / "tiles.png")
    assert grey is not None
    camera = camera_of(grey)
    lattice = lattice_of(detect_lines(grey, camera, DetectorConfig(method=method)))
    assert lattice.false == 0
    assert len(lattice.off) >= 10
    assert max(lattice.rms(0), lattice.rms(1)) < 0.015
