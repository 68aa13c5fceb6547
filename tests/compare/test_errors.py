"""Every error and warning as a user meets it: its command, exit code and message.

`docs/errors.md` is the list of messages, with ``<...>`` for what varies. Each of its rows is caused
here through the command line, and each message caused here has its row there.
"""

from __future__ import annotations

import errno
import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from compare.cli import main
from compare.folders import recover
from compare.results import whole_folder
from tests.compare.tiny_log import write_tiny_log
from tests.frontend.recordings import Bag
from tests.frontend.small_logs import CAMERA, LOG_TOML, WHEELS, write_log

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "errors.md"
PNG = cv2.imencode(".png", np.full((24, 32), 120, np.uint8))[1].tobytes()
SMALL = cv2.imencode(".png", np.full((8, 8), 120, np.uint8))[1].tobytes()
HEAD = 'format = "graphslam-log/1"\n'
FISHEYE = """
lens = "fisheye"
matrix = [[20.0, 0.0, 15.5], [0.0, 20.0, 11.5], [0.0, 0.0, 1.0]]
distortion = [0.1, 0.0, 0.0, 0.0, 0.0]
"""
EXTRACT = ("extract", "LOG", "--out", "OUT")
SIGHTINGS = "t,rho,alpha\n0,1,0.3\n1,1,0.3\n1,1,1.9\n"


@dataclass(frozen=True)
class Case:
    """Something that goes wrong.

    Attributes:
        message: words of the row of the document; only one row has them.
        words: what the message says about this very case.
        files: of the log, as `write_log` takes them.
        command: arguments of the command line; LOG, OUT and DIR stand for paths.
        prepare: changes the folder DIR before.
    """

    message: str
    words: tuple[str, ...]
    files: dict[str, str | bytes | None]
    command: tuple[str, ...] = ("run", "LOG", "--methods", "odometry", "--out", "OUT")
    prepare: Callable[[Path], Any] | None = None


def images(rows: str = "0,a.png\n1,b.png\n", camera: str = CAMERA, **more: Any) -> dict[str, Any]:
    files = {"images_csv": "t,file\n" + rows, "a_png": PNG, "b_png": PNG}
    return {"log_toml": LOG_TOML + camera, **files, **more}


def ceiling(image: bytes, **more: Any) -> dict[str, Any]:
    files = {"log_toml": LOG_TOML + UP, "images_csv": "t,file,camera\n0,a.png,up\n1,b.png,up\n"}
    blank = cv2.imencode(".png", np.zeros((24, 32), np.uint8))[1].tobytes()
    return {**files, "a_png": image, "b_png": blank, **more}


def settings(text: str) -> dict[str, Any]:
    return {"log_toml": text}


def homography(text: str) -> dict[str, Any]:
    return images(camera=f"[camera]\nimage_size = [32, 24]\nhomography = {text}\n")


def a_bag(folder: Path) -> None:
    with Bag(folder / "x.bag", 1) as bag:
        for k in range(400):
            bag.odometry(0.1 * k, 0.01 * k)
    text = 'format = "graphslam-robot/1"\n[topics]\nodometry = "/odmo"\n'
    (folder / "robot.toml").write_text(text)


def half_a_bag(folder: Path) -> None:
    a_bag(folder)
    data = (folder / "x.bag").read_bytes()
    (folder / "x.bag").write_bytes(data[: int(0.9 * len(data))])


def images_alone(folder: Path) -> None:
    with Bag(folder / "x.bag", 1) as bag:
        bag.image(0.0, np.zeros((24, 32), np.uint8))


RUN = Case.command
BAG = ("run", "DIR/x.bag", "--methods", "odometry", "--out", "OUT")
ABOVE = """
[cameras.above]
looks_at = "overhead"
image_size = [32, 24]
homography = [[20.0, 0.0, 2.0], [0.0, -20.0, 20.0], [0.0, 0.0, 1.0]]

[cameras.above.tags]
front = [0.12, 0.0]
"""
UP = """
[cameras.up]
looks_at = "ceiling"
image_size = [32, 24]
homography = [[25.0, 0.0, 15.5], [0.0, 25.0, 11.5], [0.0, 0.0, 1.0]]
"""
LAMP_AT_THE_BORDER = np.zeros((24, 32), np.uint8)
LAMP_AT_THE_BORDER[8:14, :13] = 255
CUT_LAMP = cv2.imencode(".png", LAMP_AT_THE_BORDER)[1].tobytes()
TAGS = "t,x,y,theta\n0,0,0,0\n0.5,0.25,0,0\n1,0.5,0,0\n"

ERRORS = [
    # the folder
    Case("does not exist; give a folder", ("nowhere",), {}, ("run", "DIR/nowhere")),
    Case("this folder has no log.toml", ("DIR",), {}, ("run", "DIR")),
    Case("has neither wheels.csv nor odometry.csv", ("LOG",), {"wheels_csv": None}),
    # bags
    Case("is empty (0 bytes)", ("x.bag",), {}, BAG, lambda d: (d / "x.bag").touch()),
    Case("is no bag", ("x.bag",), {}, BAG, lambda d: write_file(d / "x.bag", "t,left,right\n")),
    Case("has no topic", ("'/odmo'", "'/odom'"), {}, (*BAG, "--robot", "DIR/robot.toml"), a_bag),
    Case("nothing tells how the robot moved", ("/image",), {}, BAG, images_alone),
    # log.toml
    Case("is not valid TOML", ("log.toml:2",), settings(HEAD + "name = corridor\n")),
    Case("no format line", ("log.toml",), settings("name = 'x'\n")),
    Case("format = <text>", ("graphslam-log/9",), settings('format = "graphslam-log/9"\n')),
    Case("[robot] is missing", ("log.toml",), settings(HEAD)),
    Case(
        "[robot] <key> is missing",
        ("log.toml", "wheel_base"),
        settings(LOG_TOML.replace("wheel_base = 0.2\n", "")),
    ),
    Case(
        "log.toml: <key> is not a known key; did you mean",
        ("robot.wheel_bsae", "'wheel_base'"),
        settings(LOG_TOML.replace("wheel_base", "wheel_bsae")),
    ),
    Case(
        "log.toml: <key> is not a known key; known:",
        ("log.toml", "zzz"),
        settings(LOG_TOML + "[zzz]\n"),
    ),
    Case(
        "<table>.<key> is missing; add",
        ("camera.homography", "[camera]"),
        images(camera="[camera]\nimage_size = [32, 24]\n"),
    ),
    Case(
        "must be a number",
        ("robot.wheel_base", "without quotes"),
        settings(LOG_TOML.replace("wheel_base = 0.2", 'wheel_base = "0.2"')),
    ),
    Case(
        "must be finite",
        ("robot.wheel_base", "nan"),
        settings(LOG_TOML.replace("wheel_base = 0.2", "wheel_base = nan")),
    ),
    Case(
        "must be a positive length",
        ("[robot] wheel_base = -0.2",),
        settings(LOG_TOML.replace("wheel_base = 0.2", "wheel_base = -0.2")),
    ),
    Case(
        "homography cannot be inverted",
        ("[camera]",),
        homography("[[1, 0, 0], [2, 0, 0], [0, 0, 1]]"),
    ),
    Case("lens = <text>", ("[camera]", "'wide'"), images(camera=CAMERA + 'lens = "wide"\n')),
    Case("fisheye model takes 4", ("has 5 coefficients",), images(camera=CAMERA + FISHEYE)),
    Case(
        "ignore_px has a part",
        ("[camera]", "[0.0, 0.0, 9.0]"),
        images(camera=CAMERA + "ignore_px = [[0, 0, 9]]\n"),
    ),
    Case(
        "puts the horizon into the middle",
        ("[camera]",),
        homography("[[1, 0, 0], [0, 1, 0], [0.06451612903225806, 0, -0.06451612903225806]]"),
    ),
    # tables
    Case("is not a known column", ("wheels.csv:1", "'right'"), {"wheels_csv": "t,left,rihgt\n"}),
    Case("column <name> is missing", ("wheels.csv:1", "right"), {"wheels_csv": "t,left\n0,0\n"}),
    Case("runs backwards", ("wheels.csv:6", "t = 1 "), {"wheels_csv": WHEELS + "1,4,4\n"}),
    Case("repeats the time above", ("wheels.csv:6",), {"wheels_csv": WHEELS + "3,4,4\n"}),
    Case("repeats an image's time", ("images.csv:3",), images("0,a.png\n0,b.png\n")),
    Case(
        "is not finite", ("wheels.csv:3", "left"), {"wheels_csv": "t,left,right\n0,0,0\n1,nan,1\n"}
    ),
    Case(
        "is not a number", ("wheels.csv:3", "'x'"), {"wheels_csv": "t,left,right\n0,0,0\n1,x,1\n"}
    ),
    Case("is empty; write a number", ("wheels.csv:2",), {"wheels_csv": "t,left,right\n0,,0\n"}),
    Case("is beyond 1e+12", ("wheels.csv:2",), {"wheels_csv": "t,left,right\n1.7e18,0,0\n"}),
    Case("has <n> cells where", ("wheels.csv:2",), {"wheels_csv": "t,left,right\n0,0\n"}),
    Case("rows of data and needs", ("wheels.csv",), {"wheels_csv": "t,left,right\n0,0,0\n"}),
    Case("is not UTF-8", ("wheels.csv:2",), {"wheels_csv": b"t,left,right\n\xff\n"}),
    Case(
        "is beyond two full turns", ("sightings.csv:2",), {"sightings_csv": "t,rho,alpha\n0,1,90\n"}
    ),
    Case(
        "is no covariance",
        ("sightings.csv:2", "cov_rr = -1"),
        {"sightings_csv": "t,rho,alpha,cov_rr,cov_ra,cov_aa\n0,1,0,-1,0,1\n"},
    ),
    Case("has not the norm 1", ("groundtruth.tum:1",), {"groundtruth_tum": "0 0 0 0 0 0 0 2\n"}),
    # images
    Case("there is no image file", ("images.csv:2", "'c.png'"), images("0,c.png\n")),
    Case("leaves the log folder", ("images.csv:2", "'../a.png'"), images("0,../a.png\n")),
    Case("is an absolute path", ("images.csv:2", "'/a.png'"), images("0,/a.png\n")),
    Case("describes no camera", ("images.csv:2",), images(camera="")),
    Case("pixels, but log.toml says", ("a.png", "8 x 8", "[32, 24]"), images(a_png=SMALL)),
    # times
    Case("give both one clock", ("wheels.csv", "t = 99 s"), images("99,a.png\n")),
    Case(
        "lies between from_s",
        ("90", "to 3 s"),
        {},
        ("run", "LOG", "--from", "90", "--out", "OUT"),
    ),
    # where results go, and what they are
    Case(
        "no run.json of ours",
        ("OUT", "--out"),
        {},
        prepare=lambda folder: write_file(folder / "out" / "precious.txt"),
    ),
    Case(
        "is no earlier inspection",
        ("OUT", "--out"),
        {},
        ("inspect", "LOG", "--out", "OUT"),
        lambda folder: write_file(folder / "out" / "precious.txt"),
    ),
    Case(
        "index.html: was not written by this program",
        ("OUT/index.html",),
        {},
        ("run", "LOG", "LOG", "--out", "OUT"),
        lambda folder: write_file(folder / "out" / "index.html"),
    ),
    Case(
        "part of this path is a file",
        ("DIR/file",),
        {},
        ("extract", "LOG", "--out", "DIR/file/out"),
        lambda folder: write_file(folder / "file"),
    ),
    Case("holds no run.json of a run", ("DIR",), {}, ("report", "DIR")),
    # settings and scenarios
    Case(
        "<file>: <key> is not a known key",
        ("mine.toml: ekf.matching.gaet", "'gate'"),
        {},
        ("run", "LOG", "--config", "DIR/mine.toml"),
        lambda folder: write_file(folder / "mine.toml", "[ekf.matching]\ngaet = 9\n"),
    ),
    Case("must be 1 or more", ("every = 0",), {}, ("run", "LOG", "--every", "0")),
    Case(
        "no such file or scenario",
        ("smaple", "'sample'"),
        {},
        ("simulate", "smaple", "--out", "OUT"),
    ),
    Case(
        "exists already; choose another folder",
        ("OUT",),
        {},
        ("simulate", "sample", "--out", "OUT"),
        lambda folder: write_file(folder / "out" / "precious.txt"),
    ),
    Case(
        "is not an empty folder",
        ("pictures",),
        images(),
        (*EXTRACT, "--overlay", "DIR/pictures"),
        lambda folder: write_file(folder / "pictures" / "precious.txt"),
    ),
    Case(
        "has no images that are searched",
        (),
        {},
        (*EXTRACT, "--overlay", "DIR/pictures"),
    ),
    Case(
        "its lines are those of sightings.csv",
        (),
        images(sightings_csv=SIGHTINGS),
        (*EXTRACT, "--overlay", "DIR/pictures"),
    ),
    Case("needs position", ("'above'", "0.3"), settings(LOG_TOML + ABOVE + "height = 0.3\n")),
    Case("a show is a page", (".gif",), {}, ("play", "LOG", "--out", "DIR/show.gif")),
]

WARNINGS = [
    Case("images that could not be read", ("left out: 1, first b.png",), images(b_png=b"cut")),
    Case(
        "nodes outside the wheel record",
        ("dropped: 1", "wheels.csv", "t = 0 s to 3 s"),
        images("-1,a.png\n1,b.png\n"),
    ),
    Case("no line was seen", ("only odometry",), images()),
    Case("lines of one direction only", (), {"sightings_csv": SIGHTINGS.replace("1,1,1.9\n", "")}),
    Case("[start] counts as the pose", ("t = 1 s",), {
        "log_toml": LOG_TOML + "[start]\npose = [0, 0, 0]\n",
        "sightings_csv": SIGHTINGS,
    }, (*RUN, "--from", "0.5")),
    Case("odometry.csv: not used", (), {
        "odometry_csv": "t,x,y,theta\n0,0,0,0\n1,0,0,0\n",
        "sightings_csv": SIGHTINGS,
    }),
    Case("sightings.csv: images are not searched", (), images(sightings_csv=SIGHTINGS)),
    Case("there is only odometry", (), {}),
    Case("does not say where on the known map", (), {
        "map_csv": "line,rho,alpha\n0,1,0\n1,1,1.6\n",
        "sightings_csv": SIGHTINGS,
    }, (*RUN, "--known-map", "LOG/map.csv")),
    Case("has no [start]: the first pose fix", (), {"tags_csv": TAGS}),
    Case("no pose fix from", ("from t = 0 s to t = 20 s (20.0 s)",), {
        "wheels_csv": "t,left,right\n0,0,0\n20,100,100\n",
        "tags_csv": "t,x,y,theta\n0,0,0,0\n20,5,0,0\n",
    }),
    Case("were the tags exchanged", ("exchanged?: 1",), {
        "tags_csv": TAGS + "2,1.05,0.1,-2.7\n",
    }),
    Case("that odometry contradicts", ("contradicts: 1",), {"tags_csv": TAGS + "1,0,0.5,0\n"}),
    Case("overhead images searched for tags", ("searched for tags: 2, poses used: 0",), {
        "log_toml": LOG_TOML + ABOVE,
        "images_csv": "t,file,camera\n0,a.png,above\n1,a.png,above\n",
        "a_png": PNG,
    }),
    Case("images of overhead cameras are not searched", (), {
        "log_toml": LOG_TOML + ABOVE,
        "images_csv": "t,file,camera\n0,a.png,above\n",
        "a_png": PNG,
        "tags_csv": TAGS,
    }),
    Case("images of the ceiling that could not be read", ("left out: 1",), ceiling(b"cut")),
    Case("no lamp was seen", ("--extract.lamps.size-m",), ceiling(PNG)),
    Case("lamps cut by the image's border", ("left out: 1",), ceiling(CUT_LAMP)),
    Case("lamps.csv: images are not searched", (), ceiling(PNG, lamps_csv="t,x,y,phi\n0,1,0,0\n")),
    Case("not all of the bag could be read", ("no index",), {}, BAG, half_a_bag),
]  # fmt: skip


def write_file(path: Path, text: str = "mine") -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def execute(case: Case, folder: Path) -> int:
    """Runs a case's command below ``folder`` and returns its exit code."""
    write_log(folder / "log", **case.files)
    if case.prepare is not None:
        case.prepare(folder)
    return main([placed(argument, folder) for argument in case.command])


def placed(text: str, folder: Path) -> str:
    paths = {"LOG": folder / "log", "OUT": folder / "out", "DIR": folder}
    return re.sub(r"\b(LOG|OUT|DIR)\b", lambda name: str(paths[name[1]]), text)


def documented(heading: str) -> list[str]:
    """Returns the messages in the tables below a heading of the document."""
    text = DOCUMENT.read_text(encoding="utf-8").split(f"\n## {heading}\n")[1].split("\n## ")[0]
    return [row.replace("\\|", "|") for row in re.findall(r"^\| ``? ?(.+?) ?``? \| ", text, re.M)]


def row_of(case: Case, heading: str) -> str:
    """Returns the one documented message that a case is about."""
    rows = [row for row in documented(heading) if case.message in row]
    assert len(rows) == 1, (case.message, rows)
    return rows[0]


def follows(message: str, row: str) -> bool:
    """Returns whether a message is a documented one, with something in place of each ``<...>``."""
    parts = (re.escape(part) for part in re.split(r"<[^<>]+>", row))
    return re.fullmatch(".+?".join(parts), message) is not None


def named(cases: list[Case]) -> Any:
    return pytest.mark.parametrize(
        "case", cases, ids=lambda case: re.sub(r"\W+", "-", case.message)
    )


# ---- the table --------------------------------------------------------------------------------


@named(ERRORS)
def test_an_error_is_one_documented_line_and_exit_1(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert execute(case, tmp_path) == 1
    captured = capsys.readouterr()
    assert captured.out == ""
    start, end = "graphslam: error: ", "\n"
    assert captured.err.startswith(start)
    message = captured.err.removeprefix(start).removesuffix(end)
    assert "\n" not in message
    assert follows(message, row_of(case, "Errors")), message
    for words in case.words:
        assert placed(words, tmp_path) in message
    left = {path.name for path in tmp_path.iterdir() if path.name.startswith(".")}
    assert left == set()


@named(WARNINGS)
def test_a_warning_is_documented_and_the_run_goes_on(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert execute(case, tmp_path) == 0
    told = capsys.readouterr().err
    assert "Traceback" not in told
    warnings = json.loads((tmp_path / "out" / "run.json").read_text())["warnings"]
    (expected,) = [w for w in warnings if follows(w, row_of(case, "Warnings"))]
    assert all(words in expected for words in case.words)
    assert f": {expected}\n" in told
    assert told.count("graphslam: warning: ") == len(warnings)


@pytest.mark.parametrize(("heading", "cases"), [("Errors", ERRORS), ("Warnings", WARNINGS)])
def test_every_documented_message_is_caused_here(heading: str, cases: list[Case]) -> None:
    assert {row_of(case, heading) for case in cases} == set(documented(heading))


# ---- a full disk, a killed run ----------------------------------------------------------------


def files_of(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return write_tiny_log(tmp_path / "log", nodes=20)


@pytest.fixture
def result(log: Path, tmp_path: Path) -> Path:
    """The result of an earlier run."""
    assert main(["run", str(log), "--methods", "odometry", "--out", str(tmp_path / "out")]) == 0
    return tmp_path / "out"


@pytest.mark.parametrize(
    ("number", "cure"),
    [(errno.ENOSPC, "free some space"), (errno.EACCES, "that you may write to")],
)
@pytest.mark.parametrize("command", ["run", "extract", "inspect"])
def test_a_full_disk_or_a_forbidden_one_leaves_the_earlier_result_and_says_what_to_do(
    command: str,
    number: int,
    cure: str,
    log: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "out"
    assert main([command, str(log), "--out", str(out)]) == 0
    before = files_of(out)
    capsys.readouterr()

    def refuse(*_: object, **__: object) -> None:
        raise OSError(number, os.strerror(number))  # as write() does, without a file name

    monkeypatch.setattr("pathlib.Path.write_text", refuse)
    assert main([command, str(log), "--out", str(out)]) == 1
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    message = captured.err.removeprefix("graphslam: error: ").rstrip("\n")
    assert message.startswith(f"{out}: {os.strerror(number)}; ")
    assert cure in message
    assert [row for row in documented("Writing") if follows(message, row)]
    assert files_of(out) == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log", "out"]


def test_an_error_of_writing_names_the_file_where_it_would_have_stood(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with (
        pytest.raises(OSError, match=re.escape(f"{out / 'plots' / 'map.svg'}")),
        whole_folder(out) as folder,
    ):
        raise OSError(errno.ENOSPC, "No space left on device", str(folder / "plots" / "map.svg"))


def test_reading_errors_inside_are_not_taken_for_errors_of_writing(tmp_path: Path) -> None:
    with (
        pytest.raises(FileNotFoundError, match="lost") as caught,
        whole_folder(tmp_path / "out"),
    ):
        (tmp_path / "lost.csv").read_text()
    assert "--out" not in str(caught.value)


KILL = """
import os, signal, sys
from pathlib import Path
import compare.run
from compare.cli import main

def kill(*_):
    os.kill(os.getpid(), signal.SIGKILL)

rename = Path.rename

def rename_or_kill(path, target):
    if path.name == "new":
        kill()
    return rename(path, target)

if sys.argv[1] == "writing":
    compare.run.write_report = kill
else:
    Path.rename = rename_or_kill
main(sys.argv[2:])
"""


def killed_run(when: str, log: Path, out: Path) -> None:
    """Runs the main job in a process that is killed while writing, or between both renames."""
    arguments = ["run", str(log), "--methods", "odometry", "--out", str(out)]
    command = [sys.executable, "-c", KILL, when, *arguments]
    done = subprocess.run(command, capture_output=True, timeout=120, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr


needs_sigkill = pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no SIGKILL here")


@needs_sigkill
def test_a_run_killed_while_writing_leaves_the_earlier_result_and_the_next_one_cleans_up(
    log: Path, result: Path, tmp_path: Path
) -> None:
    before = files_of(result)
    killed_run("writing", log, result)
    assert files_of(result) == before
    assert [path for path in tmp_path.iterdir() if ".partial-" in path.name]
    assert main(["run", str(log), "--methods", "odometry", "--out", str(result)]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log", "out"]
    assert files_of(result).keys() == before.keys()


@needs_sigkill
def test_a_reader_finds_the_earlier_result_of_a_run_killed_between_the_renames(
    log: Path, result: Path, tmp_path: Path
) -> None:
    before = files_of(result)
    killed_run("renaming", log, result)
    assert not result.exists()
    assert main(["report", str(result)]) == 0
    assert files_of(result).keys() == before.keys()
    assert files_of(result)["run.json"] == before["run.json"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log", "out"]


def test_the_working_folder_of_a_living_process_is_left_alone(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with whole_folder(out) as folder:
        recover(out)
        write_file(folder / "run.json", json.dumps({"format": "graphslam-run/1"}))
    assert [path.name for path in out.iterdir()] == ["run.json"]
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize(
    "name", [".out.partial-mine", ".out.partial-12345678", ".out.partial-x.partial-12345678"]
)
def test_folders_that_merely_look_like_ours_are_left_alone(name: str, tmp_path: Path) -> None:
    write_file(tmp_path / name / "old" / "precious.txt")
    if name.endswith("x.partial-12345678"):
        write_file(tmp_path / name / "lock", "")
    recover(tmp_path / "out")
    assert (tmp_path / name / "old" / "precious.txt").exists()
    assert not (tmp_path / "out").exists()
