"""`graphslam inspect` as a user runs it."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from compare.cli import main
from tests.compare.tiny_log import write_tiny_log
from tests.frontend.small_logs import CAMERA, LOG_TOML, write_log

NEAR = CAMERA.replace("20.0", "100.0")


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A log with two empty images, whose wheels start after the first of them."""
    png = cv2.imencode(".png", np.full((24, 32), 120, np.uint8))[1].tobytes()
    return write_log(
        tmp_path / "log", log_toml=LOG_TOML + NEAR, images_csv="t,file\n-1,a.png\n1,b.png\n",
        a_png=png, b_png=png,
    )  # fmt: skip


def test_it_prints_what_is_there_what_is_missing_and_what_looks_wrong(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["inspect", str(log), "--out", str(tmp_path / "out")]) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    for words in (
        "wheels.csv",
        "32 x 24 pixels",
        "left less right",
        "groundtruth.tum",
        "what looks wrong: 2",
        "images.csv: 1 of 2 times are before the first row of wheels.csv",
        "cure: ",
    ):
        assert words in " ".join(captured.out.split()), words
    assert captured.out.endswith(f"{tmp_path / 'out' / 'lines.jpg'}\n")


def test_the_picture_and_all_that_was_found_are_written(log: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert main(["inspect", str(log), "--out", str(out)]) == 0
    assert sorted(path.name for path in out.iterdir()) == ["inspection.json", "lines.jpg"]
    assert cv2.imread(str(out / "lines.jpg")) is not None
    content = json.loads((out / "inspection.json").read_text())
    assert [finding["about"] for finding in content["findings"]] == ["images.csv", "lines"]
    assert content["folder"] == "log"


def test_it_goes_to_a_folder_named_after_the_log_and_replaces_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_tiny_log(tmp_path / "tiny")
    monkeypatch.chdir(tmp_path)
    assert main(["inspect", "tiny"]) == 0
    first = (tmp_path / "results" / "tiny-inspect" / "inspection.json").read_bytes()
    assert main(["inspect", "tiny"]) == 0
    assert (tmp_path / "results" / "tiny-inspect" / "inspection.json").read_bytes() == first
    printed = capsys.readouterr().out
    assert "nothing looks wrong" in printed
    assert printed.endswith(f"{Path('results', 'tiny-inspect')}\n")


def test_a_good_log_with_lines_of_its_own_shows_no_finding(tmp_path: Path) -> None:
    log, out = write_tiny_log(tmp_path / "tiny"), tmp_path / "out"
    assert main(["inspect", str(log), "--out", str(out)]) == 0
    assert json.loads((out / "inspection.json").read_text())["findings"] == []


def test_help_ends_with_an_example_and_lists_the_detector(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["inspect", "--help"]) == 0
    printed = capsys.readouterr().out
    assert "Example: graphslam inspect my-log" in printed
    assert "--detector.min-length-m" in printed
