"""Maps from files: what is read is what was written, and what cannot be used is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from compare.interchange.g2o_write import g2o_text
from compare.map_files import read_map, read_map_file
from compare.results import map_columns, write_csv
from graphslam.ekf import run_ekf
from graphslam.errors import BadConfig, BadLog
from graphslam.estimate import Estimate
from graphslam.geometry import twin
from tests.worlds import drive

COLUMNS = "line,rho,alpha,cov_rr,cov_ra,cov_aa,s_min,s_max,sightings"


@pytest.fixture(scope="module")
def estimate() -> Estimate:
    measurements, _ = drive(2, 100)
    return run_ekf(measurements)


def map_file(tmp_path: Path, *rows: str, columns: str = COLUMNS) -> Path:
    path = tmp_path / "map.csv"
    path.write_text("\n".join([columns, *rows]) + "\n")
    return path


def test_a_runs_map_comes_back_exactly_with_each_lines_covariance(
    estimate: Estimate, tmp_path: Path
) -> None:
    write_csv(tmp_path / "map.csv", map_columns(estimate))
    read = read_map_file(tmp_path / "map.csv")
    for name in ("id", "params", "extent", "sightings"):
        np.testing.assert_array_equal(getattr(read.landmarks, name), getattr(estimate.map, name))
    for line in range(len(estimate.map)):
        np.testing.assert_array_equal(read.landmark_cov(line), estimate.landmark_cov(line))
    assert read.known_cov
    assert not read.joint
    assert read.cov[0, 2] == 0.0


def test_an_estimate_gives_the_joint_covariance(estimate: Estimate, tmp_path: Path) -> None:
    estimate.save(tmp_path / "estimate.npz")
    for path in (tmp_path, tmp_path / "estimate.npz"):
        read = read_map_file(path)
        assert read.joint
        np.testing.assert_array_equal(read.cov, estimate.cov_joint[3:, 3:])


def test_a_g2o_graph_gives_its_lines_without_covariance(tmp_path: Path) -> None:
    measurements, _ = drive(2, 100)
    estimate = run_ekf(measurements)
    (tmp_path / "a.g2o").write_text(g2o_text(measurements, estimate))
    read = read_map_file(tmp_path / "a.g2o")
    np.testing.assert_array_equal(read.landmarks.params, estimate.map.params)
    assert not read.known_cov


def test_a_line_under_its_twins_name_is_the_same_line(tmp_path: Path) -> None:
    there = twin(np.array([1.5, 0.3]))
    rows = (
        "0,1.5,0.3,4e-6,1e-6,9e-6,-1,2,7",
        f"1,{there[0]},{there[1]},4e-6,-1e-6,9e-6,-2,1,7",
    )
    read = read_map_file(map_file(tmp_path, *rows))
    np.testing.assert_allclose(read.landmarks.params[1], read.landmarks.params[0], rtol=1e-12)
    np.testing.assert_allclose(read.landmarks.extent[1], read.landmarks.extent[0])
    np.testing.assert_allclose(read.landmark_cov(1), read.landmark_cov(0))


def test_empty_covariances_are_unknown_and_zeros_are_exact(tmp_path: Path) -> None:
    read = read_map_file(map_file(tmp_path, "0,1,0,,,,,,0", "1,2,0,0,0,0,,,0", "2,3,0,1,0,1,,,0"))
    assert np.isnan(read.landmark_cov(0)).all()
    np.testing.assert_array_equal(read.landmark_cov(1), np.zeros((2, 2)))
    np.testing.assert_array_equal(read.landmark_cov(2), np.eye(2))
    assert np.isnan(read.cov[0:2]).all()
    assert not read.known_cov


def test_a_log_folders_map_needs_no_covariance_columns(tmp_path: Path) -> None:
    map_file(tmp_path, "4,1,0.5", columns="line,rho,alpha")
    assert read_map(tmp_path).id.tolist() == [4]


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("0,1,0,1,0,,,,0", "map.csv:2: has some of cov_rr"),
        ("0,1,0,1,2,1,,,0", "map.csv:2: cov_rr = 1, cov_ra = 2, cov_aa = 1 is no covariance"),
        ("0,1,0,0,0,1,,,0", "map.csv:2: cov_rr = 0, .* is no covariance"),
        ("0,1,0,1,0,1,,,-1", "map.csv:2: sightings = -1 is negative"),
        ("0,1,0,1,0,1,,3,1", "map.csv:2: has one of s_min and s_max"),
        ("0,1,90,1,0,1,,,1", "map.csv:2: alpha = 90 is beyond two full turns; write radians"),
    ],
)
def test_what_cannot_be_used_is_named_with_its_line(tmp_path: Path, row: str, message: str) -> None:
    with pytest.raises(BadLog, match=message):
        read_map_file(map_file(tmp_path, row))


def test_a_run_of_several_methods_asks_which(estimate: Estimate, tmp_path: Path) -> None:
    for method in ("ekf", "smoother"):
        (tmp_path / method).mkdir()
        estimate.save(tmp_path / method / "estimate.npz")
    with pytest.raises(BadConfig, match=r"name one of its maps: .*ekf, .*smoother"):
        read_map_file(tmp_path)


def test_a_folder_without_a_map_says_what_to_give(tmp_path: Path) -> None:
    with pytest.raises(BadConfig, match=r"holds no map\.csv; give"):
        read_map_file(tmp_path)
