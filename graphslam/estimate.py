"""What estimators return."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import astuple, dataclass, field, fields
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from graphslam.arrays import AnyArray, frozen, load_arrays, save_arrays
from graphslam.errors import BadMeasurements
from graphslam.geometry import Array
from graphslam.measurements import IntArray, LandmarkMap

ESTIMATE_FORMAT = "graphslam-estimate/1"

Told = Callable[[int], None]
"""Called after each node, with its number, by methods that go from node to node."""


LOOP_OPEN = "loop not closed: "
"""How counts of loops that could not be closed begin; the reason follows."""
LOOP_DOUBTED = "loop closed by the first estimate, but in doubt: "
"""The same of loops that were closed already, and would stay open without that."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """A part of the way.

    Attributes:
        from_s: when it begins, s from the first node.
        to_s: when it ends.
        from_m: where it begins, metres driven by odometry.
        to_m: where it ends.
        from_xy: position where it begins, m, floor frame.
        to_xy: position where it ends.
        poses: how many poses are estimated on it, its ends apart.
    """

    from_s: float
    to_s: float
    from_m: float
    to_m: float
    from_xy: tuple[float, float]
    to_xy: tuple[float, float]
    poses: int

    @property
    def length_m(self) -> float:
        """How long it is, m."""
        return self.to_m - self.from_m

    def __str__(self) -> str:
        ends = [f"x {x:.2f}, y {y:.2f} m" for x, y in (self.from_xy, self.to_xy)]
        return (
            f"no line or other landmark counted for {self.length_m:.3g} m, from "
            f"{self.from_s:.4g} s to {self.to_s:.4g} s ({ends[0]} to {ends[1]})"
        )


@dataclass(frozen=True, slots=True)
class Unobserved:
    """What the sightings left as uncertain as odometry alone.

    Attributes:
        quantity: "position" or "heading" of the last pose, or "way": the position on a part of the
            way on which no sighting counts.
        direction: (2,) unit vector in the floor frame; (0, 0) for the heading, for a way, and for
            the position where no direction of it is observed.
        sigma: posterior standard deviation of the last pose along it, m or rad; for a way the
            largest of the position at the poses of it, m.
        sigma_odometry: the same of odometry alone, m or rad; for a way what odometry's position
            drifts by from its beginning to its end.
        stretch: which part of the way; None for what is said of the last pose.
    """

    quantity: str
    direction: tuple[float, float]
    sigma: float
    sigma_odometry: float
    stretch: Stretch | None = None

    def __str__(self) -> str:
        if self.stretch is not None:
            known = f"the position is known to {1e3 * self.sigma:.0f} mm at worst"
            return (
                f"{self.stretch}: odometry drifts by {1e3 * self.sigma_odometry:.0f} mm there (one "
                f"sigma), and {known if self.stretch.poses else 'no pose is estimated on it'}"
            )
        if self.quantity == "heading":
            return (
                f"the heading is not observed: sigma {np.degrees(self.sigma):.2f}°, "
                f"odometry alone {np.degrees(self.sigma_odometry):.2f}°"
            )
        where = "the position"
        if self.direction != (0.0, 0.0):
            where = f"the position along {self.angle_deg:.0f}° (floor frame)"
        return (
            f"{where} is not observed: "
            f"sigma {1e3 * self.sigma:.0f} mm, odometry alone {1e3 * self.sigma_odometry:.0f} mm"
        )

    @property
    def angle_deg(self) -> float:
        """The direction's angle in the floor frame, from 0 to 180 degrees."""
        x, y = self.direction
        return float(np.degrees(np.arctan2(y, x)) % 180.0)

    def to_list(self) -> list[Any]:
        """Returns it in types that JSON knows."""
        own = [self.quantity, list(self.direction), self.sigma, self.sigma_odometry]
        return own if self.stretch is None else [*own, list(astuple(self.stretch))]

    @staticmethod
    def from_list(content: list[Any]) -> Unobserved:
        """Returns what `to_list` gave."""
        quantity, (x, y), sigma, sigma_odometry, *where = content
        stretch = None
        for from_s, to_s, from_m, to_m, (x1, y1), (x2, y2), poses in where:
            stretch = Stretch(from_s, to_s, from_m, to_m, (x1, y1), (x2, y2), poses)
        return Unobserved(quantity, (x, y), sigma, sigma_odometry, stretch)


@dataclass(frozen=True, slots=True)
class Estimate:
    """Path, map and matches of one method, with their covariances. Frozen; floor frame; SI.

    Attributes:
        method: "odometry", "ekf", "smoother", ...
        causal: whether the pose at time t uses only data up to t.
        t: (N,) times of the nodes, s.
        pose: (N, 3) poses, m and rad, theta in (-pi, pi].
        cov_floor: (N, 3, 3) covariances of the poses, floor frame.
        map: estimated landmarks, canonical.
        cov_joint: (3 + L, 3 + L) covariance of the last pose and all landmark parameters in the
            order of `map` (see `LandmarkMap.offsets`), floor frame.
        match: (K,) row in `map` of each sighting's landmark, over all tables in order; -1 rejected
            or a sighting without a landmark.
        used: (K,) whether the estimate uses the sighting.
        nis: (K,) squared normalised innovation (filter: prediction; smoother: residual over the
            sighting's own noise); NaN where not used, or where it started a landmark.
        weight: (K,) robust weight of each used sighting; 1 where the method is not robust.
        cost: half the sum of squared normalised residuals at the solution; NaN for methods
            without one.
        iterations: of the optimiser; 0 for recursive methods.
        converged: whether the optimiser met its tolerance.
        engine: who minimised; empty for methods that have no choice of it.
        unobserved: directions of the last pose, and parts of the way, that the data does not fix.
        counts: what happened to sightings (rejected by reason, times lost, ...), by name.
        map_variance: (N, L) variances of all landmark parameters as they were known at each node,
            in the order of ``cov_joint``, NaN before a landmark was started; None for methods that
            have no such history, and for runs too large to keep it.
        quantities: what the method found besides, by name: value and standard deviation.
    """

    method: str
    causal: bool
    t: Array
    pose: Array
    cov_floor: Array
    map: LandmarkMap
    cov_joint: Array
    match: IntArray
    used: AnyArray
    nis: Array
    weight: Array
    cost: float = float("nan")
    iterations: int = 0
    converged: bool = True
    engine: str = ""
    unobserved: tuple[Unobserved, ...] = ()
    counts: Mapping[str, int] = field(default_factory=dict)
    map_variance: Array | None = None
    innovation: Array | None = None
    quantities: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        nodes, size, sightings = len(self.t), int(self.map.offsets()[-1]), len(self.match)
        shapes: dict[str, tuple[tuple[int, ...], type, bool]] = {
            "t": ((nodes,), float, False),
            "pose": ((nodes, 3), float, False),
            "cov_floor": ((nodes, 3, 3), float, False),
            "cov_joint": ((size, size), float, False),
            "match": ((sightings,), int, False),
            "used": ((sightings,), bool, False),
            "nis": ((sightings,), float, True),
            "weight": ((sightings,), float, True),
        }
        for name, (shape, dtype, nan) in shapes.items():
            value = frozen(f"{self.method}.{name}", getattr(self, name), shape, dtype, nan)
            object.__setattr__(self, name, value)
        object.__setattr__(self, "counts", MappingProxyType(dict(self.counts)))
        object.__setattr__(self, "quantities", MappingProxyType(dict(self.quantities)))
        if self.map_variance is not None:
            shape = (nodes, size - 3)
            value = frozen("map_variance", self.map_variance, shape, float, True)
            object.__setattr__(self, "map_variance", value)
        if self.innovation is not None:
            value = frozen("innovation", self.innovation, (nodes, 2), float, False)
            object.__setattr__(self, "innovation", value)

    def __reduce__(self) -> tuple[Any, ...]:
        values = [getattr(self, f.name) for f in fields(self)]
        return Estimate, tuple(dict(v) if isinstance(v, MappingProxyType) else v for v in values)

    def landmark_cov(self, landmark: int) -> Array:
        """Returns the covariance (l, l) of one landmark's parameters, floor frame."""
        first, last = self.map.offsets()[landmark : landmark + 2]
        return self.cov_joint[first:last, first:last]

    def _repr_html_(self) -> str:
        """Returns what a notebook shows: a table and a plan; see `graphslam.show`."""
        from graphslam.show import estimate_html

        return estimate_html(self)

    def save(self, path: Path | str) -> None:
        """Writes an .npz without pickle; equal estimates give equal bytes."""
        header = {
            "format": ESTIMATE_FORMAT,
            "method": self.method,
            "causal": self.causal,
            "cost": self.cost,
            "iterations": self.iterations,
            "converged": self.converged,
            "engine": self.engine,
            "counts": dict(self.counts),
            "quantities": {name: list(pair) for name, pair in self.quantities.items()},
            "kinds": list(self.map.kind),
            "unobserved": [entry.to_list() for entry in self.unobserved],
        }
        arrays: dict[str, AnyArray] = {
            "header": np.frombuffer(json.dumps(header).encode(), np.uint8)
        }
        for name in ("t", "pose", "cov_floor", "cov_joint", "match", "used", "nis", "weight"):
            arrays[name] = getattr(self, name)
        for name in ("map_variance", "innovation"):
            if getattr(self, name) is not None:
                arrays[name] = getattr(self, name)
        for name in ("id", "params", "extent", "sightings", "label"):
            arrays[f"map.{name}"] = getattr(self.map, name)
        save_arrays(path, arrays)

    @staticmethod
    def load(path: Path | str) -> Estimate:
        """Returns an estimate written by `save`.

        Raises:
            BadMeasurements: the file is not one, or its content contradicts the contract.
        """
        arrays = load_arrays(path)
        try:
            header = json.loads(arrays.pop("header").tobytes())
            if header.pop("format") != ESTIMATE_FORMAT:
                raise BadMeasurements(f"{path}: not an estimate of this version")
            unobserved = tuple(map(Unobserved.from_list, header["unobserved"]))
            landmarks = LandmarkMap(
                kind=tuple(header.pop("kinds")),
                **{k[4:]: arrays.pop(k) for k in list(arrays) if k.startswith("map.")},
            )
            header["unobserved"] = unobserved
            told = header.get("quantities", {})
            header["quantities"] = {name: (value, sigma) for name, (value, sigma) in told.items()}
            columns: dict[str, Any] = {**arrays, **header}
            return Estimate(map=landmarks, **columns)
        except (KeyError, TypeError, ValueError) as error:
            raise BadMeasurements(f"{path}: not an estimate file ({error!r})") from error
