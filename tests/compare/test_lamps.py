"""Lamps through filter and smoother: late, known, mapped, and as the only hint of the start."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.lamp_starts import building, run_case
from benchmarks.lamps import at_speed, covariance_along, difference, maps, path_rmse
from frontend.extract import extract
from frontend.log import open_log
from frontend.simulate import load_scenario, simulate, simulate_log
from frontend.simulate.scenario import Motion
from graphslam import run_ekf
from graphslam.late import run_naive

SCENARIO = load_scenario("four-lamps")


@pytest.mark.parametrize("speed", [0.5, 1.0])
def test_late_lamps_count_as_if_in_time_and_unheeded_delays_cost(speed: float) -> None:
    for seed in range(2):
        log = simulate_log(at_speed(SCENARIO, speed), seed)
        measurements = extract(log)
        assert difference(measurements) <= 1e-9
        heeded, naive = (path_rmse(log, run(measurements)) for run in (run_ekf, run_naive))
        assert naive > 1.5 * heeded


def test_the_covariance_falls_at_lamps_and_never_in_the_dark(tmp_path: Path) -> None:
    assert SCENARIO.ceiling is not None
    camera = replace(SCENARIO.ceiling.camera, rate=4.0)
    first = replace(
        SCENARIO, path=(Motion(forward=4.8),), ceiling=replace(SCENARIO.ceiling, camera=camera)
    )
    along = covariance_along(open_log(simulate(first, tmp_path / "log", seed=1)))
    falls = along.falls()
    assert len(falls) == 2
    assert max(falls) < 0.5
    assert along.largest_fall_in_the_dark() == 0.0
    assert 0.3 < np.mean(~along.lit) < 0.7


def test_unknown_lamps_are_mapped_once_each_with_honest_covariances() -> None:
    found = list(maps(5))
    assert all(one.once for _, one in found)
    for method in ("ekf", "smoother"):
        rows = [one for name, one in found if name == method]
        assert 0.5 < np.mean([row.map_nees for row in rows]) < 1.7
        assert 0.4 < np.mean([row.pose_nees for row in rows]) < 1.9


def test_starts_are_right_or_left_open() -> None:
    floor = building()
    cases = [case for seed in range(4) if (case := run_case(floor, seed)) is not None]
    assert len(cases) >= 3
    assert all(case.right for case in cases)
    assert any(case.answer.decided for case in cases)
    assert all(case.answer.decided for case in cases if case.allowed)
