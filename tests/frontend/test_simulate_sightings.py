"""Sightings without images: what is in view, the law of the noise, folder and memory alike."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from frontend.extract import extract, extraction_warnings
from frontend.log import Log, open_log
from frontend.simulate import (
    Scenario,
    load_scenario,
    simulate,
    simulate_log,
    simulate_measurements,
)
from frontend.simulate.drive import drive
from frontend.simulate.floor import FloorLine, LineGrid
from frontend.simulate.record import _streams
from frontend.simulate.scenario import Motion, Start
from frontend.simulate.sensors import CameraSpec, SightingSpec
from frontend.simulate.view import camera_of
from frontend.simulate.world import floor_lines
from frontend.strict import from_dict
from graphslam.baseline import integrate
from graphslam.errors import BadConfig
from graphslam.geometry import (
    is_canonical,
    line_to_robot,
    nearest_twin,
    points_on_line,
    position_along,
    transform_points,
    wrap,
)
from graphslam.measurements import Measurements
from graphslam.models.wheels import DifferentialDrive

NOISY = DifferentialDrive(0.05, 0.04, 0.25)
EXACT = DifferentialDrive(0.05, 0.04, 0.25, 0.0, 0.0, slip=(0.0, 0.0, 0.0))
CAMERA = CameraSpec((64, 48), 5.0, view_width=0.8, view_near=0.2, view_far=1.0)


def tiled(**changes: object) -> Scenario:
    """A drive of about 90 frames over uneven tiles, every frame with a line in view."""
    base = Scenario(
        format="graphslam-scenario/1",
        name="tiled",
        robot=NOISY,
        camera=CAMERA,
        path=(Motion(forward=1.5), Motion(turn_deg=-100.0), Motion(arc_deg=130.0, radius=0.5)),
        repeat=2,
        start=Start(1.0, -2.0, 160.0),
        grids=(
            LineGrid(10.0, -6.0, (0.5, 0.6, 0.55) * 8),
            LineGrid(95.0, -6.0, (0.6, 0.5, 0.45) * 8),
        ),
    )
    return replace(base, **changes)


def with_sightings(**changes: object) -> Scenario:
    return tiled(sightings=SightingSpec(**changes))


def errors_of(log: Log) -> np.ndarray:
    """Returns sighting minus truth (K, 2) in the robot frame of all sightings that are true."""
    seen = log.sightings
    real = seen.truth >= 0
    poses = log.truth.pose[np.searchsorted(log.truth.t, seen.t[real])]
    truth = nearest_twin(line_to_robot(log.map.params[seen.truth[real]], poses), seen.z[real])
    error = seen.z[real] - truth
    return np.column_stack([error[:, 0], wrap(error[:, 1])])


def same_measurements(a: Measurements, b: Measurements) -> None:
    np.testing.assert_array_equal(a.t, b.t)
    np.testing.assert_array_equal(a.start_pose, b.start_pose)
    np.testing.assert_array_equal(a.odometry.increment, b.odometry.increment)
    np.testing.assert_array_equal(a.odometry.cov, b.odometry.cov)
    assert a.sightings.keys() == b.sightings.keys()
    for name in ("node", "z", "cov", "extent", "t_received", "truth"):
        left, right = (getattr(m.sightings["line"], name) for m in (a, b))
        np.testing.assert_array_equal(left, right)


# ---- folder and memory -------------------------------------------------------------------------


@pytest.mark.parametrize(
    "scenario",
    [
        tiled(sightings=SightingSpec(false_rate=0.3, miss_rate=0.2)),
        tiled(start=Start(1.0, 2.0, 30.0, known=False)),
        replace(load_scenario("long-loop"), path=(Motion(forward=9.0),)),
        tiled(camera=None, sightings=SightingSpec(reach=1.0, rate=4.0)),
    ],
    ids=["false lines", "unknown start", "lines that end", "no camera"],
)
def test_folder_and_memory_give_the_same_measurements(scenario: Scenario, tmp_path: Path) -> None:
    folder = simulate(scenario, tmp_path / "log", 5, images=False)
    log, memory = open_log(folder), simulate_log(scenario, 5)
    same_measurements(extract(log), simulate_measurements(scenario, 5))
    assert log.warnings == ()
    assert log.start_given == memory.start_given == scenario.start.known
    assert log.cameras.keys() == memory.cameras.keys()
    np.testing.assert_allclose(log.truth.pose, memory.truth.pose, atol=1e-14)
    np.testing.assert_array_equal(np.abs(log.map.params[:, 0]), np.abs(memory.map.params[:, 0]))
    assert not (folder / "images").exists()


def test_same_seed_gives_the_same_bytes_and_another_seed_others(tmp_path: Path) -> None:
    folders = [
        simulate(tiled(), tmp_path / str(i), s, images=False) for i, s in enumerate((7, 7, 8))
    ]
    read = [{p.name: p.read_bytes() for p in sorted(f.iterdir())} for f in folders]
    assert read[0] == read[1]
    assert read[0]["sightings.csv"] != read[2]["sightings.csv"]
    assert simulate_log(tiled(), 7).digest != simulate_log(tiled(), 8).digest
    assert simulate_log(tiled(), 7).digest != simulate_log(with_sightings(scale=2.0), 7).digest


def test_wheels_and_truth_are_those_of_the_log_with_images(tmp_path: Path) -> None:
    short = tiled(path=(Motion(forward=0.2),), repeat=1)
    rendered = open_log(simulate(short, tmp_path / "log", 3))
    log = simulate_log(short, 3)
    np.testing.assert_array_equal(log.wheels.t, rendered.wheels.t)
    np.testing.assert_allclose(log.wheels.angle, rendered.wheels.angle, atol=1e-12)
    np.testing.assert_allclose(log.truth.pose, rendered.truth.pose, atol=1e-11)


def test_existing_folder_and_missing_camera_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadConfig, match="exists already"):
        simulate(tiled(), tmp_path, images=False)
    blind = tiled(camera=None, sightings=SightingSpec(reach=1.0, rate=4.0))
    with pytest.raises(BadConfig, match=r"has no \[camera\] to render images with.*--no-images"):
        simulate(blind, tmp_path / "log")
    with pytest.raises(BadConfig, match="seed = -1"):
        simulate_log(tiled(), -1)


# ---- what is seen ------------------------------------------------------------------------------


def test_every_line_with_enough_of_it_in_view_is_seen_and_no_other() -> None:
    scenario = with_sightings(min_stretch=0.3)
    log, camera, lines = simulate_log(scenario, 2), camera_of(CAMERA), floor_lines(scenario)
    seen = log.sightings
    expected = []
    wheels, slip = map(np.random.default_rng, _streams(2)[:2])
    run = drive(scenario, wheels, slip)
    for t, pose in zip(run.frame_t, run.pose_at_frames(), strict=True):
        stretch = camera.visible_stretch(line_to_robot(lines, pose))
        rows = np.flatnonzero(np.nan_to_num(stretch[:, 1] - stretch[:, 0]) >= 0.3)
        expected += [(t, line) for line in rows]
    assert list(zip(seen.t.tolist(), seen.truth.tolist(), strict=True)) == expected
    assert len(expected) > 150


def test_stretch_is_where_the_line_is_in_view_and_names_are_canonical() -> None:
    log = simulate_log(with_sightings(scale=0.0), 1)
    seen = log.sightings
    assert is_canonical(seen.z).all()
    camera = camera_of(CAMERA)
    np.testing.assert_allclose(seen.extent, camera.visible_stretch(seen.z), atol=1e-9)
    assert np.min(np.diff(seen.extent)) >= 0.2


def test_lines_that_end_are_seen_as_far_as_they_go() -> None:
    line = FloorLine(-0.4, 90.0, stretch=(-2.0, -1.0))  # from (1, -0.4) to (2, -0.4)
    scenario = tiled(
        robot=EXACT,
        grids=(),
        lines=(line,),
        start=Start(),
        path=(Motion(forward=3.0),),
        repeat=1,
        camera=replace(CAMERA, view_width=0.9),
        sightings=SightingSpec(scale=0.0),
    )
    log = simulate_log(scenario)
    seen = log.sightings
    poses = log.truth.pose[np.searchsorted(log.truth.t, seen.t)]
    ends = points_on_line(seen.z[:, None], seen.extent)
    ends = transform_points(poses[:, None], ends)
    x = np.sort(ends[..., 0], axis=1)
    assert x.min() == pytest.approx(1.0, abs=1e-9)
    assert x.max() == pytest.approx(2.0, abs=1e-9)
    np.testing.assert_allclose(ends[..., 1], -0.4, atol=1e-9)
    endless = simulate_log(replace(scenario, lines=(FloorLine(-0.4, 90.0),)))
    assert len(endless.sightings.t) > len(seen.t) > 5
    np.testing.assert_array_equal(log.map.extent, [[-2.0, -1.0]])
    assert np.isnan(endless.map.extent).all()


def test_reach_stands_in_for_a_camera() -> None:
    scenario = tiled(camera=None, sightings=SightingSpec(reach=0.9, rate=4.0, scale=0.0))
    log = simulate_log(scenario, 1)
    seen = log.sightings
    assert log.cameras == {}
    assert np.unique(np.diff(np.unique(seen.t)).round(9)).tolist() == [0.25]
    ends = points_on_line(seen.z[:, None], seen.extent)
    np.testing.assert_allclose(np.hypot(ends[..., 0], ends[..., 1]), 0.9, atol=1e-9)
    lengths = np.abs(line_to_robot(log.map.params, log.truth.pose[0])[:, 0])
    first = seen.truth[seen.t == 0.0]
    np.testing.assert_array_equal(first, np.flatnonzero(lengths <= math.sqrt(0.81 - 0.01)))


def test_frame_without_a_line_is_no_node_and_start_is_the_first_that_has_one() -> None:
    line = FloorLine(2.0, 0.0)
    scenario = tiled(grids=(), lines=(line,), start=Start(), path=(Motion(forward=4.0),), repeat=1)
    log = simulate_log(scenario, 4)
    measurements = extract(log)
    assert measurements.t[0] > 2.0
    assert len(measurements.t) < 25
    here = log.truth.pose[np.searchsorted(log.truth.t, measurements.t[0])]
    np.testing.assert_array_equal(measurements.start_pose, here)
    assert extraction_warnings(log, measurements)[0].startswith("lines of one direction")


def test_floor_without_lines_gives_a_log_without_sightings(tmp_path: Path) -> None:
    bare = tiled(grids=())
    measurements = simulate_measurements(bare)
    assert len(measurements.sightings["line"]) == 0
    log = open_log(simulate(bare, tmp_path / "log", images=False))
    same_measurements(extract(log), measurements)
    assert any("no line was seen" in text for text in extraction_warnings(log, measurements))


# ---- noise -------------------------------------------------------------------------------------


def test_without_noise_measurements_are_the_truth() -> None:
    scenario = tiled(robot=EXACT, sightings=SightingSpec(scale=0.0))
    log = simulate_log(scenario)
    measurements = extract(log)
    driven = integrate(measurements.start_pose, measurements.odometry.increment)
    truth = log.truth.pose[np.searchsorted(log.truth.t, measurements.t)]
    np.testing.assert_allclose(driven[:, :2], truth[:, :2], atol=1e-9)
    np.testing.assert_allclose(wrap(driven[:, 2] - truth[:, 2]), 0.0, atol=1e-9)
    np.testing.assert_allclose(errors_of(log), 0.0, atol=1e-12)


@pytest.mark.parametrize("scale", [1.0, 0.5, 3.0])
@pytest.mark.parametrize("constant", [False, True])
def test_noise_is_drawn_from_exactly_the_stated_covariance(scale: float, constant: bool) -> None:
    stated = {"sigma_rho": 0.013, "sigma_alpha_deg": 0.8} if constant else {}
    squares, count = np.zeros(2), 0
    for seed in range(20):
        log = simulate_log(with_sightings(scale=scale, **stated), seed)
        variance = np.diagonal(log.sightings.cov, axis1=1, axis2=2)
        unit = errors_of(log) / np.sqrt(variance)
        squares, count = squares + np.sum(unit**2, axis=0), count + len(unit)
        assert not constant or np.allclose(variance, [0.013**2, math.radians(0.8) ** 2])
    low, high = chi2.interval(0.999, count)
    assert (low < squares / scale**2).all()
    assert (squares / scale**2 < high).all()


def test_scale_changes_what_is_drawn_and_not_what_is_stated() -> None:
    once, thrice = (simulate_log(with_sightings(scale=s), 3) for s in (1.0, 3.0))
    np.testing.assert_array_equal(once.sightings.cov, thrice.sightings.cov)
    # noise may carry a line over the robot, and its name with it: rho's error changes its sign
    once, thrice = np.abs(errors_of(once)), np.abs(errors_of(thrice))
    np.testing.assert_allclose(3.0 * once, thrice, atol=1e-12)


# ---- missed and false --------------------------------------------------------------------------


def test_lines_are_missed_at_the_rate_asked_for_and_the_rest_stay_as_they_were() -> None:
    kept = total = 0
    for seed in range(10):
        whole = simulate_log(tiled(), seed).sightings
        part = simulate_log(with_sightings(miss_rate=0.3), seed).sightings
        where = {key: i for i, key in enumerate(zip(whole.t, whole.truth, strict=True))}
        rows = [where[key] for key in zip(part.t, part.truth, strict=True)]
        np.testing.assert_array_equal(part.z, whole.z[rows])
        kept, total = kept + len(part.t), total + len(whole.t)
    assert abs(kept - 0.7 * total) < 3.3 * math.sqrt(total * 0.3 * 0.7)
    assert len(simulate_log(with_sightings(miss_rate=1.0)).sightings.t) == 0


@pytest.mark.parametrize("reach", [None, 0.8])
def test_false_lines_come_at_the_rate_asked_for_and_cross_the_view(reach: float | None) -> None:
    scenario = with_sightings(false_rate=1.5, reach=reach)
    count = frames = 0
    for seed in range(5):
        log = simulate_log(scenario, seed)
        seen, true = log.sightings, simulate_log(with_sightings(reach=reach), seed).sightings
        false = seen.truth < 0
        np.testing.assert_array_equal(seen.z[~false], true.z)
        assert (np.diff(seen.t) >= 0).all()
        assert (np.diff(seen.extent[false]) > 0).all()
        middle = points_on_line(seen.z[false], seen.extent[false].mean(axis=1))
        if reach is None:
            camera = camera_of(CAMERA)
            shown = camera.visible_stretch(seen.z[false])
            s = position_along(seen.z[false], middle)
            assert ((shown[:, 0] < s) & (s < shown[:, 1])).all()
        else:
            assert np.hypot(*middle.T).max() < reach
        count += int(false.sum())
        frames += math.floor(log.wheels.t[-1] * 5.0 + 1e-6) + 1
    assert abs(count - 1.5 * frames) < 3.3 * math.sqrt(1.5 * frames)


# ---- scenario files ----------------------------------------------------------------------------


GOOD = {
    "format": "graphslam-scenario/1",
    "name": "x",
    "robot": {"wheel_radius_left": 0.05, "wheel_radius_right": 0.05, "wheel_base": 0.2},
    "sightings": {"reach": 1.0, "rate": 4.0},
    "path": [{"forward": 1}],
}


def test_scenario_needs_no_camera_where_reach_and_rate_are_given() -> None:
    assert from_dict(Scenario, GOOD, "x.toml").rate == 4.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sightings": {"reach": 1.0}}, "camera is missing"),
        ({"sightings": {"rate": 1.0}}, "camera is missing"),
        ({"sightings": {}}, r"camera is missing; add a table \[camera\], or give reach and rate"),
        ({"sightings": {"reach": 0, "rate": 1}}, "reach = 0.0: must be above 0"),
        ({"sightings": {"reach": 1, "rate": -1}}, "rate = -1.0"),
        ({"sightings": {"sigma_rho": 0}}, "sigma_rho = 0.0"),
        ({"sightings": {"sigma_alpha_deg": -1}}, "sigma_alpha_deg = -1.0"),
        ({"sightings": {"scale": -1}}, "scale = -1.0: must be 0 or more"),
        ({"sightings": {"min_stretch": -1}}, "min_stretch"),
        ({"sightings": {"miss_rate": 1.1}}, "miss_rate = 1.1: must be between 0 and 1"),
        ({"sightings": {"false_rate": -0.1}}, "false_rate = -0.1"),
        ({"sightings": {"mis_rate": 0.1}}, "did you mean 'miss_rate'"),
        ({"repeat": 0}, "repeat = 0: must be 1 or more"),
        ({"repeat": 1.5}, "repeat = 1.5 must be a whole number"),
        ({"lines": [{"rho": 1, "alpha_deg": 0, "stretch": [1, 1]}]}, "stretch = .1.0, 1.0."),
        ({"grids": [{"alpha_deg": 0, "first": 0, "stretch": [2, 1]}]}, "stretch = .2.0, 1.0."),
        (
            {"camera": {"image_size": [64, 48], "rate": 2, "homography": [[1, 0, 0]] * 3}},
            "sightings.rate is for floors without a camera",
        ),
    ],
)
def test_wrong_sightings_are_refused_by_name(change: dict[str, object], message: str) -> None:
    with pytest.raises(BadConfig, match=message) as refused:
        from_dict(Scenario, {**GOOD, **change}, "x.toml")
    assert str(refused.value).startswith("x.toml")


def test_repeat_drives_the_path_again() -> None:
    lap = (Motion(forward=0.4), Motion(turn_deg=90.0))
    twice = simulate_log(tiled(path=lap, repeat=2))
    unrolled = simulate_log(tiled(path=lap * 2, repeat=1))
    np.testing.assert_array_equal(twice.wheels.angle, unrolled.wheels.angle)


# ---- the scenarios that come with the package --------------------------------------------------


def test_periodic_floor_is_exactly_periodic() -> None:
    lines = floor_lines(load_scenario("periodic"))
    for alpha in (0.0, math.pi / 2):
        rho = lines[np.isclose(lines[:, 1], alpha), 0]
        np.testing.assert_allclose(np.diff(rho), 0.33, atol=1e-12)
        assert len(rho) >= 15


def test_one_direction_has_one_direction() -> None:
    assert len(np.unique(floor_lines(load_scenario("one-direction"))[:, 1])) == 1


def test_lines_of_the_long_loop_are_seen_again_only_when_it_closes() -> None:
    log = simulate_log(load_scenario("long-loop"))
    seen, closing = log.sightings, 0.9 * log.wheels.t[-1]
    again = 0
    for line in range(len(log.map)):
        t = seen.t[seen.truth == line]
        away = np.flatnonzero(np.diff(t) > 30.0)
        assert (t[away + 1] > closing).all(), line
        again += len(away)
    assert again >= 3
    length = np.hypot(*np.diff(log.truth.pose[:, :2], axis=0).T).sum()
    assert length == pytest.approx(204.0, abs=1.0)


def test_lap_of_the_grid_closes_after_28_metres() -> None:
    scenario = load_scenario("grid")
    lap = simulate_log(replace(scenario, robot=replace(EXACT, wheel_base=0.3), repeat=1))
    np.testing.assert_allclose(lap.truth.pose[-1], lap.truth.pose[0], atol=1e-9)
    assert np.hypot(*np.diff(lap.truth.pose[:, :2], axis=0).T).sum() == pytest.approx(28.0)
    lines = floor_lines(scenario)
    assert len(lines) == 12
    for family in (lines[:6, 0], lines[6:, 0]):
        spacings = np.unique(np.diff(family).round(6))
        assert len(spacings) == 5
        assert np.abs(spacings - 1.0).max() < 0.15


def test_two_hundred_thousand_poses_are_simulated_in_memory() -> None:
    measurements = simulate_measurements(load_scenario("huge"))
    assert len(measurements.t) > 200_000
    assert len(np.unique(measurements.sightings["line"].truth)) == 100
