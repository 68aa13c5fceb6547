"""Results for other programs: each file is read by one that others wrote, or read back."""

from __future__ import annotations

import csv
import io
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from evo.core import metrics as evo
from evo.core import sync
from evo.tools import file_interface

import compare
from compare.cli import main
from compare.interchange.dxf import layer_name
from compare.interchange.export import export
from compare.interchange.formats import Format
from compare.interchange.latex import escape
from compare.run import RunResult, run_log
from graphslam.errors import BadConfig
from graphslam.estimate import Estimate
from graphslam.geometry import points_on_line
from tests.compare.tiny_log import write_tiny_log

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    log = write_tiny_log(tmp_path_factory.mktemp("logs") / "tiny")
    return run_log(log, tmp_path_factory.mktemp("results") / "tiny")


@pytest.fixture(scope="module")
def estimate(result: RunResult) -> Estimate:
    return result.estimates["smoother"]


def exported(result: RunResult, tmp_path: Path, to: Format, **options: str) -> str:
    """Returns what `export` writes."""
    return export(result.folder, to, tmp_path / "out", **options).read_text()  # type: ignore[arg-type]


@pytest.mark.parametrize("method", ["odometry", "ekf", "smoother"])
def test_evos_errors_of_our_tum_files_are_ours(
    result: RunResult, method: str, tmp_path: Path
) -> None:
    assert result.comparison is not None
    ours = result.comparison[method].trajectory
    assert ours is not None
    export(result.folder, "tum", tmp_path / "truth.tum", method="truth")
    export(result.folder, "tum", tmp_path / "made.tum", method=method)
    pair = [
        file_interface.read_tum_trajectory_file(str(tmp_path / name))
        for name in ("truth.tum", "made.tum")
    ]
    truth, made = sync.associate_trajectories(*pair, max_diff=1e-6)
    assert made.num_poses == ours.nodes
    made.align(truth)
    figures = {}
    for relation in (evo.PoseRelation.translation_part, evo.PoseRelation.rotation_angle_deg):
        ape = evo.APE(relation)
        ape.process_data((truth, made))
        figures[relation] = ape.get_statistic(evo.StatisticsType.rmse)
    position, heading = figures.values()
    assert position == pytest.approx(ours.aligned_rmse_m, rel=1e-9)
    assert heading == pytest.approx(ours.aligned_heading_rmse_deg, rel=1e-9)


def test_a_tum_file_comes_back_as_the_path_it_was(
    result: RunResult, estimate: Estimate, tmp_path: Path
) -> None:
    track = compare.read_tum(export(result.folder, "tum", tmp_path / "path.tum"))
    np.testing.assert_array_equal(track.t, estimate.t)
    np.testing.assert_allclose(track.pose, estimate.pose, atol=1e-12)


def test_a_g2o_file_comes_back_as_the_path_and_map_it_was(
    result: RunResult, estimate: Estimate, tmp_path: Path
) -> None:
    graph = compare.read_g2o(export(result.folder, "g2o", tmp_path / "run.g2o"))
    np.testing.assert_array_equal(graph.pose, estimate.pose)
    np.testing.assert_array_equal(graph.landmarks.params, estimate.map.params)


def test_a_dxf_plan_passes_ezdxfs_audit_and_has_every_line_in_metres(
    result: RunResult, estimate: Estimate, tmp_path: Path
) -> None:
    ezdxf = pytest.importorskip("ezdxf")
    drawing = ezdxf.readfile(export(result.folder, "dxf", tmp_path / "floor.dxf"))
    audit = drawing.audit()
    assert not audit.errors
    assert not audit.fixes
    lines = drawing.modelspace().query('LINE[layer=="SMOOTHER_LINES"]')
    drawn = np.array([[line.dxf.start.vec2, line.dxf.end.vec2] for line in lines])
    wanted = points_on_line(estimate.map.params[:, None], estimate.map.extent)
    np.testing.assert_allclose(drawn, wanted, atol=1e-6)
    [path] = drawing.modelspace().query('POLYLINE[layer=="SMOOTHER_PATH"]')
    np.testing.assert_allclose(
        [point.vec2 for point in path.points()], estimate.pose[:, :2], atol=1e-6
    )


def test_dxf_layers_have_names_that_release_12_allows() -> None:
    assert layer_name("last position 95 %") == "LAST_POSITION_95"
    assert layer_name("ä") == "0"
    assert len(layer_name("x" * 50)) == 31


def test_an_svg_plan_is_in_metres_with_y_up(
    result: RunResult, estimate: Estimate, tmp_path: Path
) -> None:
    root = ElementTree.fromstring(exported(result, tmp_path, "svg", method="smoother"))
    groups = {group.get("id"): group for group in root.iter(f"{SVG}g")}
    [path] = groups["smoother-path"].iter(f"{SVG}polyline")
    drawn = np.array([pair.split(",") for pair in path.get("points", "").split()], float)
    np.testing.assert_allclose(drawn, estimate.pose[:, :2] * [1, -1], atol=1e-4)
    x, y, width, height = map(float, root.get("viewBox", "").split())
    inside = (drawn >= [x, y]) & (drawn <= [x + width, y + height])
    assert inside.all()


def test_csv_and_json_figures_are_those_of_metrics_json(result: RunResult, tmp_path: Path) -> None:
    metrics = json.loads((result.folder / "metrics.json").read_text())["methods"]
    rows = list(csv.DictReader(io.StringIO(exported(result, tmp_path, "csv"))))
    columns = json.loads(exported(result, tmp_path, "json"))["columns"]
    assert [row["method"] for row in rows] == columns["method"] == list(metrics)
    for i, (name, entry) in enumerate(metrics.items()):
        wanted = entry["trajectory"]["aligned_rmse_m"]
        assert float(rows[i]["trajectory.aligned_rmse_m"]) == wanted
        assert columns["trajectory.aligned_rmse_m"][i] == wanted
        assert (rows[i]["map.rho_rmse_m"] == "") == (name == "odometry")


@pytest.mark.parametrize(("table", "file"), [("map", "map.csv"), ("path", "trajectory.csv")])
def test_csv_tables_of_one_method_are_the_runs_own(
    result: RunResult, tmp_path: Path, table: str, file: str
) -> None:
    text = exported(result, tmp_path, "csv", table=table, method="ekf")
    assert text == (result.folder / "ekf" / file).read_text()


def test_a_json_map_has_the_joint_covariance(
    result: RunResult, estimate: Estimate, tmp_path: Path
) -> None:
    content = json.loads(exported(result, tmp_path, "json", table="map"))
    np.testing.assert_array_equal(content["cov"], estimate.cov_joint[3:, 3:])
    np.testing.assert_array_equal(content["columns"]["rho"], estimate.map.params[:, 0])


@pytest.mark.parametrize("table", ["figures", "map"])
def test_latex_tables_have_as_many_cells_in_every_row_and_close_what_they_open(
    result: RunResult, tmp_path: Path, table: str
) -> None:
    text = exported(result, tmp_path, "latex", table=table)
    [columns] = re.findall(r"\\begin\{tabular\}\{(\w+)\}", text)
    rows = [line for line in text.splitlines() if line.endswith(r"\\")]
    single = [row for row in rows if r"\multicolumn" not in row]
    assert len(single) >= 8
    assert {row.count(" & ") + 1 for row in single} == {len(columns)}
    assert re.findall(r"\\begin\{(\w+)\}", text) == re.findall(r"\\end\{(\w+)\}", text)[::-1]
    assert text.count("{") == text.count("}")
    assert text.isascii()


def test_latex_prints_special_characters_as_they_stand() -> None:
    assert escape("50 % of a_b & 3 °") == r"50 \% of a\_b \& 3 $^\circ$"


def test_a_methods_folder_stands_for_its_method(result: RunResult, tmp_path: Path) -> None:
    there = export(result.folder / "ekf", "tum", tmp_path / "a.tum").read_bytes()
    assert there == (result.folder / "ekf" / "trajectory.tum").read_bytes()


@pytest.mark.parametrize("to", ["tum", "g2o", "dxf", "svg", "latex", "csv", "json"])
def test_equal_results_give_equal_bytes(result: RunResult, tmp_path: Path, to: Format) -> None:
    first = export(result.folder, to, tmp_path / "first").read_bytes()
    assert export(result.folder, to, tmp_path / "second").read_bytes() == first


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--to", "latex", "--table", "path"], "no printed table holds"),
        (["--to", "g2o", "--method", "truth"], "the run has no method 'truth'"),
        (["--to", "tum", "--method", "best"], "it has odometry, ekf, smoother"),
    ],
)
def test_what_cannot_be_exported_is_said_and_nothing_is_written(
    result: RunResult,
    options: list[str],
    message: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "out"
    assert main(["export", str(result.folder), *options, "--out", str(out)]) == 1
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_the_command_writes_the_file_and_prints_where(
    result: RunResult, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "floor.dxf"
    assert main(["export", str(result.folder), "--to", "dxf", "--out", str(out)]) == 0
    assert capsys.readouterr().out.strip() == str(out)
    assert out.is_file()


def test_a_folder_is_no_file_to_write(result: RunResult, tmp_path: Path) -> None:
    with pytest.raises(BadConfig, match="is a folder; give the file to write"):
        export(result.folder, "tum", tmp_path)
    assert not list(tmp_path.iterdir())


def test_folders_on_the_way_to_the_file_are_made(result: RunResult, tmp_path: Path) -> None:
    assert export(result.folder, "tum", tmp_path / "a" / "b" / "path.tum").is_file()


def test_a_folder_that_is_no_result_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadConfig, match="give a folder that `run` wrote"):
        export(tmp_path, "tum", tmp_path / "out")


# ---- notebooks ----------------------------------------------------------------------------------


class Balanced(HTMLParser):
    """Checks that every element is closed, and counts them."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.count: dict[str, int] = {}
        self.feed(html)
        assert not self.open

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.open.append(tag)
        self.count[tag] = self.count.get(tag, 0) + 1

    def handle_startendtag(self, tag: str, attrs: object) -> None:
        self.count[tag] = self.count.get(tag, 0) + 1

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_estimate_comparison_and_result_show_a_table_and_a_picture(result: RunResult) -> None:
    loaded = compare.load_result(result.folder)
    for shown in (*result.estimates.values(), result.comparison, result, loaded):
        found = Balanced(shown._repr_html_())  # type: ignore[union-attr]
        assert found.count["table"] == 1
        assert found.count["svg"] == 1


def test_a_result_loaded_in_one_line_shows_what_the_run_showed(result: RunResult) -> None:
    assert compare.load_result(str(result.folder))._repr_html_() == result._repr_html_()


def test_names_cannot_smuggle_markup_into_a_notebook(estimate: Estimate) -> None:
    html = replace(estimate, method="<script>")._repr_html_()
    assert "<script>" not in html


# ---- the page -----------------------------------------------------------------------------------


def test_the_pages_python_runs_and_its_commands_are_ours(
    result: RunResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = (Path(__file__).parents[2] / "docs" / "interchange.md").read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "results").mkdir()
    for name in ("sample", "my-log"):
        (tmp_path / "results" / name).symlink_to(result.folder)
    for language, text in re.findall(r"```(\w+)\n(.*?)```", page, re.DOTALL):
        if language == "python":
            names: dict[str, Estimate] = {}
            exec(compile(text, "snippet", "exec"), names)
        for command in text.splitlines() if language == "sh" else []:
            assert main(command.split()[1:]) == 0
    np.testing.assert_allclose(names["smoothed"].pose, result.estimates["smoother"].pose, atol=1e-6)
