"""The documentation: what it tells to run runs, and where it points there is something."""

from __future__ import annotations

import json
import re
import shlex
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from compare.cli import main
from frontend.log import open_log
from frontend.readers.log_toml import every_camera, read_log_toml
from frontend.readers.robot_toml import read_robot_file
from frontend.simulate import load_scenario

ROOT = Path(__file__).parents[1]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")])
FENCE = re.compile(r"(?:<!-- ([^\n]*?) -->\n)?^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"(?<!!)\[[^\]]*\]\(([^)\s]+)\)")


@dataclass(frozen=True, slots=True)
class Block:
    """A fenced block: the comment before it, its language and its text."""

    mark: str
    language: str
    text: str


def blocks(page: Path) -> list[Block]:
    return [Block(*found) for found in FENCE.findall(page.read_text(encoding="utf-8"))]


def commands(block: Block) -> list[list[str]]:
    lines = block.text.replace("\\\n", " ").splitlines()
    return [words for line in lines if (words := shlex.split(line, comments=True))]


def run_python(text: str) -> dict[str, object]:
    """Runs a snippet as a user would paste it; returns its names."""
    names: dict[str, object] = {"__name__": "__main__"}
    exec(compile(text, "snippet", "exec"), names)
    return names


def anchors(page: Path) -> set[str]:
    """Returns what can follow # in a link to a page: slugs of its headings, and its own ids."""
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    slugs = (re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in headings)
    return {*slugs, *re.findall(r'id="([^"]+)"', text)}


@pytest.fixture(scope="module")
def tutorial(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which everything on the tutorial's page was run, in its order."""
    folder = tmp_path_factory.mktemp("tutorial")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for block in blocks(ROOT / "docs" / "tutorial.md"):
            if block.mark.startswith("not run"):
                continue
            if block.language == "python":
                run_python(block.text)
            for words in commands(block) if block.language == "sh" else []:
                assert words[0] == "graphslam", words
                assert main(words[1:]) == 0, words
    return folder


def test_the_tutorial_runs_from_the_first_command_to_the_last(tutorial: Path) -> None:
    runs = sorted(path.parent.name for path in tutorial.glob("results/*/report.html"))
    assert runs == [
        "calibrated", "compare-my-log-friday", "drive", "localised", "part", "sample", "thinned",
    ]  # fmt: skip
    assert (tutorial / "batches" / "week" / "batch.html").is_file()
    assert json.loads((tutorial / "floor.json").read_text())["probability"] > 0.001
    assert (tutorial / "results" / "sample-inspect" / "lines.jpg").is_file()
    proposed = read_robot_file(tutorial / "results" / "look" / "robot.toml")
    assert proposed.topics.images == {"floor": "/camera/floor/image"}
    clock = tomllib.loads((tutorial / "clock.toml").read_text())["extract"]["camera_offset_s"]
    assert abs(clock) < 0.005
    assert (tutorial / "results" / "sample" / "smoother" / "trajectory.csv").is_file()
    noise = tomllib.loads((tutorial / "noise.toml").read_text())["extract"]["noise"]
    assert noise["rho_factor"] < 1.0


def test_the_tutorials_homography_is_that_of_its_camera(tutorial: Path) -> None:
    texts = [b.text for b in blocks(ROOT / "docs" / "tutorial.md") if "findHomography" in b.text]
    names = run_python(texts[0])
    camera = open_log(tutorial / "my-log").cameras["floor"]
    floor = np.array([[0.3, 0.1], [0.6, -0.2], [0.9, 0.0]])
    pixel = np.column_stack([floor, np.ones(3)]) @ np.asarray(names["homography"]).T
    error = camera.pixel_to_floor(pixel[:, :2] / pixel[:, 2:]) - floor
    assert np.abs(error).max() < 0.003


def test_the_tutorials_log_toml_is_one(tmp_path: Path) -> None:
    marked = [b for b in blocks(ROOT / "docs" / "tutorial.md") if b.mark == "file: log.toml"]
    path = tmp_path / "log.toml"
    path.write_text(marked[0].text)
    content = read_log_toml(path)
    assert content.robot is not None
    content.robot.drive(geometry_needed=True)
    assert list(every_camera(path, content)) == ["floor"]


def test_the_robot_file_of_the_bags_page_is_one(tmp_path: Path) -> None:
    text = next(b.text for b in blocks(ROOT / "docs" / "bags.md") if "graphslam-robot/1" in b.text)
    path = tmp_path / "robot.toml"
    path.write_text(text)
    content = read_robot_file(path)
    assert content.robot is not None
    content.robot.drive(geometry_needed=True)
    assert list(every_camera(path, content)) == ["floor"]


def test_each_block_that_the_tutorial_does_not_run_says_why() -> None:
    left_out = [b for b in blocks(ROOT / "docs" / "tutorial.md") if b.mark.startswith("not run")]
    assert len(left_out) == 1
    for block in left_out:
        assert re.fullmatch(r"not run: needs .+", block.mark)
        compile(block.text, "snippet", "exec")


def test_the_readmes_python_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    for block in blocks(ROOT / "README.md"):
        if block.language == "python":
            run_python(block.text)


def test_the_scenario_pages_python_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = "\n".join(
        b.text for b in blocks(ROOT / "docs" / "scenarios.md") if b.language == "python"
    )
    names = run_python(text)
    assert open_log(str(names["folder"])).images is not None


def test_the_scenario_pages_example_is_a_scenario(tmp_path: Path) -> None:
    whole = [b for b in blocks(ROOT / "docs" / "scenarios.md") if "graphslam-scenario/1" in b.text]
    path = tmp_path / "mine.toml"
    path.write_text(whole[0].text)
    assert load_scenario(path).name == "my floor"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    for target in LINK.findall(text):
        if re.match(r"[a-z]+:", target):
            continue
        file, _, anchor = target.partition("#")
        linked = page.parent / file if file else page
        assert linked.exists(), f"{page.name} links to {target}"
        assert not anchor or anchor in anchors(linked), f"{page.name} links to {target}"
