"""What every sensor model provides."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, runtime_checkable

from graphslam.geometry import Array


class Model(Protocol):
    """A sensor: what a sighting of a landmark from a pose should read, and what it would start.

    Residuals are *prediction - measurement*; Jacobians are with respect to additive changes of the
    floor-frame pose ``(x, y, theta)`` and of the landmark's parameters. Twins, angles modulo pi and
    wrapping are settled inside; callers see small vectors.

    Attributes:
        kind: name of the table of sightings, for example ``"line"``.
        dim_z: length d of a sighting.
        dim_landmark: length l of a landmark's parameters; 0 for sensors without landmarks.
        angular: for each entry of the residual, whether it is an angle (rad) or a length (m).
        noun: what texts call what it sees: one, and several.
    """

    @property
    def kind(self) -> str: ...
    @property
    def dim_z(self) -> int: ...
    @property
    def dim_landmark(self) -> int: ...
    @property
    def angular(self) -> tuple[bool, ...]: ...
    @property
    def noun(self) -> tuple[str, str]: ...

    def residual(self, pose: Array, landmark: Array, z: Array) -> tuple[Array, Array, Array]:
        """Returns ``e`` (..., d), ``J_e_pose`` (..., d, 3) and ``J_e_landmark`` (..., d, l).

        Args:
            pose: (..., 3) floor frame.
            landmark: (..., l) floor frame; (..., 0) where the sensor has none.
            z: (..., d) sightings in the sensor's frame.
        """
        ...

    def initialise(self, pose: Array, z: Array, cov: Array) -> tuple[Array, Array, Array] | None:
        """Returns a new landmark (l,), ``J_pose`` (l, 3) and ``J_z`` (l, d), or None: not yet.

        Args:
            pose: (3,) floor frame.
            z: (d,) the sighting.
            cov: (d, d) its covariance.
        """
        ...

    def canonical(self, landmark: Array, extent: Array) -> tuple[Array, Array, Array]:
        """Returns landmarks (M, l) and extents (M, 2) by their one printed name, and J (M, l, l).

        ``J`` is the Jacobian of the canonical parameters with respect to the given ones.
        """
        ...

    def extent_on_landmark(self, pose: Array, landmark: Array, z: Array, extent: Array) -> Array:
        """Returns the stretches (K, 2) of landmarks (K, l) that sightings saw, NaN where unknown.

        Args:
            pose: (K, 3) floor frame.
            landmark: (K, l) floor frame.
            z: (K, d) sightings.
            extent: (K, 2) stretch seen, in the sighting's own coordinate, m.
        """
        ...


@runtime_checkable
class Stretched(Protocol):
    """What a model has besides where its landmarks are stretched out over the floor."""

    def ends(self, line: Array, extent: Array) -> Array:
        """Returns both ends (..., 2, 2), m, of stretches of landmarks, or of sightings.

        Args:
            line: (..., l) parameters in some frame.
            extent: (..., 2) stretches along them, m; the ends are NaN where it is unknown.
        """
        ...


@runtime_checkable
class PartlyLinear(Protocol):
    """What a model has besides whose residual is linear in some parameters of its landmarks.

    Attributes:
        linear_in: those parameters. However far they move, no Jacobian changes.
    """

    @property
    def linear_in(self) -> tuple[int, ...]: ...


@runtime_checkable
class Compiled(Protocol):
    """A model whose residual is also there compiled, for one sighting at a time.

    Attributes:
        kernel: ``kernel(x, y, theta, landmark, z, e, J_e_pose, J_e_landmark)`` fills the last three
            with what `Model.residual` returns for one pose, landmark (l,) and sighting (d,).
    """

    @property
    def kind(self) -> str: ...
    @property
    def dim_z(self) -> int: ...
    @property
    def dim_landmark(self) -> int: ...
    @property
    def kernel(self) -> Callable[..., None]: ...


@runtime_checkable
class Delayed(Protocol):
    """What a model has besides where one sighting does not start a landmark, but several do."""

    def initialise_from(
        self, pose: Array, pose_cov: Array | None, z: Array, cov: Array
    ) -> Array | None:
        """Returns the landmark (l,) that explains sightings from several poses, or None: not yet.

        Args:
            pose: (k, 3) where they were made, floor frame, in order.
            pose_cov: (3 k, 3 k) covariance of those poses relative to the last, floor frame; None
                where they count as exact.
            z: (k, d) the sightings.
            cov: (k, d, d) their covariances.
        """
        ...

    def unlike(self, pose: Array, z: Array, new_pose: Array, new_z: Array) -> float:
        """Returns how unlike two sightings are of one landmark not started yet; beyond 1: of two.

        Args:
            pose: (3,) where the earlier one was made, floor frame.
            z: (d,) the earlier one.
            new_pose: (3,) where the later one was made.
            new_z: (d,) the later one.
        """
        ...
