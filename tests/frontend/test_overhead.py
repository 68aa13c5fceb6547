"""The overhead camera: from two coloured tags to a pose, and everything that may go wrong."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from frontend import overhead
from frontend.camera import Camera
from frontend.config import ExtractConfig, NoiseConfig
from frontend.extract import extract, extraction_warnings
from frontend.inspect import inspect
from frontend.log import Log, open_log
from frontend.overhead import OverheadCamera, TagMount, pose_of_tags
from frontend.plausible import BREAKS, CONTRADICTED, TURNED
from frontend.pose_fixes import KIND
from frontend.simulate import Scenario, load_scenario, simulate, simulate_log
from frontend.simulate.workspace import ColouredObject
from frontend.tag_config import TagConfig
from frontend.tags import SeenTags, detect_tags, tag_covariance
from frontend.write_bag import robot_file_text, write_bag
from graphslam.errors import BadConfig, BadLog
from graphslam.geometry import Array, compose, interpolate_poses, transform_points, wrap
from graphslam.measurements import Measurements

HOMOGRAPHY = np.array([[150.0, 12.0, 10.0], [6.0, -150.0, 230.0], [0.02, 0.03, 1.0]])
MOUNT = TagMount(front=(0.12, 0.0), diameter=0.06)
CAMERA = Camera("overhead", "overhead", (320, 240), HOMOGRAPHY)
EYE = OverheadCamera(CAMERA, MOUNT)
BLUE, GREEN = (215, 95, 25), (75, 190, 60)
HERE = (0.6, 0.7, 0.0)
CONFIG = TagConfig()


def picture(*discs: tuple[tuple[float, float], tuple[int, int, int]], eye: OverheadCamera = EYE):
    """An image of discs (place on the floor, colour) on a grey floor, drawn at eight times size."""
    fine = np.full((8 * 240, 8 * 320, 3), 150, np.uint8)
    angle = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    ring = 0.03 * np.column_stack([np.cos(angle), np.sin(angle)])
    for place, colour in discs:
        pixels = eye.to_pixels(np.array(place) + ring)
        corners = np.round((8.0 * (pixels + 0.5) - 0.5) * 256).astype(np.int32)
        cv2.fillPoly(fine, [corners], colour, cv2.LINE_8, 8)
    return cv2.resize(fine, (320, 240), interpolation=cv2.INTER_AREA)


def robot(pose: tuple[float, float, float], mount: TagMount = MOUNT):
    """The two discs of a robot at a pose."""
    centre, front = transform_points(np.array(pose), mount.points()).tolist()
    return (centre, BLUE), (front, GREEN)


def seen(*discs, config: TagConfig = CONFIG) -> SeenTags:
    return detect_tags(picture(*discs), EYE, config)


def moved(scenario: Scenario, **changes) -> Scenario:
    assert scenario.overhead is not None
    return replace(scenario, overhead=replace(scenario.overhead, **changes))


@pytest.fixture(scope="module")
def small() -> Scenario:
    """The work space at a fifth of the pixels, one lap."""
    scenario = replace(load_scenario("atali"), repeat=1, mess=None)
    return moved(scenario, image_size=(320, 240), rate=4.0, tag_noise=0.001)


def errors(log: Log, measurements: Measurements) -> Array:
    """Errors (K, 3) of all fixes."""
    assert log.truth is not None
    fixes = measurements.sightings[KIND]
    true = interpolate_poses(measurements.t[fixes.node], log.truth.t, log.truth.pose)
    off = fixes.z - true
    off[:, 2] = wrap(off[:, 2])
    return off


# ---- from tags to a pose ----------------------------------------------------------------------


@pytest.mark.parametrize("theta", [0.0, 1.0, 2.5, np.pi, -0.7, -2.2])
@pytest.mark.parametrize("mount", [MOUNT, TagMount((0.05, 0.08), (-0.06, 0.02))])
def test_the_direction_is_right_in_every_quadrant(theta: float, mount: TagMount) -> None:
    pose = np.array([0.7, 1.1, theta])
    floor = transform_points(pose, mount.points())
    found, _ = pose_of_tags(floor, np.tile(1e-6 * np.eye(2), (2, 1, 1)), mount)
    assert np.allclose(found[:2], pose[:2], atol=1e-12)
    assert abs(wrap(found[2] - theta)) < 1e-12


def test_atalis_printed_quotient_gets_half_of_all_directions_wrong() -> None:
    theta = np.linspace(-3.1, 3.1, 400)
    centre, front = np.zeros((400, 2)), np.column_stack([np.cos(theta), np.sin(theta)])
    printed = np.arctan((centre - front)[:, 1] / (centre - front)[:, 0])
    wrong = np.abs(wrap(printed - theta)) > 0.1
    assert 0.45 < wrong.mean() < 0.55


def test_the_covariance_is_that_of_repeated_looks() -> None:
    rng = np.random.default_rng(0)
    mount = TagMount((0.12, 0.0), (-0.02, 0.03))
    pose = np.array([0.5, 0.8, 2.0])
    cov = np.array([[[4e-6, 1e-6], [1e-6, 1e-6]], [[2e-6, -1e-6], [-1e-6, 3e-6]]])
    floor = transform_points(pose, mount.points())
    root = np.linalg.cholesky(cov)
    noisy = [floor + (root @ rng.standard_normal((2, 2, 1)))[..., 0] for _ in range(4000)]
    found = np.array([pose_of_tags(points, cov, mount)[0] for points in noisy])
    stated = pose_of_tags(floor, cov, mount)[1]
    ratio = np.linalg.eigvals(np.linalg.solve(stated, np.cov((found - pose).T))).real
    assert np.all(np.abs(ratio - 1.0) < 0.12)
    wide = pose_of_tags(
        transform_points(pose, np.array([[0, 0], [0.24, 0]])), cov, TagMount((0.24, 0))
    )
    assert wide[1][2, 2] < 0.4 * stated[2, 2]  # tags farther apart tell the direction better


def test_tags_above_the_mapped_plane_are_put_below_themselves() -> None:
    low = OverheadCamera(CAMERA, MOUNT)
    high = OverheadCamera(CAMERA, replace(MOUNT, height=0.25), (1.0, 0.8, 2.0))
    # a tag 0.25 m high under a camera 2 m high covers the plane 8/7 as far from the camera's foot
    on_plane = np.array([[1.4, 1.0]])
    true = np.array([1.0, 0.8]) + (on_plane - [1.0, 0.8]) * 7.0 / 8.0
    assert np.allclose(high.to_floor(low.to_pixels(on_plane))[0], true)
    assert np.allclose(high.to_pixels(true), low.to_pixels(on_plane))
    with pytest.raises(BadConfig, match="needs position"):
        OverheadCamera(CAMERA, replace(MOUNT, height=0.25))
    with pytest.raises(BadConfig, match="not below the camera"):
        OverheadCamera(CAMERA, replace(MOUNT, height=2.5), (1.0, 0.8, 2.0))
    with pytest.raises(BadConfig, match="at one place"):
        TagMount((0.0, 0.0))


# ---- one image --------------------------------------------------------------------------------


@pytest.mark.parametrize("pose", [(0.6, 0.7, 0.0), (1.2, 0.5, 2.4), (0.9, 1.1, -1.9)])
def test_a_pose_is_read_to_a_fraction_of_a_pixel(pose: tuple[float, float, float]) -> None:
    found = seen(*robot(pose))
    assert found.pose is not None
    assert found.cov is not None
    off = found.pose - pose
    assert np.hypot(*off[:2]) < 0.0015  # a pixel covers 7 mm
    assert abs(wrap(off[2])) < np.radians(0.6)
    assert off @ np.linalg.solve(found.cov, off) < 12.0
    assert len(found.beside) == 0


@pytest.mark.parametrize(
    ("discs", "reason"),
    [
        ([], overhead.NEITHER),
        ([robot((0.6, 0.7, 0.0))[0]], overhead.NO_FRONT),
        ([robot((0.6, 0.7, 0.0))[1]], overhead.NO_CENTRE),
        ([((0.6, 0.7), BLUE), ((0.9, 0.7), GREEN)], overhead.APART),
        ([*robot((0.6, 0.7, 0.0)), ((0.72, 0.82), BLUE)], overhead.AMBIGUOUS),
        ([((-0.1, 0.7), BLUE), ((0.02, 0.7), GREEN)], overhead.AT_BORDER),
        ([*robot(HERE), ((0.57, 0.73), BLUE), ((0.63, 0.67), BLUE)], overhead.OTHER_SIZE),
    ],
)  # fmt: skip
def test_what_is_not_clear_gives_no_pose_and_says_why(discs, reason: str) -> None:
    found = seen(*discs)
    assert found.pose is None
    assert found.refused == reason


def test_a_second_blue_object_elsewhere_is_passed_over_and_told() -> None:
    pose = (0.6, 0.7, 0.4)
    found = seen(*robot(pose), ((1.3, 1.0), BLUE))
    assert found.pose is not None
    assert np.allclose(found.pose, pose, atol=0.005)
    place, _ = EYE.to_floor(found.beside)
    assert np.allclose(place, [[1.3, 1.0]], atol=0.002)


def test_atalis_noise_is_an_option_with_a_floor_on_the_angle() -> None:
    cov = np.tile(1e-6 * np.eye(3), (2, 1, 1))
    assert tag_covariance(cov, CONFIG) is cov
    paper = tag_covariance(cov, TagConfig(sigma_law="paper"))
    assert np.allclose(np.sqrt(np.diagonal(paper, axis1=1, axis2=2)), (0.1, 0.1, np.radians(2.0)))


# ---- whole logs -------------------------------------------------------------------------------


def test_rendered_images_give_poses_with_honest_noise(small: Scenario, tmp_path: Path) -> None:
    log = open_log(simulate(small, tmp_path / "log", seed=3))
    config = ExtractConfig(tags=TagConfig(sigma_m=0.001))
    measurements = extract(log, config)
    fixes, off = measurements.sightings[KIND], errors(log, measurements)
    lost = sum(n for reason, n in measurements.rejected.items() if reason in overhead.NO_POSE)
    assert len(fixes) + lost == len(log.images_of("overhead")) == len(measurements.t)
    assert 0.03 < lost / len(measurements.t) < 0.2
    nees = np.einsum("ki,kij,kj->k", off, np.linalg.inv(fixes.cov), off) / 3.0
    assert 0.7 < nees.mean() < 1.4
    assert np.abs(off[:, :2]).max() < 0.006
    assert np.array_equal(log.images.t[fixes.source], measurements.t[fixes.node])
    assert open_log(simulate(small, tmp_path / "again", seed=3)).digest == log.digest


def test_tags_without_images_have_the_noise_that_they_state(small: Scenario) -> None:
    chi = []
    for seed in range(6):
        log = simulate_log(moved(small, tag_noise=0.003), seed)
        measurements = extract(log)
        off, cov = errors(log, measurements), measurements.sightings[KIND].cov
        chi.append(np.einsum("ki,kij,kj->k", off, np.linalg.inv(cov), off) / 3.0)
    assert np.mean(np.concatenate(chi)) == pytest.approx(1.0, abs=0.08)


def test_exchanged_tags_are_told_from_odometry_and_never_used(small: Scenario) -> None:
    scenario = moved(small, exchanged_from=16.0)
    log = simulate_log(scenario, 1)
    measurements = extract(log)
    assert log.pose_fixes is not None
    exchanged = int(np.sum(log.pose_fixes.t >= 16.0))
    assert measurements.rejected[TURNED] == exchanged > 20
    assert np.abs(errors(log, measurements)).max() < 0.1
    warnings = "\n".join(extraction_warnings(log, measurements))
    assert f"were the tags exchanged?: {exchanged}" in warnings
    assert "no pose fix from t = " in warnings


def test_a_pair_of_objects_like_the_tags_is_told_from_the_robot_while_it_is_hidden(
    small: Scenario, tmp_path: Path
) -> None:
    pair = (
        ColouredObject(1.0, 0.75, "centre", 0.06),
        ColouredObject(1.0, 0.87, "front", 0.06),
    )
    scenario = moved(small, objects=pair, hidden=((10.0, 20.0),), miss_rate=0.0)
    log = open_log(simulate(scenario, tmp_path / "log", seed=4))
    measurements = extract(log)
    assert measurements.rejected[CONTRADICTED] + measurements.rejected[TURNED] >= 38
    assert measurements.rejected[overhead.AMBIGUOUS] > 0
    assert np.abs(errors(log, measurements)[:, :2]).max() < 0.01


def test_a_minute_without_tags_is_bridged_and_stated(small: Scenario) -> None:
    scenario = moved(replace(small, repeat=3), hidden=((10.0, 70.0),), miss_rate=0.0)
    log = simulate_log(scenario, 5)
    measurements = extract(log)
    after = measurements.t[measurements.sightings[KIND].node] >= 70.0
    assert after.sum() > 100  # the robot is recognised where odometry lost it
    assert "(60.2 s)" in "\n".join(extraction_warnings(log, measurements))


def test_a_robot_that_is_lifted_is_followed_and_told(small: Scenario) -> None:
    log = simulate_log(small, 6)
    fixes = log.pose_fixes
    assert fixes is not None
    late = fixes.t > 15.0
    elsewhere = np.where(late[:, None], compose(np.array([0.3, 0.1, 1.5]), fixes.z), fixes.z)
    measurements = extract(replace(log, pose_fixes=replace(fixes, z=elsewhere)))
    assert measurements.rejected[BREAKS] == 1
    assert len(measurements.sightings[KIND]) == len(fixes.t)
    all_kept = extract(replace(log, pose_fixes=fixes))
    assert BREAKS not in all_kept.rejected


def test_single_wrong_fixes_are_left_out_unless_told_otherwise(small: Scenario) -> None:
    log = simulate_log(small, 7)
    assert log.pose_fixes is not None
    z = log.pose_fixes.z.copy()
    z[[20, 40, 41]] += (0.1, -0.05, 0.0)
    spoiled = replace(log, pose_fixes=replace(log.pose_fixes, z=z))
    measurements = extract(spoiled)
    assert measurements.rejected[CONTRADICTED] == 3
    assert np.abs(errors(log, measurements)[:, :2]).max() < 0.02
    unchecked = extract(spoiled, ExtractConfig(tags=TagConfig(check=False)))
    assert len(unchecked.sightings[KIND]) == len(z)


def test_without_a_start_the_first_fix_tells_it(small: Scenario) -> None:
    log = replace(simulate_log(small, 8), start_given=False, start_pose=np.zeros(3))
    measurements = extract(log)
    assert np.allclose(measurements.start_pose, measurements.sightings[KIND].z[0])
    assert np.sqrt(measurements.start_cov[0, 0]) > 1.0
    assert "the first pose fix places the robot" in "\n".join(
        extraction_warnings(log, measurements)
    )


def test_atalis_process_noise_depends_on_time_alone(small: Scenario) -> None:
    log = simulate_log(small, 9)
    measurements = extract(log, ExtractConfig(noise=NoiseConfig(process_mps=2.0)))
    dt = np.diff(measurements.t)
    assert np.allclose(measurements.odometry.cov, np.square(2.0 * dt)[:, None, None] * np.eye(3))


def test_a_bag_with_overhead_images_gives_the_same_poses(small: Scenario, tmp_path: Path) -> None:
    short = replace(small, path=small.path[:1])
    log = open_log(simulate(short, tmp_path / "log", seed=2))
    write_bag(log, tmp_path / "x.mcap", "mcap")
    (tmp_path / "robot.toml").write_text(robot_file_text(log))
    bag = open_log(tmp_path / "x.mcap", tmp_path / "robot.toml")
    found, before = extract(bag).sightings[KIND], extract(log).sightings[KIND]
    assert len(found) == len(before) > 8
    assert np.allclose(found.z, before.z, atol=1e-9)


def test_what_a_camera_shows_may_be_known_later(small: Scenario, tmp_path: Path) -> None:
    folder = simulate(replace(small, path=small.path[:1]), tmp_path / "log", seed=2)
    text = (folder / "log.toml").read_text()
    (folder / "log.toml").write_text(text.replace("image_size", "delay = 0.3\nimage_size"))
    measurements = extract(open_log(folder))
    fixes = measurements.sightings[KIND]
    assert np.allclose(fixes.t_received - measurements.t[fixes.node], 0.3)


def test_inspect_tells_why_a_camera_hardly_sees_the_tags(small: Scenario, tmp_path: Path) -> None:
    folder = simulate(replace(small, path=small.path[:1]), tmp_path / "log", seed=2)
    good = inspect(open_log(folder))
    assert not good.findings
    assert not next(need for need in good.needs if need.purpose == "ekf").missing
    text = (folder / "log.toml").read_text()
    (folder / "log.toml").write_text(text.replace("front = [0.12", "front = [0.2"))
    (finding,) = inspect(open_log(folder)).findings
    assert overhead.APART in finding.found
    assert "[cameras.overhead.tags]" in finding.cure


LOG_TOML = """
format = "graphslam-log/1"

[robot]
wheel_radius_left = 0.05
wheel_radius_right = 0.05
wheel_base = 0.2

[cameras.above]
looks_at = "overhead"
image_size = [320, 240]
homography = [[150.0, 0.0, 10.0], [0.0, -150.0, 230.0], [0.0, 0.0, 1.0]]
"""
TAGS = "\n[cameras.above.tags]\nfront = [0.12, 0.0]\n"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (LOG_TOML, "cameras.above.tags is missing"),
        (LOG_TOML + TAGS + "size = 3\n", "size"),
        (LOG_TOML + TAGS + "height = 0.2\n", "needs position"),
        (LOG_TOML + TAGS + "diameter = -1\n", "must be positive"),
        (LOG_TOML + TAGS + "centre = [0.12, 0.0]\n", "at one place"),
    ],
)
def test_a_camera_described_wrongly_is_refused(tmp_path: Path, text: str, told: str) -> None:
    (tmp_path / "log.toml").write_text(text)
    (tmp_path / "wheels.csv").write_text("t,left,right\n0,0,0\n1,1,1\n")
    with pytest.raises(BadLog, match=told):
        open_log(tmp_path)


def test_an_image_of_another_size_is_refused_and_an_unreadable_one_counted(tmp_path: Path) -> None:
    (tmp_path / "log.toml").write_text(LOG_TOML + TAGS)
    (tmp_path / "wheels.csv").write_text("t,left,right\n0,0,0\n1,1,1\n")
    (tmp_path / "images.csv").write_text("t,file,camera\n0,a.png,above\n1,b.png,above\n")
    (tmp_path / "b.png").write_bytes(cv2.imencode(".png", picture(*robot((0.6, 0.7, 0.0))))[1])
    (tmp_path / "a.png").write_bytes(b"")
    measurements = extract(open_log(tmp_path))
    assert measurements.rejected["overhead image that cannot be read"] == 1
    assert len(measurements.sightings[KIND]) == 1
    (tmp_path / "a.png").write_bytes(cv2.imencode(".png", np.zeros((24, 32, 3), np.uint8))[1])
    with pytest.raises(BadLog, match=r"a.png: is 32 x 24 pixels"):
        extract(open_log(tmp_path))
