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
from frontend.log import AnyCamera, Log
from frontend.log_parts import PoseTrack, Wheels
from frontend.simulate.bearings import draw_bearings
from frontend.simulate.cones import cone_landmarks, omni_camera
from frontend.simulate.drive import Drive, drive
from frontend.simulate.lamps import draw_lamp_sightings, upward_camera
from frontend.simulate.overhead import draw_fixes
from frontend.simulate.scenario import Scenario
from frontend.simulate.series import image_series
from frontend.simulate.sightings import camera_in_log, draw_sightings
from frontend.simulate.view import camera_of
from frontend.simulate.workspace import overhead_camera
from frontend.simulate.world import floor_lines, floor_stretches
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
    start = run.pose_at(np.array([first]))[0]
    log = _log(scenario, run, start, camera_in_log(scenario))
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


def _log(scenario: Scenario, run: Drive, start: Array, floor: Camera | None) -> Log:
    """Returns what a log holds with images and without; ``floor`` looks at the floor."""
    lines, stretch = floor_lines(scenario), floor_stretches(scenario)
    count, ceiling = len(lines), scenario.ceiling
    return Log(
        name=scenario.name,
        folder=Path(scenario.name),
        robot=scenario.robot,
        cameras=_cameras(scenario, floor),
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
        landmarks=_landmarks(scenario),
    )


def _cameras(scenario: Scenario, floor: Camera | None) -> dict[str, AnyCamera]:
    """Returns the cameras that a log describes, by name."""
    ceiling, overhead, omni = scenario.ceiling, scenario.overhead, scenario.omni
    eyes = (
        floor,
        None if ceiling is None else upward_camera(ceiling.camera),
        None if overhead is None else overhead_camera(overhead),
        None if omni is None else omni_camera(omni, scenario.cones),
    )
    return {eye.name: eye for eye in eyes if eye is not None}


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
    camera = None if scenario.camera is None else camera_of(scenario.camera)
    log = _log(scenario, run, pose, camera)
    write_log(folder, log, exact=False)
    series = image_series(scenario, run, streams)
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
