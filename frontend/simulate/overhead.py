"""The work space as a camera above it sees it, and the poses that its tags give."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from frontend.log_parts import PoseFixes
from frontend.overhead import OverheadCamera, pose_of_tags
from frontend.simulate.drive import Drive
from frontend.simulate.mess import add_dirt, add_shadows
from frontend.simulate.render import Picture, PixelGrid, groove_cover, pixel_grid, sample
from frontend.simulate.scenario import Scenario
from frontend.simulate.workspace import OverheadSpec, overhead_camera
from frontend.simulate.world import World
from graphslam.errors import BadConfig
from graphslam.geometry import Array, transform_points

ORIGIN = np.zeros(3)
SHADOW_SOFT_M = 0.01
BORDER = 4.0  # a disc is drawn out to this many standard deviations of its blurred border


@dataclass(frozen=True, slots=True, eq=False)
class Workspace:
    """What is the same in all images of an overhead camera.

    Attributes:
        eye: the camera.
        grid: where on the floor its pixels look.
        tag_floor: (H, W, 2) the same at the height of the tags, m.
        floor: (H, W) grey levels without the robot, in even light.
        light: (H, W) how bright each place is, mean about 1.
        blur: standard deviation of the lens's blur, pixels.
    """

    eye: OverheadCamera
    grid: PixelGrid
    tag_floor: Array
    floor: Picture
    light: Picture
    blur: float


def build_workspace(scenario: Scenario, world: World) -> Workspace:
    """Returns the work space of a scenario, its floor drawn once for all images."""
    spec = scenario.overhead
    assert spec is not None, "scenarios without a camera overhead have no work space"
    if spec.tags.diameter is None:
        raise BadConfig(f"{scenario.name}: overhead.tags.diameter is missing; images need it, m")
    eye = overhead_camera(spec)
    grid = pixel_grid(eye.camera, scenario.light)
    height, width = grid.off_floor.shape
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).astype(float)
    tag_floor = grid.floor
    if spec.tags.height:
        tag_floor = eye.to_floor(pixels.reshape(-1, 2))[0].reshape(height, width, 2)
    grey = scenario.surface.grey + scenario.surface.texture * sample(world.texture, grid.floor)
    cover = groove_cover(scenario.groove, spec.blur, world.lines, world.stretch, grid)
    grey += scenario.groove.contrast * cover
    light = grid.shade * (1.0 + scenario.light.patches * sample(world.patches, grid.floor))
    if world.mess is not None:
        add_dirt(grey, world.mess, ORIGIN, grid, spec.blur)
        add_shadows(light, world.mess, ORIGIN, grid, spec.blur)
    return Workspace(eye, grid, tag_floor, grey, light.astype(np.float32), spec.blur)


def render_overhead(
    scenario: Scenario,
    workspace: Workspace,
    pose: Array,
    t: float,
    hidden: bool,
    pixels: np.random.Generator,
    tags: np.random.Generator,
) -> NDArray[np.uint8]:
    """Returns one coloured image (H, W, 3), BGR.

    Args:
        scenario: how everything looks.
        workspace: what does not change.
        pose: (3,) true pose of the robot, floor frame.
        t: s.
        hidden: whether something hides the tags; the body is seen all the same.
        pixels: decides the pixels' noise.
        tags: decides where the tags are, `OverheadSpec.tag_noise`.
    """
    spec = scenario.overhead
    assert spec is not None and spec.tags.diameter is not None  # noqa: PT018  checked before
    picture = np.repeat(workspace.floor[..., None], 3, axis=2)
    colours = {"centre": spec.centre_bgr, "front": spec.front_bgr}
    for thing in spec.objects:
        if thing.from_s <= t and (thing.to_s is None or t < thing.to_s):
            place, radius = np.array([thing.x, thing.y]), 0.5 * thing.diameter
            _disc(picture, workspace.grid.floor, place, radius, colours[thing.colour], workspace)
    shadow = pose[:2] + np.array(spec.shadow_offset)  # on the floor and what lies on it only
    _fade(picture, workspace.grid.floor, shadow, spec.body, 1.0 - spec.shadow, workspace)
    body = (spec.body_grey,) * 3
    _disc(picture, workspace.tag_floor, pose[:2], spec.body, body, workspace)
    places = _places(spec, pose, tags)
    if not hidden:
        for place, colour in zip(places, _shown(spec, t), strict=True):
            radius = 0.5 * spec.tags.diameter
            _disc(picture, workspace.tag_floor, place, radius, colours[colour], workspace)
    drift = scenario.light.drift * math.sin(2.0 * math.pi * t / scenario.light.drift_period)
    picture *= workspace.light[..., None] * np.float32(1.0 + drift)
    if spec.noise > 0:
        noise = pixels.standard_normal(picture.shape, dtype=np.float32)
        picture += np.float32(spec.noise) * noise
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def hidden_frames(spec: OverheadSpec, t: Array, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Returns in which of the images (I,) at times t the tags are hidden."""
    always = np.array([spec.is_hidden(when) for when in t.tolist()], bool)
    return always | (rng.random(len(t)) < spec.miss_rate)


def draw_fixes(scenario: Scenario, run: Drive, seed: np.random.SeedSequence) -> PoseFixes:
    """Returns the poses that the tags give without images, with noise of exactly the stated law.

    Images in which the tags are hidden, or outside the image, give none. Other objects count for
    nothing; exchanged tags give the pose that a camera would take them for.

    Args:
        scenario: with a camera overhead.
        run: its images' times and the true poses.
        seed: decides the noise, and which images are lost.
    """
    spec = scenario.overhead
    assert spec is not None, "called for scenarios with a camera overhead"
    eye = overhead_camera(spec)
    lost, noise = map(np.random.default_rng, seed.spawn(2))
    hidden = hidden_frames(spec, run.overhead_t, lost)
    poses = run.pose_at(run.overhead_t)
    z, cov, kept = [], [], []
    high = np.array(spec.image_size) - 0.5
    for k, (pose, t) in enumerate(zip(poses, run.overhead_t.tolist(), strict=True)):
        seen = _places(spec, pose, noise)
        pixels = eye.to_pixels(seen)
        _, J = eye.to_floor(pixels)
        own = spec.sigma_px**2 * J @ np.swapaxes(J, 1, 2)
        seen = seen + (spec.sigma_px * J @ noise.standard_normal((2, 2, 1)))[..., 0]
        if hidden[k] or not np.all((pixels > -0.5) & (pixels < high)):
            continue
        if spec.is_exchanged(t):
            seen, own = seen[::-1], own[::-1]
        fix = pose_of_tags(seen, own + spec.tag_noise**2 * np.eye(2), spec.tags)
        z.append(fix[0])
        cov.append(fix[1])
        kept.append(k)
    t = run.overhead_t[kept]
    return PoseFixes(t, np.array(z).reshape(-1, 3), np.array(cov).reshape(-1, 3, 3), t)


def _places(spec: OverheadSpec, pose: Array, rng: np.random.Generator) -> Array:
    """Returns where the centre and the front tag are (2, 2), floor frame, their noise included."""
    at = transform_points(pose, spec.tags.points())
    return np.asarray(at + spec.tag_noise * rng.standard_normal((2, 2)))


def _shown(spec: OverheadSpec, t: float) -> tuple[str, str]:
    """Returns the colours of the centre and of the front tag at a time."""
    return ("front", "centre") if spec.is_exchanged(t) else ("centre", "front")


def _cover(
    floor: Array, place: Array, radius: float, soft: float, workspace: Workspace
) -> tuple[tuple[slice, slice], NDArray[np.float32]] | None:
    """Returns the part of the image that a disc touches, and how far it covers each pixel there."""
    grid, blur = workspace.grid, workspace.blur
    height, width = grid.off_floor.shape
    angle = np.linspace(0.0, 2.0 * math.pi, 16, endpoint=False)
    ring = place + (radius + BORDER * soft) * np.column_stack([np.cos(angle), np.sin(angle)])
    pixels = workspace.eye.to_pixels(ring)
    if not np.isfinite(pixels).all():
        return None
    margin = 3.0 + BORDER * blur + 0.1 * np.ptp(pixels, axis=0)
    (u0, v0), (u1, v1) = pixels.min(axis=0) - margin, pixels.max(axis=0) + margin
    rows = slice(max(int(v0), 0), min(int(v1) + 1, height))
    columns = slice(max(int(u0), 0), min(int(u1) + 1, width))
    if rows.start >= rows.stop or columns.start >= columns.stop:
        return None
    box = (rows, columns)
    distance = np.linalg.norm(floor[box] - place, axis=-1) - radius
    pixel = math.sqrt(0.5 * (blur**2 + 1.0 / 12.0)) * grid.footprint[box]
    spread = np.maximum(np.hypot(pixel, soft), 1e-9)
    cover = 0.5 * (1.0 - erf(distance / (math.sqrt(2.0) * spread)))
    return box, np.where(grid.off_floor[box], 0.0, cover).astype(np.float32)


def _disc(
    picture: Picture,
    floor: Array,
    place: Array,
    radius: float,
    bgr: tuple[float, ...],
    workspace: Workspace,
) -> None:
    """Draws a disc of one colour into a picture (H, W, 3)."""
    found = _cover(floor, place, radius, 0.0, workspace)
    if found is not None:
        box, cover = found
        picture[box] += cover[..., None] * (np.array(bgr, np.float32) - picture[box])


def _fade(
    picture: Picture, floor: Array, place: Array, radius: float, left: float, workspace: Workspace
) -> None:
    """Leaves so much of the light of a picture (H, W, 3) where a soft disc lies."""
    found = _cover(floor, place, radius, SHADOW_SOFT_M, workspace)
    if found is not None:
        box, cover = found
        picture[box] *= 1.0 - (1.0 - left) * cover[..., None]
