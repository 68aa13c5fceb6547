"""Advice on beacons, in words and as a picture."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from compare.beacon_map import PROBABILITY, Advice, BeaconMap, Field, beacon_map, one_more
from compare.folders import whole_file, writing
from compare.results import csv_text
from frontend.readers.point_tables import read_landmarks
from graphslam.errors import BadConfig
from graphslam.models.bearing import BEARING


@dataclass(frozen=True, slots=True)
class BeaconAdvice:
    """What is known of a field with beacons.

    Attributes:
        map: how well they fix the pose, over the field.
        advice: where one more helps most.
    """

    map: BeaconMap
    advice: Advice

    def write(self, out: Path) -> Path:
        """Writes ``beacons.svg`` and ``beacons.csv`` into a folder; returns the picture's path."""
        from compare.plots_beacons import beacon_plot

        plot = beacon_plot(self.map, self.advice)
        with writing(out):
            out.mkdir(parents=True, exist_ok=True)
            for name, text in (
                ("beacons.csv", csv_text(plot.data)),
                ("beacons.svg", plot.standalone()),
            ):
                with whole_file(out / name) as beside:
                    beside.write_text(text, encoding="utf-8", newline="\n")
        return out / "beacons.svg"


def advise(
    landmarks: Path, sigma_deg: float, field: tuple[float, float, float, float] | None = None
) -> BeaconAdvice:
    """Returns how well the beacons of a landmarks.csv fix the pose, and where one more helps.

    Args:
        landmarks: the file, or a log folder that holds it.
        sigma_deg: standard deviation of a bearing, degrees.
        field: (x0, y0, x1, y1) where the robot drives, m; None: the rectangle around the beacons.

    Raises:
        BadLog: the file cannot be read.
        BadConfig: fewer than three beacons, an empty field, or no standard deviation.
    """
    if not 0.0 < sigma_deg < 90.0:
        raise BadConfig(f"sigma_deg = {sigma_deg}: must be above 0 and below 90 degrees")
    path = landmarks / "landmarks.csv" if landmarks.is_dir() else landmarks
    _, beacons = read_landmarks(path).of_kind(BEARING.kind)
    if field is None:
        if len(beacons) < 3 or not np.all(np.ptp(beacons, axis=0) > 0):
            raise BadConfig(
                f"{path}: its {len(beacons)} beacons enclose no field; give three, and --field "
                "where they stand in one line"
            )
        low, high = beacons.min(axis=0).tolist(), beacons.max(axis=0).tolist()
        rectangle = Field((low[0], low[1]), (high[0], high[1]))
    else:
        rectangle = Field(field[:2], field[2:])
    drawn = beacon_map(beacons, rectangle, math.radians(sigma_deg))
    return BeaconAdvice(drawn, one_more(drawn))


def told(found: BeaconAdvice) -> Iterator[str]:
    """Yields in words how well the beacons do, where they do not, and where one more would help."""
    drawn, advice = found.map, found.advice
    half = np.where(drawn.inside(), drawn.half_axes(), np.inf)
    lost = float(np.mean(half[drawn.inside()] > 0.5 * drawn.field.size))
    (x0, y0), (x1, y1) = drawn.field.low, drawn.field.high
    yield (
        f"{drawn.count} beacons, bearings of {math.degrees(drawn.sigma):g}° (one sigma), field "
        f"from ({x0:g}, {y0:g}) to ({x1:g}, {y1:g}) m. Half axes are the longer ones of the "
        f"{PROBABILITY:.0%} ellipse of the position."
    )
    yield (
        f"Half of the field stays below {length(advice.median_now)}, 95 % of it below "
        f"{length(advice.worst_now)}; best is {length(float(half.min()))} at {_at(drawn, half)}."
    )
    for centre, radius in drawn.circles():
        if math.isfinite(radius):
            yield (
                f"On the circle through the beacons (centre ({centre[0]:.3g}, {centre[1]:.3g}) m, "
                f"radius {radius:.3g} m) the pose is not determined, near it hardly."
            )
        else:
            yield "All beacons stand in one line: on it the pose is not determined."
    if lost:
        yield f"On {lost:.1%} of the field the half axis is beyond half of its longer side."
    x, y = advice.place
    yield (
        f"One more beacon helps most at ({x:.3g}, {y:.3g}) m: half of the field stays below "
        f"{length(advice.median_then)} then, 95 % below {length(advice.worst_then)}."
    )


def length(value: float) -> str:
    """Returns metres or millimetres with their unit."""
    if not math.isfinite(value):
        return "no limit"
    return f"{1e3 * value:.3g} mm" if value < 0.5 else f"{value:.3g} m"


def _at(drawn: BeaconMap, half: np.ndarray) -> str:
    row, column = np.unravel_index(int(np.argmin(half)), half.shape)
    return f"({drawn.x[column]:.3g}, {drawn.y[row]:.3g})"
