"""A simulated drive as a log: with images in a folder, or with sightings, in a folder or not."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from frontend.camera import Camera
from frontend.extract import extract
from frontend.log import DEFAULT_CAMERA, Log, PoseTrack, Wheels
from frontend.simulate.drive import Drive, drive
from frontend.simulate.render import pixel_grid, render
from frontend.simulate.scenario import Scenario
from frontend.simulate.sightings import camera_in_log, draw_sightings
from frontend.simulate.view import camera_of
from frontend.simulate.world import build_world, floor_lines, floor_stretches
from frontend.write_folder import write_images_csv, write_log
from graphslam.errors import BadConfig
from graphslam.geometry import Array
from graphslam.measurements import LandmarkMap, Measurements

Progress = Callable[[int, int], None]


def simulate(
    scenario: Scenario,
    out: Path | str,
    seed: int = 0,
    progress: Progress | None = None,
    images: bool = True,
) -> Path:
    """Returns the log folder that one drive of a scenario was written to.

    The folder is written beside its final place and renamed when whole. The same scenario and seed
    give the same bytes.

    Args:
        scenario: what to simulate.
        out: the folder to make; it must not exist.
        seed: decides wheel noise, slip, the floor's patterns, the pixels' noise and the sightings,
            each by a stream of its own; not negative.
        progress: called after each image with how many are done, and of how many.
        images: whether to render images; else the lines seen are written, as by `simulate_log`.

    Raises:
        BadConfig: the folder exists or cannot be made, or the scenario's camera is none.
    """
    out = Path(out)
    _refuse_existing(out)
    if images and scenario.camera is None:
        raise BadConfig(
            f"{scenario.name}: has no [camera] to render images with; add one, or simulate without "
            "images (--no-images)"
        )
    log = None if images else simulate_log(scenario, seed)
    streams = _streams(seed)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{out.name}-", dir=out.parent) as beside:
            folder = Path(beside) / "log"
            folder.mkdir()
            if log is None:
                _write_with_images(folder, scenario, streams, progress)
            else:
                write_log(folder, log, exact=True)
            _refuse_existing(out)
            folder.rename(out)
    except OSError as reason:
        raise BadConfig(
            f"{out}: cannot be written ({reason.strerror}); choose another folder"
        ) from reason
    return out


def simulate_log(scenario: Scenario, seed: int = 0) -> Log:
    """Returns one drive of a scenario as a log in memory, with sightings instead of images.

    It is the log that ``simulate(..., images=False)`` writes; both give the same measurements,
    to the last bit. Frames in which no line is seen are no nodes, so ``[start]`` is the true pose
    at the first frame in which one is.

    Args:
        scenario: what to simulate.
        seed: as of `simulate`; wheels and slip are those of the log with images.

    Raises:
        BadConfig: the scenario's camera is none, or the seed is negative.
    """
    streams = _streams(seed)
    run = _drive(scenario, streams)
    seen = draw_sightings(scenario, run, streams[4])
    first = np.searchsorted(run.frame_t, seen.t[0]) if len(seen.t) else 0
    camera = camera_in_log(scenario)
    start = run.pose_at_frames()[first]
    log = _log(scenario, run, start, {} if camera is None else {DEFAULT_CAMERA: camera})
    digest = hashlib.sha256(f"{scenario.digest()} {seed}".encode()).hexdigest()
    return replace(log, sightings=seen, digest=digest)


def simulate_measurements(scenario: Scenario, seed: int = 0) -> Measurements:
    """Returns what estimators eat of `simulate_log`."""
    return extract(simulate_log(scenario, seed))


def _streams(seed: int) -> list[np.random.SeedSequence]:
    """Returns the seeds of wheels, slip, the floor's patterns, pixels and sightings."""
    if seed < 0:
        raise BadConfig(f"seed = {seed}: must be 0 or more")
    return np.random.SeedSequence(seed).spawn(5)


def _drive(scenario: Scenario, streams: list[np.random.SeedSequence]) -> Drive:
    wheels, slip = map(np.random.default_rng, streams[:2])
    return drive(scenario, wheels, slip)


def _refuse_existing(out: Path) -> None:
    if out.exists() or out.is_symlink():
        raise BadConfig(f"{out}: exists already; choose another folder, or remove this one first")


def _log(scenario: Scenario, run: Drive, start: Array, cameras: dict[str, Camera]) -> Log:
    """Returns what a log holds with images and without."""
    lines, stretch = floor_lines(scenario), floor_stretches(scenario)
    count = len(lines)
    return Log(
        name=scenario.name,
        folder=Path(scenario.name),
        robot=scenario.robot,
        cameras=cameras,
        start_pose=start if scenario.start.known else np.zeros(3),
        start_sigma=np.zeros(3),
        start_given=scenario.start.known,
        wheels=Wheels(run.wheel_t, run.wheel_angle),
        odometry=None,
        images=None,
        sightings=None,
        pose_fixes=None,
        truth=PoseTrack(run.t, run.pose),
        map=LandmarkMap(
            id=np.arange(count),
            kind=("line",) * count,
            params=lines,
            extent=np.where(np.isfinite(stretch), stretch, np.nan),
            sightings=np.zeros(count, np.int64),
        ),
        warnings=(),
        digest="",
    )


def _write_with_images(
    folder: Path,
    scenario: Scenario,
    streams: list[np.random.SeedSequence],
    progress: Progress | None,
) -> None:
    assert scenario.camera is not None, "checked before"
    camera = camera_of(scenario.camera)
    run = _drive(scenario, streams)
    start = scenario.start
    pose = np.array([start.x, start.y, np.deg2rad(start.heading_deg)])
    write_log(folder, _log(scenario, run, pose, {DEFAULT_CAMERA: camera}), exact=False)
    world = build_world(scenario, np.random.default_rng(streams[2]))
    pixels = np.random.default_rng(streams[3])
    grid = pixel_grid(camera, scenario.light)
    quality = scenario.camera.jpeg_quality
    options = [cv2.IMWRITE_JPEG_QUALITY, quality] if quality else []
    suffix = "jpg" if quality else "png"
    files = [f"images/{number:06d}.{suffix}" for number in range(len(run.frame_t))]
    write_images_csv(folder, run.frame_t, files)
    (folder / "images").mkdir()
    frames = zip(files, run.frame_t, run.pose_at_frames(), strict=True)
    for done, (file, t, pose) in enumerate(frames, start=1):
        image = render(scenario, world, grid, pose, float(t), pixels)
        (folder / file).write_bytes(cv2.imencode(f".{suffix}", image, options)[1].tobytes())
        if progress is not None:
            progress(done, len(files))
