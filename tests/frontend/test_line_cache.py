"""Lines kept from run to run: what decides an entry, and that nothing about it can go wrong."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from frontend import extract, line_cache, open_log
from frontend.config import DetectorConfig, ExtractConfig
from frontend.extract import UNREADABLE
from frontend.image_lines import lines_in_images
from frontend.line_cache import cache_key
from graphslam.measurements import Measurements
from tests.frontend.floors import CAMERAS, LINES, floor_with_lines
from tests.frontend.small_logs import LOG_TOML, write_log

CAMERA = CAMERAS["160x120"]


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "cache"
    monkeypatch.setenv(line_cache.FOLDER, str(folder))
    return folder


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A log of four images of one floor, each with noise of its own, and one that is none."""
    folder = tmp_path / "log"
    camera = f"\n[camera]\nimage_size = [160, 120]\nhomography = {CAMERA.homography.tolist()}\n"
    images = "".join(f"{number},{number}.png\n" for number in range(4))
    write_log(folder, log_toml=LOG_TOML + camera, images_csv="t,file\n" + images)
    grey = floor_with_lines(CAMERA).astype(int)
    for number in range(3):
        noise = np.random.default_rng(number).integers(-3, 4, grey.shape)
        cv2.imwrite(str(folder / f"{number}.png"), np.clip(grey + noise, 0, 255).astype(np.uint8))
    (folder / "3.png").write_bytes(b"no picture")
    return folder


def bytes_of(measurements: Measurements, folder: Path) -> bytes:
    measurements.save(folder / "measurements.npz")
    return (folder / "measurements.npz").read_bytes()


def test_a_second_run_gives_the_same_bytes_and_searches_no_image(
    log: Path, cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cold = extract(open_log(log))
    assert len(cold.sightings["line"]) == 3 * len(LINES)
    assert cold.rejected[UNREADABLE] == 1
    monkeypatch.setattr("frontend.image_lines.detect_lines", None)
    warm = extract(open_log(log))
    assert bytes_of(warm, tmp_path) == bytes_of(cold, tmp_path)


def test_without_a_cache_nothing_is_kept_and_the_result_is_the_same(
    log: Path, cache: Path, tmp_path: Path
) -> None:
    plain = extract(open_log(log), ExtractConfig(cache=False))
    assert not cache.exists()
    assert bytes_of(extract(open_log(log)), tmp_path) == bytes_of(plain, tmp_path)
    assert len(list(cache.iterdir())) == 1


@pytest.mark.parametrize("damage", ["empty", "cut", "changed", "of another key", "a folder"])
def test_a_damaged_entry_counts_as_none_and_is_written_again(
    log: Path, cache: Path, tmp_path: Path, damage: str
) -> None:
    right = bytes_of(extract(open_log(log)), tmp_path)
    (entry,) = cache.iterdir()
    whole = entry.read_bytes()
    if damage == "of another key":
        extract(open_log(log), ExtractConfig(detector=DetectorConfig(polarity="bright")))
        (other,) = set(cache.iterdir()) - {entry}
        entry.write_bytes(other.read_bytes())
    elif damage == "a folder":
        entry.unlink()
        entry.mkdir()
    else:
        middle = len(whole) // 2
        flipped = whole[:middle] + bytes([whole[middle] ^ 1]) + whole[middle + 1 :]
        entry.write_bytes({"empty": b"", "cut": whole[:-1], "changed": flipped}[damage])
    assert bytes_of(extract(open_log(log)), tmp_path) == right
    assert entry.is_dir() or entry.read_bytes() == whole


def test_a_cache_that_cannot_be_written_is_none(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv(line_cache.FOLDER, str(tmp_path / "file" / "cache"))
    assert len(extract(open_log(log)).sightings["line"]) == 3 * len(LINES)


def test_the_key_follows_images_camera_detector_and_part_but_not_the_folder(
    log: Path, tmp_path: Path
) -> None:
    numbers, detector = np.arange(4), DetectorConfig()

    def key(
        folder: Path, numbers: np.ndarray = numbers, detector: DetectorConfig = detector
    ) -> str:
        return cache_key(open_log(folder), numbers, detector)

    first = key(log)
    moved = tmp_path / "moved"
    log.rename(moved)
    assert key(moved) == first
    keys = {first, key(moved, numbers[:2]), key(moved, detector=replace(detector, polarity="dark"))}
    picture = moved / "0.png"
    picture.write_bytes(picture.read_bytes() + b"\0")
    keys.add(key(moved))
    settings = moved / "log.toml"
    settings.write_text(settings.read_text() + "ignore_px = [[0, 0, 9, 9]]\n")
    keys.add(key(moved))
    assert len(keys) == 5


def test_the_oldest_entries_go_when_there_are_too_many_bytes_and_no_file_of_others(
    log: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache.mkdir()
    theirs = cache / "thesis.tex"
    theirs.write_text("x" * 10_000)
    recording, numbers = open_log(log), np.arange(4)
    lines_in_images(recording, numbers, ExtractConfig())
    (first,) = set(cache.iterdir()) - {theirs}
    monkeypatch.setattr(line_cache, "MOST_BYTES", first.stat().st_size)
    lines_in_images(recording, numbers[:2], ExtractConfig())
    (second,) = set(cache.iterdir()) - {theirs}
    assert second != first
    assert theirs.exists()
