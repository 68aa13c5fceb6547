"""What simulated experiments lack and real ones have: a camera, a map and noise that err alike.

The scenarios' sightings err anew in every frame, about an exact camera and an exact map. Here each
of the three is replaced by what a real floor may well be like, to measure what it does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from frontend.calibrate_fit import fit_homography
from frontend.camera import Camera
from frontend.extract import extract
from frontend.log import DEFAULT_CAMERA, Log
from frontend.log_parts import LineSightings
from frontend.simulate import Scenario, simulate_log
from graphslam.geometry import Array, line_through, points_on_line, position_along
from graphslam.measurements import IntArray, LandmarkMap, Measurements
from graphslam.models.line import LINE

PASS_S = 5.0
"""A line that was out of sight for longer is on another pass, s."""
GRID = 9
"""Points along each side of the grid over which a calibration's error is averaged."""
ROUNDS = 3
"""Rounds in which the calibration's size is found; it is all but linear."""


@dataclass(frozen=True, slots=True)
class Flaws:
    """What is wrong for a whole run; all 0 is what the scenarios do by themselves.

    Attributes:
        calibration_m: mean distance, over the floor in view, between where a pixel looks and where
            the calibration says that it does, m; the estimators know nothing of it.
        map_rho_m: standard deviation of rho of the lines in the known map, m.
        map_alpha_deg: standard deviation of their alpha, degrees.
        held: 0: a sighting's noise is drawn for each frame. Else it is drawn once for each pass
            over a line and stays, so many times as large as stated.
    """

    calibration_m: float = 0.0
    map_rho_m: float = 0.0
    map_alpha_deg: float = 0.0
    held: float = 0.0


def simulate_flawed(scenario: Scenario, flaws: Flaws, seed: int) -> tuple[Log, Measurements]:
    """Returns one drive without images, and what is measured on it with the map known.

    Args:
        scenario: with a camera.
        flaws: what is wrong; the drive is the same whatever it is.
        seed: of the drive, of the sightings and of what is wrong.
    """
    streams = np.random.SeedSequence(seed, spawn_key=(1,)).spawn(3)
    camera_rng, map_rng, noise_rng = map(np.random.default_rng, streams)
    if flaws.held:
        silent = replace(scenario, sightings=replace(scenario.sightings, scale=0.0))
        log = simulate_log(silent, seed)
        assert log.sightings is not None, "simulated without images"
        log = replace(log, sightings=_with_held_noise(log.sightings, flaws.held, noise_rng))
    else:
        log = simulate_log(scenario, seed)
    if flaws.calibration_m:
        said = miscalibrated(log.cameras[DEFAULT_CAMERA], flaws.calibration_m, camera_rng)
        log = replace(log, sightings=_seen_through(log, said))
    return log, replace(extract(log), known=known_map(log, flaws, map_rng))


def miscalibrated(camera: Camera, error_m: float, rng: np.random.Generator) -> Camera:
    """Returns the camera as it is taken to be after a calibration with a mean error on the floor.

    The four corners of the image are taken to look at points that are off in random directions by
    random distances; the homography through them errs smoothly in between. All are scaled so that
    the mean distance over a grid of the image is ``error_m``.

    Args:
        camera: as it is, without a lens.
        error_m: mean error on the floor, m.
        rng: decides directions and shares.
    """
    width, height = camera.image_size
    u, v = (np.linspace(0.0, size - 1.0, GRID) for size in (width, height))
    grid = np.stack(np.meshgrid(u, v), -1).reshape(-1, 2)
    corners = grid[[0, GRID - 1, -GRID, -1]]
    floor, shift = camera.pixel_to_floor(corners), rng.standard_normal((4, 2))
    shift *= error_m / np.hypot(*shift.T).mean()
    said = camera
    for _ in range(ROUNDS):
        said = replace(camera, homography=fit_homography(floor + shift, corners).homography)
        off = np.hypot(*(said.pixel_to_floor(grid) - camera.pixel_to_floor(grid)).T).mean()
        shift *= error_m / off
    return said


def known_map(log: Log, flaws: Flaws, rng: np.random.Generator) -> LandmarkMap:
    """Returns the lines of a log as they are taken to be known; each errs by itself."""
    assert log.map is not None, "simulated logs have a map"
    sigma = np.array([flaws.map_rho_m, np.radians(flaws.map_alpha_deg)])
    lines = log.map.params[:, :2] + sigma * rng.standard_normal((len(log.map), 2))
    lines, extent, _ = LINE.canonical(lines, log.map.extent)
    return replace(log.map, params=lines, extent=extent)


def passes(t: Array, line: IntArray) -> IntArray:
    """Returns the number (K,) of the pass over its line that each sighting belongs to.

    Args:
        t: (K,) times, s, not decreasing.
        line: (K,) the line of each.
    """
    order = np.lexsort((t, line))
    new = np.ones(len(t), bool)
    new[1:] = (np.diff(line[order]) != 0) | (np.diff(t[order]) > PASS_S)
    number = np.empty(len(t), np.int64)
    number[order] = np.cumsum(new) - 1
    return number


def _with_held_noise(seen: LineSightings, size: float, rng: np.random.Generator) -> LineSightings:
    """Returns sightings (made without noise) whose noise stays the same through each pass."""
    number = passes(seen.t, seen.truth)
    unit = size * rng.standard_normal((int(number.max(initial=-1)) + 1, 2))[number]
    z = seen.z + (np.linalg.cholesky(seen.cov) @ unit[..., None])[..., 0]
    z, extent, _ = LINE.canonical(z, seen.extent)
    return replace(seen, z=z, extent=extent)


def _seen_through(log: Log, said: Camera) -> LineSightings:
    """Returns a log's sightings as the camera's wrong calibration puts them on the floor."""
    seen, camera = log.sightings, log.cameras[DEFAULT_CAMERA]
    assert seen is not None, "the log has sightings"
    ends = points_on_line(seen.z[:, None], seen.extent)
    ends = said.pixel_to_floor(camera.floor_to_pixel(ends))
    z = line_through(ends[:, 0], ends[:, 1])
    extent = position_along(z[:, None], ends)
    extent = np.sort(extent, axis=1)
    z, extent, _ = LINE.canonical(z, extent)
    return replace(seen, z=z, extent=extent)
