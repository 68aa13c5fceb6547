"""A differential drive: from wheels, or someone else's poses, to increments and their noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from graphslam.compiled import guvectorize
from graphslam.errors import BadConfig
from graphslam.geometry import Array, between, interpolate_poses, wrap

LAWS = ("distance", "paper")
DEFAULT_NOISE = {"distance": 0.02, "paper": 0.03}


@dataclass(frozen=True, slots=True)
class DifferentialDrive:
    """A robot with two driven wheels, and how much its odometry errs.

    Attributes:
        wheel_radius_left: m.
        wheel_radius_right: m.
        wheel_base: distance between the wheels, m.
        noise_left: k of the left wheel: rad/sqrt(rad), default 0.02, under "distance"; rad/rad,
            default 0.03, under "paper".
        noise_right: the same of the right wheel.
        law: "distance": each reading has variance k^2 |rotation|. "paper": std = k |rotation|,
            applied once to the whole rotation between two nodes, SantanaSLAM eq. (17).
        slip: standard deviations of slip along x, y (m) and of the heading (rad) for each square
            root of a metre, a metre being driven or turned by the wheels.
        floor: standard deviations added to every increment between nodes, m and rad; numerical.
    """

    wheel_radius_left: float
    wheel_radius_right: float
    wheel_base: float
    noise_left: float | None = None
    noise_right: float | None = None
    law: str = "distance"
    slip: tuple[float, float, float] = (0.002, 0.002, 0.005)
    floor: tuple[float, float] = (1e-4, 1e-4)

    def __post_init__(self) -> None:
        for name in ("wheel_radius_left", "wheel_radius_right", "wheel_base"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise BadConfig(f"{name} = {value}: must be a positive length in metres")
        if self.law not in LAWS:
            raise BadConfig(f"law = {self.law!r}: must be one of {', '.join(LAWS)}")
        for name in ("noise_left", "noise_right"):
            if getattr(self, name) is None:
                object.__setattr__(self, name, DEFAULT_NOISE[self.law])
        for name, size in (("slip", 3), ("floor", 2)):
            if len(getattr(self, name)) != size:
                raise BadConfig(f"{name} needs {size} numbers, not {len(getattr(self, name))}")
        values = [self.noise_left, self.noise_right, *self.slip, *self.floor]
        if not all(v is not None and math.isfinite(v) and v >= 0 for v in values):
            raise BadConfig("noise_left, noise_right, slip and floor must be finite, not negative")

    @property
    def parameters(self) -> Array:
        """Radii, base, noises and slip (8,), in the order that the compiled functions take."""
        radii = (self.wheel_radius_left, self.wheel_radius_right, self.wheel_base)
        return np.array([*radii, self.noise_left, self.noise_right, *self.slip], dtype=float)

    @property
    def floor_covariance(self) -> Array:
        """The numerical floor as a covariance (3, 3), frame of node i."""
        return np.diag([self.floor[0] ** 2, self.floor[0] ** 2, self.floor[1] ** 2])


@njit(cache=True)
def _arc(length, turn):  # type: ignore[no-untyped-def]
    """Returns x, y of an arc's end and their derivatives (x_L, x_T, y_L, y_T); exact at turn = 0.

    With the half turn h: x = L sinc(h) cos(h), y = L sinc(h) sin(h), which is SantanaSLAM eq. (8)
    and its limit (10) in one form. sinc and its derivative use their series near zero.
    """
    h = 0.5 * turn
    if abs(h) < 1e-3:
        h2 = h * h
        sinc = 1.0 - h2 / 6.0 * (1.0 - h2 / 20.0)
        d_sinc = -h / 3.0 * (1.0 - h2 / 10.0)
    else:
        sinc = math.sin(h) / h
        d_sinc = (math.cos(h) - sinc) / h
    c, s = math.cos(h), math.sin(h)
    x_T = 0.5 * length * (d_sinc * c - sinc * s)
    y_T = 0.5 * length * (d_sinc * s + sinc * c)
    return length * sinc * c, length * sinc * s, sinc * c, x_T, sinc * s, y_T


@njit(cache=True)
def _wheel_step(left, right, r_left, r_right, base, V):  # type: ignore[no-untyped-def]
    """Returns x, y, turn and length of one reading; fills V (3, 2), columns left and right."""
    length = 0.5 * (right * r_right + left * r_left)
    turn = (right * r_right - left * r_left) / base
    x, y, x_L, x_T, y_L, y_T = _arc(length, turn)
    L_l, L_r, T_l, T_r = 0.5 * r_left, 0.5 * r_right, -r_left / base, r_right / base
    V[0, 0], V[0, 1] = x_L * L_l + x_T * T_l, x_L * L_r + x_T * T_r
    V[1, 0], V[1, 1] = y_L * L_l + y_T * T_l, y_L * L_r + y_T * T_r
    V[2, 0], V[2, 1] = T_l, T_r
    return x, y, turn, length


@guvectorize(["void(f8[:], f8[:], f8[:], f8[:], f8[:,:])"], "(w),(g),(p)->(p),(p,w)")
def _wheel_increment(rotation, drive, dummy, increment, V):  # type: ignore[no-untyped-def]
    x, y, turn, _ = _wheel_step(rotation[0], rotation[1], drive[0], drive[1], drive[2], V)
    increment[0], increment[1], increment[2] = x, y, turn


def wheel_increment(rotation: Array, drive: DifferentialDrive) -> tuple[Array, Array]:
    """Returns the motion (..., 3) of wheel rotations and its Jacobian V (..., 3, 2).

    Args:
        rotation: (..., 2) rotations of the left and right wheel, rad, speeds held constant.
        drive: radii and base.

    Returns:
        The increment ``(x, y, theta)`` in the robot frame before the motion, m and rad, theta not
        wrapped; and V, its derivative by the two rotations. Exact for equal and for still wheels.

    Source: SantanaSLAM eqs. (8)-(10), (16); (16) divides by the difference of the wheels and needs
    the limit that is taken here. SantanaLoc (9), (12) print the wrong sign in y, (14) the wrong
    factor, (19), (21) wrong K1 and K3.
    """
    increment, V = _wheel_increment(np.asarray(rotation, float), drive.parameters, np.zeros(3))
    return increment, V


@njit(cache=True)
def _turn(A, theta):  # type: ignore[no-untyped-def]
    """Turns the x and y rows of A (3, n) by theta, in place."""
    c, s = math.cos(theta), math.sin(theta)
    for col in range(A.shape[1]):
        x, y = A[0, col], A[1, col]
        A[0, col], A[1, col] = c * x - s * y, s * x + c * y


@njit(cache=True)
def _carry(A, dx, dy):  # type: ignore[no-untyped-def]
    """Moves sensitivities A (3, n) of a pose over a step: heading errors become offsets."""
    for col in range(A.shape[1]):
        A[0, col] -= dy * A[2, col]
        A[1, col] += dx * A[2, col]


@njit(cache=True)
def _add_noise(cov, A, variance):  # type: ignore[no-untyped-def]
    """Adds A diag(variance) A' to cov (3, 3), in place."""
    for a in range(3):
        for b in range(3):
            for n in range(A.shape[1]):
                cov[a, b] += A[a, n] * variance[n] * A[b, n]


@njit(cache=True)
def _accumulate(steps, interval, count, drive, paper):  # type: ignore[no-untyped-def]
    """Returns increments (count, 3) and covariances (count, 3, 3) of grouped readings.

    Loops over scalars throughout: matrix products would take ten times as long to compile.
    """
    increment, cov = np.zeros((count, 3)), np.zeros((count, 3, 3))
    scale = np.zeros((count, 3, 2))  # d increment / d relative error of each wheel, for "paper"
    V, half = np.zeros((3, 2)), np.zeros((3, 3))
    wheel, slip = np.zeros(2), np.zeros(3)
    for k in range(len(steps)):
        i = interval[k]
        x, y, turn, length = _wheel_step(steps[k, 0], steps[k, 1], drive[0], drive[1], drive[2], V)
        # slip strikes in the middle of the reading: turned by half, with the rest as lever arm
        x_h, y_h = _arc(0.5 * length, 0.5 * turn)[:2]
        half[0, 0], half[0, 1], half[0, 2] = 1.0, 0.0, 0.0
        half[1, 0], half[1, 1], half[1, 2] = 0.0, 1.0, 0.0
        half[2, 2] = 1.0
        _turn(half, 0.5 * turn)
        _carry(half, x - x_h, y - y_h)
        # compose: increment <- increment + R(theta) step
        theta = increment[i, 2]
        _turn(V, theta)
        _turn(half, theta)
        c, s = math.cos(theta), math.sin(theta)
        dx, dy = c * x - s * y, s * x + c * y
        _carry(cov[i], dx, dy)
        _carry(cov[i].T, dx, dy)
        _carry(scale[i], dx, dy)
        metres = abs(length) + 0.5 * drive[2] * abs(turn)
        for n in range(3):
            slip[n] = drive[5 + n] ** 2 * metres
        _add_noise(cov[i], half, slip)
        for w in range(2):
            wheel[w] = drive[3 + w] ** 2 * abs(steps[k, w])
            for a in range(3):
                scale[i, a, w] += V[a, w] * steps[k, w]
        if not paper:
            _add_noise(cov[i], V, wheel)
        increment[i, 0] += dx
        increment[i, 1] += dy
        increment[i, 2] += turn
    if paper:
        for w in range(2):
            wheel[w] = drive[3 + w] ** 2
        for i in range(count):
            _add_noise(cov[i], scale[i], wheel)
    return increment, cov


def _split(t: Array, values: Array, nodes: Array) -> tuple[Array, NDArray[np.int64]]:
    """Returns differences of ``values`` between readings cut at nodes, and their node interval."""
    inside = t[(t > nodes[0]) & (t < nodes[-1])]
    cuts = np.union1d(inside, nodes)
    at_cuts = np.column_stack([np.interp(cuts, t, column) for column in values.T])
    interval = np.searchsorted(nodes, cuts[:-1], side="right") - 1
    return np.diff(at_cuts, axis=0), interval


def increments_from_wheels(
    wheel_t: Array, wheel_angle: Array, node_t: Array, drive: DifferentialDrive
) -> tuple[Array, Array]:
    """Returns odometry increments between nodes, composed from every encoder reading.

    Args:
        wheel_t: (W,) s, increasing, covering all of ``node_t``.
        wheel_angle: (W, 2) cumulative angles of the left and right wheel, rad; linear in between.
        node_t: (N,) s, increasing, N >= 1.
        drive: geometry, noise law, slip and floor.

    Returns:
        Increments (N-1, 3), m and rad, and covariances (N-1, 3, 3), in the frame of node i. Under
        "paper" one relative error of each wheel holds for the whole interval, so that its rotation
        has std k |rotation|.

    Source: SantanaSLAM eqs. (8)-(10), (16), (17); SantanaLoc eq. (20) is the law "distance".
    """
    if len(node_t) < 2:
        return np.zeros((0, 3)), np.zeros((0, 3, 3))
    steps, interval = _split(wheel_t, wheel_angle, node_t)
    return _with_floor(steps, interval, len(node_t) - 1, drive)


def increments_from_poses(
    pose_t: Array, poses: Array, node_t: Array, drive: DifferentialDrive
) -> tuple[Array, Array]:
    """Returns odometry increments between nodes from someone else's odometry poses.

    Each step between two poses is taken as an arc, its wheel rotations follow from the drive, and
    noise and slip are those of `increments_from_wheels`.

    Args:
        pose_t: (K,) s, increasing, covering all of ``node_t``.
        poses: (K, 3) odometry poses in their own frame, m and rad.
        node_t: (N,) s, increasing.
        drive: the geometry that the wheel noise acts through.

    Returns:
        Increments (N-1, 3) and covariances (N-1, 3, 3), in the frame of node i. The increments are
        the poses' own, exactly; only the noise goes through the wheels.
    """
    if len(node_t) < 2:
        return np.zeros((0, 3)), np.zeros((0, 3, 3))
    inside = pose_t[(pose_t > node_t[0]) & (pose_t < node_t[-1])]
    cuts = np.union1d(inside, node_t)
    at_cuts = interpolate_poses(cuts, pose_t, poses)
    step = between(at_cuts[:-1], at_cuts[1:])
    # the arc with this chord and turn, driven forwards or backwards
    half = 0.5 * step[:, 2]
    chord = np.hypot(step[:, 0], step[:, 1])
    sign = np.where(step[:, 0] * np.cos(half) + step[:, 1] * np.sin(half) < 0, -1.0, 1.0)
    length = sign * chord / np.sinc(half / np.pi)
    spread = 0.5 * drive.wheel_base * step[:, 2]
    rotations = np.column_stack(
        [
            (length - spread) / drive.wheel_radius_left,
            (length + spread) / drive.wheel_radius_right,
        ]
    )
    interval = np.searchsorted(node_t, cuts[:-1], side="right") - 1
    _, cov = _with_floor(rotations, interval, len(node_t) - 1, drive)
    at_nodes = interpolate_poses(node_t, pose_t, poses)
    return between(at_nodes[:-1], at_nodes[1:]), cov


def _with_floor(
    steps: Array, interval: NDArray[np.int64], count: int, drive: DifferentialDrive
) -> tuple[Array, Array]:
    increment, cov = _accumulate(steps, interval, count, drive.parameters, drive.law == "paper")
    increment[:, 2] = wrap(increment[:, 2])
    return increment, cov + drive.floor_covariance
