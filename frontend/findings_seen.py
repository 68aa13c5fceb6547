"""What looks wrong in what a log's cameras see, and against its lines and its truth."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from frontend.extract import UNREADABLE_CURE, one_direction
from frontend.findings import Evidence, Finding
from frontend.nodes import odometry_label
from frontend.turning import LARGEST_SHIFT_S
from graphslam.geometry import between, interpolate_poses

LARGEST_SHIFT = 0.05
"""Shift between the clocks of wheels and images that is not worth a word, s."""
LARGEST_ERROR = 0.08
"""Error of a scale, relative, that is not worth a word."""
LEAST_AGREEMENT = 0.5
"""Share of the lines seen turning that have to turn as the wheels say."""
USABLE, FARTHEST_M, SMALLEST_M = 0.5, 5.0, 0.16
TRUTH_STEP_S = 1.0
LEAST_MOTION = (0.5, 0.5)  # m and rad by odometry, below which truth tells nothing about scale


def seen_findings(evidence: Evidence) -> Iterator[Finding]:
    """Yields what looks wrong in cameras, turning, truth and lines."""
    yield from _cameras(evidence)
    yield from _turns(evidence)
    yield from _truth(evidence)
    yield from _lines(evidence)


def _cameras(evidence: Evidence) -> Iterator[Finding]:
    cure = (
        "homography maps floor metres (x forward, y left, robot frame) to pixels: not pixels to "
        "floor, not centimetres"
    )
    for view in evidence.views:
        about = f"log.toml camera {view.camera!r}"
        if view.nearest_m > FARTHEST_M:
            yield Finding(
                about,
                f"the nearest floor in view is {view.nearest_m:.3g} m away",
                f"more than {FARTHEST_M:g} m is too far to see lines",
                cure,
            )
        elif view.usable < USABLE:
            horizon = f"looks at the horizon: {100 * view.horizon:.0f} % of the image are above it"
            fine = 1e3 * evidence.detector.coarsest_pixel_m
            yield Finding(
                about,
                f"{horizon if view.horizon > 0 else 'shows the floor too coarsely'}, "
                f"{100 * view.usable:.0f} % show floor at less than {fine:.0f} mm a pixel",
                "only those are searched for lines",
                f"tilt the camera down, or correct the homography ({cure})",
            )
        if view.across_m < SMALLEST_M:
            yield Finding(
                about,
                f"sees {1e3 * view.across_m:.3g} mm of floor from corner to corner",
                f"less than {1e3 * SMALLEST_M:.0f} mm leave no line to see",
                cure,
            )
        if view.mirrored:
            yield Finding(
                about,
                "the homography mirrors the floor",
                "a camera above the floor never does",
                "y points left, v points down; exchange the sign of one axis",
            )


def _lines(evidence: Evidence) -> Iterator[Finding]:
    frames = evidence.frames
    if not frames:
        if evidence.log.sightings is not None:
            yield Finding(
                "sightings.csv",
                "holds no sighting",
                "without lines only odometry remains",
                "record sightings, or remove the file so that images are searched",
            )
        return
    bad = [frame for frame in frames if not frame.readable]
    images = evidence.log.images
    if bad and images is not None:
        yield Finding(
            images.name(bad[0].image, evidence.log.folder),
            f"{len(bad)} of {len(frames)} images looked at cannot be read, this one first",
            "empty, cut off, or of an unknown format",
            UNREADABLE_CURE[evidence.log.described == "log.toml"],
        )
    readable = [frame for frame in frames if frame.readable]
    seen = [frame for frame in readable if len(frame.z)]
    if readable and not seen:
        yield Finding(
            "lines",
            f"no line in {len(readable)} frames",
            "without lines only odometry remains",
            "look at the picture: are there lines, are they as wide and as long as "
            "extract.detector.line_width_m and min_length_m say, and is the homography right?",
        )
    if not seen:
        return
    alpha = np.concatenate([frame.z[:, 1] for frame in seen])
    t = np.repeat([frame.t for frame in seen], [len(frame.z) for frame in seen])
    turned_right = evidence.turns is None or evidence.turns.agree >= LEAST_AGREEMENT
    if turned_right and one_direction(alpha + evidence.moves.heading_at(t)):
        yield Finding(
            "lines",
            f"one direction only, in {len(seen)} of {len(frames)} frames",
            "the position along the lines is not observed",
            "drive where lines cross, or accept odometry's drift along them",
        )


# ---- scales, senses and clocks ----------------------------------------------------------------


def _turns(evidence: Evidence) -> Iterator[Finding]:
    turns, odometry = evidence.turns, odometry_label(evidence.log)
    if turns is None:
        return
    agree = (
        f"{100 * turns.agree_best:.0f} % of the lines seen turning then agree with the wheels, "
        f"{100 * turns.agree:.0f} % as it is"
    )
    if turns.agree_best < LEAST_AGREEMENT:
        yield Finding(
            f"{odometry} and lines",
            f"{100 * turns.agree:.0f} % of the lines seen turning turn as the wheels say",
            f"no shift of the clocks up to {LARGEST_SHIFT_S:g} s and no scale explains the rest",
            "give wheels and images one clock; check homography and [robot]",
        )
        return
    if turns.factor < 0 and not any(view.mirrored for view in evidence.views):
        yield Finding(
            odometry,
            "left and right are exchanged: the lines turn the other way than the wheels say",
            agree,
            "exchange the columns left and right (or the sign of theta); forward is positive",
        )
    if abs(turns.shift_s) > LARGEST_SHIFT:
        late = "late" if turns.shift_s < 0 else "early"
        yield Finding(
            f"{odometry} and lines",
            f"the clock of the images is {abs(turns.shift_s):.2f} s {late}",
            f"{agree}; up to {LARGEST_SHIFT:g} s are tolerated",
            f"add {turns.shift_s:+.2f} s to the times of the images; "
            "`graphslam calibrate --time-offset` measures it",
        )
    excess = 1.0 / abs(turns.factor) - 1.0
    if abs(excess) > LARGEST_ERROR:
        yield Finding(
            f"{evidence.log.described} [robot]",
            f"the wheels turn the robot by about {100 * abs(excess):.0f} % "
            f"{'more' if excess > 0 else 'less'} than the lines",
            agree,
            "measure wheel_base and the radii; check the scale of the homography",
        )


def _truth(evidence: Evidence) -> Iterator[Finding]:
    """Yields where the true path contradicts odometry in scale or sense."""
    log, moves = evidence.log, evidence.moves
    if log.truth is None:
        return
    begin, end = max(moves.t[0], log.truth.t[0]), min(moves.t[-1], log.truth.t[-1])
    if begin > end:
        yield Finding(
            log.labels["truth"],
            f"lasts from t = {log.truth.t[0]:.12g} s to {log.truth.t[-1]:.12g} s, "
            f"{odometry_label(log)} from t = {moves.t[0]:.12g} s to {moves.t[-1]:.12g} s",
            "without common times nothing can be judged",
            "give both one clock, in seconds",
        )
        return
    t = np.arange(begin, end, TRUTH_STEP_S)
    if len(t) < 2:
        return
    true = interpolate_poses(t, log.truth.t, log.truth.pose)
    ours = interpolate_poses(t, moves.t, moves.pose())
    by_truth, by_wheels = between(true[:-1], true[1:]), between(ours[:-1], ours[1:])
    for column, what, sense, least in (
        (0, "distance", "forward is positive for both wheels", LEAST_MOTION[0]),
        (2, "turn", "left and right may be exchanged", LEAST_MOTION[1]),
    ):
        x, y = by_wheels[:, column], by_truth[:, column]
        if np.abs(x).sum() < least:
            continue
        scale = float(x @ y / (x @ x))
        if abs(scale - 1.0) > LARGEST_ERROR:
            yield Finding(
                f"{evidence.log.described} [robot]",
                f"the true {what} is {scale:.3g} times the wheels'",
                f"up to {100 * LARGEST_ERROR:.0f} % apart is noise, more is not",
                f"measure radii{' and wheel_base' if column else ''}; check the clock of "
                f"{evidence.log.labels['truth']}{'; ' + sense if scale < 0 else ''}",
            )
