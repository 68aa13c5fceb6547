"""Floor lines, ceiling lamps and bearings in one log: no worse than with any one of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from graphslam.config import SmootherConfig
from graphslam.ekf import run_ekf
from graphslam.estimate import Estimate
from graphslam.geometry import compose, inverse, wrap
from graphslam.measurements import Measurements, Sightings
from graphslam.smoother import smooth
from tests.worlds import bearing_drive, drive

LAMPS = np.array([[0.5, 1.5, 0.3], [2.5, 0.2, 1.2], [3.8, 2.8, -0.4], [1.2, 3.9, 0.9]])
SIGMA = np.array([0.02, 0.02, 0.03])
NODES = 100


def lamps_seen(truth: np.ndarray, seed: int, within: float = 1.5) -> Sightings:
    rng = np.random.default_rng(seed + 1000)
    near = np.linalg.norm(truth[:, None, :2] - LAMPS[:, :2], axis=2) < within
    node, lamp = np.nonzero(near)
    z = compose(inverse(truth[node]), LAMPS[lamp]) + SIGMA * rng.standard_normal((len(node), 3))
    none = np.full(len(node), -1)
    return Sightings(
        "lamp",
        node,
        z,
        np.broadcast_to(np.diag(SIGMA**2), (len(node), 3, 3)),
        np.full((len(node), 2), np.nan),
        0.1 * node,
        np.full(len(node), np.nan),
        none,
        lamp,
        none,
    )


def world(seed: int) -> tuple[Measurements, np.ndarray]:
    lines, truth = drive(seed, NODES, reach=0.3)
    points, _ = bearing_drive(seed, NODES)
    tables = {
        "line": lines.sightings["line"],
        "lamp": lamps_seen(truth, seed),
        "bearing": points.sightings["bearing"],
    }
    return replace(lines, sightings=tables), truth


def only(measurements: Measurements, names: tuple[str, ...]) -> Measurements:
    return replace(measurements, sightings={n: measurements.sightings[n] for n in names})


def test_all_together_are_no_worse_than_any_one() -> None:
    squared: dict[tuple[str, ...], list[float]] = {}
    honesty = []
    for seed in range(5):
        everything, truth = world(seed)
        whole = tuple(everything.sightings)
        sigma = {}
        for names in (*((kind,) for kind in whole), whole):
            part = only(everything, names)
            estimate = smooth(part, run_ekf(part), SmootherConfig(engine="gtsam"))
            e = estimate.pose[1:] - truth[1:]
            e[:, 2] = wrap(e[:, 2])
            squared.setdefault(names, []).append(float(np.mean(e[:, 0] ** 2 + e[:, 1] ** 2)))
            sigma[names] = np.trace(estimate.cov_floor[1:, :2, :2], axis1=1, axis2=2)
        honesty.append(np.mean(np.einsum("ni,nij,nj->n", e, inverses(estimate), e)) / 3)
        assert all(np.all(sigma[whole] < sigma[(kind,)]) for kind in whole)
    rms = {names: np.sqrt(np.mean(values)) for names, values in squared.items()}
    assert rms[whole] == min(rms.values())
    assert 0.6 < np.mean(honesty) < 1.5


def inverses(estimate: Estimate) -> np.ndarray:
    return np.linalg.inv(estimate.cov_floor[1:])


def test_both_engines_take_all_kinds_at_once() -> None:
    everything, _ = world(0)
    filtered = run_ekf(everything)
    one, two = (smooth(everything, filtered, SmootherConfig(engine=e)) for e in ("gtsam", "chain"))
    np.testing.assert_allclose(two.pose, one.pose, atol=1e-5)
    np.testing.assert_allclose(two.cov_floor[1:], one.cov_floor[1:], rtol=1e-3, atol=1e-12)
