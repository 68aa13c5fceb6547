"""Directions of coloured landmarks, from images that are drawn here."""

from __future__ import annotations

import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest

from frontend.cones import AROUND_CENTRE, AT_BORDER, TOO_SMALL, TOO_WIDE, detect_bearings
from frontend.config import ExtractConfig
from frontend.extract import UNREADABLE_OMNI, extract
from frontend.log import open_log
from frontend.omni import BearingCorrection, Colour, OmniCamera
from frontend.omni_config import OmniConfig
from frontend.readers.log_toml import LogTable, every_camera
from frontend.strict import from_dict
from frontend.write_folder import log_toml
from graphslam.errors import BadConfig, BadLog
from graphslam.geometry import wrap
from tests.frontend.small_logs import LOG_TOML, write_log

BLUE, RED = (200, 40, 20), (20, 20, 210)  # BGR
COLOURS = (
    Colour(0, (105, 120, 60), (130, 255, 255), "blue"),
    Colour(1, (172, 120, 60), (8, 255, 255), "red"),
)
CAMERA = OmniCamera("omni", (320, 240), (160.0, 118.5), COLOURS, ring_px=(20.0, 115.0))


def picture(*cones: tuple[float, float, tuple[int, int, int]], base: bool = False) -> np.ndarray:
    """Returns an image with a triangle for each (direction rad, distance px, colour)."""
    image = np.full((240, 320, 3), 120, np.uint8)
    for bearing, distance, colour in cones:
        ends = CAMERA.pixels(np.array([bearing - 0.06, bearing + 0.06]), np.full(2, distance))
        tip = CAMERA.pixels(np.array([bearing]), np.array([distance + 30.0]))
        parts = [np.concatenate([ends, tip])]
        if base:  # it sticks out to one side
            sides = np.array([bearing - 0.1, bearing - 0.1, bearing + 0.2, bearing + 0.2])
            parts.append(CAMERA.pixels(sides, distance + np.array([-4.0, 3.0, 3.0, -4.0])))
        for corners in parts:
            cv2.fillPoly(image, [np.rint(16 * corners).astype(np.int32)], colour, cv2.LINE_AA, 4)
    return image


def test_an_image_without_any_cone_gives_none() -> None:
    found = detect_bearings(picture(), CAMERA, OmniConfig())
    assert len(found) == 0
    assert found.z.shape == (0, 1)


def test_each_cone_is_seen_in_its_direction_under_its_label() -> None:
    truth = np.array([0.3, 2.0, -2.9, -1.2])
    image = picture(*zip(truth, (50.0, 60.0, 70.0, 45.0), (BLUE, RED, RED, BLUE), strict=True))
    found = detect_bearings(image, CAMERA, OmniConfig())
    assert dict(found.rejected) == {}
    order = np.argsort(found.z[:, 0])
    assert found.label[order].tolist() == [1, 0, 0, 1]
    error = wrap(found.z[order, 0] - np.sort(truth))
    sigma = np.sqrt(found.cov[order, 0, 0])
    assert np.abs(error / sigma).max() < 3.0
    assert np.degrees(np.abs(error)).max() < 0.3


def test_a_base_on_one_side_does_not_move_the_direction() -> None:
    image = picture((0.5, 55.0, RED), base=True)
    bare = detect_bearings(image, CAMERA, OmniConfig(base_share=0.0)).z[0, 0]
    masked = detect_bearings(image, CAMERA, OmniConfig(base_share=0.5)).z[0, 0]
    assert abs(masked - 0.5) < 0.5 * abs(bare - 0.5)


def test_an_image_that_is_turned_or_mirrored_gives_the_same_directions() -> None:
    image = picture((0.3, 50.0, BLUE), (2.0, 60.0, RED))
    whole = OmniCamera("omni", (320, 240), (160.0, 118.5), COLOURS)
    mirrored = OmniCamera("omni", (320, 240), (159.0, 118.5), COLOURS, mirrored=True)
    turned = OmniCamera("omni", (320, 240), (159.0, 120.5), COLOURS, heading_deg=-90.0)
    straight = detect_bearings(image, whole, OmniConfig()).z
    flipped = detect_bearings(np.ascontiguousarray(image[:, ::-1]), mirrored, OmniConfig()).z
    upside = detect_bearings(np.ascontiguousarray(image[::-1, ::-1]), turned, OmniConfig()).z
    np.testing.assert_allclose(flipped, straight, atol=1e-3)
    np.testing.assert_allclose(upside, straight, atol=1e-3)


def test_what_is_no_cone_is_left_out_and_counted() -> None:
    image = picture((0.3, 60.0, RED))
    cv2.circle(image, (160, 70), 2, RED, -1)  # a crumb
    cv2.ellipse(image, (160, 118), (100, 100), 0, 20, 160, BLUE, 6)  # a fence
    cv2.rectangle(image, (0, 100), (12, 110), BLUE, -1)  # cut off
    around = image.copy()
    cv2.circle(around, (160, 118), 10, RED, -1)  # the robot itself
    whole = OmniCamera("omni", (320, 240), (160.0, 118.5), COLOURS)
    config = OmniConfig(min_area_px=12)
    found = detect_bearings(around, whole, config)
    assert dict(found.rejected) == {TOO_SMALL: 1, TOO_WIDE: 1, AT_BORDER: 1, AROUND_CENTRE: 1}
    assert found.label.tolist() == [1]
    # the ring keeps the robot and the border out before anything is looked for
    ringed = detect_bearings(around, CAMERA, config)
    assert AROUND_CENTRE not in ringed.rejected
    assert AT_BORDER not in ringed.rejected
    assert len(ringed) == 1


def test_a_correction_adds_its_offset_and_its_waves() -> None:
    correction = BearingCorrection(2.0, ((1.0, 0.0), (0.0, -0.5)))
    b = np.array([0.0, np.pi / 2, np.pi / 4, 3.0])
    expected = b + np.radians(2.0 + np.cos(b) - 0.5 * np.sin(2 * b))
    np.testing.assert_allclose(correction.of(b), wrap(expected), atol=1e-12)
    camera = OmniCamera("omni", (320, 240), (160.0, 118.5), COLOURS, correction=correction)
    plain = detect_bearings(picture((1.0, 50.0, RED)), CAMERA, OmniConfig()).z
    moved = detect_bearings(picture((1.0, 50.0, RED)), camera, OmniConfig()).z
    np.testing.assert_allclose(moved, correction.of(plain))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"centre": (400.0, 100.0)}, "outside the image"),
        ({"colours": ()}, "colours is empty"),
        ({"colours": (COLOURS[0], COLOURS[0])}, "a label is there twice"),
        ({"ring_px": (50.0, 20.0)}, "first < second"),
    ],
)
def test_a_camera_that_is_none_says_so(change: dict[str, object], message: str) -> None:
    given = {"name": "omni", "image_size": (320, 240), "centre": (160.0, 118.5), "colours": COLOURS}
    with pytest.raises(BadConfig, match=message):
        OmniCamera(**{**given, **change})  # type: ignore[arg-type]
    with pytest.raises(BadConfig, match="hue is 0 to 179"):
        Colour(0, (200, 0, 0), (10, 255, 255))
    with pytest.raises(BadConfig, match="harmonics_deg"):
        BearingCorrection(0.0, ((90.0, 0.0),))


# ---- in a log ---------------------------------------------------------------------------------

OMNI = """
[start]
pose = [0.0, 0.0, 0.0]
[cameras.round]
looks_at = "omni"
image_size = [320, 240]
centre = [160.0, 118.5]
ring_px = [20, 115]
[[cameras.round.colours]]
label = 0
low = [105, 120, 60]
high = [130, 255, 255]
[[cameras.round.colours]]
label = 1
low = [172, 120, 60]
high = [8, 255, 255]
"""
LANDMARKS = "landmark,kind,x,y,label\n4,bearing,2,2,0\n5,bearing,-1,0.1,1\n6,bearing,2,2.1,1\n"
TRUTH = "0 0 0 0 0 0 0 1\n3 0 0 0 0 0 0 1\n"


def image_file(image: np.ndarray) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()


def write_omni(folder: Path, **files: str | bytes) -> Path:
    shown = picture((np.pi / 4, 55.0, BLUE), (np.arctan2(0.1, -1.0), 50.0, RED))
    given: dict[str, str | bytes] = {
        "log_toml": LOG_TOML + OMNI,
        "images_csv": "t,file,camera\n0,a.png,round\n1,b.png,round\n2,a.png,round\n",
        "a_png": image_file(shown),
        "b_png": b"no image",
        "landmarks_csv": LANDMARKS,
        "groundtruth_tum": TRUTH,
    }
    return write_log(folder, **{**given, **files})


def test_images_of_a_log_become_bearings_at_its_nodes(tmp_path: Path) -> None:
    log = open_log(write_omni(tmp_path / "log"))
    assert log.warnings == ()
    measurements = extract(log)
    table = measurements.sightings["bearing"]
    assert measurements.t.tolist() == [0.0, 1.0, 2.0]
    assert table.node.tolist() == [0, 0, 2, 2]
    assert table.source.tolist() == [0, 0, 2, 2]
    assert table.label.tolist() == [0, 1, 0, 1]
    assert table.truth.tolist() == [4, 5, 4, 5]
    assert measurements.rejected == {UNREADABLE_OMNI: 1}
    assert measurements.known is not None
    assert extract(log, ExtractConfig(landmarks="mapped")).known is None
    one, two = (extract(log, ExtractConfig(workers=n)).sightings["bearing"].z for n in (1, 2))
    assert np.array_equal(one, two)
    changed = write_omni(tmp_path / "changed", b_png=image_file(picture((1.0, 50.0, RED))))
    assert open_log(changed).digest != log.digest


def test_a_search_for_cones_tells_its_progress_and_its_delay(tmp_path: Path) -> None:
    late = OMNI.replace("[[cameras.round.colours]]", "delay = 0.5\n[[cameras.round.colours]]", 1)
    log = open_log(write_omni(tmp_path / "log", log_toml=LOG_TOML + late))
    told: list[tuple[int, int]] = []
    table = extract(log, progress=lambda *done: told.append(done)).sightings["bearing"]
    assert told == [(1, 3), (2, 3), (3, 3)]
    assert table.t_received.tolist() == [0.5, 0.5, 2.5, 2.5]
    again = from_dict(LogTable, tomllib.loads("\n".join(log_toml(log))), "log.toml", BadLog)
    assert every_camera(tmp_path / "log.toml", again) == dict(log.cameras)
    with pytest.raises(BadLog, match=r"camera 'round': delay = -1\.0: must be from 0"):
        open_log(write_omni(tmp_path / "b", log_toml=LOG_TOML + late.replace("0.5\n", "-1.0\n")))


def test_bearings_already_measured_come_first_and_are_corrected(tmp_path: Path) -> None:
    rows = "t,bearing,sigma\n0,0.5,0.01\n1,0.5,0.01\n"
    extra = "[bearings]\noffset_deg = 2.0\nharmonics_deg = [[1.0, 0.0]]\n"
    settings = LOG_TOML + OMNI + extra
    log = open_log(write_omni(tmp_path, log_toml=settings, bearings_csv=rows))
    assert any("bearings.csv: images are not searched" in text for text in log.warnings)
    assert not len(log.images_of("omni"))
    z = extract(log).sightings["bearing"].z
    np.testing.assert_allclose(z, 0.5 + np.radians(2.0 + np.cos(0.5)))


def test_an_image_of_another_size_and_a_wrong_key_are_named(tmp_path: Path) -> None:
    small = image_file(np.zeros((10, 10, 3), np.uint8))
    with pytest.raises(BadLog, match=r"b\.png: is 10 x 10 pixels, .* camera 'round'"):
        extract(open_log(write_omni(tmp_path / "a", b_png=small)))
    with pytest.raises(BadLog, match=r"cameras.round.center is not a known key.*'centre'"):
        open_log(write_omni(tmp_path / "b", log_toml=LOG_TOML + OMNI.replace("centre", "center")))
    with pytest.raises(BadLog, match=r"\[cameras.round\] camera 'round': ring_px"):
        open_log(write_omni(tmp_path / "c", log_toml=LOG_TOML + OMNI.replace("[20,", "[200,")))
