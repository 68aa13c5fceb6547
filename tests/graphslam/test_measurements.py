from __future__ import annotations

import pickle
import zipfile
from dataclasses import FrozenInstanceError, replace
from pathlib import Path

import numpy as np
import pytest

from graphslam.arrays import check_covariances, load_arrays
from graphslam.ekf import run_ekf
from graphslam.errors import BadMeasurements
from graphslam.estimate import Estimate
from graphslam.measurements import LandmarkMap, Measurements, Odometry, Sightings
from tests.worlds import drive


@pytest.fixture(scope="module")
def measurements() -> Measurements:
    known = LandmarkMap([3, 7], ("line", "line"), [[1, 0], [2, 1]], np.full((2, 2), np.nan), [0, 0])
    return replace(drive(0, 60)[0], known=known, rejected={"one edge only": 4})


def equal(a: object, b: object) -> bool:
    return pickle.dumps(a) == pickle.dumps(b)


def test_saved_measurements_come_back_equal(measurements: Measurements, tmp_path: Path) -> None:
    measurements.save(tmp_path / "m.npz")
    again = Measurements.load(tmp_path / "m.npz")
    np.testing.assert_array_equal(again.sightings["line"].z, measurements.sightings["line"].z)
    np.testing.assert_array_equal(again.known.params, measurements.known.params)
    assert again.known.kind == ("line", "line")
    assert dict(again.rejected) == {"one edge only": 4}
    again.save(tmp_path / "n.npz")
    assert (tmp_path / "m.npz").read_bytes() == (tmp_path / "n.npz").read_bytes()


def test_saved_estimate_comes_back_equal(measurements: Measurements, tmp_path: Path) -> None:
    estimate = run_ekf(measurements)
    estimate.save(tmp_path / "e.npz")
    again = Estimate.load(tmp_path / "e.npz")
    np.testing.assert_array_equal(again.cov_joint, estimate.cov_joint)
    np.testing.assert_array_equal(again.match, estimate.match)
    assert (again.method, again.causal, again.counts) == ("ekf", True, estimate.counts)
    assert again.unobserved == estimate.unobserved
    np.testing.assert_array_equal(again.map_variance, estimate.map_variance)
    again.save(tmp_path / "f.npz")
    assert (tmp_path / "e.npz").read_bytes() == (tmp_path / "f.npz").read_bytes()


def test_measurements_survive_the_way_to_a_worker_process(measurements: Measurements) -> None:
    assert equal(pickle.loads(pickle.dumps(measurements)), measurements)


def test_nothing_can_be_changed_afterwards(measurements: Measurements) -> None:
    with pytest.raises(FrozenInstanceError):
        measurements.t = np.zeros(3)
    with pytest.raises(ValueError, match="read-only"):
        measurements.sightings["line"].z[0, 0] = 1.0
    with pytest.raises(TypeError):
        measurements.sightings["line"] = None


def test_files_with_pickles_or_false_sizes_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "pickle.npz", header=np.array([{"a": 1}], dtype=object))
    np.savez_compressed(tmp_path / "bomb.npz", header=np.zeros(10**6))
    with zipfile.ZipFile(tmp_path / "lie.npz", "w") as archive:
        header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }"
        header += b" " * (128 - 10 - 1 - len(header)) + b"\n"
        archive.writestr("t.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header)
    (tmp_path / "noise.npz").write_bytes(b"not a zip at all")
    for name in ("pickle", "bomb", "lie", "noise", "absent"):
        with pytest.raises(BadMeasurements, match=name):
            load_arrays(tmp_path / f"{name}.npz")


def test_a_file_of_another_kind_is_named_as_such(tmp_path: Path) -> None:
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    with pytest.raises(BadMeasurements, match="not a measurements file"):
        Measurements.load(tmp_path / "other.npz")
    with pytest.raises(BadMeasurements, match="not an estimate file"):
        Estimate.load(tmp_path / "other.npz")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"z": np.zeros((3, 3))}, r"line.z has shape \(3, 3\); expected \(3, 2\)"),
        ({"z": [[0, 0], [0, np.nan], [0, 0]]}, r"line.z\[1, 1\] = nan"),
        ({"node": [2, 1, 3]}, "sorted"),
        ({"cov": np.zeros((3, 2, 2))}, "not positive definite"),
        ({"cov": np.tile([[1.0, 0.5], [0.1, 1.0]], (3, 1, 1))}, "not symmetric"),
        ({"kind": "lines"}, "no model"),
    ],
)
def test_contradicting_sightings_are_refused(change: dict, message: str) -> None:
    values = {
        "kind": "line",
        "node": [0, 1, 2],
        "z": np.ones((3, 2)),
        "cov": np.tile(np.eye(2), (3, 1, 1)),
        "extent": np.full((3, 2), np.nan),
        "t_received": np.zeros(3),
        "quality": np.ones(3),
        "source": [0, 1, 2],
        "truth": [-1, -1, -1],
    }
    with pytest.raises(BadMeasurements, match=message):
        Sightings(**(values | change))


def test_contradicting_measurements_are_refused(measurements: Measurements) -> None:
    with pytest.raises(BadMeasurements, match="increase"):
        replace(measurements, t=measurements.t[::-1])
    with pytest.raises(BadMeasurements, match="increments do not join"):
        replace(measurements, t=measurements.t[:-1])
    with pytest.raises(BadMeasurements, match="no node"):
        replace(measurements, t=[], odometry=Odometry(np.zeros((0, 3)), np.zeros((0, 3, 3))))
    with pytest.raises(BadMeasurements, match="filed under"):
        replace(measurements, sightings={"pose_fix": measurements.sightings["line"]})
    with pytest.raises(BadMeasurements, match="start_cov"):
        replace(measurements, start_cov=np.zeros((3, 3)))


def test_one_large_covariance_does_not_hide_an_asymmetric_one() -> None:
    cov = np.array([1e8 * np.eye(2), [[1.0, 0.05], [0.0, 1.0]]])
    with pytest.raises(BadMeasurements, match="not symmetric"):
        check_covariances("cov", cov)
