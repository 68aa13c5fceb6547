"""Pictures of every frame: the lines lie on the grooves, in the image and on the floor."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from compare.cli import main
from frontend.config import DetectorConfig
from frontend.lines import detect_lines
from frontend.overlay_frames import HEIGHT, frame_picture
from tests.frontend.floors import CAMERAS, LINES, floor_with_lines
from tests.frontend.small_logs import LOG_TOML, write_log


def coloured(picture: np.ndarray) -> np.ndarray:
    """Which pixels are clearly not grey."""
    return np.ptp(picture.astype(int), axis=2) > 60


@pytest.mark.parametrize("name", ["320x240", "320x240 bent", "320x240 fisheye"])
def test_lines_are_drawn_on_the_dark_grooves_of_both_pictures(name: str) -> None:
    camera = CAMERAS[name]
    grey = floor_with_lines(camera)
    found = detect_lines(grey, camera, DetectorConfig())
    lines = frame_picture(grey, camera, found.z, found.extent, "text")[:HEIGHT]
    none = frame_picture(grey, camera, found.z[:0], found.extent[:0], "text")[:HEIGHT]
    marked = coloured(lines)
    left = np.arange(lines.shape[1]) < HEIGHT * 320 // 240
    for part in (left, ~left):
        shown = part & (none[..., 0] > 20)  # around what a lens shows there is black
        assert np.count_nonzero(marked & shown) > 300
        assert np.median(none[marked & shown]) < np.median(none[shown]) - 40


def test_extract_writes_a_picture_of_each_image_that_can_be_read(tmp_path: Path) -> None:
    camera = CAMERAS["160x120"]
    settings = f"\n[camera]\nimage_size = [160, 120]\nhomography = {camera.homography.tolist()}\n"
    log = write_log(
        tmp_path / "log", log_toml=LOG_TOML + settings, images_csv="t,file\n0,a.png\n1,b.png\n"
    )
    cv2.imwrite(str(log / "a.png"), floor_with_lines(camera))
    (log / "b.png").write_bytes(b"")
    out, pictures = tmp_path / "out", tmp_path / "pictures"
    assert main(["extract", str(log), "--out", str(out), "--overlay", str(pictures)]) == 0
    assert [path.name for path in pictures.iterdir()] == ["000000.jpg"]
    assert coloured(cv2.imread(str(pictures / "000000.jpg"))).sum() > 300
    assert (out / "measurements.npz").is_file()
    rows = (out / "sightings.csv").read_text().splitlines()
    assert len(rows) == 1 + len(LINES)
