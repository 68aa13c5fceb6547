"""What estimators eat: nodes, odometry between them, and one table of sightings per kind."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graphslam.arrays import AnyArray, check_covariances, frozen, load_arrays, save_arrays
from graphslam.errors import BadMeasurements
from graphslam.geometry import Array
from graphslam.models import MODELS

IntArray = NDArray[np.int64]

MEASUREMENTS_FORMAT = "graphslam-measurements/1"


@dataclass(frozen=True, slots=True)
class Odometry:
    """Motion from each node to the next, and the raw wheel readings behind it.

    Attributes:
        increment: (N-1, 3) pose of node i+1 in the frame of node i, m and rad.
        cov: (N-1, 3, 3) its covariance, frame of node i, positive definite.
        wheel_t: (W,) times of the raw readings, s, or None.
        wheel_angle: (W, 2) cumulative wheel angles, left and right, rad, or None.
        metres: (N-1,) driven between the nodes, forwards or backwards, m, or None: straight lines.
    """

    increment: Array
    cov: Array
    wheel_t: Array | None = None
    wheel_angle: Array | None = None
    metres: Array | None = None

    def __post_init__(self) -> None:
        count = len(self.increment)
        _set(self, "increment", frozen("odometry.increment", self.increment, (None, 3)))
        _set(self, "cov", frozen("odometry.cov", self.cov, (count, 3, 3)))
        check_covariances("odometry.cov", self.cov)
        if (self.wheel_t is None) != (self.wheel_angle is None):
            raise BadMeasurements("wheel_t and wheel_angle come together or not at all")
        if self.wheel_t is not None:
            _set(self, "wheel_t", frozen("odometry.wheel_t", self.wheel_t, (None,)))
            shape = (len(self.wheel_t), 2)
            _set(self, "wheel_angle", frozen("odometry.wheel_angle", self.wheel_angle, shape))
        if self.metres is not None:
            _set(self, "metres", frozen("odometry.metres", self.metres, (count,)))


@dataclass(frozen=True, slots=True)
class Sightings:
    """All sightings of one kind, ordered by node.

    Attributes:
        kind: name of the model, a key of `graphslam.models.MODELS`.
        node: (K,) node of each sighting, not decreasing.
        z: (K, d) values, in the sensor's frame (a line: rho m, alpha rad, robot frame).
        cov: (K, d, d) covariances of z, same frame.
        extent: (K, 2) stretch seen, m, in the sighting's own coordinate; NaN where unknown.
        t_received: (K,) when the sighting became available, s.
        quality: (K,) the detector's own score, larger is better; NaN where it gives none.
        source: (K,) number of the image or scan it came from; -1 where there is none.
        truth: (K,) identity of the true landmark, -1 where unknown; for judging only.
        label: (K,) what the sensor tells landmarks apart by (a colour), as a number; -1 for none. A
            sighting is never matched with a landmark of another label.
    """

    kind: str
    node: IntArray
    z: Array
    cov: Array
    extent: Array
    t_received: Array
    quality: Array
    source: IntArray
    truth: IntArray
    label: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))

    def __post_init__(self) -> None:
        _set(self, "label", _labels(self.label, len(self.node)))
        if self.kind not in MODELS:
            raise BadMeasurements(f"kind {self.kind!r} has no model; known: {', '.join(MODELS)}")
        d, count = MODELS[self.kind].dim_z, len(self.node)
        shapes: dict[str, tuple[tuple[int, ...], type, bool]] = {
            "node": ((count,), int, False),
            "z": ((count, d), float, False),
            "cov": ((count, d, d), float, False),
            "extent": ((count, 2), float, True),
            "t_received": ((count,), float, False),
            "quality": ((count,), float, True),
            "source": ((count,), int, False),
            "truth": ((count,), int, False),
            "label": ((count,), int, False),
        }
        for name, (shape, dtype, nan) in shapes.items():
            _set(self, name, frozen(f"{self.kind}.{name}", getattr(self, name), shape, dtype, nan))
        check_covariances(f"{self.kind}.cov", self.cov)
        if np.any(np.diff(self.node) < 0) or np.any(self.node < 0):
            raise BadMeasurements(f"{self.kind}.node must be sorted and not negative")

    def __len__(self) -> int:
        return len(self.node)

    def starts(self, nodes: int) -> IntArray:
        """Returns (nodes + 1,) row numbers: sightings of node i are rows starts[i]:starts[i+1]."""
        return np.searchsorted(self.node, np.arange(nodes + 1))

    def select(self, keep: AnyArray) -> Sightings:
        """Returns the rows that ``keep`` (mask or sorted indices) names."""
        columns = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "kind"}
        return Sightings(self.kind, **{name: value[keep] for name, value in columns.items()})


@dataclass(frozen=True, slots=True)
class LandmarkMap:
    """Landmarks, one a row, whatever their kind.

    Attributes:
        id: (M,) number of each landmark, once for each kind; in a known map the true identity.
        kind: (M,) name of each landmark's model.
        params: (M, l) parameters, floor frame, padded with NaN to the longest kind (a line:
            rho m, alpha rad).
        extent: (M, 2) stretch along the landmark that was seen or is known, m; NaN where unknown.
        sightings: (M,) how many sightings support it; 0 in a known map.
        label: (M,) what sensors tell it apart by, as `Sightings.label`; -1 for none.
    """

    id: IntArray
    kind: tuple[str, ...]
    params: Array
    extent: Array
    sightings: IntArray
    label: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))

    def __post_init__(self) -> None:
        count = len(self.id)
        label = _labels(self.label, count)
        _set(self, "label", frozen("map.label", label, (count,), int))
        _set(self, "id", frozen("map.id", self.id, (count,), int))
        _set(self, "kind", tuple(str(k) for k in self.kind))
        _set(self, "params", frozen("map.params", self.params, (count, None), float, True))
        _set(self, "extent", frozen("map.extent", self.extent, (count, 2), float, True))
        _set(self, "sightings", frozen("map.sightings", self.sightings, (count,), int))
        if len(self.kind) != count:
            raise BadMeasurements(f"map.kind has {len(self.kind)} entries for {count} landmarks")
        if len(set(zip(self.kind, self.id.tolist(), strict=True))) != count:
            raise BadMeasurements("map.id names one landmark twice")

    def __len__(self) -> int:
        return len(self.id)

    def of_kind(self, kind: str) -> tuple[IntArray, Array]:
        """Returns row numbers (m,) and parameters (m, l) of the landmarks of one kind."""
        rows = np.flatnonzero(np.array(self.kind, dtype=object) == kind)
        return rows, self.params[rows][:, : MODELS[kind].dim_landmark]

    def joined(self, other: LandmarkMap) -> LandmarkMap:
        """Returns the landmarks of both, those of ``other`` behind.

        Raises:
            BadMeasurements: both name one landmark of one kind.
        """
        width = max(self.params.shape[1], other.params.shape[1])
        params = np.full((len(self) + len(other), width), np.nan)
        params[: len(self), : self.params.shape[1]] = self.params
        params[len(self) :, : other.params.shape[1]] = other.params
        rest = ("id", "extent", "sightings", "label")
        columns = {n: np.concatenate([getattr(self, n), getattr(other, n)]) for n in rest}
        return LandmarkMap(kind=self.kind + other.kind, params=params, **columns)

    def most_seen(self, kind: str) -> int | None:
        """Returns the row of the landmark of one kind with most sightings; None without any."""
        rows, _ = self.of_kind(kind)
        return int(rows[np.argmax(self.sightings[rows])]) if len(rows) else None

    def offsets(self) -> IntArray:
        """Returns (M + 1,) where each landmark's parameters start in a joint vector, pose first."""
        dims = [MODELS[kind].dim_landmark for kind in self.kind]
        return 3 + np.concatenate([[0], np.cumsum(dims, dtype=np.int64)]).astype(np.int64)


@dataclass(frozen=True, slots=True)
class Measurements:
    """Everything an estimator may use, and nothing else. Frozen, columnar, floor frame and SI.

    Attributes:
        t: (N,) times of the nodes, s, increasing.
        start_pose: (3,) pose at the first node, floor frame.
        start_cov: (3, 3) its covariance, floor frame, positive definite.
        odometry: motion between the nodes.
        sightings: one table per kind, by kind.
        known: landmarks known beforehand, or None.
        rejected: how many readings were left out before estimation, by reason.
    """

    t: Array
    start_pose: Array
    start_cov: Array
    odometry: Odometry
    sightings: Mapping[str, Sightings] = field(default_factory=dict)
    known: LandmarkMap | None = None
    rejected: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _set(self, "t", frozen("t", self.t, (None,)))
        if len(self.t) == 0:
            raise BadMeasurements("there is no node: nothing was recorded at any time")
        if np.any(np.diff(self.t) <= 0):
            raise BadMeasurements("t must increase strictly from node to node")
        _set(self, "start_pose", frozen("start_pose", self.start_pose, (3,)))
        _set(self, "start_cov", frozen("start_cov", self.start_cov, (3, 3)))
        check_covariances("start_cov", self.start_cov[None])
        if len(self.odometry.increment) != len(self.t) - 1:
            raise BadMeasurements(
                f"{len(self.odometry.increment)} increments do not join {len(self.t)} nodes"
            )
        for kind, table in self.sightings.items():
            if kind != table.kind:
                raise BadMeasurements(f"the table of kind {table.kind!r} is filed under {kind!r}")
            if len(table) and table.node[-1] >= len(self.t):
                raise BadMeasurements(f"{kind}.node names node {table.node[-1]} of {len(self.t)}")
        _set(self, "sightings", MappingProxyType(dict(sorted(self.sightings.items()))))
        _set(self, "rejected", MappingProxyType(dict(self.rejected)))

    def __reduce__(self) -> tuple[Any, ...]:
        values = [getattr(self, f.name) for f in fields(self)]
        return Measurements, tuple(
            dict(v) if isinstance(v, MappingProxyType) else v for v in values
        )

    @property
    def sighting_count(self) -> int:
        """Sightings of all kinds; the length of an estimate's ``match`` and ``nis``."""
        return sum(len(table) for table in self.sightings.values())

    def tables(self) -> Iterator[tuple[int, Sightings]]:
        """Yields each table with the row number of its first sighting among all sightings."""
        first = 0
        for table in self.sightings.values():
            yield first, table
            first += len(table)

    def driven(self) -> Array:
        """Returns (N,) the metres driven up to each node, by odometry."""
        steps = self.odometry.metres
        if steps is None:
            steps = np.hypot(*self.odometry.increment[:, :2].T)
        return np.concatenate([[0.0], np.cumsum(steps)])

    def without_sightings(self) -> Measurements:
        """Returns the same nodes and odometry with no sightings at all."""
        return replace(self, sightings={})

    def save(self, path: Path | str) -> None:
        """Writes an .npz without pickle; equal measurements give equal bytes."""
        header = {
            "format": MEASUREMENTS_FORMAT,
            "kinds": list(self.sightings),
            "rejected": dict(self.rejected),
            "known_kinds": None if self.known is None else list(self.known.kind),
        }
        arrays: dict[str, AnyArray] = {
            "header": np.frombuffer(json.dumps(header).encode(), np.uint8),
            "t": self.t,
            "start_pose": self.start_pose,
            "start_cov": self.start_cov,
        }
        parts: list[tuple[str, Any]] = [("odometry", self.odometry), ("known", self.known)]
        parts += [(f"sightings.{kind}", table) for kind, table in self.sightings.items()]
        for prefix, part in parts:
            arrays.update(_columns(prefix, part))
        save_arrays(path, arrays)

    @staticmethod
    def load(path: Path | str) -> Measurements:
        """Returns measurements written by `save`.

        Raises:
            BadMeasurements: the file is not one, or its content contradicts the contract.
        """
        arrays = load_arrays(path)
        try:
            header = json.loads(arrays.pop("header").tobytes())
            if header["format"] != MEASUREMENTS_FORMAT:
                raise BadMeasurements(f"{path}: format {header['format']!r} is not read here")
            sightings = {
                kind: Sightings(kind, **_part(arrays, f"sightings.{kind}"))
                for kind in header["kinds"]
            }
            known = None
            if header["known_kinds"] is not None:
                known = LandmarkMap(kind=tuple(header["known_kinds"]), **_part(arrays, "known"))
            return Measurements(
                arrays["t"],
                arrays["start_pose"],
                arrays["start_cov"],
                Odometry(**_part(arrays, "odometry")),
                sightings,
                known,
                header["rejected"],
            )
        except (KeyError, TypeError, ValueError) as error:
            raise BadMeasurements(f"{path}: not a measurements file ({error!r})") from error


def _set(instance: object, name: str, value: object) -> None:
    object.__setattr__(instance, name, value)


def _labels(label: IntArray, count: int) -> IntArray:
    """Returns ``label``, or 'none' for all ``count`` where it is left empty."""
    return label if len(label) or not count else np.full(count, -1)


def _columns(prefix: str, part: Any) -> dict[str, AnyArray]:
    if part is None:
        return {}
    named = {f.name: getattr(part, f.name) for f in fields(part)}
    return {f"{prefix}.{k}": v for k, v in named.items() if isinstance(v, np.ndarray)}


def _part(arrays: Mapping[str, AnyArray], prefix: str) -> dict[str, AnyArray]:
    named = {k: v for k, v in arrays.items() if k.startswith(prefix + ".")}
    return {k[len(prefix) + 1 :]: v for k, v in named.items()}
