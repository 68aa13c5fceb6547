"""An offset between the clocks of camera and wheels: found, applied, and what the map gains."""

from __future__ import annotations

import json
import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from compare.cli import main
from compare.config import RunConfig
from compare.opening import open_as
from compare.run import run_opened
from compare.time_offset import estimate_time_offset, velocity_at
from frontend.log import Log, open_log, with_camera_offset
from frontend.log_parts import Wheels
from frontend.simulate import load_scenario, simulate_log
from graphslam.errors import BadLog
from tests.compare.tiny_log import write_tiny_log

ROOT = Path(__file__).resolve().parents[2]
PUT_IN_S = 0.08


@pytest.fixture(scope="module")
def late() -> Log:
    """The bundled sample, its images stamped 80 ms too early."""
    log = open_log(ROOT / "data" / "sample")
    return replace(with_camera_offset(log, -PUT_IN_S), offset_s=0.0)


def log_with_wheels(t: np.ndarray, angle: np.ndarray) -> Log:
    return replace(simulate_log(load_scenario("grid")), wheels=Wheels(t, angle))


def map_error(folder: Path, method: str) -> float:
    metrics = json.loads((folder / "metrics.json").read_text())
    return float(metrics["methods"][method]["map"]["rho_rmse_m"])


def test_80_ms_are_found_within_5_and_the_map_is_better_with_them(late: Log, tmp_path: Path):
    found = estimate_time_offset(late)
    assert abs(found.offset_s - PUT_IN_S) < 0.005
    assert 0.0 < found.sigma_s < 0.003
    assert abs(found.offset_s - PUT_IN_S) < 3 * found.sigma_s
    assert found.cost < 0.5 * found.cost_at_zero
    config = RunConfig(methods=("ekf", "smoother"))
    right = replace(config, extract=replace(config.extract, camera_offset_s=found.offset_s))
    run_opened(late, tmp_path / "without", config, report=False)
    run_opened(late, tmp_path / "with", right, report=False)
    for method in ("ekf", "smoother"):
        before, after = (map_error(tmp_path / name, method) for name in ("without", "with"))
        print(f"{method}: map RMSE {1e3 * before:.2f} mm without, {1e3 * after:.2f} mm with")
        assert after < 0.5 * before


@pytest.mark.parametrize(
    ("seed", "offsets"), [(0, (0.0, PUT_IN_S, -0.05)), (2, (PUT_IN_S,)), (3, (-0.05,))]
)
def test_what_is_found_does_not_depend_on_how_late_the_images_are(
    seed: int, offsets: tuple[float, ...]
):
    """Within 5 ms, as sure as it says, and alike for all to a tenth of a millisecond."""
    log = simulate_log(load_scenario("sample"), seed)
    errors = []
    for put_in in offsets:
        shifted = replace(with_camera_offset(log, -put_in), offset_s=0.0)
        found = estimate_time_offset(shifted)
        errors.append(found.offset_s - put_in)
        assert abs(errors[-1]) < 0.005
        assert abs(errors[-1]) < 3 * found.sigma_s
        assert found.sigma_s < 0.005
    assert np.ptp(errors) < 1e-4


def test_the_velocity_is_that_of_the_arc():
    t = np.arange(0.0, 10.0, 0.05)
    turning = np.column_stack([2.0 * t, 3.0 * t])
    log = log_with_wheels(t, turning)
    assert log.robot is not None
    left, right = 2.0 * log.robot.wheel_radius_left, 3.0 * log.robot.wheel_radius_right
    expected = [0.5 * (left + right), 0.0, (right - left) / log.robot.wheel_base]
    velocity = velocity_at(log, np.array([1.0, 4.321, 9.0]))
    np.testing.assert_allclose(velocity, np.tile(expected, (3, 1)), atol=2e-6)


def test_the_command_writes_settings_that_run_takes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    write_tiny_log(tmp_path / "log", nodes=150)
    assert main(["calibrate", "log", "--time-offset", "--out", "clock.toml"]) == 0
    told = capsys.readouterr().out
    number = re.search(r"camera_offset = (\S+)", told)
    assert number is not None
    written = tomllib.loads(Path("clock.toml").read_text())["extract"]["camera_offset_s"]
    assert written == pytest.approx(float(number[1]), abs=1e-4)
    assert main(["extract", "log", "--out", "a", "--config", "clock.toml"]) == 0
    log = open_as(
        "log", replace(RunConfig(), extract=replace(RunConfig().extract, camera_offset_s=written))
    )
    assert log.sightings is not None
    plain = open_log("log").sightings
    assert plain is not None
    np.testing.assert_allclose(log.sightings.t - plain.t, written, atol=1e-12)


def test_a_log_that_shows_no_lines_says_that_nothing_tells_the_clock(tmp_path: Path):
    folder = write_tiny_log(tmp_path / "log")
    (folder / "sightings.csv").unlink()
    (folder / "tags.csv").write_text("t,x,y,theta\n1,0,0,0\n")
    with pytest.raises(BadLog, match="no line is seen, so nothing tells the camera's clock"):
        estimate_time_offset(open_log(folder))


def test_usage_is_told(capsys: pytest.CaptureFixture[str]):
    assert main(["calibrate", "--time-offset"]) == 2
    assert "LOG goes with --noise, --time-offset or --bearings" in capsys.readouterr().err
