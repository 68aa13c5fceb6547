"""Scenarios, and the drives and images that are simulated from them."""

from __future__ import annotations

import math
import re
from dataclasses import fields, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.stats import chi2

from frontend.log import open_log
from frontend.overhead import TagMount
from frontend.simulate import (
    Scenario,
    load_scenario,
    scenario_names,
    simulate,
    simulate_log,
)
from frontend.simulate.ceiling import Ceiling, Lamp, LampSpec, UpwardCamera
from frontend.simulate.cones import Cone, OmniSpec
from frontend.simulate.drive import Drive, drive
from frontend.simulate.floor import FloorLine, Groove, Light, LineGrid, Surface
from frontend.simulate.render import pixel_grid, render
from frontend.simulate.scenario import Motion, Start
from frontend.simulate.sensors import CameraSpec, Encoder, SightingSpec
from frontend.simulate.view import camera_of
from frontend.simulate.workspace import ColouredObject, OverheadSpec
from frontend.simulate.world import build_world, floor_lines, random_tile
from frontend.strict import from_dict
from graphslam.errors import BadConfig
from graphslam.geometry import (
    between,
    compose,
    interpolate_poses,
    line_to_robot,
    points_on_line,
    transform_points,
    wrap,
)
from graphslam.models.wheels import DifferentialDrive, increments_from_wheels

EXACT = DifferentialDrive(0.05, 0.04, 0.25, 0.0, 0.0, slip=(0.0, 0.0, 0.0))
PLAIN_LIGHT = Light((0.0, 0.0), 0.0, 0.0, 1.0, 0.0)
STILL = np.array([0.3, -0.2, math.radians(25.0)])
SMALL_CAMERA = CameraSpec((64, 48), 5.0, view_width=0.8, view_near=0.2, view_far=1.0)


def small_scenario(**changes: object) -> Scenario:
    base = Scenario(
        format="graphslam-scenario/1",
        name="small",
        robot=DifferentialDrive(0.05, 0.04, 0.25),
        camera=SMALL_CAMERA,
        path=(
            Motion(forward=0.4),
            Motion(turn_deg=-50.0),
            Motion(arc_deg=130.0, radius=0.3),
            Motion(pause=0.3),
            Motion(forward=-0.3),
        ),
        start=Start(1.0, -2.0, 160.0),
        lines=(FloorLine(-0.8, 10.0), FloorLine(0.5, 95.0)),
    )
    return replace(base, **changes)


def drive_of(scenario: Scenario, seed: int = 0) -> Drive:
    wheels, slip = map(np.random.default_rng, np.random.SeedSequence(seed).spawn(2))
    return drive(scenario, wheels, slip)


def files_of(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def read_tum(path: Path) -> tuple[np.ndarray, np.ndarray]:
    rows = np.loadtxt(path)
    theta = 2.0 * np.arctan2(rows[:, 6], rows[:, 7])
    return rows[:, 0], np.column_stack([rows[:, 1:3], wrap(theta)])


# ---- the folder --------------------------------------------------------------------------------


def test_same_scenario_and_seed_give_the_same_bytes(tmp_path: Path) -> None:
    first = files_of(simulate(small_scenario(), tmp_path / "a", 7))
    again = files_of(simulate(small_scenario(), tmp_path / "b", 7))
    other = files_of(simulate(small_scenario(), tmp_path / "c", 8))
    assert first == again
    assert first.keys() == other.keys()
    changed = {name for name in first if first[name] != other[name]}
    assert {"wheels.csv", "groundtruth.tum", "images/000000.jpg"} <= changed
    assert not {"log.toml", "map.csv", "images.csv"} & changed


def test_streams_are_separate_so_that_pixel_noise_leaves_the_drive_alone(tmp_path: Path) -> None:
    noisy = small_scenario()
    clean = small_scenario(camera=replace(SMALL_CAMERA, noise=0.0))
    a = files_of(simulate(noisy, tmp_path / "a", 3))
    b = files_of(simulate(clean, tmp_path / "b", 3))
    assert a["wheels.csv"] == b["wheels.csv"]
    assert a["groundtruth.tum"] == b["groundtruth.tum"]
    assert a["images/000000.jpg"] != b["images/000000.jpg"]


def test_existing_folder_is_refused_and_left_alone(tmp_path: Path) -> None:
    out = tmp_path / "log"
    out.mkdir()
    (out / "mine.txt").write_text("keep")
    with pytest.raises(BadConfig, match="exists already"):
        simulate(small_scenario(), out)
    assert files_of(out) == {"mine.txt": b"keep"}


def test_interrupted_simulation_leaves_nothing(tmp_path: Path) -> None:
    def stop(done: int, of: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(small_scenario(), tmp_path / "log", progress=stop)
    assert list(tmp_path.iterdir()) == []


def test_folder_that_cannot_be_made_is_a_clear_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BadConfig, match=r"file.log: cannot be written"):
        simulate(small_scenario(), tmp_path / "file" / "log")


def test_progress_counts_every_image(tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    simulate(small_scenario(), tmp_path / "log", progress=lambda *state: seen.append(state))
    count = len(list((tmp_path / "log" / "images").iterdir()))
    assert seen == [(i + 1, count) for i in range(count)]


def test_open_log_reads_what_was_simulated(tmp_path: Path) -> None:
    scenario = small_scenario(encoder=Encoder(20.0, 1024))
    folder = simulate(scenario, tmp_path / "log", 1)
    log, run = open_log(folder), drive_of(scenario)
    assert log.name == "small"
    assert log.warnings == ()
    assert log.robot == scenario.robot
    assert log.start_given
    np.testing.assert_array_equal(log.start_pose, [1.0, -2.0, math.radians(160.0)])
    np.testing.assert_array_equal(log.start_sigma, 0.0)
    np.testing.assert_array_equal(log.wheels.t, run.wheel_t)
    np.testing.assert_array_equal(log.images.t, run.frame_t)
    np.testing.assert_array_equal(log.truth.t, run.t)
    assert all(file.is_file() for file in log.images.file)
    np.testing.assert_array_equal(log.cameras["floor"].image_size, (64, 48))
    np.testing.assert_array_equal(
        log.cameras["floor"].homography, camera_of(SMALL_CAMERA).homography
    )
    assert len(log.map) == 2
    at_first_image = interpolate_poses(log.images.t[:1], log.truth.t, log.truth.pose)[0]
    np.testing.assert_allclose(between(log.start_pose, at_first_image), 0.0, atol=1e-9)


def test_unknown_start_is_left_out_of_the_log(tmp_path: Path) -> None:
    folder = simulate(small_scenario(start=Start(1.0, 2.0, 30.0, known=False)), tmp_path / "log")
    assert "[start]" not in (folder / "log.toml").read_text()
    assert not open_log(folder).start_given
    np.testing.assert_allclose(
        read_tum(folder / "groundtruth.tum")[1][0], [1.0, 2.0, math.radians(30.0)], atol=1e-12
    )


# ---- the drive ---------------------------------------------------------------------------------


@pytest.mark.parametrize("rate", [5.0, 7.3])
def test_wheels_without_noise_give_the_truth(tmp_path: Path, rate: float) -> None:
    camera = replace(SMALL_CAMERA, rate=rate)
    folder = simulate(small_scenario(robot=EXACT, camera=camera), tmp_path / "log")
    wheels = np.loadtxt(folder / "wheels.csv", delimiter=",", skiprows=1)
    t, truth = read_tum(folder / "groundtruth.tum")
    increments, _ = increments_from_wheels(wheels[:, 0], wheels[:, 1:], t, EXACT)
    pose = truth[0]
    for increment, true in zip(increments, truth[1:], strict=True):
        pose = compose(pose, increment)
        assert np.abs(between(true, pose)).max() < 1e-9


def test_path_goes_where_its_motions_say() -> None:
    run = drive_of(small_scenario(robot=EXACT, path=(Motion(forward=3.0), Motion(turn_deg=-180.0))))
    end = compose([1.0, -2.0, math.radians(160.0)], [3.0, 0.0, math.pi])
    np.testing.assert_allclose(between(end, run.pose[-1]), 0.0, atol=1e-12)
    circle = drive_of(
        small_scenario(robot=EXACT, path=tuple(Motion(arc_deg=90.0, radius=0.7) for _ in range(4)))
    )
    np.testing.assert_allclose(between(circle.pose[0], circle.pose[-1]), 0.0, atol=1e-12)
    quarter = circle.pose[np.abs(circle.t - 0.25 * circle.t[-1]).argmin()]
    np.testing.assert_allclose(
        between(circle.pose[0], quarter), [0.7, 0.7, math.pi / 2], atol=1e-12
    )


def test_speeds_hold_to_the_nearest_reading() -> None:
    path = (Motion(forward=1.01), Motion(turn_deg=90.0, turn_rate_deg=30.0), Motion(pause=1.5))
    run = drive_of(small_scenario(path=path, speed=0.5, encoder=Encoder(10.0)))
    assert run.wheel_t[-1] == 2.0 + 3.0 + 1.5
    assert run.frame_t[-1] == 6.4
    np.testing.assert_array_equal(run.wheel_true[-15:], np.tile(run.wheel_true[-1], (15, 1)))


def test_encoder_steps_round_the_angle() -> None:
    run = drive_of(small_scenario(encoder=Encoder(20.0, 500)))
    counts = run.wheel_angle / (2.0 * math.pi / 500)
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
    assert len(np.unique(np.round(counts[:, 0]))) > 20


def in_bounds(squares: np.ndarray) -> bool:
    """Whether normalised squared errors have mean 1, at 99.9 %."""
    low, high = chi2.interval(0.999, squares.size)
    return bool(low <= squares.sum() <= high)


def test_distance_noise_is_independent_with_variance_in_proportion_to_rotation() -> None:
    robot = DifferentialDrive(0.05, 0.04, 0.25, 0.03, 0.01)
    scenario = small_scenario(robot=robot)
    errors, sizes = [], []
    for seed in range(60):
        run = drive_of(scenario, seed)
        true = np.diff(run.wheel_true, axis=0)
        moving = np.all(np.abs(true) > 0, axis=1)
        errors.append((np.diff(run.wheel_angle, axis=0) - true)[moving])
        sizes.append(true[moving])
    error, rotation = np.array(errors), np.abs(np.array(sizes))
    unit = error / (np.array([0.03, 0.01]) * np.sqrt(rotation))
    assert in_bounds(unit[..., 0] ** 2)
    assert in_bounds(unit[..., 1] ** 2)
    pairs = unit[:, 1:].size
    assert abs(np.mean(unit[:, 1:] * unit[:, :-1])) < 3.3 / math.sqrt(pairs)
    assert abs(np.mean(unit[..., 0] * unit[..., 1])) < 3.3 / math.sqrt(unit[..., 0].size)
    small = rotation < np.median(rotation)
    assert in_bounds(unit[small] ** 2)
    assert in_bounds(unit[~small] ** 2)


def test_paper_noise_is_one_relative_error_for_each_wheel_and_image_interval() -> None:
    robot = DifferentialDrive(0.05, 0.04, 0.25, 0.06, 0.02, law="paper")
    scenario = small_scenario(robot=robot, path=(Motion(forward=6.0),))
    errors = []
    for seed in range(30):
        run = drive_of(scenario, seed)
        relative = np.diff(run.wheel_angle, axis=0) / np.diff(run.wheel_true, axis=0) - 1.0
        by_interval = relative.reshape(-1, 4, 2)  # 20 readings, 5 images a second
        spread = by_interval - by_interval[:, :1]
        np.testing.assert_allclose(spread, 0.0, atol=1e-10)
        errors.append(by_interval[:, 0])
    error = np.concatenate(errors)
    assert in_bounds((error[:, 0] / 0.06) ** 2)
    assert in_bounds((error[:, 1] / 0.02) ** 2)
    assert abs(np.corrcoef(error.T)[0, 1]) < 3.3 / math.sqrt(len(error))


@pytest.mark.parametrize("law", ["distance", "paper"])
@pytest.mark.parametrize("slip", [(0.0, 0.0, 0.0), (0.004, 0.006, 0.01)])
def test_errors_of_increments_have_the_covariance_that_estimators_assume(
    law: str, slip: tuple[float, float, float]
) -> None:
    robot = DifferentialDrive(0.05, 0.04, 0.25, 0.02, 0.03, law=law, slip=slip)
    assumed = replace(robot, floor=(1e-7, 1e-7))
    camera = replace(SMALL_CAMERA, rate=1.0)
    path = (Motion(forward=0.6), Motion(arc_deg=200.0, radius=0.4), Motion(turn_deg=-90.0))
    scenario = small_scenario(robot=robot, camera=camera, path=path)
    squares, dimension = 0.0, 0
    for seed in range(60):
        run = drive_of(scenario, seed)
        increment, cov = increments_from_wheels(run.wheel_t, run.wheel_angle, run.frame_t, assumed)
        true = run.pose_at_frames()
        error = between(true[:-1], true[1:]) - increment
        error[:, 2] = wrap(error[:, 2])
        if not any(slip):  # two wheels: two directions
            values, vectors = np.linalg.eigh(cov)
            error = (np.swapaxes(vectors, -1, -2) @ error[..., None])[..., 1:, 0]
            squares += float(np.sum(error**2 / values[:, 1:]))
        else:
            squares += float(np.einsum("ni,nij,nj", error, np.linalg.inv(cov), error))
        dimension += error.size
    low, high = chi2.interval(0.999, dimension)
    assert low < squares < high


# ---- the images --------------------------------------------------------------------------------


def still_picture(line: FloorLine, spec: CameraSpec, **changes: object) -> np.ndarray:
    scenario = small_scenario(
        camera=spec,
        lines=(line,),
        surface=Surface(150.0, 0.0),
        light=PLAIN_LIGHT,
        **changes,
    )
    grid = pixel_grid(camera_of(spec), scenario.light)
    world = build_world(scenario, np.random.default_rng(0))
    return render(scenario, world, grid, STILL, 0.0, np.random.default_rng(0))


@pytest.mark.parametrize("contrast", [-90.0, 80.0])
@pytest.mark.parametrize("blur", [0.5, 0.9])
@pytest.mark.parametrize(
    ("line", "along"),
    [
        (FloorLine(0.86, 18.0), 0),  # far, nearly along an image row
        (FloorLine(0.55, 40.0), 0),
        (FloorLine(-0.35, 112.0), 1),  # nearly along a column
    ],
)
def test_groove_lies_where_the_homography_says(
    line: FloorLine, along: int, blur: float, contrast: float
) -> None:
    size = (160, 120)
    spec = replace(SMALL_CAMERA, image_size=size, noise=0.0, blur=blur)
    image = still_picture(line, spec, groove=Groove(0.008, contrast))
    cover = (image.astype(float) - 150.0) / contrast
    camera = camera_of(spec)
    line_robot = line_to_robot(floor_lines(small_scenario(lines=(line,))), STILL)
    (stretch,) = camera.visible_stretch(line_robot)
    pixels = camera.floor_to_pixel(points_on_line(line_robot[0], np.linspace(*stretch, 500)))
    pixels = pixels[np.argsort(pixels[:, along])]
    place = np.arange(8, size[along] - 8)
    predicted = np.interp(place, pixels[:, along], pixels[:, 1 - along])
    whole = (predicted > 8) & (predicted < size[1 - along] - 9)
    whole &= (place > pixels[0, along]) & (place < pixels[-1, along])
    assert whole.sum() > 40
    profile = cover[:, place[whole]] if along == 0 else cover[place[whole]].T
    found = np.arange(len(profile)) @ profile / profile.sum(0)
    error = found - predicted[whole]
    assert abs(error.mean()) < 0.02
    assert np.abs(error).max() < 0.1


def test_groove_is_as_wide_as_it_says_even_where_it_is_thinner_than_a_pixel() -> None:
    spec = replace(SMALL_CAMERA, image_size=(160, 120), noise=0.0, blur=0.5)
    image = still_picture(FloorLine(0.6, 25.0), spec, groove=Groove(0.004, -140.0))
    line_robot = line_to_robot(np.array([[0.6, math.radians(25.0)]]), STILL)[0]
    ahead = np.array([[line_robot[0] - 0.002, 0.0], [line_robot[0] + 0.002, 0.0]])
    near, far = camera_of(spec).floor_to_pixel(ahead)[:, 1]
    assert near - far < 1.0
    total = (150.0 - image[:, 79].astype(float)).sum() / 140.0
    assert total == pytest.approx(near - far, rel=0.03)


def test_line_that_ends_is_drawn_as_far_as_it_goes() -> None:
    spec = replace(SMALL_CAMERA, image_size=(160, 120), noise=0.0, blur=0.5)
    line = FloorLine(0.6, 0.0)  # across the image, x = 0.6
    scenario = small_scenario(
        camera=spec, surface=Surface(150.0, 0.0), light=PLAIN_LIGHT, lines=(line,)
    )
    cut = replace(scenario, lines=(replace(line, stretch=(-0.1, 0.2)),))
    grid, rng = pixel_grid(camera_of(spec), PLAIN_LIGHT), np.random.default_rng(0)
    whole, part = (
        render(s, build_world(s, rng), grid, np.zeros(3), 0.0, rng) for s in (scenario, cut)
    )
    left = grid.floor[..., 1]
    inside = (left > -0.1) & (left < 0.2)
    np.testing.assert_array_equal(part[inside], whole[inside])
    assert (part[~inside] == 150).all()
    assert (whole[~inside] < 140).any()
    assert (part < 140).any()


def test_texture_stays_on_the_floor_while_the_robot_moves() -> None:
    spec = replace(SMALL_CAMERA, image_size=(160, 120), noise=0.0, blur=0.0)
    scenario = small_scenario(
        camera=spec, lines=(), light=PLAIN_LIGHT, surface=Surface(120, 20, 0.1)
    )
    camera, world = camera_of(spec), build_world(scenario, np.random.default_rng(1))
    grid = pixel_grid(camera, scenario.light)
    # over the seam of the pattern's period, 0.1 m / 4 * 512
    poses = np.array([[12.4, 25.3, 0.2], [12.65, 25.4, 0.5]])
    images = [render(scenario, world, grid, p, 0.0, np.random.default_rng(0)) for p in poses]
    points = transform_points(between(poses[1], poses[0]), grid.floor)
    maps = camera.floor_to_pixel(points).astype(np.float32)
    moved = cv2.remap(images[1], maps, None, cv2.INTER_LINEAR, borderValue=0)
    both = (maps[..., 0] > 1) & (maps[..., 0] < 158) & (maps[..., 1] > 1) & (maps[..., 1] < 118)
    assert both.sum() > 5000
    difference = images[0][both].astype(float) - moved[both]
    assert images[0][both].std() > 10.0
    assert difference.std() < 2.0


def test_pattern_repeats_without_a_seam_and_keeps_to_its_band() -> None:
    tile = random_tile(0.04, np.random.default_rng(2))
    values = tile.values.astype(float)
    assert values.std() == pytest.approx(1.0)
    inside = np.abs(np.diff(values, axis=1)).mean()
    seam = np.abs(values[:, 0] - values[:, -1]).mean()
    assert seam < 1.3 * inside
    power = np.abs(np.fft.fft2(values)) ** 2
    waves = np.hypot(*np.meshgrid(*[np.fft.fftfreq(512, tile.cell)] * 2))
    outside = (waves > 1.01 / 0.04) | (waves < 0.99 / 0.64)
    assert power[outside].sum() < 1e-9 * power.sum()


def test_light_drifts_and_falls_off_as_asked() -> None:
    spec = replace(SMALL_CAMERA, noise=0.0, blur=0.0)
    light = Light((0.2, 0.0), 0.3, 0.0, 1.0, 0.1, 20.0)
    scenario = small_scenario(camera=spec, lines=(), light=light, surface=Surface(100.0, 0.0))
    world, rng = build_world(scenario, np.random.default_rng(0)), np.random.default_rng(0)
    grid = pixel_grid(camera_of(spec), light)
    dim, bright = (render(scenario, world, grid, STILL, t, rng) for t in (0.0, 5.0))
    assert dim[24, 32] == pytest.approx(100, abs=1)
    assert bright[24, 32] == pytest.approx(110, abs=1)
    assert dim[24, 63] / dim[24, 0] == pytest.approx(1.1 / 0.9, rel=0.02)
    assert dim[0, 0] == pytest.approx(100 * 0.7 * 0.9, abs=2)


def test_horizon_in_the_image_is_drawn_without_floor() -> None:
    homography = ((0.0, -40.0, 0.0), (20.0, 0.0, 30.0), (1.0, 0.0, 0.0))  # horizon at row 20
    spec = CameraSpec((64, 48), 5.0, homography=homography, noise=0.0, blur=0.0)
    image = still_picture(FloorLine(1.7, 25.0), spec, groove=Groove(0.06, -100.0, 0.0))
    assert (image[:20] == 75).all()
    assert image[22:].mean() > 130
    assert image[22:].min() < 120


def test_pixel_noise_has_the_deviation_asked_for() -> None:
    image = still_picture(FloorLine(50.0, 0.0), replace(SMALL_CAMERA, noise=5.0))
    assert image.mean() == pytest.approx(150.0, abs=0.3)
    assert image.astype(float).std() == pytest.approx(5.0, rel=0.05)


def test_lossless_images_are_the_rendered_ones(tmp_path: Path) -> None:
    spec = replace(SMALL_CAMERA, jpeg_quality=0)
    folder = simulate(small_scenario(camera=spec), tmp_path / "log")
    listed = (folder / "images.csv").read_text().split()
    assert listed[1] == "0.000000000,images/000000.png"
    image = cv2.imread(str(folder / "images" / "000000.png"), cv2.IMREAD_UNCHANGED)
    assert image.shape == (48, 64)


# ---- the camera's view -------------------------------------------------------------------------


@pytest.mark.parametrize("view", [(0.6, 0.26, 0.98), (0.9, 0.2, 1.2), (0.5, 0.4, 0.9)])
def test_view_is_as_wide_and_reaches_as_far_as_asked(view: tuple[float, float, float]) -> None:
    width, near, far = view
    spec = CameraSpec((160, 120), 5.0, None, width, near, far)
    camera = camera_of(spec)
    centre = np.array([[79.5, 119.5], [79.5, -0.5]])
    np.testing.assert_allclose(camera.pixel_to_floor(centre), [[near, 0.0], [far, 0.0]], atol=1e-9)
    middle = camera.floor_to_pixel(np.array([0.5 * (near + far), 0.0]))[1]
    edges = camera.pixel_to_floor(np.array([[-0.5, middle], [159.5, middle]]))
    np.testing.assert_allclose(edges[:, 1], [0.5 * width, -0.5 * width], atol=1e-9)


def test_view_that_no_camera_has_is_refused() -> None:
    with pytest.raises(BadConfig, match=r"view_width = 3\.0.*0\.9. m wide"):
        camera_of(replace(SMALL_CAMERA, view_width=3.0))
    with pytest.raises(BadConfig, match="view_near = 2"):
        camera_of(replace(SMALL_CAMERA, view_near=2.0))


# ---- scenario files ----------------------------------------------------------------------------


GOOD = {
    "format": "graphslam-scenario/1",
    "name": "x",
    "robot": {"wheel_radius_left": 0.05, "wheel_radius_right": 0.05, "wheel_base": 0.2},
    "camera": {
        "image_size": [64, 48],
        "rate": 2,
        "view_width": 0.8,
        "view_near": 0.2,
        "view_far": 1.0,
    },
    "path": [{"forward": 1}],
}


def test_smallest_scenario_is_accepted() -> None:
    assert from_dict(Scenario, GOOD, "x.toml").path == (Motion(forward=1.0),)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "graphslam-scenario/2"}, "format"),
        ({"name": " "}, "name = ' '"),
        ({"name": "a/b"}, "name = 'a/b'"),
        ({"speeed": 1.0}, "did you mean 'speed'"),
        ({"speed": -1.0}, "speed = -1.0: must be above 0"),
        ({"turn_rate_deg": 0}, "turn_rate_deg"),
        ({"path": []}, "path is empty"),
        ({"path": [{}]}, r"path\[0\].*found none"),
        ({"path": [{"forward": 1, "turn_deg": 3}]}, "found forward and turn_deg"),
        ({"path": [{"arc_deg": 90}]}, "arc_deg and radius come together"),
        ({"path": [{"pause": -1}]}, "pause = -1.0"),
        ({"path": [{"foward": 1}]}, "did you mean 'forward'"),
        ({"lines": [{"rho": 1.0}]}, r"lines\[0\].alpha_deg is missing"),
        ({"grids": [{"alpha_deg": 0, "first": 0, "spacings": [0.5, 0]}]}, "spacings = 0.0"),
        ({"robot": {**GOOD["robot"], "wheel_base": 0}}, "wheel_base"),
        ({"robot": {**GOOD["robot"], "law": "none"}}, "law"),
        ({"robot": {**GOOD["robot"], "floor": [0.1, 0.1]}}, "robot.floor"),
        ({"encoder": {"rate": 0}}, "rate = 0.0"),
        ({"encoder": {"ticks": -4}}, "ticks = -4"),
        ({"groove": {"width": 0}}, "width = 0.0"),
        ({"groove": {"contrast": -300}}, "contrast"),
        ({"surface": {"grey": 256}}, "grey = 256.0: must be between 0 and 255"),
        ({"surface": {"texture_scale": 0}}, "texture_scale"),
        ({"light": {"gradient": [0.1]}}, "gradient has 1 entries, not 2"),
        ({"light": {"vignette": 1.0}}, "vignette"),
        ({"camera": {"image_size": [64, 48], "rate": 2}}, "homography, or all of view_width"),
        ({"camera": {**GOOD["camera"], "homography": [[1, 0, 0]] * 3}}, "not both"),
        ({"camera": {**GOOD["camera"], "jpeg_quality": 101}}, "jpeg_quality"),
        ({"camera": {**GOOD["camera"], "image_size": [0, 48]}}, "image_size"),
        ({"camera": {**GOOD["camera"], "distortion": [0.1]}}, "need the homography"),
    ],
)
def test_wrong_scenarios_are_refused_by_name(change: dict[str, object], message: str) -> None:
    with pytest.raises(BadConfig, match=message) as refused:
        from_dict(Scenario, {**GOOD, **change}, "x.toml")
    assert str(refused.value).startswith("x.toml")


def test_unknown_scenario_names_the_nearest() -> None:
    with pytest.raises(BadConfig, match="did you mean 'santana-slam'"):
        load_scenario("santanaslam")
    with pytest.raises(BadConfig, match=r"no/such\.toml: does not exist"):
        load_scenario("no/such.toml")


def test_file_is_loaded_by_its_path_and_comes_before_a_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = """
        format = "graphslam-scenario/1"
        name = "mine"
        path = [{ forward = 1.0 }]
        robot = { wheel_radius_left = 0.05, wheel_radius_right = 0.05, wheel_base = 0.2 }
        [camera]
        image_size = [64, 48]
        rate = 2
        view_width = 0.8
        view_near = 0.2
        view_far = 1.0
    """
    (tmp_path / "sample.toml").write_text(text)
    assert load_scenario(tmp_path / "sample.toml").name == "mine"
    monkeypatch.chdir(tmp_path)
    assert load_scenario("sample.toml").name == "mine"
    assert load_scenario("sample").name == "sample"


def documented() -> str:
    return (Path(__file__).resolve().parents[2] / "docs" / "scenarios.md").read_text()


def test_documented_example_can_be_simulated(tmp_path: Path) -> None:
    example = documented().split("```toml\n")[1].split("```")[0]
    (tmp_path / "example.toml").write_text(example)
    folder = simulate(load_scenario(tmp_path / "example.toml"), tmp_path / "log")
    assert len(open_log(folder).map) == 5


def test_every_key_is_documented() -> None:
    text = documented()
    parts = (Scenario, CameraSpec, Encoder, FloorLine, Groove, Light, LineGrid, Motion, Start)
    for part in (
        *parts,
        SightingSpec,
        Surface,
        OverheadSpec,
        ColouredObject,
        TagMount,
        Cone,
        OmniSpec,
        Ceiling,
        Lamp,
        LampSpec,
        UpwardCamera,
    ):
        for field in fields(part):
            assert re.search(rf"`(\w+\.)?{field.name}`|\[{field.name}\]", text), field.name
    assert all(f"`{name}`" in text for name in scenario_names())


# ---- the scenarios that come with the package --------------------------------------------------


def test_shipped_scenarios_are_found_by_name() -> None:
    assert scenario_names() == (
        "atali",
        "atali-trouble",
        "cones-outdoors",
        "corridor",
        "four-lamps",
        "grid",
        "huge",
        "long-loop",
        "narrow-grid",
        "noisy-grid",
        "one-direction",
        "periodic",
        "sample",
        "santana-loc-1",
        "santana-loc-2",
        "santana-slam",
        "three-cones",
    )


@pytest.mark.parametrize("name", scenario_names())
def test_shipped_scenario_loads_under_its_own_name_and_something_is_seen(name: str) -> None:
    scenario = load_scenario(name)
    assert scenario.name == name
    two_laps = replace(scenario, repeat=min(2, scenario.repeat))
    log, run = simulate_log(two_laps), drive_of(two_laps)
    parts = (log.sightings, log.pose_fixes, log.bearings, log.lamps)
    seen = np.concatenate([part.t for part in parts if part is not None])
    assert len(np.unique(seen)) > 0.4 * len(run.frame_t)
    per_interval = scenario.encoder.rate / scenario.rate
    assert per_interval == pytest.approx(round(per_interval))


@pytest.mark.parametrize("seed", range(3))
def test_all_six_lines_of_santana_slam_come_into_view(seed: int) -> None:
    scenario = load_scenario("santana-slam")
    run, camera = drive_of(scenario, seed), camera_of(scenario.camera)
    lines = floor_lines(scenario)
    stretches = np.array(
        [camera.visible_stretch(line_to_robot(lines, pose)) for pose in run.pose_at_frames()]
    )
    length = np.nan_to_num(np.diff(stretches, axis=-1)[..., 0])
    frames = np.sum(length >= 0.25, axis=0)
    assert len(lines) == 6
    assert (frames >= 5).all(), frames


def test_santana_slam_is_the_papers_experiment() -> None:
    scenario = load_scenario("santana-slam")
    run = drive_of(replace(scenario, robot=replace(scenario.robot, slip=(0.0, 0.0, 0.0))))
    assert len(run.frame_t) == 261
    np.testing.assert_allclose(np.diff(run.frame_t), 0.3, atol=1e-9)
    start = [3.0, 3.1, math.radians(-110.0)]
    np.testing.assert_allclose(run.pose[0], start, atol=1e-12)
    turned_back = compose(start, [0.0, 0.0, math.pi])
    np.testing.assert_allclose(between(turned_back, run.pose[-1]), 0.0, atol=1e-9)
    backwards = np.diff(run.wheel_true, axis=0).min(axis=0) < 0
    np.testing.assert_array_equal(backwards, [False, True])  # left, right: clockwise
    assert scenario.robot.law == "paper"
    assert (scenario.robot.noise_left, scenario.robot.noise_right) == (0.03, 0.03)
    expected = [[1.08, 0], [2.16, 0], [3.24, 0], [0.98, 90], [1.96, 90], [2.94, 90]]
    found = floor_lines(scenario) * [1.0, 180.0 / math.pi]
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_a_path_that_no_memory_holds_is_refused_in_words(tmp_path: Path) -> None:
    endless = replace(load_scenario("corridor"), path=(Motion(forward=1e9),))
    with pytest.raises(BadConfig, match="encoder readings"):
        simulate(endless, tmp_path / "log")
