"""A log as it plays: images with what was seen in them, and the paths so far, moment by moment."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from compare.config import RunConfig
from compare.folders import writing
from compare.known import on_known_map
from compare.methods import run_methods
from compare.opening import open_as
from compare.plots_plan import stretches
from compare.plots_points import ellipses
from compare.plots_style import method_colour
from compare.replay import sighting_nodes
from compare.truth import truth_of
from frontend.extract import extract, extraction_warnings
from frontend.log import Log
from frontend.marks import Shot, shot_of
from frontend.show import Show, Track
from graphslam.errors import BadConfig
from graphslam.estimate import Estimate
from graphslam.geometry import Array, compose, inverse
from graphslam.measurements import Measurements
from graphslam.models import MODELS

Progress = Callable[[str, int, int], None]

MARGIN = 0.08
"""Room around the paths on the plan, as a share of their extent."""
LEAST_SPAN_M = 0.5
"""Smallest width and height of the plan, m."""
PAGE = ".html"
ALONE = "fixes"
"""The method that shows what a sensor of poses tells alone."""


def make_show(
    path: Path | str, config: RunConfig | None = None, progress: Progress | None = None
) -> Show:
    """Returns what is to be shown of a log: it is extracted and estimated first.

    Where a sensor reads poses directly, the method `fixes` is added: what it tells alone.

    Args:
        path: the log.
        config: methods and settings, as of a run; None for the defaults.
        progress: told about each stage.

    Raises:
        BadLog: the log cannot be used.
        BadConfig: the configuration cannot be used.
    """
    config = config or RunConfig()
    log = open_as(path, config, progress)

    def tell(stage: str) -> Callable[[int, int], None] | None:
        return None if progress is None else lambda a, b: progress(f"{log.name}: {stage}", a, b)

    measurements = on_known_map(extract(log, config.extract, tell("extract")), config.known_map)
    direct = any(not MODELS[k].dim_landmark and len(t) for k, t in measurements.sightings.items())
    if direct and ALONE not in config.methods:
        first = [name for name in config.methods if name == "odometry"]
        others = [name for name in config.methods if name != "odometry"]
        config = replace(config, methods=(*first, ALONE, *others))  # type: ignore[arg-type]
    estimates, failed = run_methods(measurements, config, lambda _, work: work())
    if not estimates:
        raise next(iter(failed.values()))
    warnings = [*log.warnings, *extraction_warnings(log, measurements)]
    warnings += [f"{name} failed: {error}" for name, error in failed.items()]
    shots = _shots(log, measurements, config, tell("look"))
    return show_of(log, measurements, estimates, shots, tuple(warnings))


def show_of(
    log: Log,
    measurements: Measurements,
    estimates: Mapping[str, Estimate],
    shots: tuple[Shot, ...],
    warnings: tuple[str, ...] = (),
) -> Show:
    """Returns what is shown of a log whose estimates are there."""
    truth = truth_of(log, measurements)
    true_pose, covered = truth.at(measurements.t)
    true_pose[covered] = compose(inverse(truth.truth_T_start), true_pose[covered])
    places = true_pose[:, :2] if covered.any() else None
    tracks = tuple(_track(measurements, name, estimate) for name, estimate in estimates.items())
    seen = [track.pose[:, :2] for track in tracks] + [
        np.zeros((0, 2)) if places is None else places
    ]
    return Show(
        log.name,
        measurements.t,
        tracks,
        places,
        _box(np.concatenate(seen)),
        shots,
        warnings,
        log,
    )


def _shots(
    log: Log,
    measurements: Measurements,
    config: RunConfig,
    progress: Callable[[int, int], None] | None,
) -> tuple[Shot, ...]:
    if log.images is None:
        return ()
    numbers = np.flatnonzero(np.isin(log.images.t, measurements.t))
    shots = []
    for done, number in enumerate(numbers.tolist(), start=1):
        shots.append(shot_of(log, measurements, number, config.extract))
        if progress is not None:
            progress(done, len(numbers))
    return tuple(shots)


def _track(measurements: Measurements, name: str, estimate: Estimate) -> Track:
    half, angle = ellipses(estimate.cov_floor)
    shown = np.arange(len(estimate.t))
    dots = name == ALONE
    if dots:
        shown = np.unique(sighting_nodes(measurements)[estimate.used])
    used = np.flatnonzero((estimate.match >= 0) & estimate.used)
    first = np.full(len(estimate.map), len(estimate.t))
    np.minimum.at(first, estimate.match[used], sighting_nodes(measurements)[used])
    rows, _ = estimate.map.of_kind("line")
    return Track(
        name,
        method_colour(name),
        estimate.causal,
        estimate.pose,
        half[:, ::-1],
        angle + 0.5 * np.pi,
        np.sqrt(estimate.cov_floor[:, 2, 2]),
        shown,
        dots,
        stretches(estimate).reshape(-1, 4),
        first[rows],
    )


def _box(points: Array) -> tuple[float, float, float, float]:
    """Returns the plan's limits around all paths."""
    points = points[np.isfinite(points).all(axis=1)]
    low, high = points.min(axis=0), points.max(axis=0)
    middle = 0.5 * (low + high)
    half = np.maximum((0.5 + MARGIN) * (high - low), 0.5 * LEAST_SPAN_M)
    x0, y0 = (middle - half).tolist()
    x1, y1 = (middle + half).tolist()
    return x0, y0, x1, y1


def check_out(out: Path | None) -> None:
    """Raises BadConfig where a show cannot be written to a file of this name."""
    from frontend.film import CODECS

    if out is not None and out.suffix.lower() not in (PAGE, *CODECS):
        raise BadConfig(
            f"{out}: a show is a page (.html) or a video ({', '.join(CODECS)}); name it so"
        )
    if out is not None and out.is_dir():
        raise BadConfig(f"{out}: is a folder; give a file")


def write_show(
    show: Show,
    out: Path | str,
    speed: float = 1.0,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Writes a show as a page or as a video, by the ending of the file; it appears when whole.

    Args:
        show: what to play.
        out: file; its folder is made.
        speed: seconds of the log in a second.
        progress: called with (pictures done, pictures in all).

    Raises:
        BadConfig: the file cannot be written, or its ending is none of those.
    """
    from compare.play_page import write_page
    from frontend.film import write_film

    out = Path(out)
    check_out(out)
    with writing(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        beside = out.with_name(f".{out.stem}-beside{out.suffix}")
        try:
            if out.suffix.lower() == PAGE:
                write_page(show, beside, speed, progress)
            else:
                write_film(show, beside, speed, progress)
            beside.replace(out)
        finally:
            beside.unlink(missing_ok=True)
