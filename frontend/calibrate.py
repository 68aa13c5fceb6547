"""Where the floor is in the image: a camera from points whose places on the floor are known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np

from frontend.calibrate_fit import (
    FEWEST_FOR_LENS,
    FEWEST_POINTS,
    Fit,
    fit_homography,
    fit_with_lens,
    nominal_matrix,
)
from frontend.camera import Camera
from frontend.log import DEFAULT_CAMERA
from graphslam.errors import BadConfig, UnderConstrained
from graphslam.geometry import Array

OUTLIER = 6.0
"""A point is suspicious where the others put it this many times their median, in pixels, away."""
VISIBLE_M = 0.005
"""And at least this far, m: below it a tape measure is at its end."""
FAR_M = 20.0
"""Points beyond this, m, are hardly in metres."""


@dataclass(frozen=True, slots=True, eq=False)
class KnownPoints:
    """Points of the floor and where they are in one image.

    Attributes:
        pixel: (K, 2) (u, v) in the image as it was taken, centres at integers.
        floor: (K, 2) (x, y), robot frame, m.
        source: where they are from, for messages.
    """

    pixel: Array
    floor: Array
    source: str

    def __post_init__(self) -> None:
        _freeze(self)
        if self.pixel.shape != (len(self.pixel), 2) or self.pixel.shape != self.floor.shape:
            raise BadConfig(
                f"{self.source}: pixel {self.pixel.shape} and floor {self.floor.shape} must both "
                "be (K, 2)"
            )
        if not (np.isfinite(self.pixel).all() and np.isfinite(self.floor).all()):
            raise BadConfig(f"{self.source}: holds NaN or infinity; leave those points out")


@dataclass(frozen=True, slots=True, eq=False)
class Lens:
    """A lens that is known already, from OpenCV's calibration for example.

    Attributes:
        matrix: (3, 3) camera matrix, pixels.
        distortion: (n,) OpenCV coefficients k1 k2 p1 p2 [k3 ...] (fisheye: k1 k2 k3 k4).
        model: which of OpenCV's models they belong to, "plain" or "fisheye".
    """

    matrix: Array
    distortion: Array
    model: str = "plain"


@dataclass(frozen=True, slots=True, eq=False)
class CameraCalibration:
    """A camera and how well it puts the points where they are.

    Attributes:
        camera: that was found.
        points: that it was found from.
        error_m: (K, 2) where each pixel lands on the floor less where the point is, m, robot frame.
        error_px: (K, 2) where each point lands in the image less where it was seen, undistorted
            pixels.
        left_out_m: (K, 2) `error_m` of each point by the camera that the others give; NaN where
            they give none.
        left_out_px: (K, 2) the same of `error_px`.
        notes: what looks wrong, in sentences.
    """

    camera: Camera
    points: KnownPoints
    error_m: Array
    error_px: Array
    left_out_m: Array
    left_out_px: Array
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _freeze(self)

    @property
    def mean_error_m(self) -> float:
        """The paper's reprojection error: mean distance on the floor, m (SantanaLoc, 4.2)."""
        return float(np.linalg.norm(self.error_m, axis=1).mean())


def calibrate_camera(
    points: KnownPoints,
    image_size: tuple[int, int],
    lens: Lens | None = None,
    fit_distortion: bool = False,
) -> CameraCalibration:
    """Returns the camera that known points of the floor give.

    Args:
        points: four or more, no three of four on a line.
        image_size: (width, height), pixels.
        lens: its matrix and distortion, where they are known.
        fit_distortion: whether to find one radial coefficient from the same points; needs six.

    Raises:
        UnderConstrained: too few points, or nearly all on a line.
        BadConfig: the points make no camera that looks at the floor from above.
    """
    if lens is not None and fit_distortion:
        raise BadConfig("a lens that is given is not fitted too; choose one of both")
    solve = _solver(image_size, lens, fit_distortion)
    try:
        camera = solve(points.pixel, points.floor)
    except (UnderConstrained, BadConfig) as refused:
        raise type(refused)(f"{points.source}: {refused}") from None
    _check_side(camera, points)
    error_m, error_px = errors_of(camera, points)
    left_out = _leave_one_out(points, solve)
    found = CameraCalibration(camera, points, error_m, error_px, *left_out)
    return replace(found, notes=_notes(found, fit_distortion))


def errors_of(camera: Camera, points: KnownPoints) -> tuple[Array, Array]:
    """Returns errors (K, 2) of known points on the floor, m, and in the undistorted image, pixels.

    NaN on the floor where a pixel is not below the horizon, in the image where a point is behind
    the camera.
    """
    seen = camera.undistort(points.pixel)
    return camera.pixel_to_floor(seen) - points.floor, camera.floor_to_pixel(points.floor) - seen


def camera_toml(found: CameraCalibration) -> str:
    """Returns ``[camera]`` for log.toml, with what it was found from and how well it fits."""
    camera, pixels = found.camera, np.linalg.norm(found.error_px, axis=1).mean()
    lines = [
        f"# from {len(found.points.floor)} points of {found.points.source}; mean reprojection "
        f"error {1e2 * found.mean_error_m:.2g} cm, {pixels:.2g} px",
        "[camera]",
        f"image_size = [{camera.image_size[0]}, {camera.image_size[1]}]",
        f"homography = {_rows(camera.homography)}  # floor (robot frame, m) to pixel",
    ]
    if camera.distortion is not None and camera.matrix is not None:
        lines.append(f"matrix = {_rows(camera.matrix)}")
        lines.append(f"distortion = [{', '.join(_number(v) for v in camera.distortion)}]")
        if camera.lens != "plain":
            lines.append(f'lens = "{camera.lens}"')
    return "\n".join(lines) + "\n"


def _solver(
    image_size: tuple[int, int], lens: Lens | None, fit_distortion: bool
) -> Callable[[Array, Array], Camera]:
    """Returns the function that makes a camera of pixels (K, 2) and floor points (K, 2)."""

    model = "plain" if lens is None else lens.model

    def camera_of(fit: Fit, matrix: Array | None, distortion: Array | None) -> Camera:
        H = fit.homography
        return Camera(DEFAULT_CAMERA, "floor", image_size, H, matrix, distortion, model)

    def plain(pixel: Array, floor: Array) -> Camera:
        return camera_of(fit_homography(floor, pixel), None, None)

    def fitted(pixel: Array, floor: Array) -> Camera:
        fit = fit_with_lens(floor, pixel, image_size)
        return camera_of(fit, nominal_matrix(image_size), np.array([fit.k1, 0.0, 0.0, 0.0]))

    def known(pixel: Array, floor: Array) -> Camera:
        assert lens is not None
        only_lens = camera_of(Fit(np.eye(3)), lens.matrix, lens.distortion)
        fit = fit_homography(floor, only_lens.undistort(pixel))
        return camera_of(fit, lens.matrix, lens.distortion)

    return fitted if fit_distortion else plain if lens is None else known


def _leave_one_out(
    points: KnownPoints, solve: Callable[[Array, Array], Camera]
) -> tuple[Array, Array]:
    """Returns the errors (K, 2) of each point by the camera of the others, m and pixels."""
    count = len(points.floor)
    left_m, left_px = np.full((count, 2), np.nan), np.full((count, 2), np.nan)
    for k in range(count) if count > FEWEST_POINTS else ():
        rest = np.arange(count) != k
        try:
            camera = solve(points.pixel[rest], points.floor[rest])
        except (UnderConstrained, BadConfig):
            continue
        one = KnownPoints(points.pixel[k : k + 1], points.floor[k : k + 1], points.source)
        left_m[k : k + 1], left_px[k : k + 1] = errors_of(camera, one)
    return left_m, left_px


def _check_side(camera: Camera, points: KnownPoints) -> None:
    """Raises BadConfig where the camera would see the floor from below.

    From above x, y and the way to the eye are right-handed and so are u, v and the way from it:
    the homography, its depth positive, turns the sense of rotation round.
    """
    if np.linalg.det(camera.homography) > 0:
        raise BadConfig(
            f"{points.source}: the image is a mirror image of the points; x must point forward and "
            "y to the left, in metres, u to the right and v down in the image"
        )
    if np.isnan(errors_of(camera, points)[1]).any():
        raise BadConfig(
            f"{points.source}: some points would lie behind the camera; one of them was measured "
            "or read wrongly"
        )


def _notes(found: CameraCalibration, fit_distortion: bool) -> tuple[str, ...]:
    notes = []
    farthest = np.linalg.norm(found.points.floor, axis=1).max()
    if farthest > FAR_M:
        notes.append(f"The farthest point is {farthest:.3g} m away: are the numbers in metres?")
    left_m, left_px = (np.linalg.norm(e, axis=1) for e in (found.left_out_m, found.left_out_px))
    if np.isfinite(left_px).sum() > 1:
        worst = int(np.nanargmax(left_px))
        others = float(np.nanmedian(np.delete(left_px, worst)))
        if left_px[worst] > OUTLIER * others and left_m[worst] > VISIBLE_M:
            notes.append(
                f"Point {worst + 1} is {1e2 * left_m[worst]:.2g} cm, {left_px[worst]:.2g} px, from "
                f"where the others put it; among them {others:.2g} px is usual. Was it measured or "
                "read wrongly?"
            )
    if len(found.points.floor) == FEWEST_POINTS:
        notes.append(
            "Four points are met exactly whatever they are: measure two more to see how good "
            "they are."
        )
    if fit_distortion and len(found.points.floor) < 2 * FEWEST_FOR_LENS:
        notes.append("Distortion from so few points is vague: compare the errors of left-out ones.")
    return tuple(notes)


def _rows(matrix: Array) -> str:
    return f"[{', '.join('[' + ', '.join(_number(v) for v in row) + ']' for row in matrix)}]"


def _number(value: float) -> str:
    text = f"{value:.10g}"
    return text if any(c in text for c in ".en") else f"{text}.0"


def _freeze(instance: KnownPoints | CameraCalibration) -> None:
    for f in fields(instance):
        value = getattr(instance, f.name)
        if isinstance(value, np.ndarray):
            value = np.array(value, float)
            value.flags.writeable = False
            object.__setattr__(instance, f.name, value)
