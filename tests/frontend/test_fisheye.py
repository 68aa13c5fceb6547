"""A whole drive through a fisheye lens of over 100 degrees: rendered, read, extracted, smoothed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from compare import compare
from frontend.camera import Camera
from frontend.config import ExtractConfig
from frontend.extract import extract
from frontend.log import Log, open_log
from frontend.simulate import load_scenario, simulate
from frontend.simulate.scenario import Motion
from frontend.simulate.sensors import CameraSpec
from graphslam.ekf import run_ekf
from graphslam.measurements import Measurements
from graphslam.smoother import smooth
from tests.frontend.floors import pinhole

FISHEYE = pinhole((320, 240), 170.0, (0.08, -0.02, 0.01, -0.003), "fisheye")


def rows(matrix: np.ndarray) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, matrix.tolist()))


def drive_through(camera: Camera, folder: Path) -> Log:
    """A lap of 12 m on the scenario `grid`, seen by a camera."""
    assert camera.matrix is not None
    assert camera.distortion is not None
    scenario = load_scenario("grid")
    spec = CameraSpec(
        camera.image_size,
        4.0,
        homography=rows(camera.homography),
        matrix=rows(camera.matrix),
        distortion=tuple(camera.distortion.tolist()),
        lens="fisheye",
    )
    path = (Motion(forward=3.0), Motion(turn_deg=90.0)) * 4
    return open_log(simulate(replace(scenario, camera=spec, path=path, repeat=1), folder))


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Log:
    return drive_through(FISHEYE, tmp_path_factory.mktemp("fisheye") / "log")


@pytest.fixture(scope="module")
def measurements(log: Log) -> Measurements:
    return extract(log, ExtractConfig(cache=False))


def test_the_lens_survives_the_log_folder(log: Log) -> None:
    camera = log.cameras["floor"]
    assert camera.lens == "fisheye"
    np.testing.assert_allclose(camera.distortion, FISHEYE.distortion)
    np.testing.assert_allclose(camera.homography, FISHEYE.homography)
    edges = camera.undistort(np.array([[0.0, 120.0], [319.0, 120.0]]))
    assert np.ptp(edges[:, 0]) > 1.3 * 320.0


def test_lines_seen_through_it_are_true(measurements: Measurements) -> None:
    lines = measurements.sightings["line"]
    assert len(lines) > 2 * len(np.unique(lines.node))
    assert np.mean(lines.truth >= 0) > 0.995


def test_path_and_map_come_out_to_millimetres(log: Log, measurements: Measurements) -> None:
    filtered = run_ekf(measurements)
    methods = compare(log, measurements, [filtered, smooth(measurements, filtered)]).to_dict()
    for method in ("ekf", "smoother"):
        path, found = (methods["methods"][method][part] for part in ("trajectory", "map"))
        assert path["aligned_rmse_m"] < 0.003
        assert found["rho_rmse_m"] < 0.002
        assert found["alpha_rmse_deg"] < 0.1
        assert found["spurious"] == found["duplicates"] == 0
        # two of the twelve only ever show at the rim, where a pixel is centimetres of floor
        assert found["matched"] >= 10
