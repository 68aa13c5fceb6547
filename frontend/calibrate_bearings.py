"""What lens, mirror and mounting do to directions, found from known poses and landmarks."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from frontend.config import ExtractConfig
from frontend.image_cones import bearings_in_images
from frontend.log import Log
from frontend.omni import MOST_HARMONICS, BearingCorrection, OmniCamera, correction_terms
from graphslam.errors import BadConfig, BadLog
from graphslam.geometry import Array, interpolate_poses, wrap
from graphslam.measurements import IntArray
from graphslam.models.bearing import BEARING

HARMONICS = 2
FEWEST_PER_NUMBER = 3
"""Directions for each number that is found; fewer would be fitted, not measured."""
LARGEST_OFF = np.radians(45.0)
"""A direction is a landmark's within this, once the mean error is taken off."""
NEAR = np.radians(6.0)
"""Errors this near to their fullest bin make the mean error."""
ROBUST = 3.0
"""Residuals beyond this many standard deviations count less and less (soft L1)."""


@dataclass(frozen=True, slots=True)
class KnownDirections:
    """Directions as measured, with the true ones.

    Attributes:
        measured: (K,) directions without any correction, rad, robot frame.
        true: (K,) where the landmark really is, rad, robot frame.
        sigma: (K,) stated standard deviations of the measured ones, rad.
        pixel: (K, 2) the centroids they were read from, NaN where they come from no image.
        group: (K,) pose that each was seen from, as a number.
    """

    measured: Array
    true: Array
    sigma: Array
    pixel: Array
    group: IntArray

    def select(self, rows: Array) -> KnownDirections:
        """Returns the rows that a mask or numbers name."""
        columns = (getattr(self, name)[rows] for name in self.__slots__)
        return KnownDirections(*columns)


@dataclass(frozen=True, slots=True)
class BearingCalibration:
    """What was found.

    Attributes:
        camera: the omnidirectional camera with its new numbers; None for bearings.csv.
        correction: what is to be added to directions.
        count: directions that were used.
        before_deg: RMS error of the directions as they are used now, degrees.
        after_deg: the same with the new numbers, on poses that had no part in finding them (each
            fifth of the drive from the other four); degrees.
        bias_before_deg: mean error now, degrees.
        sigma_deg: (n,) standard deviations of the numbers found: offset, harmonics, degrees.
        sigma_centre_px: the same of the mirror's centre, pixels; NaN where it was not looked for.
        stated_deg: RMS of the standard deviations stated for the directions, degrees.
    """

    camera: OmniCamera | None
    correction: BearingCorrection
    count: int
    before_deg: float
    after_deg: float
    bias_before_deg: float
    sigma_deg: Array
    sigma_centre_px: float
    stated_deg: float


def fit_correction(known: KnownDirections, harmonics: int) -> tuple[BearingCorrection, Array]:
    """Returns the correction that fits best, and standard deviations of its numbers, degrees.

    Linear least squares of true minus measured direction, weighted, with a soft L1 kernel against
    what was taken for the wrong landmark.

    Args:
        known: directions with the true ones.
        harmonics: how many waves around the robot to find; 0 finds the offset only.

    Raises:
        BadConfig: too few directions for so many numbers.
    """
    _check_count(known, 1 + 2 * harmonics)
    A = correction_terms(known.measured, harmonics)
    off = wrap(known.true - known.measured)
    middle = float(np.angle(np.mean(np.exp(1j * off))))
    start = np.zeros(A.shape[1])
    start[0] = middle

    def residual(x: Array) -> Array:
        return np.asarray(wrap(off - A @ x) / known.sigma)

    scale = max(float(np.median(np.abs(residual(start)))) / 0.6745, 1e-9)
    found = least_squares(
        residual, start, loss="soft_l1", f_scale=ROBUST * scale, x_scale="jac", xtol=1e-14
    )
    numbers = np.degrees(found.x)
    pairs = tuple((float(c), float(s)) for c, s in numbers[1:].reshape(-1, 2))
    return BearingCorrection(float(numbers[0]), pairs), np.degrees(_sigmas(found.jac, found.fun))


def fit_centre(
    known: KnownDirections, camera: OmniCamera, harmonics: int
) -> tuple[OmniCamera, Array, float]:
    """Returns the camera with its centre and correction found together.

    A centre that is off shows as a wave once around whose height goes as one over the distance
    from the centre, so that only the second wave and higher ones are found beside it.

    Args:
        known: directions with the true ones, and their pixels.
        camera: begins the search; its correction is replaced.
        harmonics: as of `fit_correction`; the first is zero.

    Returns:
        The camera; standard deviations of offset and harmonics, degrees, and of the centre, px.
    """
    higher = max(0, harmonics - 1)
    _check_count(known, 3 + 2 * higher)

    def made(x: Array) -> OmniCamera:
        pairs = ((0.0, 0.0), *(tuple(np.degrees(pair)) for pair in x[3:].reshape(-1, 2)))
        correction = BearingCorrection(float(np.degrees(x[2])), pairs if higher else ())
        centre = (float(x[0]), float(x[1]))
        return replace(camera, centre=centre, correction=correction)

    def residual(x: Array) -> Array:
        return np.asarray(wrap(known.true - made(x).bearing(known.pixel)) / known.sigma)

    off = wrap(known.true - camera.measured(known.pixel))
    start = np.zeros(3 + 2 * higher)
    start[:3] = *camera.centre, float(np.angle(np.mean(np.exp(1j * off))))
    scale = max(float(np.median(np.abs(residual(start)))) / 0.6745, 1e-9)
    size = np.array([1.0, 1.0, *[0.01] * (1 + 2 * higher)])
    found = least_squares(
        residual, start, loss="soft_l1", f_scale=ROBUST * scale, x_scale=size, diff_step=1e-7
    )
    sigma = _sigmas(found.jac, found.fun)
    angles = np.degrees(np.concatenate([sigma[2:3], [0.0, 0.0] if higher else [], sigma[3:]]))
    return made(found.x), angles, float(np.hypot(*sigma[:2]) / np.sqrt(2.0))


def known_directions(log: Log, config: ExtractConfig) -> tuple[KnownDirections, OmniCamera | None]:
    """Returns the directions of a log whose landmarks and poses are known, and their camera.

    Which landmark a direction is of, where the log does not say, is the nearest of its label once
    the mean error is taken off; the mean is found by trying where most agree.

    Raises:
        BadLog: there are no bearings, no landmarks or no true poses.
    """
    if log.truth is None or log.landmarks is None:
        missing = "groundtruth.tum" if log.truth is None else "landmarks.csv"
        raise BadLog(
            f"{log.folder}: calibration of bearings needs poses and landmarks that are known: "
            f"{missing} is missing; add it"
        )
    camera: OmniCamera | None = None
    numbers = log.images_of("omni")
    if log.bearings is not None:
        t, z = log.bearings.t, log.bearings.z[:, 0]
        sigma, label = np.sqrt(log.bearings.cov[:, 0, 0]), log.bearings.label
        pixel, named = np.full((len(t), 2), np.nan), log.bearings.truth
    elif log.images is not None and len(numbers):
        cameras = [*log.looking_at("omni").values()]
        if len(cameras) > 1:
            raise BadLog(
                f"{log.folder}: has several omnidirectional cameras; keep the images of one"
            )
        camera, found = cameras[0], bearings_in_images(log, numbers, config)
        t, pixel = log.images.t[found.source], found.seen.pixel
        z, label = camera.measured(pixel), found.seen.label
        sigma = np.sqrt(found.seen.cov[:, 0, 0])
        named = np.full(len(t), -1)
    else:
        raise BadLog(
            f"{log.folder}: has no bearings to calibrate; add bearings.csv, or images of a camera "
            'with looks_at = "omni"'
        )
    first, last = log.truth.t[[0, -1]]
    inside = (t >= first) & (t <= last)
    t, z, sigma, label, pixel, named = (a[inside] for a in (t, z, sigma, label, pixel, named))
    true = _true_directions(log, t, z, label, named)
    kept = np.isfinite(true)
    group = np.unique(t[kept], return_inverse=True)[1]
    return KnownDirections(z[kept], true[kept], sigma[kept], pixel[kept], group), camera


def calibrate_bearings(
    log: Log, config: ExtractConfig | None = None, harmonics: int = HARMONICS
) -> BearingCalibration:
    """Returns the correction of directions, and the mirror's centre, that a log's truth gives.

    Args:
        log: with bearings.csv or images of an omnidirectional camera, landmarks.csv and
            groundtruth.tum. What is found replaces the correction that it has.
        config: how cones are found.
        harmonics: how many waves around the robot to find.

    Raises:
        BadLog: something is missing.
        BadConfig: there are too few directions, or too many harmonics are asked for.
    """
    if not 0 <= harmonics <= MOST_HARMONICS:
        raise BadConfig(f"harmonics = {harmonics}: must be 0 to {MOST_HARMONICS}")
    known, camera = known_directions(log, config or ExtractConfig())
    used_now = log.bearing_correction if camera is None else camera.correction
    before = wrap(used_now.of(known.measured) - known.true)
    after = np.full(len(before), np.nan)
    fold = known.group * 5 // (known.group.max(initial=0) + 1)
    for part in np.unique(fold):
        rest, held = known.select(fold != part), known.select(fold == part)
        after[fold == part] = wrap(_corrected(rest, camera, harmonics, held) - held.true)
    sigma_centre = float("nan")
    if camera is None:
        correction, sigma = fit_correction(known, harmonics)
    else:
        camera, sigma, sigma_centre = fit_centre(known, camera, harmonics)
        correction = camera.correction
    return BearingCalibration(
        camera=camera,
        correction=correction,
        count=len(before),
        before_deg=_rms_deg(before),
        after_deg=_rms_deg(after),
        bias_before_deg=float(np.degrees(np.angle(np.mean(np.exp(1j * before))))),
        sigma_deg=sigma,
        sigma_centre_px=sigma_centre,
        stated_deg=_rms_deg(known.sigma),
    )


def _corrected(
    known: KnownDirections, camera: OmniCamera | None, harmonics: int, held: KnownDirections
) -> Array:
    """Returns the directions ``held`` (k,), corrected by what ``known`` ones give, rad."""
    if camera is None:
        return fit_correction(known, harmonics)[0].of(held.measured)
    return fit_centre(known, camera, harmonics)[0].bearing(held.pixel)


def _true_directions(log: Log, t: Array, z: Array, label: IntArray, named: IntArray) -> Array:
    """Returns where the landmark of each direction is (K,), rad, robot frame; NaN where unclear."""
    assert log.truth is not None and log.landmarks is not None  # noqa: PT018  checked before
    rows, points = log.landmarks.of_kind(BEARING.kind)
    if not len(rows):
        raise BadLog(f"{log.folder / 'landmarks.csv'}: holds no landmark of kind bearing; add them")
    pose = interpolate_poses(t, log.truth.t, log.truth.pose)
    true = BEARING.residual(pose[:, None], points, np.zeros((len(points), 1)))[0][..., 0]
    if (named >= 0).any():
        allowed = named[:, None] == log.landmarks.id[rows]
    else:
        own, of = label[:, None], log.landmarks.label[rows]
        allowed = (own == of) | (own < 0) | (of < 0)
    off = wrap(true - z[:, None])
    middle = _common(off[allowed])
    away = np.where(allowed, np.abs(wrap(off - middle)), np.inf)
    nearest = away.argmin(axis=1)
    row = np.arange(len(z))
    return np.where(away[row, nearest] < LARGEST_OFF, true[row, nearest], np.nan)


def _common(angles: Array) -> float:
    """Returns the angle that most of these (n,), rad, are near to: the fullest bin, refined."""
    if not len(angles):
        return 0.0
    counts, edges = np.histogram(angles, bins=180, range=(-np.pi, np.pi))
    around = counts + np.roll(counts, 1) + np.roll(counts, -1)
    best = int(around.argmax())
    middle = 0.5 * float(edges[best] + edges[best + 1])
    near = angles[np.abs(wrap(angles - middle)) < NEAR]
    return middle + float(np.mean(wrap(near - middle))) if len(near) else middle


def _check_count(known: KnownDirections, numbers: int) -> None:
    if len(known.true) < FEWEST_PER_NUMBER * numbers:
        raise BadConfig(
            f"{len(known.true)} directions of known landmarks from known poses are too few to find "
            f"{numbers} numbers; record more, or ask for fewer --harmonics"
        )


def _sigmas(J: Array, residual: Array) -> Array:
    """Returns standard deviations of fitted numbers, scaled by how well they fit."""
    freedom = max(1, len(residual) - J.shape[1])
    scale = float(residual @ residual) / freedom
    return np.asarray(np.sqrt(scale * np.diag(np.linalg.pinv(J.T @ J))))


def _rms_deg(angles: Array) -> float:
    return float(np.degrees(np.sqrt(np.mean(np.square(angles)))))
