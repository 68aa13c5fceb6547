"""A simulated drive as a log: with images in a folder, or with sightings, in a folder or not."""

from __future__ import annotations

import hashlib
import math
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from frontend.camera import Camera
from frontend.extract import extract
from frontend.log import DEFAULT_CAMERA, Log, PoseTrack, Wheels
from frontend.simulate.bearings import draw_bearings
from frontend.simulate.cones import OMNI, cone_landmarks, omni_camera
from frontend.simulate.drive import Drive, drive
from frontend.simulate.lamps import CAMERA as CEILING_CAMERA
from frontend.simulate.lamps import (
    ceiling_view,
    draw_lamp_sightings,
    render_ceiling,
    upward_camera,
)
from frontend.simulate.mirror import render_around
from frontend.simulate.overhead import (
    build_workspace,
    draw_fixes,
    hidden_frames,
    render_overhead,
)
from frontend.simulate.render import pixel_grid, render
from frontend.simulate.scenario import Scenario
from frontend.simulate.sightings import camera_in_log, draw_sightings
from frontend.simulate.view import camera_of
from frontend.simulate.workspace import NAME, overhead_camera
from frontend.simulate.world import World, build_world, floor_lines, floor_stretches
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
    others = (scenario.overhead, scenario.omni, scenario.ceiling)
    blind = all(other is None for other in others) or scenario.sees_lines
    if images and scenario.camera is None and blind:
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
    seen = draw_sightings(scenario, run, streams[4]) if scenario.sees_lines else None
    fixes = None if scenario.overhead is None else draw_fixes(scenario, run, streams[5])
    ceiling = scenario.ceiling
    lamps = None if ceiling is None else draw_lamp_sightings(ceiling, run, streams[4])
    bearings = None if scenario.omni is None else draw_bearings(scenario, run, streams[6])
    parts = (part for part in (seen, fixes, lamps, bearings) if part is not None and len(part.t))
    first = min((part.t[0] for part in parts), default=0.0)
    camera = camera_in_log(scenario)
    start = run.pose_at(np.array([first]))[0]
    log = _log(scenario, run, start, {} if camera is None else {DEFAULT_CAMERA: camera})
    digest = hashlib.sha256(f"{scenario.digest()} {seed}".encode()).hexdigest()
    log = replace(log, sightings=seen, pose_fixes=fixes, digest=digest)
    return replace(log, lamps=lamps, bearings=bearings)


def simulate_measurements(scenario: Scenario, seed: int = 0) -> Measurements:
    """Returns what estimators eat of `simulate_log`."""
    return extract(simulate_log(scenario, seed))


def _streams(seed: int) -> list[np.random.SeedSequence]:
    """Returns the seeds of wheels, slip, patterns, pixels, sightings, tags and bearings."""
    if seed < 0:
        raise BadConfig(f"seed = {seed}: must be 0 or more")
    return np.random.SeedSequence(seed).spawn(7)


def _drive(scenario: Scenario, streams: list[np.random.SeedSequence]) -> Drive:
    wheels, slip = map(np.random.default_rng, streams[:2])
    return drive(scenario, wheels, slip)


def _refuse_existing(out: Path) -> None:
    if out.exists() or out.is_symlink():
        raise BadConfig(f"{out}: exists already; choose another folder, or remove this one first")


def _log(scenario: Scenario, run: Drive, start: Array, cameras: dict[str, Camera]) -> Log:
    """Returns what a log holds with images and without."""
    lines, stretch = floor_lines(scenario), floor_stretches(scenario)
    count, ceiling = len(lines), scenario.ceiling
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
        map=None
        if ceiling is not None
        else LandmarkMap(
            id=np.arange(count),
            kind=("line",) * count,
            params=lines,
            extent=np.where(np.isfinite(stretch), stretch, np.nan),
            sightings=np.zeros(count, np.int64),
        ),
        warnings=(),
        digest="",
        overhead={} if scenario.overhead is None else {NAME: overhead_camera(scenario.overhead)},
        landmarks=_landmarks(scenario),
        ceiling={} if ceiling is None else {CEILING_CAMERA: upward_camera(ceiling.camera)},
        omni={} if scenario.omni is None else {OMNI: omni_camera(scenario.omni, scenario.cones)},
    )


def _landmarks(scenario: Scenario) -> LandmarkMap | None:
    """Returns the landmarks that are no lines and that log folders tell of, None for none."""
    ceiling = scenario.ceiling
    lamps = ceiling.landmarks() if ceiling is not None and ceiling.known else None
    if not scenario.cones:
        return lamps
    cones = cone_landmarks(scenario.cones)
    return cones if lamps is None else cones.joined(lamps)


def _write_with_images(
    folder: Path,
    scenario: Scenario,
    streams: list[np.random.SeedSequence],
    progress: Progress | None,
) -> None:
    run = _drive(scenario, streams)
    start = scenario.start
    pose = np.array([start.x, start.y, np.deg2rad(start.heading_deg)])
    cameras = {} if scenario.camera is None else {DEFAULT_CAMERA: camera_of(scenario.camera)}
    log = _log(scenario, run, pose, cameras)
    write_log(folder, log, exact=False)
    world = build_world(scenario, np.random.default_rng(streams[2]))
    series = [
        part
        for part in (
            _floor_images(scenario, world, run, streams[3], cameras),
            _overhead_images(scenario, world, run, streams[3], streams[5]),
            _ceiling_images(scenario, run, *streams[2:4]),
            _omni_images(scenario, run, streams[6]),
        )
        if part is not None
    ]
    t = np.concatenate([part.t for part in series])
    files = [file for part in series for file in part.files]
    names = [part.camera for part in series for _ in part.files]
    order = np.argsort(t, kind="stable").tolist()
    write_images_csv(folder, t[order], [files[k] for k in order], [names[k] for k in order])
    done = 0
    for part in series:
        (folder / part.files[0]).parent.mkdir()
        options = [cv2.IMWRITE_JPEG_QUALITY, part.quality] if part.quality else []
        for file, image in zip(part.files, part.pictures, strict=True):
            data = cv2.imencode(Path(file).suffix, image, options)[1]
            (folder / file).write_bytes(data.tobytes())
            done += 1
            if progress is not None:
                progress(done, len(files))


@dataclass(frozen=True, slots=True)
class _Series:
    """The images of one camera: their times, files, quality, and what draws them in order."""

    camera: str
    t: Array
    files: list[str]
    quality: int
    pictures: Iterator[NDArray[np.uint8]]


def _files(folder: str, count: int, quality: int) -> list[str]:
    suffix = "jpg" if quality else "png"
    return [f"{folder}/{number:06d}.{suffix}" for number in range(count)]


def _floor_images(
    scenario: Scenario,
    world: World,
    run: Drive,
    seed: np.random.SeedSequence,
    cameras: dict[str, Camera],
) -> _Series | None:
    if scenario.camera is None:
        return None
    grid = pixel_grid(cameras[DEFAULT_CAMERA], scenario.light)
    pixels, quality = np.random.default_rng(seed), scenario.camera.jpeg_quality
    frames = zip(run.frame_t.tolist(), run.pose_at_frames(), strict=True)
    pictures = (render(scenario, world, grid, pose, t, pixels) for t, pose in frames)
    files = _files("images", len(run.frame_t), quality)
    return _Series(DEFAULT_CAMERA, run.frame_t, files, quality, pictures)


def _overhead_images(
    scenario: Scenario,
    world: World,
    run: Drive,
    pixel_seed: np.random.SeedSequence,
    tag_seed: np.random.SeedSequence,
) -> _Series | None:
    spec = scenario.overhead
    if spec is None:
        return None
    workspace = build_workspace(scenario, world)
    lost, tags = map(np.random.default_rng, tag_seed.spawn(2))
    pixels = np.random.default_rng(pixel_seed.spawn(1)[0])
    hidden = hidden_frames(spec, run.overhead_t, lost)
    frames = zip(run.overhead_t.tolist(), run.pose_at(run.overhead_t), hidden, strict=True)
    pictures = (
        render_overhead(scenario, workspace, pose, t, bool(covered), pixels, tags)
        for t, pose, covered in frames
    )
    files = _files(NAME, len(run.overhead_t), spec.jpeg_quality)
    return _Series(NAME, run.overhead_t, files, spec.jpeg_quality, pictures)


def _ceiling_images(
    scenario: Scenario,
    run: Drive,
    fringe_seed: np.random.SeedSequence,
    pixel_seed: np.random.SeedSequence,
) -> _Series | None:
    ceiling = scenario.ceiling
    if ceiling is None:
        return None
    camera = upward_camera(ceiling.camera)
    view = ceiling_view(ceiling, camera, np.random.default_rng(fringe_seed))
    pixels, quality = np.random.default_rng(pixel_seed), ceiling.camera.jpeg_quality
    frames = zip(run.frame_t.tolist(), run.pose_at_frames(), strict=True)
    pictures = (render_ceiling(ceiling, view, pose, t, pixels) for t, pose in frames)
    files = _files("images", len(run.frame_t), quality)
    return _Series(CEILING_CAMERA, run.frame_t, files, quality, pictures)


def _omni_images(scenario: Scenario, run: Drive, seed: np.random.SeedSequence) -> _Series | None:
    spec = scenario.omni
    if spec is None:
        return None
    pixels, light = np.random.default_rng(seed), scenario.light
    frames = zip(run.omni_t.tolist(), run.pose_at(run.omni_t), strict=True)
    pictures = (
        render_around(
            spec,
            scenario.cones,
            pose,
            scenario.surface.grey,
            pixels,
            1.0 + light.drift * math.sin(2.0 * math.pi * t / light.drift_period),
        )
        for t, pose in frames
    )
    files = _files(OMNI, len(run.omni_t), spec.jpeg_quality)
    return _Series(OMNI, run.omni_t, files, spec.jpeg_quality, pictures)
