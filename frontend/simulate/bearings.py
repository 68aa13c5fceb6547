"""Directions of cones without images, with noise of exactly the stated law."""

from __future__ import annotations

import math

import numpy as np

from frontend.log_parts import BearingSightings
from frontend.simulate.cones import cone_landmarks
from frontend.simulate.drive import Drive
from frontend.simulate.scenario import Scenario
from graphslam.geometry import wrap
from graphslam.models.bearing import BEARING


def draw_bearings(scenario: Scenario, run: Drive, seed: np.random.SeedSequence) -> BearingSightings:
    """Returns the directions of all cones seen in all images of a drive, by time, then by cone.

    Which cones are missed and the noise are drawn from streams of their own, for every cone, so
    that changing one leaves the other as it was.

    Args:
        scenario: with cones and a camera that sees them.
        run: its images' times and the true poses.
        seed: decides all that is random.
    """
    spec = scenario.omni
    assert spec is not None, "called for scenarios that see cones"
    lost, noise = map(np.random.default_rng, seed.spawn(2))
    cones, pose = cone_landmarks(scenario.cones), run.pose_at(run.omni_t)
    sigma = math.radians(spec.sigma_deg)
    true = BEARING.residual(pose[:, None], cones.params, np.zeros((len(cones), 1)))[0][..., 0]
    z = true + sigma * noise.standard_normal(true.shape)
    away = np.linalg.norm(pose[:, None, :2] - cones.params, axis=2)
    seen = lost.random(true.shape) >= spec.miss_rate
    seen &= away <= (math.inf if spec.reach is None else spec.reach)
    frame, cone = np.nonzero(seen)
    t = run.omni_t[frame]
    cov = np.full((len(t), 1, 1), sigma**2)
    return BearingSightings(t, wrap(z[seen])[:, None], cov, cones.label[cone], cone, t)
