"""`graphslam calibrate` for a camera, as a user runs it."""

from __future__ import annotations

import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest

from compare.camera_calibration import calibrate_floor
from compare.cli import main
from frontend.calibrate_target import Chessboard
from frontend.camera import Camera
from tests.frontend.targets import CAMERA, chessboard_paint, dots_paint, photograph
from tests.test_docs import ROOT, blocks, commands, run_python

BOARD = Chessboard(5, 6, 0.04, (0.40, 0.10, -30.0))
FLOOR = np.array([[0.3, 0.1], [0.3, -0.1], [0.5, 0.2], [0.55, -0.2], [0.85, 0.25], [0.8, -0.2]])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    tmp_path = tmp_path_factory.mktemp("calibrate")
    rows = zip(CAMERA.floor_to_pixel(FLOOR).round(1).tolist(), FLOOR.tolist(), strict=True)
    lines = (f"{u},{v},{x},{y}\n" for (u, v), (x, y) in rows)
    (tmp_path / "points.csv").write_text("u,v,x,y\n" + "".join(lines))
    (tmp_path / "dots.csv").write_text("x,y\n" + "".join(f"{x},{y}\n" for x, y in FLOOR))
    cv2.imwrite(str(tmp_path / "dots.png"), photograph(CAMERA, dots_paint(FLOOR, 0.012)))
    cv2.imwrite(str(tmp_path / "board.png"), photograph(CAMERA, chessboard_paint(BOARD)))
    return tmp_path


POINTS = ["--points", "points.csv", "--image-size", "320", "240"]
DOTS = ["--dots", "dots.csv", "--image", "dots.png"]
CHESS = ["--chessboard", "5", "6", "--square", "0.04", "--board-pose", "0.4", "0.1", "-30"]
CHESS += ["--image", "board.png"]


@pytest.mark.parametrize("arguments", [POINTS, DOTS, CHESS], ids=["points", "dots", "chessboard"])
def test_each_way_prints_the_errors_and_writes_the_camera_and_a_picture(
    arguments: list[str],
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(folder)
    assert main(["calibrate", *arguments, "--out", "camera.toml", "--picture", "p.png"]) == 0
    shown = capsys.readouterr().out
    assert "on the floor, cm" in shown
    assert "left out" in shown
    text = Path("camera.toml").read_text()
    assert text in shown
    table = tomllib.loads(text)["camera"]
    found = Camera("floor", "floor", tuple(table["image_size"]), np.array(table["homography"]))
    pixel = np.array([[50.0, 50.0], [160.0, 120.0], [250.0, 200.0]])
    apart = found.pixel_to_floor(pixel) - CAMERA.pixel_to_floor(pixel)
    assert np.abs(apart).max() < 0.003
    assert cv2.imread("p.png") is not None


def test_the_same_arguments_give_the_same_bytes(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    for name in ("a", "b"):
        out = ["--out", f"{name}.toml", "--picture", f"{name}.png"]
        assert main(["calibrate", *CHESS, *out]) == 0
    for ending in ("toml", "png"):
        assert Path(f"a.{ending}").read_bytes() == Path(f"b.{ending}").read_bytes()


def test_a_known_lens_is_read_from_the_block_that_an_earlier_calibration_wrote(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    assert main(["calibrate", *CHESS, "--fit-distortion", "--out", "lens.toml"]) == 0
    assert main(["calibrate", *POINTS, "--lens", "lens.toml", "--out", "camera.toml"]) == 0
    one, two = (tomllib.loads(Path(n).read_text())["camera"] for n in ("lens.toml", "camera.toml"))
    assert one["distortion"] == two["distortion"]


def test_the_command_is_a_function_with_the_same_arguments(folder: Path) -> None:
    found = calibrate_floor(points=folder / "points.csv", image_size=(640, 480))
    assert found.mean_error_m < 1e-3
    assert found.points.source == str(folder / "points.csv")


def test_what_the_page_on_calibration_tells_to_run_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    page = blocks(ROOT / "docs" / "calibration.md")
    (table,) = (block for block in page if block.mark == "file: points.csv")
    Path("points.csv").write_text(table.text)
    for block in page:
        for words in commands(block) if block.language == "sh" else []:
            assert main(words[1:]) == 0
        if block.language == "python":
            run_python(block.text)
    assert Path("camera.toml").is_file()


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        ([], 2, "needs one of --noise, --time-offset, --bearings, --points, --dots, --chessboard"),
        (["--noise"], 2, "LOG goes with --noise"),
        (["log", *POINTS], 2, "LOG goes with --noise"),
        ([*POINTS, *DOTS], 2, "found --points and --dots"),
        (["--points", "points.csv"], 1, "size of the camera's images is missing"),
        ([*POINTS, "--image", "none.png"], 1, "none.png: cannot be read as an image"),
        (["--points", "points.csv", "--image-size", "9", "9", "--image", "dots.png"], 1, "320 x"),
        (["--dots", "dots.csv"], 1, "give --image"),
        (["--chessboard", "5", "6", "--image", "board.png"], 1, "needs --square and --board-pose"),
        ([*DOTS, "--square", "0.04"], 1, "give --chessboard too"),
        ([*POINTS, "--picture", "p.gif"], 1, "ends in .png or .jpg"),
        ([*POINTS, "--lens", "points.csv"], 1, "is not valid TOML"),
        (["--points", "dots.csv", "--image-size", "320", "240"], 1, "dots.csv:1: column 'u'"),
    ],
)
def test_what_is_missing_or_wrong_is_one_line_with_a_cure(
    arguments: list[str],
    code: int,
    message: str,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(folder)
    assert main(["calibrate", *arguments]) == code
    told = capsys.readouterr().err
    assert message in told
    assert told.count("\n") == 1
