"""The images of a simulated drive, camera by camera: when each is taken, and what draws it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frontend.log import DEFAULT_CAMERA
from frontend.simulate.cones import OMNI
from frontend.simulate.drive import Drive
from frontend.simulate.lamps import CAMERA as CEILING_CAMERA
from frontend.simulate.lamps import ceiling_view, render_ceiling, upward_camera
from frontend.simulate.mirror import render_around
from frontend.simulate.overhead import build_workspace, hidden_frames, render_overhead
from frontend.simulate.render import pixel_grid, render
from frontend.simulate.scenario import Scenario
from frontend.simulate.view import camera_of
from frontend.simulate.workspace import NAME
from frontend.simulate.world import World, build_world
from graphslam.geometry import Array


@dataclass(frozen=True, slots=True)
class Series:
    """The images of one camera.

    Attributes:
        camera: its name.
        t: (I,) when they are taken, s.
        files: (I,) their paths inside the log's folder.
        quality: of JPEG files, 0 to 100; 0 for PNG.
        pictures: the images in order, each drawn when it is asked for.
    """

    camera: str
    t: Array
    files: list[str]
    quality: int
    pictures: Iterator[NDArray[np.uint8]]


def image_series(
    scenario: Scenario, run: Drive, streams: list[np.random.SeedSequence]
) -> list[Series]:
    """Returns the images of each camera of a scenario, those of the floor first.

    Args:
        scenario: what to draw.
        run: where the robot is.
        streams: seeds as `frontend.simulate.record` deals them.
    """
    _, _, patterns, pixels, _, tags, bearings = streams
    world = build_world(scenario, np.random.default_rng(patterns))
    series = (
        _floor(scenario, world, run, pixels),
        _overhead(scenario, world, run, pixels, tags),
        _ceiling(scenario, run, patterns, pixels),
        _omni(scenario, run, bearings),
    )
    return [part for part in series if part is not None]


def _files(folder: str, count: int, quality: int) -> list[str]:
    suffix = "jpg" if quality else "png"
    return [f"{folder}/{number:06d}.{suffix}" for number in range(count)]


def _floor(
    scenario: Scenario, world: World, run: Drive, seed: np.random.SeedSequence
) -> Series | None:
    if scenario.camera is None:
        return None
    grid = pixel_grid(camera_of(scenario.camera), scenario.light)
    pixels, quality = np.random.default_rng(seed), scenario.camera.jpeg_quality
    frames = zip(run.frame_t.tolist(), run.pose_at_frames(), strict=True)
    pictures = (render(scenario, world, grid, pose, t, pixels) for t, pose in frames)
    files = _files("images", len(run.frame_t), quality)
    return Series(DEFAULT_CAMERA, run.frame_t, files, quality, pictures)


def _overhead(
    scenario: Scenario,
    world: World,
    run: Drive,
    pixel_seed: np.random.SeedSequence,
    tag_seed: np.random.SeedSequence,
) -> Series | None:
    spec = scenario.overhead
    if spec is None:
        return None
    workspace = build_workspace(scenario, world)
    lost, tags = map(np.random.default_rng, tag_seed.spawn(2))
    pixels = np.random.default_rng(pixel_seed.spawn(1)[0])
    hidden = hidden_frames(spec, run.overhead_t, lost)
    frames = zip(run.overhead_t.tolist(), run.pose_at(run.overhead_t), hidden, strict=True)
    pictures = (
        render_overhead(scenario, workspace, pose, t, bool(covered), pixels, tags)
        for t, pose, covered in frames
    )
    files = _files(NAME, len(run.overhead_t), spec.jpeg_quality)
    return Series(NAME, run.overhead_t, files, spec.jpeg_quality, pictures)


def _ceiling(
    scenario: Scenario,
    run: Drive,
    fringe_seed: np.random.SeedSequence,
    pixel_seed: np.random.SeedSequence,
) -> Series | None:
    ceiling = scenario.ceiling
    if ceiling is None:
        return None
    camera = upward_camera(ceiling.camera)
    view = ceiling_view(ceiling, camera, np.random.default_rng(fringe_seed))
    pixels, quality = np.random.default_rng(pixel_seed), ceiling.camera.jpeg_quality
    frames = zip(run.frame_t.tolist(), run.pose_at_frames(), strict=True)
    pictures = (render_ceiling(ceiling, view, pose, t, pixels) for t, pose in frames)
    files = _files("images", len(run.frame_t), quality)
    return Series(CEILING_CAMERA, run.frame_t, files, quality, pictures)


def _omni(scenario: Scenario, run: Drive, seed: np.random.SeedSequence) -> Series | None:
    spec = scenario.omni
    if spec is None:
        return None
    pixels, light = np.random.default_rng(seed), scenario.light
    frames = zip(run.omni_t.tolist(), run.pose_at(run.omni_t), strict=True)
    pictures = (
        render_around(
            spec,
            scenario.cones,
            pose,
            scenario.surface.grey,
            pixels,
            1.0 + light.drift * math.sin(2.0 * math.pi * t / light.drift_period),
        )
        for t, pose in frames
    )
    files = _files(OMNI, len(run.omni_t), spec.jpeg_quality)
    return Series(OMNI, run.omni_t, files, spec.jpeg_quality, pictures)
