"""A simulated drive seen through its images, which go straight into the detector."""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace

import numpy as np

from frontend.config import DetectorConfig, NoiseConfig
from frontend.log import Log
from frontend.nodes import odometry_at
from frontend.simulate import Scenario, simulate_log
from frontend.simulate.drive import TIME_DECIMALS
from frontend.truth import true_lines
from graphslam.errors import BadConfig
from graphslam.geometry import Array, interpolate_poses
from graphslam.measurements import IntArray, Measurements, Sightings
from graphslam.models.line import LINE

CHUNK = 60
"""Frames that a worker renders before it hands in what it has seen."""
KNOWN_COV = 1e-12 * np.eye(3)
"""Covariance of the start, which is known, m and rad."""

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, slots=True)
class Filmed:
    """One drive as its images showed it.

    Attributes:
        log: wheels, true path and true lines; no images, as none were kept.
        measurements: every frame is a node.
        seconds: mean wall time of a frame: "render" (what a camera does by itself) and "detect".
    """

    log: Log
    measurements: Measurements
    seconds: dict[str, float]


@dataclass(frozen=True, slots=True)
class Seen:
    """What the detector made of a few frames; arrays as in `frontend.detected.DetectedLines`.

    Attributes:
        frame: (K,) frame of each line.
        z: (K, 2) lines, robot frame.
        cov: (K, 2, 2) their covariances, robot frame.
        extent: (K, 2) stretch seen, m.
        quality: (K,) how well.
        rejected: lines that were left out, by reason.
        render_s: wall time of all these frames' rendering, s.
        detect_s: the same of detection, s.
    """

    frame: IntArray
    z: Array
    cov: Array
    extent: Array
    quality: Array
    rejected: dict[str, int]
    render_s: float
    detect_s: float


def drive_of(scenario: Scenario, detector: DetectorConfig, seed: int) -> Log:
    """Returns the drive of a scenario whose frames are to be filmed; the digest says with what."""
    log = simulate_log(scenario, seed)
    start = scenario.start
    pose = np.array([start.x, start.y, np.radians(start.heading_deg)])
    said = json.dumps([scenario.digest(), seed, asdict(detector)])
    return replace(
        log,
        start_pose=pose if start.known else np.zeros(3),
        sightings=None,
        digest=hashlib.sha256(said.encode()).hexdigest(),
    )


def film(
    scenario: Scenario,
    detector: DetectorConfig,
    seed: int,
    *,
    jobs: int = 0,
    progress: Progress | None = None,
) -> Filmed:
    """Returns what the detector sees in the images of a drive; they are rendered one by one.

    Images are those of `frontend.simulate.simulate` but for the pixels' noise, which is drawn for
    each frame by itself, and without the loss of JPEG.

    Args:
        scenario: with a camera.
        detector: method, noise law, thresholds.
        seed: of the drive, the floor's patterns and the pixels' noise.
        jobs: worker processes; 0: as many as the machine has cores. Changes no measurement.
        progress: told about each chunk of frames.
    """
    import joblib

    if scenario.camera is None:
        raise BadConfig(f"{scenario.name}: has no [camera] to render images with; add one")
    log = drive_of(scenario, detector, seed)
    assert log.truth is not None, "simulated"
    count = int(np.floor(log.truth.t[-1] * scenario.rate + 1e-6)) + 1
    t = np.round(np.arange(count) / scenario.rate, TIME_DECIMALS)
    pose = interpolate_poses(t, log.truth.t, log.truth.pose)
    chunks = np.split(np.arange(count), np.arange(CHUNK, count, CHUNK))
    seen = []
    workers = jobs or os.cpu_count() or 1
    with joblib.parallel_config(backend="loky", n_jobs=workers, inner_max_num_threads=1):
        parallel = joblib.Parallel(return_as="generator")
        work = (
            joblib.delayed(look)(scenario, detector, seed, frames, t[frames], pose[frames])
            for frames in chunks
        )
        for part in parallel(work):
            seen.append(part)
            if progress is not None:
                progress(f"{scenario.name}: images", min(CHUNK * len(seen), count), count)
    render, detect = (sum(getattr(s, n) for s in seen) for n in ("render_s", "detect_s"))
    seconds = {"render": render / count, "detect": detect / count}
    return Filmed(log, _measurements(log, t, seen), seconds)


def look(
    scenario: Scenario,
    detector: DetectorConfig,
    seed: int,
    frames: IntArray,
    t: Array,
    pose: Array,
) -> Seen:
    """Returns the lines in a few frames, each rendered, looked at and forgotten.

    Args:
        scenario: with a camera.
        detector: method, noise law, thresholds.
        seed: of the floor's patterns and the pixels' noise.
        frames: (n,) numbers of the frames.
        t: (n,) their times, s.
        pose: (n, 3) true poses of the robot.
    """
    from frontend.lines import detect_lines
    from frontend.simulate.render import pixel_grid, render
    from frontend.simulate.view import camera_of
    from frontend.simulate.world import build_world

    assert scenario.camera is not None, "checked before"
    world = build_world(
        scenario, np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(2,)))
    )
    camera = camera_of(scenario.camera)
    grid = pixel_grid(camera, scenario.light)
    found, spent = [], [0.0, 0.0]
    for number, at, here in zip(frames.tolist(), t.tolist(), pose, strict=True):
        pixels = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(3, number)))
        began = time.perf_counter()
        image = render(scenario, world, grid, here, at, pixels)
        shown = time.perf_counter()
        found.append(detect_lines(image, camera, detector))
        spent[0] += shown - began
        spent[1] += time.perf_counter() - shown
    rejected: Counter[str] = Counter()
    for lines in found:
        rejected.update(lines.rejected)
    return Seen(
        np.repeat(frames, [len(lines) for lines in found]),
        *(
            np.concatenate([getattr(f, n) for f in found])
            for n in ("z", "cov", "extent", "quality")
        ),
        dict(rejected),
        *spent,
    )


def _measurements(log: Log, t: Array, seen: list[Seen]) -> Measurements:
    """Returns all that was seen, every frame a node."""
    frame, z, cov, extent, quality = (
        np.concatenate([getattr(s, name) for s in seen])
        for name in ("frame", "z", "cov", "extent", "quality")
    )
    rejected: Counter[str] = Counter()
    for part in seen:
        rejected.update(part.rejected)
    lines = Sightings(
        kind=LINE.kind,
        node=frame,
        z=z,
        cov=cov,
        extent=extent,
        t_received=t[frame],
        quality=quality,
        source=frame,
        truth=true_lines(log, t[frame], z, extent),
    )
    return Measurements(
        t=t,
        start_pose=log.start_pose,
        start_cov=KNOWN_COV,
        odometry=odometry_at(log, t, NoiseConfig()),
        sightings={LINE.kind: lines},
        rejected={reason: n for reason, n in sorted(rejected.items()) if n},
    )
