"""What a log holds, what it is good for, and what looks wrong in it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from frontend.config import DetectorConfig
from frontend.findings import Evidence, Finding, odometry_findings
from frontend.findings_seen import seen_findings
from frontend.findings_tags import tag_findings
from frontend.log import Log
from frontend.moves import moves_of
from frontend.sample import Frame, sample_frames
from frontend.search import Progress
from frontend.turning import TurnCheck
from frontend.view import View, view_of
from graphslam.geometry import Array


@dataclass(frozen=True, slots=True)
class Source:
    """The times of one part of a log.

    Attributes:
        file: name of the file in a log folder, or of the topic in a bag.
        rows: how many rows it has.
        first_s: first time, s.
        last_s: last time, s.
        rate_hz: one over the median step between distinct times; NaN for a single time.
        jitter_s: half the width that holds the middle 68 % of the steps, s; NaN likewise.
        gap_s: longest step, s; NaN likewise.
        gap_at_s: time before the longest step, s; NaN likewise.
        overlap: share of its times that lie within the odometry's.
    """

    file: str
    rows: int
    first_s: float
    last_s: float
    rate_hz: float
    jitter_s: float
    gap_s: float
    gap_at_s: float
    overlap: float


@dataclass(frozen=True, slots=True)
class Need:
    """What a log lacks for one purpose.

    Attributes:
        purpose: a method, or judging it.
        missing: what to add; empty where nothing is missing.
    """

    purpose: str
    missing: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Inspection:
    """What `inspect` found out about a log.

    Attributes:
        name: of the log.
        folder: where it lies.
        sources: times of each part, odometry first.
        driven_m: length of the way by odometry, m.
        turned_rad: turns by odometry, either way added up, rad.
        net_turn_rad: left turns less right turns, rad.
        speed_mps: median (while moving) and largest speed by odometry, m/s.
        wheel_rate: (2,) largest speed of the left and right wheel, rad/s; NaN without wheels.
        views: what each floor camera sees.
        images: how many images of floor cameras there are.
        frames: the sample, `SAMPLE` frames evenly spaced over the log.
        turns: turning of wheels against lines; None where the log tells nothing about it.
        needs: what is missing for which purpose.
        findings: what looks wrong.
        warnings: what the reader of the log warned about.
    """

    name: str
    folder: Path
    sources: tuple[Source, ...]
    driven_m: float
    turned_rad: float
    net_turn_rad: float
    speed_mps: tuple[float, float]
    wheel_rate: Array
    views: tuple[View, ...]
    images: int
    frames: tuple[Frame, ...]
    turns: TurnCheck | None
    needs: tuple[Need, ...]
    findings: tuple[Finding, ...]
    warnings: tuple[str, ...]


def inspect(
    log: Log, detector: DetectorConfig | None = None, progress: Progress | None = None
) -> Inspection:
    """Returns what a log holds, what it lacks for which purpose, and what looks wrong in it.

    Up to `SAMPLE` images, evenly spaced, and as many as 160 next to turns are searched for lines.

    Args:
        log: the recording.
        detector: how to look for lines; None for the defaults.
        progress: called with (images searched, images in all).

    Raises:
        BadLog: an image has not the size that the log states.
    """
    detector = detector or DetectorConfig()
    moves = moves_of(log)
    sample, turns = sample_frames(log, moves, detector, progress)
    cameras = sorted(log.looking_at("floor").items())
    views = tuple(view_of(camera, detector.coarsest_pixel_m) for _, camera in cameras)
    evidence = Evidence(log, moves, views, sample, turns, detector)
    return Inspection(
        name=log.name,
        folder=log.folder,
        sources=tuple(_sources(log)),
        driven_m=float(moves.length.sum()),
        turned_rad=moves.turned(),
        net_turn_rad=float(moves.heading[-1]),
        speed_mps=moves.typical_speed(),
        wheel_rate=_wheel_rate(log),
        views=views,
        images=len(log.images_of("floor")),
        frames=sample,
        turns=turns,
        needs=tuple(_needs(log)),
        findings=(
            *odometry_findings(evidence),
            *seen_findings(evidence),
            *tag_findings(log),
        ),
        warnings=log.warnings,
    )


def _wheel_rate(log: Log) -> Array:
    if log.wheels is None:
        return np.full(2, np.nan)
    rate = np.diff(log.wheels.angle, axis=0) / np.diff(log.wheels.t)[:, None]
    return np.asarray(np.abs(rate).max(axis=0))


def _sources(log: Log) -> Iterator[Source]:
    names = (
        "wheels",
        "odometry",
        "images",
        "sightings",
        "pose_fixes",
        "bearings",
        "lamps",
        "scans",
        "truth",
    )
    parts = {log.labels[name]: getattr(log, name) for name in (*names, "truth")}
    known = (log.wheels or log.odometry).t  # type: ignore[union-attr]
    for file, part in parts.items():
        if part is None or not len(part.t):
            continue
        t = np.unique(part.t)
        inside = float(np.mean((t >= known[0]) & (t <= known[-1])))
        step = np.diff(t)
        if len(step):
            low, high = np.percentile(step, [16, 84])
            gap = int(step.argmax())
            times = (1 / np.median(step), 0.5 * (high - low), step[gap], t[gap])
        else:
            times = (np.nan,) * 4
        yield Source(file, len(part.t), float(t[0]), float(t[-1]), *map(float, times), inside)


def _needs(log: Log) -> Iterator[Need]:
    """Yields what is missing for each purpose."""
    images = log.images is not None and len(log.images_of("floor")) > 0
    others = len(np.setdiff1d(log.searched_images(), log.images_of("floor"))) > 0
    given = log.sightings is not None and len(log.sightings.t) > 0
    fixes = log.pose_fixes is not None and len(log.pose_fixes.t) > 0
    points = any(part is not None and len(part.t) > 0 for part in (log.bearings, log.lamps))
    sensor = given or fixes or points or others or (images and log.sightings is None)
    lines = () if sensor else ("images.csv with a [camera], sightings.csv or tags.csv",)
    path = () if log.truth is not None else ("groundtruth.tum",)
    lines_true = () if log.map is not None else ("map.csv",)
    start = () if log.start_given and not log.start_sigma.any() else ("[start] with sigma 0",)
    yield Need("odometry", ())
    yield Need("ekf", lines)
    yield Need("smoother", lines)
    bearings = len(log.images_of("omni")) or (log.bearings is not None and len(log.bearings.t))
    if bearings:
        known = log.landmarks is not None and len(log.landmarks.of_kind("bearing")[0]) > 2
        yield Need("triangulation", () if known else ("landmarks.csv with three points or more",))
    yield Need("judging the path", path)
    yield Need("judging the map", lines_true)
    yield Need("judging consistency", (*path, *start))
