"""Sightings of lines without images: what is in view, with noise of exactly the stated law."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from frontend.camera import Camera
from frontend.config import DetectorConfig
from frontend.lines import line_covariance
from frontend.log_parts import LineSightings
from frontend.simulate.drive import Drive
from frontend.simulate.scenario import Scenario
from frontend.simulate.sensors import SightingSpec
from frontend.simulate.view import camera_of
from frontend.simulate.world import floor_lines, floor_stretches
from graphslam.geometry import Array, line_through, line_to_robot, position_along
from graphslam.measurements import IntArray
from graphslam.models.line import LINE

BLOCK = 2**19  # pairs of a frame and a line looked at at a time


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """The floor that a frame shows.

    Attributes:
        corners: (V, 2) convex polygon that holds it, counter-clockwise, m, robot frame.
        reach: no floor in view is farther from the robot, m.
        stretch: takes lines (K, 2), robot frame; returns the stretch (K, 2) of each that is in
            view, m along it, NaN where none.
    """

    corners: Array
    reach: float
    stretch: Callable[[Array], Array]


def view_of(scenario: Scenario) -> View:
    """Returns what a frame shows: the camera's view, or all floor within ``sightings.reach``."""
    reach = scenario.sightings.reach
    if reach is not None:
        square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        return View(reach * square, reach, lambda lines: _chord(lines, reach))
    assert scenario.camera is not None, "a scenario has a camera or a reach"
    camera = camera_of(scenario.camera)
    corners = camera.view()
    return View(corners, float(np.hypot(*corners.T).max()), camera.visible_stretch)


def camera_in_log(scenario: Scenario) -> Camera | None:
    """Returns the camera whose view decides what is seen; None where ``sightings.reach`` does."""
    if scenario.camera is None or scenario.sightings.reach is not None:
        return None
    return camera_of(scenario.camera)


def draw_sightings(scenario: Scenario, run: Drive, seed: np.random.SeedSequence) -> LineSightings:
    """Returns the lines seen in all frames of a drive, by time, then by line, false ones last.

    Noise, missed lines and false lines are drawn from streams of their own, and noise is drawn for
    every line in view, so that changing one of them leaves the others as they were.

    Args:
        scenario: the lines, what is in view, and ``[sightings]``.
        run: the frames and the true poses.
        seed: decides all that is random.
    """
    spec, view = scenario.sightings, view_of(scenario)
    noise, missed, false = map(np.random.default_rng, seed.spawn(3))
    frame, truth, line, extent = _in_view(scenario, view, run.pose_at_frames())
    stated = stated_covariance(spec, line)
    line = line + spec.scale * _normal(stated, noise)
    kept = missed.random(len(frame)) >= spec.miss_rate
    columns = [(frame[kept], truth[kept], line[kept], stated[kept], extent[kept])]
    if spec.false_rate:
        columns.append(_false(spec, view, len(run.frame_t), false))
    frame, truth, line, stated, extent = map(np.concatenate, zip(*columns, strict=True))
    order = np.argsort(frame, kind="stable")
    z, extent, _ = LINE.canonical(line[order], extent[order])
    t = run.frame_t[frame[order]]
    # rho and alpha are independent, so that the twin's covariance is the same
    return LineSightings(t, z, stated[order], extent, truth[order], t)


def stated_covariance(spec: SightingSpec, z: Array) -> Array:
    """Returns the covariances (K, 2, 2) that are written beside sightings of lines (K, 2).

    SantanaLoc's formula at its defaults, or the constants of ``[sightings]``, times its ``factor``;
    both diagonal. It is the law of the studies, and coarser than what the default detector states
    of rendered images.
    """
    cov = line_covariance(z, DetectorConfig())
    if spec.sigma_rho is not None:
        cov[:, 0, 0] = spec.sigma_rho**2
    if spec.sigma_alpha_deg is not None:
        cov[:, 1, 1] = np.radians(spec.sigma_alpha_deg) ** 2
    return spec.factor**2 * cov


def _in_view(
    scenario: Scenario, view: View, pose: Array
) -> tuple[IntArray, IntArray, Array, Array]:
    """Returns frame and line (K,) of all true sightings, the lines (K, 2) in the robot frame and
    the stretches (K, 2) in view; a block of frames at a time."""
    lines, stretch = floor_lines(scenario), floor_stretches(scenario)
    size = max(1, BLOCK // max(1, len(lines)))
    found = [(np.zeros(0, int), np.zeros(0, int), np.zeros((0, 2)), np.zeros((0, 2)))]
    for first in range(0, len(pose), size):
        block = pose[first : first + size]
        seen = line_to_robot(lines, block[:, None])
        frame, line = np.nonzero(np.abs(seen[..., 0]) <= view.reach)
        z = seen[frame, line]
        ends = stretch[line] - position_along(lines[line], block[frame, :2])[:, None]
        shown = view.stretch(z)
        shown = np.column_stack(
            [np.maximum(shown[:, 0], ends[:, 0]), np.minimum(shown[:, 1], ends[:, 1])]
        )
        length = shown[:, 1] - shown[:, 0]
        long = (length > 0) & (length >= scenario.sightings.min_stretch)
        found.append((first + frame[long], line[long], z[long], shown[long]))
    frame, line, z, shown = map(np.concatenate, zip(*found, strict=True))
    return frame, line, z, shown


def _false(
    spec: SightingSpec, view: View, frames: int, rng: np.random.Generator
) -> tuple[IntArray, IntArray, Array, Array, Array]:
    """Returns frame, truth (-1), line, covariance and stretch of sightings that are of no line.

    Each passes through a random point of the view in a random direction.
    """
    frame = np.repeat(np.arange(frames), rng.poisson(spec.false_rate, frames))
    low, high = view.corners.min(axis=0), view.corners.max(axis=0)
    line, extent = np.zeros((len(frame), 2)), np.full((len(frame), 2), np.nan)
    while (open_ := np.isnan(extent[:, 0])).any():
        point = rng.uniform(low, high, (int(open_.sum()), 2))
        angle = rng.uniform(-np.pi, np.pi, len(point))
        step = np.column_stack([np.cos(angle), np.sin(angle)])
        drawn = line_through(point, point + step)
        shown = view.stretch(drawn)
        s = position_along(drawn, point)
        inside = (shown[:, 0] <= s) & (s <= shown[:, 1])
        line[open_] = drawn
        extent[open_] = np.where(inside[:, None], shown, np.nan)
    return frame, np.full(len(frame), -1), line, stated_covariance(spec, line), extent


def _normal(cov: Array, rng: np.random.Generator) -> Array:
    """Returns one normal deviate (K, 2) for each covariance (K, 2, 2)."""
    unit = rng.standard_normal((len(cov), 2, 1))
    return np.asarray((np.linalg.cholesky(cov) @ unit)[..., 0])


def _chord(lines: Array, reach: float) -> Array:
    """Returns the stretch (K, 2) of lines (K, 2) within ``reach`` of the robot, m; NaN if none."""
    half = np.sqrt(np.maximum(reach**2 - lines[:, 0] ** 2, 0.0))
    half = np.where(np.abs(lines[:, 0]) < reach, half, np.nan)
    return np.column_stack([-half, half])
