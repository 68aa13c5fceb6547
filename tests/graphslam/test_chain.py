"""The chain solver against the GTSAM engine: the same optimum, the same covariances."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import gtsam
import numpy as np
import pytest

from graphslam.config import Robust, SmootherConfig
from graphslam.ekf import run_ekf
from graphslam.errors import BadMeasurements, UnderConstrained
from graphslam.geometry import rotate_covariance
from graphslam.measurements import Measurements
from graphslam.models import MODELS
from graphslam.smoother import engine_gtsam, engines_agree, smooth
from graphslam.smoother.batch import HOPELESS, misfit, solve
from graphslam.smoother.chain import minimise, started_along, symbolic
from graphslam.smoother.factors import pose_key
from graphslam.smoother.problem import Problem, state_problem
from tests.graphslam.test_ekf import pose_fixes
from tests.worlds import GRID, drive

TIGHT = SmootherConfig(tolerance=1e-14)
ONE_WAY = GRID[:4]


def posed(measurements: Measurements) -> Problem:
    """Returns the problem with the true matches, numbered without gaps."""
    match = np.full(measurements.sighting_count, -1)
    for first, table in measurements.tables():
        seen = np.flatnonzero(table.truth >= 0)
        match[first + seen] = np.unique(table.truth[seen], return_inverse=True)[1]
    return state_problem(measurements, match)


def started_with(measurements: Measurements, sigma: float) -> Measurements:
    cov = np.diag([sigma**2, sigma**2, min(sigma, 3.0) ** 2])
    return replace(measurements, start_cov=cov)


def with_fixes(measurements: Measurements, truth: np.ndarray, every: int) -> Measurements:
    tables = {**measurements.sightings, "pose_fix": pose_fixes(measurements, truth, every, 0.05)}
    return replace(measurements, sightings=tables)


def holding(problem: Problem, landmarks: slice | list[int]) -> Problem:
    fixed = problem.fixed.copy()
    fixed[landmarks] = True
    return replace(problem, fixed=fixed)


def weighted(problem: Problem) -> Problem:
    rng = np.random.default_rng(5)
    weight = rng.uniform(0.0, 1.0, len(problem.weight))
    weight[rng.random(len(weight)) < 0.2] = 0.0
    odometry = rng.uniform(0.2, 1.0, len(problem.odometry_weight))
    return replace(problem, weight=weight, odometry_weight=odometry)


def scenario(
    nodes: int = 300, start: float = 1e-6, lines: np.ndarray = GRID, seed: int = 1
) -> tuple[Measurements, np.ndarray]:
    measurements, truth = drive(seed, nodes=nodes, lines=lines)
    return started_with(measurements, start), truth


SCENARIOS: dict[str, Callable[[], Problem]] = {
    "one node": lambda: posed(scenario(nodes=1)[0]),
    "two nodes": lambda: posed(scenario(nodes=2)[0]),
    "one chunk": lambda: posed(scenario(nodes=25)[0]),
    "one node more": lambda: posed(scenario(nodes=26)[0]),
    "laps, start to a micrometre": lambda: posed(scenario(nodes=600)[0]),
    "start to a metre": lambda: posed(scenario(start=1.0)[0]),
    "start to a kilometre": lambda: posed(scenario(start=1e3)[0]),
    "one direction": lambda: posed(scenario(lines=ONE_WAY)[0]),
    "one direction, start to a kilometre": lambda: posed(scenario(lines=ONE_WAY, start=1e3)[0]),
    "nothing seen": lambda: posed(scenario()[0].without_sightings()),
    "nothing seen, start to a kilometre": lambda: posed(scenario(start=1e3)[0].without_sightings()),
    "two known lines": lambda: holding(posed(scenario()[0]), [0, 3]),
    "localisation": lambda: holding(posed(scenario(start=1e3)[0]), slice(None)),
    "localisation, one direction": lambda: holding(
        posed(scenario(lines=ONE_WAY, start=10.0)[0]), slice(None)
    ),
    "pose fixes": lambda: posed(with_fixes(*scenario(start=1e3), 40)),
    "pose fixes alone": lambda: posed(
        replace(
            with_fixes(*scenario(start=1e3), 40),
            sightings={"pose_fix": pose_fixes(*scenario(), 40, 0.05)},
        )
    ),
    "weights": lambda: weighted(posed(with_fixes(*scenario(), 40))),
}


def correlation_units(cov: np.ndarray, reference: np.ndarray) -> float:
    """Returns the largest difference, each entry over the sigmas that belong to it."""
    sigma = np.sqrt(np.diagonal(reference, axis1=-2, axis2=-1))
    sigma = np.where(sigma > 0, sigma, 1.0)
    return float(np.max(np.abs(cov - reference) / (sigma[..., :, None] * sigma[..., None, :])))


def pose_covariances(minimum: engine_gtsam.GtsamMinimum) -> np.ndarray:
    """Returns GTSAM's marginals from their square roots.

    ``marginalCovariance`` inverts a product and loses up to three digits of a start known to a
    kilometre beside odometry known to millimetres.
    """
    linear = minimum.solution.linear
    order = gtsam.Ordering.ColamdGaussianFactorGraph(linear)
    tree = linear.eliminateMultifrontal(order, gtsam.EliminateQR)
    roots = np.empty((len(minimum.pose), 3, 3))
    for node in range(len(roots)):
        conditional = tree.marginalFactor(pose_key(node), gtsam.EliminateQR)
        roots[node] = conditional.R()  # a view of the conditional's own storage
    inverse = np.linalg.inv(roots)
    theta = gtsam.utilities.extractPose2(minimum.solution.values).reshape(-1, 3)[:, 2]
    return rotate_covariance(inverse @ np.swapaxes(inverse, 1, 2), theta)


@pytest.mark.parametrize("name", SCENARIOS)
def test_both_engines_reach_one_optimum_and_know_it_equally_well(name: str) -> None:
    problem = SCENARIOS[name]()
    ours, theirs = minimise(problem, TIGHT), engine_gtsam.minimise(problem, TIGHT)
    assert ours.converged
    assert ours.cost == pytest.approx(theirs.cost, rel=1e-9, abs=1e-9)
    cov, joint = ours.covariances()
    _, joint_theirs = theirs.covariances()
    assert correlation_units(joint, joint_theirs) < 1e-6
    assert correlation_units(cov, pose_covariances(theirs)) < 1e-6
    np.testing.assert_array_equal(joint[:3, :3] == 0, cov[-1] == 0)
    # GTSAM takes it from the covariances, which a start to a kilometre makes nearly singular
    assert ours.map_log_det() == pytest.approx(theirs.map_log_det(), abs=1e-3)


@pytest.mark.parametrize("name", ["one node", "start to a metre", "two known lines", "pose fixes"])
def test_joint_covariances_of_any_pose_and_landmark_equal_gtsams(name: str) -> None:
    problem = SCENARIOS[name]()
    ours, theirs = minimise(problem, TIGHT), engine_gtsam.minimise(problem, TIGHT)
    rng = np.random.default_rng(2)
    node = rng.integers(0, len(problem.pose), 12)
    landmark = rng.integers(0, len(problem.kinds), 12)
    pairs = ours.pair_covariances(node, landmark)
    assert correlation_units(pairs, theirs.pair_covariances(node, landmark)) < 1e-6


def test_a_system_cut_up_by_place_has_the_same_minimum(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = posed(scenario(nodes=3000)[0])
    plain = minimise(problem, TIGHT)
    monkeypatch.setattr(symbolic, "WORTH_CUTTING", -1.0)
    monkeypatch.setattr(symbolic, "_work", lambda *_: -float(next(falling)))
    falling = iter(range(100))
    cut = minimise(problem, TIGHT)
    assert cut.cost == pytest.approx(plain.cost, rel=1e-12)
    assert correlation_units(cut.covariances()[1], plain.covariances()[1]) < 1e-9


def test_the_same_problem_gives_the_same_bytes() -> None:
    problem = posed(scenario()[0])
    first, second = minimise(problem, TIGHT), minimise(problem, TIGHT)
    assert first.pose.tobytes() == second.pose.tobytes()
    assert first.covariances()[1].tobytes() == second.covariances()[1].tobytes()


def test_a_landmark_that_nothing_fixes_is_named() -> None:
    problem = posed(scenario()[0])
    weight = np.where(problem.match == 5, 0.0, 1.0)
    with pytest.raises(UnderConstrained, match=r"landmark 5 \(line, 0 sightings"):
        minimise(replace(problem, weight=weight), TIGHT)


def test_too_few_iterations_are_not_called_converged() -> None:
    problem = posed(scenario()[0])
    short = minimise(problem, SmootherConfig(max_iterations=1))
    assert not short.converged
    assert short.iterations == 1
    assert short.cost <= minimise(problem, SmootherConfig(max_iterations=2)).cost * 1e9


@pytest.mark.parametrize("kind", [k for k, m in MODELS.items() if m.dim_landmark])
def test_sightings_of_landmarks_do_not_depend_on_where_the_floor_lies(kind: str) -> None:
    """What the solver's unknowns rest on: one motion of landmarks undoes that of all poses."""
    model, rng = MODELS[kind], np.random.default_rng(3)
    z = rng.normal(1.0, 0.3, model.dim_z)
    landmark, _, _ = model.initialise(rng.normal(size=3), z, np.eye(model.dim_z)) or (None,) * 3
    if landmark is None:
        landmark = rng.normal(4.0, 1.0, model.dim_landmark)
    poses = rng.normal(size=(6, 3))
    G_pose = np.tile(np.eye(3), (6, 1, 1))
    G_pose[:, 0, 2], G_pose[:, 1, 2] = -poses[:, 1], poses[:, 0]
    _, J_pose, J_landmark = model.residual(poses, np.tile(landmark, (6, 1)), np.tile(z, (6, 1)))
    left = J_landmark.reshape(-1, model.dim_landmark)
    right = -(J_pose @ G_pose).reshape(-1, 3)
    G = np.linalg.lstsq(left, right, rcond=None)[0]
    np.testing.assert_allclose(left @ G, right, atol=1e-9)


# ---- bad starts -------------------------------------------------------------------------------


def from_odometry(seed: int, rate: float, nodes: int) -> tuple[Problem, float]:
    """Returns a problem started from odometry, and the cost of the minimum near the truth."""
    sigma = (0.004, 0.004, rate * np.sqrt(0.1))  # steps of 0.1 m
    measurements, truth = drive(seed, nodes=nodes, odometry_sigma=sigma)
    problem = posed(measurements)
    seen = np.unique(measurements.sightings["line"].truth)
    near = replace(problem, pose=truth, params=GRID[seen])
    return problem, minimise(near, SmootherConfig()).cost


@pytest.mark.parametrize("seed", range(10))
def test_from_odometry_the_optimum_near_the_truth_is_reached(seed: int) -> None:
    problem, cost = from_odometry(seed, 0.03, 1000)
    found = minimise(problem, SmootherConfig())
    assert found.converged
    assert found.cost == pytest.approx(cost, rel=1e-6)


@pytest.mark.parametrize("seed", [1, 2, 5, 8])
def test_a_start_found_along_the_chain_mends_odometry_that_turns_away(seed: int) -> None:
    problem, cost = from_odometry(seed, 0.1, 1000)
    assert minimise(problem, SmootherConfig()).cost > 2.0 * cost
    found = minimise(started_along(problem), SmootherConfig())
    assert found.cost == pytest.approx(cost, rel=1e-6)


def test_smoothing_tries_a_start_along_the_chain_where_its_own_is_hopeless() -> None:
    problem, cost = from_odometry(1, 0.1, 1000)
    config = SmootherConfig(engine="chain")
    plain = minimise(problem, config)
    assert misfit(problem, plain) > HOPELESS
    found = solve(problem, config)
    assert found.cost == pytest.approx(cost, rel=1e-6)
    assert found.converged
    assert found.iterations > plain.iterations


# ---- which engine ------------------------------------------------------------------------------


def test_the_engine_follows_the_length_of_the_log_and_is_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    measurements, _ = drive(2, 60)
    filtered = run_ekf(measurements)
    assert smooth(measurements, filtered).engine == "gtsam"
    monkeypatch.setattr("graphslam.smoother.batch.CHAIN_FROM", 60)
    by_chain = smooth(measurements, filtered)
    assert by_chain.engine == "chain"
    assert smooth(measurements, filtered, SmootherConfig(engine="gtsam")).engine == "gtsam"


def test_deciding_matches_again_takes_the_chain_however_short_the_log(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    measurements, _ = drive(2, 60)
    engines = []

    def rematch(problem: Problem, config: SmootherConfig, _: object) -> tuple[Problem, dict]:
        engines.append(config.engine)
        return problem, {}

    monkeypatch.setattr("graphslam.rematch.rematch", rematch)
    for engine in ("auto", "gtsam"):
        smooth(measurements, run_ekf(measurements), SmootherConfig(engine=engine, rematch=True))
    assert engines == ["chain", "gtsam"]


@pytest.mark.parametrize("robust", ["none", "cauchy"])
def test_engines_are_held_against_each_other_on_any_log(robust: Robust) -> None:
    measurements, _ = drive(2, 60)
    config = SmootherConfig(robust=robust)
    estimate = smooth(measurements, run_ekf(measurements), config)
    found = engines_agree(measurements, estimate, config)
    assert (found.engine, found.other, found.agree) == ("gtsam", "chain", True)
    assert "agree: cost to" in str(found)
    wrong = replace(found, cost=1e-6)
    assert not wrong.agree
    assert "do NOT agree" in str(wrong)
    with pytest.raises(BadMeasurements, match="ekf has no engine"):
        engines_agree(measurements, run_ekf(measurements), config)
