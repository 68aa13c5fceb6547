"""Rendered images of cones in a mirror: what is detected in them is where the cones stand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from frontend.cones import detect_bearings
from frontend.omni_config import OmniConfig
from frontend.simulate.cones import Cone, OmniSpec, cone_landmarks, omni_camera
from frontend.simulate.mirror import render_around
from graphslam.errors import BadConfig
from graphslam.geometry import Array, wrap
from graphslam.models.bearing import BEARING

CONES = (Cone(0.0, 0.0, "blue"), Cone(0.0, 0.7, "red"), Cone(1.0, 0.0, "green"))
SPEC = OmniSpec((320, 240), 2.0, noise=2.0)


def errors(
    spec: OmniSpec,
    pose: Array,
    cones: tuple[Cone, ...] = CONES,
    config: OmniConfig | None = None,
    seed: int = 0,
) -> Array:
    """Returns direction seen less true direction of each cone (all of different colours), rad."""
    image = render_around(spec, cones, pose, 150.0, np.random.default_rng(seed))
    found = detect_bearings(image, omni_camera(spec, cones), config or OmniConfig())
    known = cone_landmarks(cones)
    order = [found.label.tolist().index(label) for label in known.label.tolist()]
    assert len(found) == len(cones)
    return -BEARING.residual(pose, known.params, found.z[order])[0][:, 0]


@pytest.mark.parametrize("heading", [0.0, 1.1, np.pi, -2.0])
def test_each_cone_is_found_in_its_direction_whatever_the_heading(heading: float) -> None:
    error = errors(SPEC, np.array([0.4, 0.3, heading]))
    assert np.degrees(np.abs(error)).max() < 0.3


def test_the_same_seed_gives_the_same_picture_and_another_gives_other_noise() -> None:
    pose = np.array([0.4, 0.3, 0.7])
    one, same, other = (
        render_around(SPEC, CONES, pose, 150.0, np.random.default_rng(seed)) for seed in (1, 1, 2)
    )
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


def test_a_bare_base_moves_the_centroid_unless_it_is_left_out() -> None:
    spec = replace(SPEC, image_size=(640, 480), noise=0.0)
    moved = []
    for share in (0.0, 0.6):
        config = OmniConfig(base_share=share)
        off = []
        for turn in (-20.0, 0.0, 31.0):
            bare = replace(CONES[2], base="bare", base_turn_deg=turn, radius=0.06)
            poses = [np.array([0.75, 0.2, heading]) for heading in (0.4, 2.3)]
            off.append([errors(spec, pose, (bare,), config)[0] for pose in poses])
        moved.append(np.std(off, axis=0).mean())
    assert moved[1] < 0.5 * moved[0]


def test_what_is_wrong_with_the_mirror_shows_as_offset_and_waves() -> None:
    pose = np.array([0.4, 0.3, 0.7])
    turned = errors(replace(SPEC, turned_deg=2.0), pose)
    np.testing.assert_allclose(np.degrees(turned), -2.0, atol=0.2)
    around = np.radians(np.arange(0, 360, 45))
    for change, order in (({"oval": 0.05}, 2), ({"centre_off_px": (3.0, 0.0)}, 1)):
        off = [errors(replace(SPEC, **change), pose + np.array([0, 0, turn]))[0] for turn in around]
        power = np.abs(np.fft.rfft(off))
        assert power.argmax() == order


def test_a_camera_inside_its_mirror_is_refused() -> None:
    with pytest.raises(BadConfig, match="clear of the mirror"):
        OmniSpec((320, 240), 2.0, mirror_distance=0.03)


def test_a_far_cone_is_seen_small_and_one_behind_another_is_hidden() -> None:
    spec = replace(SPEC, image_size=(640, 480))
    pose = np.array([0.4, 0.3, 0.0])
    near, far = Cone(0.7, 0.3, "blue", height=0.25), Cone(1.3, 0.3, "red", height=0.1)
    assert wrap(errors(spec, pose, (near, replace(far, y=0.8)))).shape == (2,)
    image = render_around(spec, (near, far), pose, 150.0, np.random.default_rng(0))
    found = detect_bearings(image, omni_camera(spec, (near, far)), OmniConfig())
    assert found.label.tolist() == [0]
