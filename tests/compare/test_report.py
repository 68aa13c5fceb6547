"""The report: complete, offline, escaped, and the same when written again from its folder."""

from __future__ import annotations

import base64
import csv
import hashlib
import json
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from compare.config import RunConfig
from compare.pages import source
from compare.plots_sightings import matches_per_landmark
from compare.plots_style import METHOD_COLOURS, MOST_POINTS, stride, style
from compare.record import Record
from compare.report import rebuild_report, write_report
from compare.report_quality import lines_per_node, worst_residuals
from compare.report_summary import summary
from compare.report_tables import fixed, number
from compare.run import RunResult, run_log
from graphslam.errors import BadConfig, BadMeasurements
from tests.compare.tiny_log import write_tiny_log

VOID = {"meta", "link", "br", "img", "hr", "input"}
PAGES = ["verdict", "replay", "maps", "paths", "consistency", "matching", "variance"]
PAGES += ["quality", "timings", "reading"]


class Page(HTMLParser):
    """Collects what the tests ask about a page, and whether every element is closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.ids: list[str] = []
        self.references: list[str] = []
        self.words: list[str] = []
        self.data: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag not in VOID:
            self.open.append(tag)
        for name, value in attrs:
            if name == "id":
                self.ids.append(value or "")
            if name in ("src", "href", "xlink:href", "action", "data"):
                self.references.append(value or "")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] == "script":
            self.data.append(data)
        elif self.open and self.open[-1] != "style":
            self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    folder = tmp_path_factory.mktemp("report")
    return run_log(write_tiny_log(folder / "log"), folder / "out")


@pytest.fixture(scope="module")
def record(result: RunResult) -> Record:
    return Record.load(result.folder)


@pytest.fixture(scope="module")
def page(result: RunResult) -> Page:
    return Page((result.folder / "report.html").read_text())


def test_the_report_is_well_formed_and_has_every_page(page: Page) -> None:
    assert page.open == []
    assert [i for i in page.ids if i in PAGES] == PAGES
    assert len(set(page.ids)) == len(page.ids)


def test_the_page_needs_nothing_from_elsewhere(result: RunResult, page: Page) -> None:
    assert page.references
    assert all(reference.startswith("#") for reference in page.references)
    assert not {"link", "img", "iframe", "object"} & set(page.tags)
    html = (result.folder / "report.html").read_text()
    assert "@import" not in html
    assert all(target.startswith("#") for target in re.findall(r"url\(['\"]?(.)", html))
    assert "default-src 'none'" in html
    assert not re.search(r"fetch\(|XMLHttpRequest|https?://(?!www\.w3\.org/)", html)


def test_only_the_script_of_the_report_may_run(page: Page, result: RunResult) -> None:
    data, script = page.data
    html = (result.folder / "report.html").read_text()
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert re.findall(r"script-src ([^;\"]*)", html) == [f"'sha256-{digest}'"]
    assert json.loads(data)["nodes"] == 60


def test_every_reference_within_the_page_has_its_target(result: RunResult, page: Page) -> None:
    html = (result.folder / "report.html").read_text()
    targets = {r[1:] for r in page.references} - {"all"} | set(re.findall(r"url\(#([^)]+)\)", html))
    assert targets <= set(page.ids)


def test_the_page_says_the_figures_and_the_verdict(result: RunResult, page: Page) -> None:
    metrics = json.loads((result.folder / "metrics.json").read_text())
    for sentence in metrics["verdict"]:
        assert " ".join(sentence.split()) in page.text
    for figures in metrics["methods"].values():
        assert number(1e3 * figures["trajectory"]["rmse_m"]) in page.text
    assert "60" in page.text
    assert f"{result.measurements.sighting_count}" in page.text
    assert "95%" in page.text


def test_strings_of_the_log_are_escaped(record: Record, tmp_path: Path) -> None:
    evil = "<script>alert(1)</script>"
    info = json.loads(json.dumps(dict(record.info)))
    info["log"]["name"] = evil
    info["warnings"] = [f"{evil} & co"]
    info["rejected"] = {evil: 3}
    write_report(replace(record, info=info), tmp_path)
    html = (tmp_path / "report.html").read_text()
    assert "<script>alert" not in html
    assert html.count("<script") == 2
    assert f"{evil} & co" in Page(html).text


def test_writing_it_again_from_the_folder_gives_the_same_bytes(
    result: RunResult, tmp_path: Path
) -> None:
    folder = shutil.copytree(result.folder, tmp_path / "moved")
    before = {p.name: p.read_bytes() for p in (folder / "plots").iterdir()}
    block = re.compile(rb"<!-- timings -->.*?<!-- /timings -->", re.DOTALL)
    html = block.sub(b"", (folder / "report.html").read_bytes())
    shutil.rmtree(folder / "plots")
    (folder / "report.html").unlink()
    assert rebuild_report(folder) == folder / "report.html"
    assert block.sub(b"", (folder / "report.html").read_bytes()) == html
    assert {p.name: p.read_bytes() for p in (folder / "plots").iterdir()} == before


@pytest.mark.parametrize("name", ["metrics.json", "truth.npz", "ekf/estimate.npz"])
def test_a_folder_with_a_missing_or_damaged_file_is_an_error_that_names_it(
    result: RunResult, tmp_path: Path, name: str
) -> None:
    folder = shutil.copytree(result.folder, tmp_path / "damaged")
    (folder / name).write_bytes(b"\x00 not what a run wrote")
    with pytest.raises(BadMeasurements, match=Path(name).name):
        rebuild_report(folder)
    (folder / name).unlink()
    with pytest.raises(BadMeasurements, match=Path(name).name):
        rebuild_report(folder)


def test_a_folder_that_no_run_wrote_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadConfig, match=r"run\.json"):
        rebuild_report(tmp_path)


def test_without_truth_the_page_says_so_and_shows_what_the_methods_claim(tmp_path: Path) -> None:
    log = write_tiny_log(tmp_path / "log", truth=False)
    result = run_log(log, tmp_path / "out")
    text = Page((result.folder / "report.html").read_text()).text
    assert "Uncertainty over time" in text
    assert "no true path" in text
    assert "Errors over time" not in text
    assert "differs (mm)" in text


def test_one_method_alone_still_has_a_report(tmp_path: Path) -> None:
    log = write_tiny_log(tmp_path / "log", truth=False)
    result = run_log(log, tmp_path / "out", RunConfig(methods=("odometry",)))
    page = Page((result.folder / "report.html").read_text())
    assert page.open == []
    assert "maps" in page.ids
    assert "nothing was matched" in page.text
    assert "identifications" not in page.text


def test_plots_are_well_formed_undated_and_carry_what_they_show_as_text(result: RunResult) -> None:
    plots = sorted((result.folder / "plots").glob("*.svg"))
    names = ["errors", "floor-plan", "line-variance", "map-errors", "matches", "nees"]
    names += ["nis-along-the-way", "nis", "sightings", "variance"]
    assert [p.stem for p in plots] == names
    for path in plots:
        text = path.read_text()
        root = ElementTree.fromstring(text)
        assert root.tag.endswith("svg")
        assert root.get("aria-label")
        assert "dc:date" not in text
        assert "currentColor" in text
    plan = (result.folder / "plots" / "floor-plan.svg").read_text()
    for word in ("truth", "odometry", "ekf", "smoother", "start", "x (m)"):
        assert f">{word}</text>" in plan


def test_every_plot_has_its_numbers_beside_it_with_their_units(
    result: RunResult, record: Record
) -> None:
    for path in (result.folder / "plots").glob("*.svg"):
        with path.with_suffix(".csv").open(newline="") as stream:
            rows = list(csv.DictReader(stream))
        assert len(rows) > 5, path
        names = {
            n for n in rows[0] if n.startswith(("t_", "x", "y", "ekf_", "odometry_", "true_p"))
        }
        assert all(re.search(r"_(s|m|m2|mm|mm2|deg|deg2|node|nis|dof)$", name) for name in names), (
            path
        )
    with (result.folder / "plots" / "variance.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    cov = record.estimates["ekf"].cov_floor
    assert [float(row["ekf_variance_y_m2"]) for row in rows] == pytest.approx(cov[:, 1, 1])
    heading = np.degrees(np.degrees(cov[:, 2, 2]))
    assert [float(row["ekf_variance_heading_deg2"]) for row in rows] == pytest.approx(heading)


def test_nees_over_time_averages_to_the_figure_in_metrics(record: Record) -> None:
    for name in record.estimates:
        nees = record.pose_nees(name)
        assert np.isnan(nees[0])
        figure = record.metrics["methods"][name]["pose_nees"]
        assert float(np.mean(nees[1:])) == pytest.approx(figure, rel=1e-6)


def test_shares_of_nodes_by_number_of_lines_add_up(record: Record) -> None:
    table = lines_per_node(record)
    assert table["columns"] == ["seen", "used by ekf", "used by smoother"]
    shares = [[float(row["cells"][i].rstrip("%")) for row in table["rows"]] for i in range(3)]
    assert [sum(column) for column in shares] == pytest.approx([100.0] * 3, abs=0.3)
    count = record.measurements.sighting_count / len(record.measurements.t)
    assert float(table["mean"][0]) == pytest.approx(count, abs=0.005)


def test_worst_residuals_come_worst_first_with_their_node(record: Record) -> None:
    table = worst_residuals(record)
    assert table is not None
    rows = [row for row in table["rows"] if row["method"] == "ekf"]
    nis = np.sort(record.estimates["ekf"].nis)
    nis = nis[np.isfinite(nis)][::-1]
    assert [row["nis"] for row in rows] == [number(float(v)) for v in nis[: len(rows)]]
    sightings = record.measurements.sightings["line"]
    assert [row["node"] for row in rows] == sightings.node[[r["sighting"] for r in rows]].tolist()


def test_true_poses_begin_at_the_start_and_errors_wrap(record: Record) -> None:
    assert np.allclose(record.true_pose[0], record.measurements.start_pose, atol=1e-9)
    for name in record.estimates:
        error = record.pose_error(name)
        assert np.abs(error[:, 2]).max() <= np.pi
        rmse = record.metrics["methods"][name]["trajectory"]["rmse_m"]
        assert np.sqrt(np.mean(error[:, 0] ** 2 + error[:, 1] ** 2)) == pytest.approx(rmse)


def test_true_lines_are_drawn_in_the_frame_of_the_true_path(record: Record) -> None:
    table = record.measurements.sightings["line"]
    rho, alpha = record.true_lines.T
    pose = record.true_pose[table.node]
    row = table.truth
    distance = rho[row] - pose[:, 0] * np.cos(alpha[row]) - pose[:, 1] * np.sin(alpha[row])
    assert np.abs(np.abs(distance) - np.abs(table.z[:, 0])).max() < 0.05


def test_match_counts_add_up_to_the_used_sightings(record: Record) -> None:
    for name in ("ekf", "smoother"):
        estimate, counts = record.estimates[name], record.match_counts(name)
        assert counts.shape == (len(estimate.map), 3)
        assert counts.sum() == np.sum(estimate.used & (estimate.match >= 0))
        assert counts[:, 0].sum() == record.metrics["methods"][name]["matching"]["correct"]


def test_a_wrong_match_is_counted_and_drawn(record: Record) -> None:
    landmark = record.truth.landmark.copy()
    chosen = np.flatnonzero(record.estimates["ekf"].match == 0)[:2]
    landmark[chosen] = [99, -1]
    wrong = replace(record, truth=replace(record.truth, landmark=landmark))
    before, after = record.match_counts("ekf")[0], wrong.match_counts("ekf")[0]
    assert (after - before).tolist() == [-2, 1, 1]
    with style():
        plots = [matches_per_landmark(record), matches_per_landmark(wrong)]
    assert plots[0] != plots[1]


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (float("nan"), "–"),
        (0.0, "0"),
        (12, "12"),
        (12345, "12,345"),
        (3.14159, "3.14"),
        (0.0123456, "0.0123"),
        (-31.41, "−31.4"),
        (9.996, "10.0"),
        (999.6, "1,000"),
        (1234.5, "1,234"),
        (1e-9, "0"),
    ],
)
def test_numbers_have_three_significant_digits(value: float | None, text: str) -> None:
    assert number(value) == text


def test_fixed_numbers_have_no_negative_zero() -> None:
    assert fixed(-0.0, 2) == "0.00"
    assert fixed(-0.001, 2) == "0.00"
    assert fixed(-1.005, 1) == "−1.0"


def test_the_best_of_a_row_is_marked_only_where_methods_differ() -> None:
    path = {"rmse_m": 0.1, "final_error_m": 0.2, "heading_rmse_deg": 1.0}
    methods = {"a": {"trajectory": path}, "b": {"trajectory": path | {"rmse_m": 0.05}}}
    rows = summary({"methods": methods})[0]["rows"]
    assert [[cell["best"] for cell in row["cells"]] for row in rows] == [
        [False, True],
        [False, False],
        [False, False],
    ]
    assert [cell["text"] for cell in rows[0]["cells"]] == ["100", "50.0"]


@pytest.mark.parametrize("count", [1, 1500, 1501, 100_000])
def test_long_curves_are_thinned(count: int) -> None:
    assert len(range(0, count, stride(count))) <= MOST_POINTS


@pytest.mark.parametrize(
    ("file", "content"),
    [("metrics.json", "{}"), ("run.json", '{"format": "graphslam-run/1", "methods": ["../x"]}')],
)
def test_a_folder_that_is_not_of_one_run_is_refused_in_words(
    tmp_path: Path, file: str, content: str
) -> None:
    folder = run_log(write_tiny_log(tmp_path / "log"), tmp_path / "out").folder
    (folder / file).write_text(content)
    with pytest.raises(BadMeasurements, match="run it again"):
        Record.load(folder)


def test_an_estimate_of_another_run_is_noticed(tmp_path: Path) -> None:
    one = run_log(write_tiny_log(tmp_path / "a", nodes=60), tmp_path / "one").folder
    other = run_log(write_tiny_log(tmp_path / "b", nodes=40), tmp_path / "other").folder
    (one / "ekf" / "estimate.npz").write_bytes((other / "ekf" / "estimate.npz").read_bytes())
    with pytest.raises(BadMeasurements, match="not of one run"):
        Record.load(one)


def test_every_method_with_a_colour_has_it_on_light_dark_and_printed_pages() -> None:
    style = source("page.html")
    for method, colour in METHOD_COLOURS.items():
        assert style.count(f"--{method}: {colour};") == 2, method
        assert style.count(f"--{method}: ") == 3, method
