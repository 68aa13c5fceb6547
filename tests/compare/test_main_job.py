"""The main job on real wheels over a real floor, and on the rendered experiment of the paper."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from compare import compare
from compare.comparison import Comparison
from frontend.config import ExtractConfig, NoiseConfig
from frontend.extract import extract
from frontend.log import open_log
from frontend.simulate import load_scenario, simulate
from graphslam.baseline import dead_reckoning
from graphslam.ekf import run_ekf
from graphslam.smoother import smooth


def main_job(folder: Path, sigmas: float = 1.0) -> Comparison:
    """Returns the comparison of a log, every default standard deviation scaled by ``sigmas``."""
    log = open_log(folder)
    drive = replace(
        log.robot,
        noise_left=sigmas * log.robot.noise_left,
        noise_right=sigmas * log.robot.noise_right,
        slip=tuple(sigmas * s for s in log.robot.slip),
    )
    log = replace(log, robot=drive)
    noise = NoiseConfig(rho_factor=sigmas, alpha_factor=sigmas)
    measurements = extract(log, ExtractConfig(noise=noise))
    filtered = run_ekf(measurements)
    smoothed = smooth(measurements, filtered)
    return compare(log, measurements, [dead_reckoning(measurements), filtered, smoothed])


@pytest.mark.parametrize("name", ["square", "free"])
def test_real_wheels_over_a_real_floor(shared_data: Path, name: str) -> None:
    methods = main_job(shared_data / "logs" / name).to_dict()["methods"]
    drift = methods["odometry"]["trajectory"]["aligned_rmse_m"]
    assert drift == pytest.approx({"square": 0.007, "free": 0.072}[name], rel=0.1)
    for method in ("ekf", "smoother"):
        path, found = methods[method]["trajectory"], methods[method]["map"]
        assert path["aligned_rmse_m"] <= 0.010
        assert found["rho_rmse_m"] <= 0.008
        assert found["alpha_rmse_deg"] <= 0.5
        assert (found["true_lines_seen"], found["matched"]) == (12, 12)
        assert found["missed"] == found["spurious"] == found["duplicates"] == 0


@pytest.mark.parametrize("sigmas", [0.5, 2.0])
@pytest.mark.parametrize("name", ["square", "free"])
def test_the_line_count_survives_wrong_sigmas(shared_data: Path, name: str, sigmas: float) -> None:
    found = main_job(shared_data / "logs" / name, sigmas).to_dict()["methods"]["smoother"]["map"]
    assert found["matched"] == 12
    assert found["missed"] == found["spurious"] == found["duplicates"] == 0


@pytest.fixture(scope="module")
def santana_runs(tmp_path_factory: pytest.TempPathFactory) -> list[dict]:
    folder = tmp_path_factory.mktemp("santana")
    scenario = load_scenario("santana-slam")
    logs = [simulate(scenario, folder / str(seed), seed) for seed in range(5)]
    return [main_job(log).to_dict()["methods"] for log in logs]


@pytest.mark.parametrize("method", ["ekf", "smoother"])
def test_santana_slams_six_lines_are_mapped_once_each(santana_runs: list, method: str) -> None:
    for methods in santana_runs:
        found = methods[method]["map"]
        assert (found["true_lines_seen"], found["matched"]) == (6, 6)
        assert found["missed"] == found["spurious"] == found["duplicates"] == 0
        assert found["rho_rmse_m"] <= 0.008  # the paper: 26 mm
        assert methods[method]["matching"]["right_share"] >= 0.99  # the paper: 93.8 %


@pytest.mark.parametrize("method", ["ekf", "smoother"])
def test_santana_slams_directions_are_within_half_a_degree(santana_runs: list, method: str) -> None:
    """In the median; a run's own figure is what its odometry does while no line is in view."""
    found = [methods[method]["map"]["alpha_rmse_deg"] for methods in santana_runs]
    assert np.median(found) <= 0.5  # the paper: 2.1 degrees
    assert max(found) <= 1.2
