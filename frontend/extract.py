"""From a recording to measurements: nodes, odometry between them, sightings at them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from frontend.config import ExtractConfig, NoiseConfig
from frontend.log import Log, with_camera_offset
from frontend.nodes import (
    choose_nodes,
    line_times,
    odometry_at,
    odometry_part,
    odometry_times,
)
from frontend.pose_fixes import fix_warnings, pose_fixes, start_of
from frontend.seen import (
    UNREADABLE,
    UNREADABLE_CEILING,
    UNREADABLE_OMNI,
    seen_bearings,
    seen_lamps,
    seen_lines,
    seen_walls,
)
from frontend.sighting_tables import given
from frontend.truth import true_lines
from graphslam.geometry import Array, wrap
from graphslam.measurements import Measurements, Sightings

Progress = Callable[[int, int], None]

NODE_OUTSIDE = "node outside the wheel record"
UNREADABLE_CURE = {
    True: "write them again, or remove their rows from images.csv",
    False: "see what the camera's driver reports",
}
LINE_OUTSIDE = "line outside the wheel record"
BEARING_OUTSIDE = "bearing outside the wheel record"
LAMP_OUTSIDE = "lamp outside the wheel record"

ONE_DIRECTION = np.radians(5.0)  # lines within this angle of each other fix nothing along them


def extract(
    log: Log, config: ExtractConfig | None = None, progress: Progress | None = None
) -> Measurements:
    """Returns what estimators eat.

    Nodes are those of `frontend.nodes`. Images are searched for lines in parallel; the result does
    not depend on the number of workers.

    Args:
        log: the recording.
        config: detector, workers, and which part of the log; None for the defaults.
        progress: called with (images done, images in all).

    Raises:
        BadLog: an image has not the size that the log states, or no node lies in the record.
        BadConfig: the chosen part of the log is empty.
    """
    config = config or ExtractConfig()
    log = with_camera_offset(log, config.camera_offset_s)
    rejected: Counter[str] = Counter()
    nodes = choose_nodes(log, config)
    t = nodes.t
    rejected[NODE_OUTSIDE] += len(nodes.chosen) - len(t)
    lines = _given_lines(log, nodes.of_lines, t, rejected)
    if lines is None:
        lines = seen_lines(log, nodes, config, rejected, progress)
    if lines is None:
        lines = seen_walls(log, nodes, config, rejected, progress)
    odometry = odometry_at(log, t, config.noise)
    fixes = pose_fixes(log, nodes, odometry, config, rejected, progress)
    start_pose, start_cov = start_of(log, fixes, odometry)
    tables = (
        _with_noise(lines, config.noise),
        fixes,
        _bearings(log, nodes.chosen, t, rejected),
        seen_bearings(log, nodes, config, rejected, progress),
        _lamps(log, nodes.chosen, t, rejected),
        seen_lamps(log, nodes, odometry, config, rejected, progress),
    )
    return Measurements(
        t=t,
        start_pose=start_pose,
        start_cov=start_cov,
        odometry=odometry,
        sightings={table.kind: table for table in tables if table is not None},
        known=log.landmarks if config.landmarks == "known" else None,
        rejected={reason: count for reason, count in sorted(rejected.items()) if count},
    )


def extraction_warnings(log: Log, measurements: Measurements) -> tuple[str, ...]:
    """Returns what the user should know about measurements extracted from a log."""
    rejected, found = measurements.rejected, []
    lines = measurements.sightings.get("line")
    if UNREADABLE in rejected:
        cure = UNREADABLE_CURE[log.described == "log.toml"]
        found.append(
            f"images that could not be read and were left out: {rejected[UNREADABLE]}, first "
            f"{_first_unreadable(log, measurements)}; {cure}"
        )
    if UNREADABLE_OMNI in rejected:
        found.append(
            f"omnidirectional images that could not be read and were left out: "
            f"{rejected[UNREADABLE_OMNI]}; {UNREADABLE_CURE[log.described == 'log.toml']}"
        )
    if UNREADABLE_CEILING in rejected:
        found.append(
            f"images of the ceiling that could not be read and were left out: "
            f"{rejected[UNREADABLE_CEILING]}; {UNREADABLE_CURE[log.described == 'log.toml']}"
        )
    if len(log.images_of("ceiling")):
        found += _lamp_warnings(measurements)
    used, known = measurements.t, odometry_times(log)
    if NODE_OUTSIDE in rejected:
        found.append(
            f"nodes outside the wheel record that were dropped: {rejected[NODE_OUTSIDE]}; "
            f"{log.labels[odometry_part(log)]} lasts from t = {known[0]:.12g} s to "
            f"{known[-1]:.12g} s: start it before and stop it after images and sightings"
        )
    first = min(times[0] for times in line_times(log) if len(times))
    if log.start_given and used[0] > first:
        found.append(
            f"[start] counts as the pose at t = {used[0]:.12g} s, the first node used, "
            f"though the log begins at t = {first:.12g} s; write that pose into log.toml"
        )
    if measurements.known is not None and not log.start_given:
        found.append(
            "the log does not say where on the known map it starts, so the robot is taken to start "
            "at the map's origin, heading along x: write [start] into log.toml, or find it with "
            "--methods particle --particle.start anywhere, which names the other places where the "
            "floor repeats"
        )
    if lines is not None and not len(lines):
        found.append(
            "no line was seen: only odometry (and pose fixes) remain to estimate from; look at "
            "the picture that `graphslam inspect` writes"
        )
    if lines is not None and len(lines) and _one_direction(measurements, lines):
        found.append(
            "lines of one direction only were seen: the position along them is not observed; "
            "drive where lines cross"
        )
    found += fix_warnings(log, measurements)
    return tuple(found)


def _lamp_warnings(measurements: Measurements) -> list[str]:
    """Returns what the user should know about lamps searched in images."""
    from frontend.lamps import CUT

    found = []
    if cut := measurements.rejected.get(CUT):
        found.append(
            f"lamps cut by the image's border that were left out: {cut}; say how large the lamps "
            "are, as --extract.lamps.size-m LENGTH WIDTH, to have them completed"
        )
    if not len(measurements.sightings["lamp"]):
        found.append(
            "no lamp was seen: only odometry and other sightings remain; look at what was left out "
            "and why, and set --extract.lamps.size-m or --extract.lamps.area-m2"
        )
    return found


def _first_unreadable(log: Log, measurements: Measurements) -> str:
    """Returns the first image that cannot be read, as the log names it."""
    from frontend.images import read_grey

    assert log.images is not None, "only images can be unreadable"
    shown = measurements.sightings["line"].source
    numbers = log.images_of("floor")
    numbers = numbers[np.isin(log.images.t[numbers], measurements.t) & ~np.isin(numbers, shown)]
    unreadable = (n for n in numbers.tolist() if read_grey(log.images.file[n]) is None)
    return log.images.name(next(unreadable), log.folder)


# ---- sightings that the log gives -------------------------------------------------------------


def _given_lines(log: Log, chosen: Array, t: Array, rejected: Counter[str]) -> Sightings | None:
    if log.sightings is None:
        return None
    lines, rejected[LINE_OUTSIDE] = given("line", log.sightings, chosen, t, "extent", "truth")
    if np.any(log.sightings.truth >= 0):
        return lines
    return replace(lines, truth=true_lines(log, t[lines.node], lines.z, lines.extent))


def _with_noise(lines: Sightings | None, noise: NoiseConfig) -> Sightings | None:
    if lines is None or noise.rho_factor == noise.alpha_factor == 1.0:
        return lines
    factors = np.array([noise.rho_factor, noise.alpha_factor])
    return replace(lines, cov=lines.cov * np.outer(factors, factors))


def _bearings(log: Log, chosen: Array, t: Array, rejected: Counter[str]) -> Sightings | None:
    if log.bearings is None:
        return None
    part = replace(log.bearings, z=log.bearing_correction.of(log.bearings.z))
    points, rejected[BEARING_OUTSIDE] = given("bearing", part, chosen, t, "truth", "label")
    return points


def _lamps(log: Log, chosen: Array, t: Array, rejected: Counter[str]) -> Sightings | None:
    if log.lamps is None:
        return None
    lamps, rejected[LAMP_OUTSIDE] = given("lamp", log.lamps, chosen, t, "truth")
    return lamps


def _one_direction(measurements: Measurements, lines: Sightings) -> bool:
    turned = np.concatenate([[0.0], np.cumsum(measurements.odometry.increment[:, 2])])
    return one_direction(lines.z[:, 1] + turned[lines.node])


def one_direction(alpha_floor: Array) -> bool:
    """Returns whether all lines (K,), but a few misread ones, have one direction, modulo pi."""
    double = 2.0 * alpha_floor  # twins have one direction
    main = np.angle(np.mean(np.exp(1j * double)))
    off = np.count_nonzero(np.abs(wrap(double - main)) > 2.0 * ONE_DIRECTION)
    return bool(off <= min(4, len(alpha_floor) // 20))
