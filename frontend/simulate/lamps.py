"""Lamps as a camera that looks up sees them: sightings without images, and rendered images."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from frontend.camera import Camera
from frontend.columns import later
from frontend.lamps import motion_covariance, pixel_areas
from frontend.log_parts import LampSightings
from frontend.simulate.ceiling import Ceiling, UpwardCamera
from frontend.simulate.drive import Drive
from graphslam.geometry import Array, between, compose, interpolate_poses, inverse, wrap

CAMERA = "up"
"""Name of the camera in the log."""
INSTANT_S = 0.01
SAMPLES = (13, 5)
"""Points along and across a lamp that decide how much of it is in view."""


def upward_camera(spec: UpwardCamera) -> Camera:
    """Returns the camera that a scenario describes, its homography for the plane of the lamps."""
    if spec.homography is None:
        assert spec.metres_per_pixel is not None, "checked on entry"
        per_m = 1.0 / spec.metres_per_pixel
        u, v = 0.5 * (spec.image_size[0] - 1), 0.5 * (spec.image_size[1] - 1)
        # seen from below: ahead is up in the image, and left is right
        homography = np.array([[0.0, per_m, u], [-per_m, 0.0, v], [0.0, 0.0, 1.0]])
    else:
        homography = np.array(spec.homography)
    return Camera(
        CAMERA,
        "ceiling",
        spec.image_size,
        homography,
        None if spec.matrix is None else np.array(spec.matrix),
        None if spec.distortion is None else np.array(spec.distortion),
        spec.lens,
        delay_s=spec.delay,
    )


def draw_lamp_sightings(
    ceiling: Ceiling, run: Drive, seed: np.random.SeedSequence
) -> LampSightings:
    """Returns the lamps seen in all frames of a drive, by time, then by lamp.

    Args:
        ceiling: the lamps, the camera, and how they are seen.
        run: the frames and the true poses.
        seed: decides noise and what is missed, by streams of their own.
    """
    spec, pose = ceiling.seen, run.pose_at_frames()
    noise, missed, black = map(np.random.default_rng, seed.spawn(3))
    lit, places = ceiling.lit(), ceiling.places()
    z = compose(inverse(pose)[:, None], places[lit])
    shown = _share_in_view(upward_camera(ceiling.camera), z, ceiling.size) >= spec.visible
    shown &= (black.random(len(pose)) >= ceiling.camera.black_rate)[:, None]
    frame, column = np.nonzero(shown)
    z, truth, t = z[frame, column], lit[column], run.frame_t[frame]
    cov = np.diag([spec.sigma**2, spec.sigma**2, np.deg2rad(spec.sigma_phi_deg) ** 2])
    cov = cov + motion_covariance(z, _velocities(run, t), spec.timing)
    unit = noise.standard_normal((len(z), 3, 1))
    z = z + (np.linalg.cholesky(cov) @ unit)[..., 0]
    z[:, 2] = 0.5 * wrap(2.0 * z[:, 2])
    kept = missed.random(len(z)) >= spec.miss_rate
    received = later(t, ceiling.camera.delay)
    return LampSightings(t[kept], z[kept], cov[kept], truth[kept], received[kept])


def _share_in_view(camera: Camera, z: Array, size: tuple[float, float]) -> Array:
    """Returns how much (...) of each lamp (..., 3), robot frame, the image shows, 0 to 1."""
    along, across = (
        side * (np.arange(n) + 0.5 - 0.5 * n) / n for side, n in zip(size, SAMPLES, strict=True)
    )
    grid = np.stack(np.meshgrid(along, across), axis=-1).reshape(-1, 2)
    points = np.column_stack([grid, np.zeros(len(grid))])
    at = camera.distort(camera.floor_to_pixel(compose(z[..., None, :], points)[..., :2]))
    limit = np.array(camera.image_size) - 0.5
    with np.errstate(invalid="ignore"):
        return np.asarray(((at >= -0.5) & (at <= limit)).all(axis=-1).mean(axis=-1))


def _velocities(run: Drive, t: Array) -> Array:
    """Returns the true velocity (K, 3) of the robot, robot frame, m/s and rad/s."""
    before = np.clip(t - INSTANT_S, run.t[0], run.t[-1])
    after = np.clip(t + INSTANT_S, run.t[0], run.t[-1])
    first, last = (interpolate_poses(when, run.t, run.pose) for when in (before, after))
    return between(first, last) / (after - before)[:, None]


@dataclass(frozen=True, slots=True, eq=False)
class CeilingView:
    """What is the same in every image of one camera that looks up.

    Attributes:
        plane: (H, W, 2) where each pixel's centre looks in the plane of the lamps, robot frame, m;
            far away where it does not.
        spread: (H, W) standard deviation of blur and pixel there, m.
        fringes: by lamp, (F, 5) centre along and across it, length and width, m, and brightness, 0
            to 1, of the reflections at its border.
    """

    plane: Array
    spread: Array
    fringes: tuple[Array, ...]


FAR_AWAY = 1e6


def ceiling_view(ceiling: Ceiling, camera: Camera, rng: np.random.Generator) -> CeilingView:
    """Returns where a camera's pixels look, and each lamp's reflections, which ``rng`` decides."""
    width, height = camera.image_size
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).astype(float)
    plane = np.nan_to_num(camera.pixel_to_floor(camera.undistort(pixels)), nan=FAR_AWAY)
    spread = np.sqrt(pixel_areas(camera) * (ceiling.camera.blur**2 + 1.0 / 12.0))
    fringes = tuple(_fringes(ceiling, rng) for _ in ceiling.lamps)
    return CeilingView(plane, np.maximum(spread, 1e-6), fringes)


def _fringes(ceiling: Ceiling, rng: np.random.Generator) -> Array:
    """Returns reflections beside the edges of one lamp: narrow, some of them apart from it."""
    count, half = ceiling.reflections, 0.5 * np.array(ceiling.size)
    end = rng.random(count) < 0.5
    side = rng.choice([-1.0, 1.0], count)
    width, gap = rng.uniform(0.006, 0.02, count), rng.uniform(0.0, 0.03, count)
    length = rng.uniform(0.2, 0.6, count) * np.where(end, 2 * half[1], 2 * half[0])
    beside = side * (np.where(end, half[0], half[1]) + gap + 0.5 * width)
    along = rng.uniform(-0.5, 0.5, count) * np.where(end, half[1], half[0])
    return np.column_stack(
        [
            np.where(end, beside, along),
            np.where(end, along, beside),
            np.where(end, width, length),
            np.where(end, length, width),
            rng.uniform(0.3, 1.0, count),
        ]
    )


def render_ceiling(
    ceiling: Ceiling, view: CeilingView, pose: Array, t: float, rng: np.random.Generator
) -> NDArray[np.uint8]:
    """Returns one grey image (H, W).

    Reflections grow stronger the farther a lamp is from the middle of the image: there its light
    comes by way of the metal grid below it.

    Args:
        ceiling: how lamps and ceiling look, exposure and noise.
        view: where the pixels look.
        pose: (3,) true pose of the robot, floor frame.
        t: s, for the change of exposure.
        rng: decides the pixels' noise, and whether the image is black.
    """
    camera = ceiling.camera
    grey = np.full(view.spread.shape, ceiling.dark, float)
    places, light = ceiling.places(), ceiling.bright - ceiling.dark
    for number in ceiling.lit().tolist():
        z = compose(inverse(pose), places[number])
        reach = math.hypot(*ceiling.size)
        near = np.abs(view.plane - z[:2]).max(axis=-1) < reach
        if not near.any():
            continue
        x, y, _ = compose(inverse(z), _as_poses(view.plane[near])).T
        spread = view.spread[near]
        cover = _cover(x, y, *ceiling.size, spread)
        slanted = min(1.0, math.hypot(z[0], z[1]))
        for along, across, length, width, strength in view.fringes[number].tolist():
            cover += slanted * strength * _cover(x - along, y - across, length, width, spread)
        grey[near] += light * cover
    swing = math.sin(2.0 * math.pi * t / camera.exposure_period)
    grey = np.minimum(grey, max(ceiling.bright, 255.0)) * (1.0 + camera.exposure * swing)
    if rng.random() < camera.black_rate:
        grey[:] = 0.3 * ceiling.dark
    grey += camera.noise * rng.standard_normal(grey.shape)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def _as_poses(points: Array) -> Array:
    return np.concatenate([points, np.zeros((*points.shape[:-1], 1))], axis=-1)


def _cover(x: Array, y: Array, length: float, width: float, spread: Array) -> Array:
    """Returns how far a rectangle around the origin covers pixels at (x, y), 0 to 1."""
    cover = np.ones_like(x)
    for at, side in ((x, length), (y, width)):
        cover *= ndtr((at + 0.5 * side) / spread) - ndtr((at - 0.5 * side) / spread)
    return cover
