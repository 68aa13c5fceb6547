"""Pictures of cones as a camera sees them in a mirror: every pixel's ray, followed to its end."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from frontend.simulate.cones import COLOURS, Cone, OmniSpec
from graphslam.geometry import Array

SAMPLES = 4
"""Rays along each side of a pixel in which something ends."""
BASE_WIDTH, BASE_HEIGHT = 2.6, 0.06
"""Of a cone's base, in radii and in heights of the cone."""
PAPER, SKY, OUTSIDE = 0.55, 0.75, 0.02
"""Brightness of a masked base, of what is above the floor, and of what is not the mirror."""
FLOOR_FADES_M = 30.0
SUN = np.array([0.36, 0.48, 0.80])
"""Where the light comes from; most of it comes from everywhere."""
AMBIENT = 0.75
OFF, ABOVE, FLOOR, FIRST = 0, 1, 2, 3
"""What a ray meets: nothing of the mirror, no floor, the floor, or cone and base number n."""


@dataclass(frozen=True, slots=True, eq=False)
class Mirror:
    """The camera under its mirror, in the order that compiled code takes it.

    Attributes:
        numbers: focal length px, centre u and v px, oval, turn rad, distance m, height m, radius m.
        image_size: (width, height), pixels.
    """

    numbers: Array
    image_size: tuple[int, int]


def mirror_of(spec: OmniSpec) -> Mirror:
    """Returns the mirror of a scenario, with all that is wrong with it."""
    width, height = spec.image_size
    u, v = 0.5 * (width - 1) + spec.centre_off_px[0], 0.5 * (height - 1) + spec.centre_off_px[1]
    turn = math.radians(spec.turned_deg)
    size = (spec.mirror_distance, spec.mirror_height, spec.mirror_radius)
    return Mirror(np.array([spec.focal(), u, v, spec.oval, turn, *size]), spec.image_size)


def render_around(
    spec: OmniSpec,
    cones: tuple[Cone, ...],
    pose: Array,
    floor_grey: float,
    rng: np.random.Generator,
    light: float = 1.0,
) -> NDArray[np.uint8]:
    """Returns one coloured image (H, W, 3), BGR.

    Args:
        spec: the camera.
        cones: what stands around.
        pose: (3,) true pose of the robot, floor frame.
        floor_grey: of the floor, grey levels.
        rng: decides the pixels' noise.
        light: factor on all brightness.
    """
    mirror = mirror_of(spec)
    solids, colours = _solids(cones)
    image = np.empty((mirror.image_size[1], mirror.image_size[0], 3), np.float32)
    meets = np.empty(image.shape[:2], np.int32)
    shown = np.empty((len(colours) + FIRST, 3))
    shown[OFF], shown[ABOVE], shown[FLOOR] = OUTSIDE, SKY, floor_grey / 255.0
    shown[FIRST:] = colours
    _trace(mirror.numbers, np.asarray(pose, float), solids, shown, image, meets)
    _refine(mirror.numbers, np.asarray(pose, float), solids, shown, image, meets)
    picture = 255.0 * light * image
    if spec.blur > 0:
        picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), spec.blur), np.float32)
    if spec.noise > 0:
        noise = rng.standard_normal(picture.shape, dtype=np.float32)
        picture = picture + np.float32(spec.noise) * noise
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def _solids(cones: tuple[Cone, ...]) -> tuple[Array, Array]:
    """Returns the solids (2 n, 6) and what they reflect (2 n, 3): each cone, then its base.

    A solid is x, y, height, radius, and of a base its direction, else -1000; a base that is not
    there has no radius.
    """
    rows, colours = [], []
    for cone in cones:
        reflects = COLOURS[cone.colour][0]
        rows.append((cone.x, cone.y, cone.height, cone.radius, 0.0, 0.0))
        half = 0.0 if cone.base == "none" else 0.5 * BASE_WIDTH * cone.radius
        turn = math.radians(cone.base_turn_deg)
        rows.append((cone.x, cone.y, BASE_HEIGHT * cone.height, half, turn, 1.0))
        colours += [reflects, reflects if cone.base == "bare" else (PAPER,) * 3]
    return np.array(rows, float).reshape(-1, 6), np.array(colours, float).reshape(-1, 3)


@njit(cache=True)
def _trace(mirror, pose, solids, shown, image, meets):  # type: ignore[no-untyped-def]
    """Fills the image, and what each pixel's middle meets."""
    rows, columns = meets.shape
    for row in range(rows):
        for column in range(columns):
            what, bright = _look(mirror, pose, solids, float(column), float(row))
            meets[row, column] = what
            for channel in range(3):
                image[row, column, channel] = bright * shown[what, channel]


@njit(cache=True)
def _refine(mirror, pose, solids, shown, image, meets):  # type: ignore[no-untyped-def]
    """Fills pixels whose neighbours meet something else with the mean over their area."""
    rows, columns = meets.shape
    for row in range(1, rows - 1):
        for column in range(1, columns - 1):
            what = meets[row, column]
            same = True
            for a in range(-1, 2):
                for b in range(-1, 2):
                    same = same and meets[row + a, column + b] == what
            if same:
                continue
            for channel in range(3):
                image[row, column, channel] = 0.0
            for a in range(SAMPLES):
                for b in range(SAMPLES):
                    u = column + (b + 0.5) / SAMPLES - 0.5
                    v = row + (a + 0.5) / SAMPLES - 0.5
                    met, bright = _look(mirror, pose, solids, u, v)
                    for channel in range(3):
                        share = bright * shown[met, channel] / (SAMPLES * SAMPLES)
                        image[row, column, channel] += share


@njit(cache=True)
def _look(mirror, pose, solids, u, v):  # type: ignore[no-untyped-def]
    """Returns what a pixel's ray meets first, and how bright it is there."""
    hit, px, py, pz, dx, dy, dz = _ray(mirror, pose, u, v)
    if not hit:
        return OFF, 1.0
    what, bright, nearest = ABOVE, 1.0, 1e30
    if dz < 0.0:
        what, nearest = FLOOR, -pz / dz
        bright = 1.0 / (1.0 + nearest / FLOOR_FADES_M)
    for k in range(solids.shape[0]):
        if solids[k, 3] <= 0.0:
            continue
        if solids[k, 5] > 0.0:
            t, nx, ny, nz = _box(solids[k], px, py, pz, dx, dy, dz)
        else:
            t, nx, ny, nz = _cone(solids[k], px, py, pz, dx, dy, dz)
        if 0.0 < t < nearest:
            facing = max(0.0, nx * SUN[0] + ny * SUN[1] + nz * SUN[2])
            what, nearest, bright = FIRST + k, t, AMBIENT + (1.0 - AMBIENT) * facing
    return what, bright


@njit(cache=True)
def _ray(mirror, pose, u, v):  # type: ignore[no-untyped-def]
    """Returns whether a pixel shows the mirror, and the ray from there, floor frame.

    The camera looks up: the image's up is ahead, its right is left.
    """
    focal, cu, cv, oval, turn, distance, height, radius = mirror
    ahead, left = -(v - cv) / focal, (u - cu) * (1.0 + oval) / focal
    c, s = math.cos(turn), math.sin(turn)
    x, y = c * ahead - s * left, s * ahead + c * left
    scale = 1.0 / math.sqrt(x * x + y * y + 1.0)
    x, y, z = x * scale, y * scale, scale
    inside = (z * distance) ** 2 - distance * distance + radius * radius
    if inside < 0.0:
        return False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    t = z * distance - math.sqrt(inside)
    px, py, pz = t * x, t * y, t * z
    nx, ny, nz = px / radius, py / radius, (pz - distance) / radius
    twice = 2.0 * (x * nx + y * ny + z * nz)
    x, y, z = x - twice * nx, y - twice * ny, z - twice * nz
    c, s = math.cos(pose[2]), math.sin(pose[2])
    at_x, at_y = pose[0] + c * px - s * py, pose[1] + s * px + c * py
    return True, at_x, at_y, height - distance + pz, c * x - s * y, s * x + c * y, z


@njit(cache=True)
def _cone(solid, px, py, pz, dx, dy, dz):  # type: ignore[no-untyped-def]
    """Returns how far along a ray an upright cone is met (-1: not), and its normal there."""
    tip, slope = solid[2], solid[3] / solid[2]
    ox, oy, oz = px - solid[0], py - solid[1], tip - pz
    a = dx * dx + dy * dy - (slope * dz) ** 2
    b = ox * dx + oy * dy + slope * slope * oz * dz
    c = ox * ox + oy * oy - (slope * oz) ** 2
    inside = b * b - a * c
    if inside < 0.0 or a == 0.0:
        return -1.0, 0.0, 0.0, 0.0
    root = math.sqrt(inside)
    best = -1.0
    for sign in (-1.0, 1.0):
        t = (-b + sign * root) / a
        z = pz + t * dz
        if t > 0.0 and 0.0 <= z <= tip and (best < 0.0 or t < best):
            best = t
    if best < 0.0:
        return -1.0, 0.0, 0.0, 0.0
    x, y = ox + best * dx, oy + best * dy
    r = max(math.hypot(x, y), 1e-12)
    scale = 1.0 / math.sqrt(1.0 + slope * slope)
    return best, scale * x / r, scale * y / r, scale * slope


@njit(cache=True)
def _box(solid, px, py, pz, dx, dy, dz):  # type: ignore[no-untyped-def]
    """Returns how far along a ray a square slab on the floor is met (-1: not), and its normal."""
    c, s = math.cos(solid[4]), math.sin(solid[4])
    ox, oy = px - solid[0], py - solid[1]
    origin = (c * ox + s * oy, -s * ox + c * oy, pz)
    way = (c * dx + s * dy, -s * dx + c * dy, dz)
    low, high = (-solid[3], -solid[3], 0.0), (solid[3], solid[3], solid[2])
    enter, leave, axis, sign = -1e30, 1e30, 0, 1.0
    for k in range(3):
        if abs(way[k]) < 1e-15:
            if origin[k] < low[k] or origin[k] > high[k]:
                return -1.0, 0.0, 0.0, 0.0
            continue
        one, two = (low[k] - origin[k]) / way[k], (high[k] - origin[k]) / way[k]
        if min(one, two) > enter:
            enter, axis, sign = min(one, two), k, -1.0 if way[k] > 0.0 else 1.0
        leave = min(leave, max(one, two))
    if enter > leave or leave < 0.0:
        return -1.0, 0.0, 0.0, 0.0
    if axis == 0:
        return enter, sign * c, sign * s, 0.0
    if axis == 1:
        return enter, -sign * s, sign * c, 0.0
    return enter, 0.0, 0.0, sign
