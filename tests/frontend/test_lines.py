"""The line detector on rendered floors of known geometry, and on the real recordings."""

from __future__ import annotations

import csv
import tomllib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from frontend.camera import Camera
from frontend.config import DetectorConfig
from frontend.hough import find_edge_pixels
from frontend.lines import detect_lines, line_covariance
from graphslam.errors import BadConfig, BadLog
from graphslam.geometry import (
    interpolate_poses,
    is_canonical,
    line_to_robot,
    points_on_line,
    wrap,
)
from tests.frontend.floors import (
    CAMERAS,
    LINES,
    Floor,
    assert_found,
    errors,
    floor_with_lines,
    pinhole,
)

PITCH_M = 0.6


# ---- rendered floors ----------------------------------------------------------------------------


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
@pytest.mark.parametrize("width", [0.005, 0.010, 0.020])
def test_each_groove_is_found_once_in_every_kind_of_image(camera: Camera, width: float) -> None:
    assert_found(detect_lines(floor_with_lines(camera, width), camera, DetectorConfig()), LINES)


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_painted_lines_are_found_like_grooves(camera: Camera) -> None:
    image = floor_with_lines(camera, 0.010, grey=200.0, background=70.0)
    assert_found(detect_lines(image, camera, DetectorConfig()), LINES)


@pytest.mark.parametrize("method", ["hough", "hough-p"])
@pytest.mark.parametrize("name", ["160x120", "640x480"])
def test_one_threshold_finds_grooves_in_even_light_and_loses_some_in_uneven(
    method: str, name: str
) -> None:
    camera = CAMERAS[name]
    settings = DetectorConfig(method=method, binarise="global")
    image = floor_with_lines(camera)
    assert_found(detect_lines(image, camera, settings), LINES)
    uneven = np.clip(image * np.linspace(0.2, 1.2, image.shape[1]), 0, 255).astype(np.uint8)
    assert len(detect_lines(uneven, camera, settings).z) < len(LINES)
    assert_found(detect_lines(uneven, camera, replace(settings, binarise="canny")), LINES)


@pytest.mark.parametrize("polarity", ["dark", "bright"])
def test_only_the_wanted_polarity_is_reported(polarity: str) -> None:
    camera = CAMERAS["320x240"]
    floor = Floor(camera).draw(LINES[0], 0.01, 40.0).draw(LINES[1], 0.01, 230.0)
    image = floor.image(np.random.default_rng(1))
    found = detect_lines(image, camera, DetectorConfig(polarity=polarity))
    assert_found(found, LINES[:1] if polarity == "dark" else LINES[1:2])


@pytest.mark.parametrize("name", ["160x120", "320x240"])
@pytest.mark.parametrize(("gain", "shift"), [(0.3, 0.0), (1.7, 0.0), (0.5, 80.0), (-1.0, 220.0)])
def test_light_and_contrast_do_not_matter(name: str, gain: float, shift: float) -> None:
    camera = CAMERAS[name]
    image = floor_with_lines(camera).astype(float)
    changed = np.clip(np.rint(gain * image + shift), 0, 255).astype(np.uint8)
    assert_found(detect_lines(changed, camera, DetectorConfig()), LINES)


@pytest.mark.parametrize("noise", [0.0, 6.0, 12.0])
def test_thresholds_follow_the_noise(noise: float) -> None:
    camera = CAMERAS["320x240"]
    floor = Floor(camera)
    for line in LINES:
        floor.draw(line)
    image = floor.image(np.random.default_rng(2), noise)
    assert_found(detect_lines(image, camera, DetectorConfig()), LINES)


def test_random_lattices_are_seen_whole_and_without_phantoms() -> None:
    camera = CAMERAS["160x120"]
    lattice = np.array([[k * PITCH_M, a] for a in (0.0, np.pi / 2) for k in range(-3, 4)])
    rng = np.random.default_rng(3)
    wanted = seen = 0
    for _ in range(25):
        pose = np.append(rng.uniform(0.0, PITCH_M, 2), rng.uniform(-np.pi, np.pi))
        lines = line_to_robot(lattice, pose)
        floor = Floor(camera)
        for line in lines:
            floor.draw(line, rng.uniform(0.005, 0.010))
        found = detect_lines(floor.image(rng), camera, DetectorConfig())
        nearest, offset, angle = errors(found, lines)
        assert len(set(nearest)) == len(nearest)
        assert np.abs(offset).max(initial=0.0) < 2e-3
        assert np.degrees(np.abs(angle)).max(initial=0.0) < 1.0
        in_view = np.flatnonzero(np.ptp(camera.visible_stretch(lines), axis=1) > 0.25)
        wanted += len(in_view)
        seen += len(np.intersect1d(in_view, nearest))
    assert seen >= 0.95 * wanted


def test_a_line_ends_where_it_ends_whatever_dirt_lies_beyond() -> None:
    camera, line, end = CAMERAS["320x240"], np.array([0.02, 1.5]), 0.65
    rng = np.random.default_rng(12)
    for _ in range(8):
        floor = Floor(camera)
        floor.grey[(np.abs(floor.across(line)) < 0.004) & (floor.point[..., 0] < end)] = 60.0
        image = floor.image(rng)
        for u, v in rng.uniform((0, 0), camera.image_size, (150, 2)).astype(int):
            cv2.circle(image, (int(u), int(v)), int(rng.integers(1, 4)), rng.uniform(30, 200), -1)
        found = detect_lines(image, camera, DetectorConfig())
        assert_found(found, line[None], angle_deg=0.7)
        ends = points_on_line(np.repeat(found.z, 2, axis=0), found.extent[0])
        assert abs(ends[:, 0].max() - end) < 0.04


def test_rows_of_dots_are_no_line_and_hide_none() -> None:
    camera = CAMERAS["320x240"]
    floor = Floor(camera)
    floor.grey[(np.abs(floor.across(LINES[1])) < 0.004) & (floor.point[..., 0] < 0.36)] = 60.0
    image = floor.image(np.random.default_rng(14))
    for u in range(15, 320, 10):
        for v in range(12, 140, 10):
            cv2.circle(image, (u, v), 3, 60, -1)
    found = detect_lines(image, camera, DetectorConfig(min_length_m=0.08))
    assert_found(found, LINES[1:2], angle_deg=0.5)


def test_edges_that_do_not_face_each_other_are_no_line() -> None:
    camera = CAMERAS["320x240"]
    floor = Floor(camera)
    x, y = floor.point[..., 0], floor.point[..., 1]
    floor.grey[((x < 0.6) & (y > 0.0)) | ((x > 0.6) & (y < 0.01))] = 60.0
    found = detect_lines(floor.image(np.random.default_rng(15)), camera, DetectorConfig())
    assert len(found) == 0
    assert found.rejected["one edge only"] >= 2


def test_a_groove_that_widens_is_found_at_its_middle() -> None:
    camera, line = CAMERAS["320x240"], np.array([0.0, np.pi / 2])
    floor = Floor(camera)
    x = floor.point[..., 0]
    floor.grey[np.abs(floor.across(line)) < 0.5 * (0.006 + 0.025 * (x - 0.4))] = 60.0
    found = detect_lines(floor.image(np.random.default_rng(16)), camera, DetectorConfig())
    assert_found(found, line[None])


def test_a_blurred_edge_does_not_bend_where_it_leaves_the_image() -> None:
    camera = CAMERAS["320x240"]
    u, v = np.meshgrid(np.arange(320.0), np.arange(240.0))
    across = (v - 226.0 - 0.06 * u) / np.hypot(1.0, 0.06)
    image = np.rint(120.0 + 50.0 * np.tanh(across / 1.5)).astype(np.uint8)
    edges = find_edge_pixels(image, camera, DetectorConfig())
    off = (edges.point[:, 1] - 226.0 - 0.06 * edges.point[:, 0]) / np.hypot(1.0, 0.06)
    assert len(edges) > 100
    assert np.abs(off).max() < 0.15


def test_edges_of_a_bent_image_face_across_the_straight_line() -> None:
    camera, line = CAMERAS["320x240 bent"], np.array([0.4, 0.7])
    floor = Floor(camera).draw(line, 0.02)
    edges = find_edge_pixels(floor.image(), camera, DetectorConfig())
    ends = camera.floor_to_pixel(points_on_line(line, np.array([-0.2, 0.2])))
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    tilt = np.arctan2(edges.normal @ along, edges.normal @ (-along[1], along[0]))
    position = (edges.point - (159.5, 119.5)) @ along
    for side in (position > 100.0, position < -100.0):
        one_edge = side & (np.abs(tilt) < 0.5)
        assert np.count_nonzero(one_edge) > 20
        assert abs(np.degrees(np.median(tilt[one_edge]))) < 1.0


def test_the_middle_does_not_move_when_one_edge_is_hidden_in_part() -> None:
    camera = CAMERAS["320x240"]
    line = np.array([0.0, np.pi / 2])
    floor = Floor(camera).draw(line, 0.016)
    hidden = (np.abs(floor.across(line) - 0.03) < 0.03) & (floor.point[..., 0] > 0.6)
    floor.grey[hidden] = 60.0
    found = detect_lines(floor.image(np.random.default_rng(4)), camera, DetectorConfig())
    assert_found(found, line[None], offset_m=5e-4, angle_deg=0.2)


def test_a_groove_broken_by_a_wide_band_is_one_line() -> None:
    camera = CAMERAS["320x240"]
    line, band = np.array([0.05, np.pi / 2]), np.array([0.6, 0.1])
    floor = Floor(camera).draw(line).draw(band, 0.08, 60.0)
    found = detect_lines(floor.image(np.random.default_rng(5)), camera, DetectorConfig())
    assert_found(found, line[None])
    stretch = camera.visible_stretch(line[None])[0]
    assert np.ptp(found.extent[0]) > 0.85 * np.ptp(stretch)


@pytest.mark.parametrize("number", [0, 1, 2])
def test_a_bevelled_groove_with_four_edges_is_one_line(number: int) -> None:
    camera, line = CAMERAS["640x480"], LINES[number]
    floor = Floor(camera).draw(line, 0.018, 105.0).draw(line, 0.006, 50.0)
    image = floor.image(np.random.default_rng(11))
    assert_found(detect_lines(image, camera, DetectorConfig()), line[None])
    found = detect_lines(image, camera, DetectorConfig(method="hough"))
    assert_found(found, line[None], offset_m=2e-3, angle_deg=0.7)
    assert found.rejected["seen twice"] == 1


def test_neighbouring_grooves_stay_apart() -> None:
    camera = CAMERAS["320x240"]
    pair = np.array([[0.55, 0.1], [0.59, 0.1]])
    floor = Floor(camera).draw(pair[0]).draw(pair[1])
    found = detect_lines(floor.image(np.random.default_rng(6)), camera, DetectorConfig())
    assert_found(found, pair)


def test_the_edge_of_a_shadow_is_no_line_but_is_counted() -> None:
    camera = CAMERAS["320x240"]
    floor = Floor(camera).draw(LINES[0])
    floor.grey[floor.across(np.array([0.1, 1.2])) > 0] *= 0.6
    found = detect_lines(floor.image(np.random.default_rng(7)), camera, DetectorConfig())
    assert_found(found, LINES[:1])
    assert found.rejected["one edge only"] >= 1


@pytest.mark.parametrize("width", [0.001, 0.04])
def test_widths_outside_the_configured_range_are_no_lines(width: float) -> None:
    camera = CAMERAS["640x480"]
    floor = Floor(camera).draw(np.array([0.0, np.pi / 2]), width)
    config = DetectorConfig(line_width_m=(0.006, 0.025))
    found = detect_lines(floor.image(np.random.default_rng(8)), camera, config)
    assert len(found) == 0


def test_a_stretch_shorter_than_asked_for_is_rejected_and_counted() -> None:
    camera = CAMERAS["320x240"]
    floor = Floor(camera)
    near = (np.abs(floor.across(LINES[1])) < 0.004) & (np.abs(floor.point[..., 0] - 0.5) < 0.06)
    floor.grey[near] = 60.0
    image = floor.image(np.random.default_rng(9))
    assert len(detect_lines(image, camera, DetectorConfig(min_length_m=0.08))) == 1
    found = detect_lines(image, camera, DetectorConfig(min_length_m=0.2))
    assert len(found) == 0
    assert found.rejected["too short"] == 1


def test_a_line_of_too_vague_a_direction_is_rejected_and_counted() -> None:
    camera = CAMERAS["160x120"]
    config = DetectorConfig(vaguest_alpha_deg=1e-3)
    found = detect_lines(floor_with_lines(camera), camera, config)
    assert len(found) == 0
    assert found.rejected["direction too vague"] == len(LINES)


@pytest.mark.parametrize("texture", [0.0, 2.0, 10.0])
def test_a_bare_floor_shows_no_lines(texture: float) -> None:
    camera = CAMERAS["320x240"]
    rng = np.random.default_rng(10)
    for _ in range(5):
        blotches = cv2.GaussianBlur(rng.normal(size=(240, 320)), (0, 0), 2.0)
        grey = 120.0 + texture * blotches / blotches.std()
        image = np.clip(np.rint(grey), 0, 255).astype(np.uint8)
        assert len(detect_lines(image, camera, DetectorConfig())) == 0


def test_lines_come_canonical_with_the_stretch_in_view() -> None:
    camera = CAMERAS["320x240"]
    found = detect_lines(floor_with_lines(camera), camera, DetectorConfig())
    stretch = camera.visible_stretch(found.z)
    assert is_canonical(found.z).all()
    assert (found.extent[:, 0] < found.extent[:, 1]).all()
    assert (found.extent[:, 0] > stretch[:, 0] - 0.005).all()
    assert (found.extent[:, 1] < stretch[:, 1] + 0.005).all()
    assert (np.ptp(found.extent, axis=1) > 0.85 * np.ptp(stretch, axis=1)).all()
    assert (found.quality > 0.8).all()


def test_the_noise_is_the_papers_where_that_is_asked_for() -> None:
    camera = CAMERAS["320x240"]
    config = DetectorConfig(sigma_law="paper")
    found = detect_lines(floor_with_lines(camera), camera, config)
    np.testing.assert_array_equal(found.cov, line_covariance(found.z, config))


def test_threads_do_not_change_the_result() -> None:
    images = [floor_with_lines(camera) for camera in CAMERAS.values()] * 4
    cameras = list(CAMERAS.values()) * 4

    def search(number: int) -> bytes:
        found = detect_lines(images[number], cameras[number], DetectorConfig())
        return found.z.tobytes() + found.extent.tobytes() + found.quality.tobytes()

    alone = [search(number) for number in range(len(CAMERAS))] * 4
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(search, range(len(images)))) == alone


def test_an_image_of_another_size_than_the_camera_is_refused() -> None:
    with pytest.raises(BadLog, match="image_size"):
        detect_lines(np.zeros((120, 160), np.uint8), CAMERAS["320x240"], DetectorConfig())


def test_an_image_smaller_than_the_smoothing_shows_nothing() -> None:
    camera = pinhole((4, 4), 5.0)
    assert len(detect_lines(np.zeros((4, 4), np.uint8), camera, DetectorConfig())) == 0


# ---- noise and configuration --------------------------------------------------------------------


def test_the_noise_is_that_of_the_paper_with_its_sign_mended() -> None:
    """At alpha_M = +-90 degrees, rho = 1 m: 10.7 mm; at alpha_M = 0 the constant 4 mm."""
    z = np.array([[1.0, 0.0], [1.0, np.pi], [1.0, np.pi / 2], [0.0, 0.0]])
    sigma = np.sqrt(line_covariance(z, DetectorConfig())[:, 0, 0])
    np.testing.assert_allclose(sigma, [0.0107413, 0.0107413, 0.004, 0.004], atol=1e-7)


def test_rho_and_alpha_are_independent_and_twins_have_one_noise() -> None:
    z = np.array([[0.8, 0.3], [-0.8, 0.3 + np.pi]])
    cov = line_covariance(z, DetectorConfig())
    np.testing.assert_allclose(cov[0], cov[1])
    np.testing.assert_array_equal(cov[:, 0, 1], 0.0)
    np.testing.assert_allclose(np.degrees(np.sqrt(cov[:, 1, 1])), 0.5)


def test_the_noise_takes_its_parameters_from_the_configuration() -> None:
    config = replace(DetectorConfig(), sigma_rho_a_m=0.01, sigma_rho_b_m=0.0, sigma_alpha_deg=2.0)
    cov = line_covariance(np.array([3.0, 0.5]), config)
    np.testing.assert_allclose(np.sqrt(np.diag(cov)), [0.01, np.radians(2.0)])


@pytest.mark.parametrize(
    "change",
    [
        {"line_width_m": (0.02, 0.01)},
        {"edge_over_noise": (2.0, np.inf)},
        {"polarity": "grey"},
        {"smoothing_px": 0.0},
        {"sigma_alpha_deg": np.nan},
        {"min_support": -1},
    ],
)
def test_a_detector_configuration_that_cannot_work_is_refused(change: dict[str, object]) -> None:
    with pytest.raises(BadConfig, match=next(iter(change))):
        DetectorConfig(**change)


# ---- real recordings ----------------------------------------------------------------------------


def recording(folder: Path) -> tuple[Camera, list[Path], np.ndarray, np.ndarray]:
    """Camera, images, true poses at the images and true lines of one of the real logs."""
    settings = tomllib.loads((folder / "log.toml").read_text())["camera"]
    camera = Camera("floor", "floor", settings["image_size"], settings["homography"])
    with (folder / "images.csv").open() as file:
        rows = list(csv.DictReader(file))
    t, x, y, _, _, _, qz, qw = np.loadtxt(folder / "groundtruth.tum").T
    poses = np.column_stack([x, y, wrap(2.0 * np.arctan2(qz, qw))])
    at_images = interpolate_poses(np.array([float(row["t"]) for row in rows]), t, poses)
    lines = np.loadtxt(folder / "map.csv", delimiter=",", skiprows=1)[:, 1:3]
    return camera, [folder / row["file"] for row in rows], at_images, lines


@pytest.mark.parametrize("name", ["square", "free"])
def test_real_grooves_are_found_within_a_millimetre(shared_data: Path, name: str) -> None:
    camera, files, poses, lines = recording(shared_data / "logs" / name)
    offsets, angles, wanted, seen = [], [], 0, 0
    for file, pose in list(zip(files, poses, strict=True))[::8]:
        image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        true = line_to_robot(lines, pose)
        nearest, offset, angle = errors(detect_lines(image, camera, DetectorConfig()), true)
        assert len(set(nearest)) == len(nearest)
        offsets.extend(np.abs(offset))
        angles.extend(np.degrees(np.abs(angle)))
        in_view = np.flatnonzero(np.ptp(camera.visible_stretch(true), axis=1) > 0.25)
        wanted += len(in_view)
        seen += len(np.intersect1d(in_view, nearest))
    assert np.median(offsets) < 0.25e-3
    assert np.median(angles) < 0.05
    assert max(offsets) < 5e-3
    assert max(angles) < 1.5
    assert seen >= 0.95 * wanted
