"""Simulated ceilings: rendered and as sightings, through the front-end back to what was true."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from frontend.config import ExtractConfig
from frontend.extract import extract
from frontend.lamp_config import LampConfig
from frontend.log import Log, open_log
from frontend.simulate import Scenario, load_scenario, simulate, simulate_log
from frontend.simulate.scenario import Motion
from graphslam.errors import BadConfig
from graphslam.geometry import Array, interpolate_poses
from graphslam.measurements import Measurements, Sightings
from graphslam.models.lamp import LAMP

FULL = load_scenario("four-lamps")
assert FULL.ceiling is not None
SIZED = ExtractConfig(lamps=LampConfig(size_m=FULL.ceiling.size))


def short(forward: float = 2.5, **camera: object) -> Scenario:
    """Returns the first metres of the corridor, seen five times a second."""
    assert FULL.ceiling is not None
    seen = replace(FULL.ceiling.camera, rate=5.0, **camera)  # type: ignore[arg-type]
    return replace(
        FULL, path=(Motion(forward=forward),), ceiling=replace(FULL.ceiling, camera=seen)
    )


def errors(log: Log, measurements: Measurements) -> tuple[Sightings, Array]:
    """Returns the lamps seen, and how far each is from the true one, whichever that is."""
    table = measurements.sightings["lamp"]
    assert log.truth is not None
    assert log.landmarks is not None
    pose = interpolate_poses(measurements.t, log.truth.t, log.truth.pose)[table.node]
    e, _, _ = LAMP.residual(pose, log.landmarks.params[table.truth], table.z)
    return table, e


def nees(table: Sightings, e: Array) -> float:
    return float(np.einsum("ki,kij,kj->k", e, np.linalg.inv(table.cov), e).mean() / 3.0)


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Log:
    return open_log(simulate(short(), tmp_path_factory.mktemp("ceiling") / "log", seed=1))


def test_rendered_lamps_are_found_where_they_are(rendered: Log) -> None:
    measurements = extract(rendered, SIZED)
    table, e = errors(rendered, measurements)
    assert rendered.warnings == ()
    assert len(measurements.t) == len(rendered.images.t)  # type: ignore[union-attr]
    assert len(table) >= 12
    assert np.all(table.truth == 0)
    assert np.all(np.abs(e) < [0.01, 0.01, np.radians(1.0)])
    assert nees(table, e) < 2.0
    assert table.t_received == pytest.approx(measurements.t[table.node] + 0.1)
    assert set(table.source.tolist()) <= set(range(len(measurements.t)))
    assert (table.quality < 1.0).any()  # some were cut, and completed
    assert (table.quality == 1.0).any()


def test_lamps_of_unknown_size_are_found_whole_and_the_cut_ones_told(rendered: Log) -> None:
    from frontend.extract import extraction_warnings

    measurements = extract(rendered)
    assert (
        5 <= len(measurements.sightings["lamp"]) < len(extract(rendered, SIZED).sightings["lamp"])
    )
    assert any(
        "--extract.lamps.size-m" in text for text in extraction_warnings(rendered, measurements)
    )


def test_a_fisheye_sees_the_same_lamps(tmp_path: Path) -> None:
    assert FULL.ceiling is not None
    matrix = ((300.0, 0.0, 175.5), (0.0, 300.0, 143.5), (0.0, 0.0, 1.0))
    lens = short(1.5, matrix=matrix, distortion=(0.05, -0.01, 0.0, 0.0), lens="fisheye")
    log = open_log(simulate(lens, tmp_path / "log", seed=2))
    table, e = errors(log, extract(log, SIZED))
    assert len(table) >= 6
    assert np.all(np.abs(e) < [0.012, 0.012, np.radians(1.0)])


def test_black_images_and_dark_lamps_show_nothing(tmp_path: Path) -> None:
    assert FULL.ceiling is not None
    black = simulate(short(0.5, black_rate=1.0), tmp_path / "black", seed=1)
    assert len(extract(open_log(black), SIZED).sightings["lamp"]) == 0
    out_of_order = tuple(replace(lamp, dark=True) for lamp in FULL.ceiling.lamps)
    dark = replace(short(), ceiling=replace(short().ceiling, lamps=out_of_order))  # type: ignore[type-var]
    assert len(simulate_log(dark).lamps.t) == 0  # type: ignore[union-attr]


def test_half_of_three_hundred_frames_show_no_lamp_and_none_shows_the_dark_one() -> None:
    log = simulate_log(FULL, seed=3)
    assert log.lamps is not None
    frames = round(30.0 * 10.0)
    assert 0.45 * frames <= len(np.unique(log.lamps.t)) <= 0.55 * frames
    assert set(log.lamps.truth.tolist()) == {0, 1, 3, 4}
    assert log.lamps.t_received == pytest.approx(log.lamps.t + 0.1)


def test_the_noise_that_is_drawn_is_the_noise_that_is_stated() -> None:
    figures = []
    for seed in range(6):
        log = simulate_log(FULL, seed)
        figures.append(nees(*errors(log, extract(log))))
    assert np.mean(figures) == pytest.approx(1.0, abs=0.12)


def test_a_simulated_log_reads_as_it_was_written(tmp_path: Path) -> None:
    inside = simulate_log(FULL, seed=5)
    outside = open_log(simulate(FULL, tmp_path / "log", seed=5, images=False))
    a, b = extract(inside), extract(outside)
    assert np.array_equal(a.sightings["lamp"].z, b.sightings["lamp"].z)
    assert np.array_equal(a.sightings["lamp"].cov, b.sightings["lamp"].cov)
    assert np.array_equal(a.sightings["lamp"].truth, b.sightings["lamp"].truth)
    assert a.known is not None
    assert b.known is not None
    assert np.array_equal(a.known.params, b.known.params)


def test_a_scenario_looks_at_floor_or_ceiling_not_both() -> None:
    with pytest.raises(BadConfig, match="floor or at the ceiling"):
        replace(load_scenario("grid"), ceiling=FULL.ceiling)


def test_overlays_show_each_image_of_the_ceiling(rendered: Log, tmp_path: Path) -> None:
    from frontend.overlay_frames import write_overlays

    measurements = extract(rendered, SIZED)
    assert write_overlays(rendered, measurements, tmp_path / "pictures") == len(measurements.t)
    number = int(measurements.sightings["lamp"].source[0])
    shown = cv2.imread(str(tmp_path / "pictures" / f"{number:06d}.jpg"))
    assert np.any(shown[..., 2].astype(int) - shown[..., 0] > 100)  # an axis, in colour
