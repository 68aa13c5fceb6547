"""Odometry's and sightings' covariances as printed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from graphslam.baseline import integrate
from graphslam.errors import BadMeasurements, UnderConstrained
from graphslam.geometry import Array, rotate_covariance
from graphslam.geometry import rotation as rotation_by
from graphslam.measurements import Measurements
from graphslam.models.line import LINE
from graphslam.models.wheels import DifferentialDrive, increments_from_wheels, wheel_increment

STRAIGHT = 1e-6
"""Wheels whose rotations differ by less count as turning alike, rad."""
A_M, B_M, C_M = 0.004, 0.3, 45.0
"""a, b and c of the printed noise of rho (SantanaLoc section 4.3), m."""
SMALLEST_SIGMA_M = 1e-4
"""The printed sigma passes through zero; a covariance needs more than that."""


def printed_v_loc(rotation: Array, drive: DifferentialDrive, heading: float) -> Array:
    """Returns V (3, 2) of wheel rotations (2,), columns left and right, floor frame.

    Not right: `wheel_increment` is. K1 is 2/b and K3 is b²/2r² of what it should be, and one K3
    serves both wheels. Wheels that turn alike up to `STRAIGHT` take the limit.

    Args:
        rotation: of the left and right wheel, rad.
        drive: radii, of which the printed form takes the mean, and base.
        heading: of the robot before the motion, rad.

    Source: SantanaLoc eqs. (19), (21).
    """
    left, right = rotation
    r, b = _radius(drive), drive.wheel_base
    difference = right - left
    if abs(difference) < STRAIGHT:
        return _right_v(rotation, drive, heading)
    K1 = r * (right + left) / (b * difference)
    K2 = heading + r * difference / b
    K3 = b * left / (2.0 * (r * difference / b) ** 2)
    x = K1 * math.cos(K2) - K3 * (math.sin(K2) - math.sin(heading))
    y = K1 * math.sin(K2) - K3 * (-math.cos(K2) + math.cos(heading))
    turn = drive.wheel_radius_left / b, drive.wheel_radius_right / b
    return np.array([[-x, x], [-y, y], [-turn[0], turn[1]]])


def printed_v_slam(rotation: Array, drive: DifferentialDrive, heading: float) -> Array:
    """Returns V (3, 2) of wheel rotations (2,), columns left and right, floor frame.

    Right but for rounding, which the printed form magnifies without bound where the wheels turn
    nearly alike; where they turn exactly alike it takes the limit.

    Args:
        rotation: of the left and right wheel, rad.
        drive: radii, of which the printed form takes the mean, and base.
        heading: of the robot before the motion, rad.

    Source: SantanaSLAM eq. (16).
    """
    left, right = rotation
    r, b = _radius(drive), drive.wheel_base
    difference = right - left
    if difference == 0.0:
        return _right_v(rotation, drive, heading)
    beta = heading + r * difference / b
    V1 = r * (right + left) / (2.0 * difference)
    V2, V3 = -b * left / difference**2, b * right / difference**2
    c, s = math.cos(beta), math.sin(beta)
    c_off, s_off = c - math.cos(heading), s - math.sin(heading)
    return np.array(
        [
            [-V1 * c + V3 * s_off, V1 * c + V2 * s_off],
            [-V1 * s - V3 * c_off, V1 * s - V2 * c_off],
            [-drive.wheel_radius_left / b, drive.wheel_radius_right / b],
        ]
    )


def with_v(
    V: Callable[[Array, DifferentialDrive, float], Array],
    measurements: Measurements,
    drive: DifferentialDrive,
) -> Measurements:
    """Returns measurements whose wheel noise reaches the pose through a printed V.

    V is taken at odometry's own headings. Slip and floor stay; M is the drive's law for the whole
    rotation between two nodes.

    Raises:
        BadMeasurements: there are no raw wheel readings.
        UnderConstrained: rounding in V leaves a covariance that is none.
    """
    t, angle = _wheels(measurements)
    silent = replace(drive, noise_left=0.0, noise_right=0.0)
    increment, rest = increments_from_wheels(t, angle, measurements.t, silent)
    at_nodes = np.column_stack([np.interp(measurements.t, t, column) for column in angle.T])
    rotation = np.diff(at_nodes, axis=0)
    heading = integrate(measurements.start_pose, increment)[:-1, 2]
    k = np.array([drive.noise_left, drive.noise_right], float)
    M = (k * rotation) ** 2 if drive.law == "paper" else k**2 * np.abs(rotation)
    steps = zip(rotation, heading, strict=True)
    printed = np.array([V(step, drive, float(theta)) for step, theta in steps]).reshape(-1, 3, 2)
    wheel_floor = (printed * M[:, None]) @ np.swapaxes(printed, 1, 2)
    cov = rest + rotate_covariance(wheel_floor, -heading)
    smallest = np.linalg.eigvalsh(cov)[:, 0]
    if np.any(smallest <= 0.0):
        raise UnderConstrained(
            f"the printed V leaves no covariance of the motion after node {np.argmin(smallest)}: "
            "it divides by the difference of wheels that turn nearly alike"
        )
    return _with_cov(measurements, cov)


def with_variance_law(measurements: Measurements, drive: DifferentialDrive) -> Measurements:
    """Returns measurements whose wheel noise has a variance proportional to the rotation.

    The text beside the equation says 'standard deviation'. With the same k: variance k² |rotation|.

    Raises:
        BadMeasurements: there are no raw wheel readings.

    Source: SantanaLoc eq. (20).
    """
    t, angle = _wheels(measurements)
    drive = replace(drive, law="distance")
    return _with_cov(measurements, increments_from_wheels(t, angle, measurements.t, drive)[1])


def with_signed_sigma(measurements: Measurements, drive: DifferentialDrive) -> Measurements:
    """Returns measurements with ``a + b sin(alpha_M) (exp(rho/c) - 1)`` as sigma of rho.

    Negative for half of all lines from some distance on, and near zero where it changes its sign:
    the sine needs its absolute value.

    Source: SantanaLoc section 4.3, the noise numbered '(22)'.
    """
    table = measurements.sightings[LINE.kind]
    sine = np.cos(table.z[:, 1])  # alpha_M = alpha_robot + pi/2
    sigma = A_M + B_M * sine * np.expm1(table.z[:, 0] / C_M)
    cov = table.cov.copy()
    cov[:, 0, 1] = cov[:, 1, 0] = 0.0
    cov[:, 0, 0] = np.maximum(np.abs(sigma), SMALLEST_SIGMA_M) ** 2
    sightings = {**measurements.sightings, LINE.kind: replace(table, cov=cov)}
    return replace(measurements, sightings=sightings)


def _right_v(rotation: Array, drive: DifferentialDrive, heading: float) -> Array:
    turned = np.eye(3)
    turned[:2, :2] = rotation_by(heading)
    return np.asarray(turned @ wheel_increment(rotation, drive)[1])


def _radius(drive: DifferentialDrive) -> float:
    """Returns the one wheel radius of the printed equations, which take both for equal."""
    return 0.5 * (drive.wheel_radius_left + drive.wheel_radius_right)


def _wheels(measurements: Measurements) -> tuple[Array, Array]:
    odometry = measurements.odometry
    if odometry.wheel_t is None or odometry.wheel_angle is None:
        raise BadMeasurements(
            "a printed wheel noise needs the raw wheel readings, and the measurements have none; "
            "use a log with wheels.csv"
        )
    return odometry.wheel_t, odometry.wheel_angle


def _with_cov(measurements: Measurements, cov: Array) -> Measurements:
    symmetric = 0.5 * (cov + np.swapaxes(cov, 1, 2))
    return replace(measurements, odometry=replace(measurements.odometry, cov=symmetric))
