"""Pictures of the floor: what the camera of a scenario sees from a pose."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from frontend.camera import Camera
from frontend.simulate.floor import Groove, Light
from frontend.simulate.mess import add_dirt, add_legs, add_shadows
from frontend.simulate.scenario import Scenario
from frontend.simulate.world import TILE_CELLS, Tile, World
from graphslam.geometry import (
    Array,
    distance_from_line,
    line_to_robot,
    position_along,
    transform_points,
)

Image = NDArray[np.float32]
Picture = Image

# a groove is drawn out to this many standard deviations of its soft edge
REACH = 4.0
# brightness above the horizon, as a fraction of the floor's
WALL = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class PixelGrid:
    """What is the same in every image of one camera.

    Attributes:
        floor: (H, W, 2) floor point under each pixel's centre, m, robot frame; 0 off the floor.
        J_floor_pixel: (H, W, 2, 2) its derivative by the pixel's (u, v), m per pixel.
        footprint: (H, W) Frobenius norm of that derivative, m per pixel.
        off_floor: (H, W) whether the pixel looks at or above the horizon.
        shade: (H, W) brightness that moves with the camera: gradient and vignette, mean about 1.
        corners: (V, 2) the floor in view, m, robot frame.
        camera: the camera.
    """

    floor: Array
    J_floor_pixel: Array
    footprint: Array
    off_floor: NDArray[np.bool_]
    shade: Image
    corners: Array
    camera: Camera


def pixel_grid(camera: Camera, light: Light) -> PixelGrid:
    """Returns where on the floor each pixel of a camera looks, and how bright it is there."""
    width, height = camera.image_size
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).astype(float)

    def look(du: float, dv: float) -> Array:
        return camera.pixel_to_floor(camera.undistort(pixels + np.array([du, dv])))

    floor = look(0.0, 0.0)
    columns = [look(0.5, 0.0) - look(-0.5, 0.0), look(0.0, 0.5) - look(0.0, -0.5)]
    J_floor_pixel = np.stack(columns, -1)
    off_floor = ~(np.isfinite(floor).all(-1) & np.isfinite(J_floor_pixel).all((-1, -2)))
    floor[off_floor], J_floor_pixel[off_floor] = 0.0, 0.0
    footprint = np.linalg.norm(J_floor_pixel, axis=(-2, -1))
    side = (pixels - pixels.mean((0, 1))) / [width, height]
    corner = np.sum(side**2, -1) / 0.5
    shade = (1.0 + side @ light.gradient) * (1.0 - light.vignette * corner)
    shade = shade.astype(np.float32)
    return PixelGrid(floor, J_floor_pixel, footprint, off_floor, shade, camera.view(), camera)


def render(
    scenario: Scenario,
    world: World,
    grid: PixelGrid,
    pose: Array,
    t: float,
    rng: np.random.Generator,
) -> NDArray[np.uint8]:
    """Returns one grey image (H, W).

    Args:
        scenario: how floor, lines and light look, and the camera's blur and noise.
        world: what lies on the floor.
        grid: where the camera's pixels look.
        pose: (3,) true pose of the robot, floor frame.
        t: s, for the slow change of the light.
        rng: decides the pixels' noise.
    """
    surface, light, camera = scenario.surface, scenario.light, scenario.camera
    assert camera is not None, "images have a camera"
    points = transform_points(pose, grid.floor)
    lines_robot = line_to_robot(world.lines, pose)
    stretch_robot = world.stretch - position_along(world.lines, pose[:2])[:, None]
    grey = surface.grey + surface.texture * sample(world.texture, points)
    cover = groove_cover(scenario.groove, camera.blur, lines_robot, stretch_robot, grid)
    grey += scenario.groove.contrast * cover
    mess = world.mess
    if mess is not None:
        add_dirt(grey, mess, pose, grid, camera.blur)
    grey *= 1.0 + light.patches * sample(world.patches, points)
    if mess is not None:
        add_shadows(grey, mess, pose, grid, camera.blur)
        add_legs(grey, mess, pose, grid, camera.blur)
    grey[grid.off_floor] = WALL * surface.grey
    grey *= grid.shade * np.float32(
        1.0 + light.drift * math.sin(2.0 * math.pi * t / light.drift_period)
    )
    if camera.noise > 0:
        grey += np.float32(camera.noise) * rng.standard_normal(grey.shape, dtype=np.float32)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def groove_cover(
    groove: Groove, blur: float, lines_robot: Array, stretch_robot: Array, grid: PixelGrid
) -> Image:
    """Returns how far (H, W) lines cover each pixel, 0 to 1.

    A line is a box of the groove's width across it, smoothed by a normal distribution: the soft
    edge, and the lens's blur and the pixel's own area as they lie on the floor there. Smoothing
    comes before sampling, so that a line thinner than a pixel keeps its strength and its place.
    Where a line ends it is cut off square.

    Args:
        groove: width and softness.
        blur: standard deviation of the lens's blur, pixels.
        lines_robot: (L, 2) rho m, alpha rad, robot frame.
        stretch_robot: (L, 2) where each begins and ends along itself, m; may be infinite.
        grid: where the pixels look.
    """
    bare = np.ones(grid.off_floor.shape, np.float32)
    half = 0.5 * groove.width
    aperture = blur**2 + 1.0 / 12.0  # a pixel is a box one wide and one high
    reach = half + REACH * (math.sqrt(aperture) * grid.footprint + groove.softness)
    across = distance_from_line(lines_robot[:, None], grid.corners)
    beside = np.maximum(across.min(axis=1), -across.max(axis=1))
    for row in np.flatnonzero(beside < reach.max()):
        line, (begin, end) = lines_robot[row], stretch_robot[row]
        across = distance_from_line(line, grid.floor)
        touched = (np.abs(across) < reach) & ~grid.off_floor
        if np.isfinite((begin, end)).any():
            along = position_along(line, grid.floor)
            touched &= (along >= begin) & (along <= end)
        normal = np.array([math.cos(line[1]), math.sin(line[1])])
        spread = aperture * np.sum((normal @ grid.J_floor_pixel[touched]) ** 2, -1)
        scale = np.sqrt(2.0 * (spread + groove.softness**2))
        d = across[touched]
        bare[touched] *= 1.0 - 0.5 * (erf((d + half) / scale) - erf((d - half) / scale))
    return 1.0 - bare


def sample(tile: Tile, points: Array) -> Image:
    """Returns the pattern (H, W) at floor points (H, W, 2), m, floor frame; bilinear."""
    period = TILE_CELLS * tile.cell
    # whole periods off, so that remap's 16-bit coordinates suffice anywhere on the floor
    cells = (points - period * np.floor(points[0, 0] / period)) / tile.cell
    return cv2.remap(
        tile.values,
        cells.astype(np.float32),
        None,
        interpolation=cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_WRAP,
    )
