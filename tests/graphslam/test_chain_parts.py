"""Parts of the chain solver: orders of elimination, fronts, kinds of landmarks to come."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest

from graphslam.config import SmootherConfig
from graphslam.geometry import wrap
from graphslam.measurements import Measurements, Odometry, Sightings
from graphslam.models import MODELS
from graphslam.smoother import engine_gtsam
from graphslam.smoother.chain import minimise
from graphslam.smoother.chain.dissection import stages
from graphslam.smoother.chain.fronts import BLOCK, STRIP, _partial_cholesky
from graphslam.smoother.chain.ordering import DENSE, Groups, minimum_degree
from graphslam.smoother.chain.symbolic import analyse
from graphslam.smoother.problem import Problem
from tests.graphslam.test_chain import correlation_units
from tests.worlds import GRID, drive

# ---- orders of elimination --------------------------------------------------------------------


def cliques(seed: int, variables: int, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns random cliques along a line, with some variables in far places too."""
    rng = np.random.default_rng(seed)
    parts = []
    for e in range(count):
        near = e * variables // count + rng.integers(-5, 6, 5)
        parts.append(np.unique(np.append(near, rng.integers(0, variables)).clip(0, variables - 1)))
    start = np.concatenate([[0], np.cumsum([len(part) for part in parts])])
    return start, np.concatenate(parts), rng.integers(1, 4, variables)


def coupled_after(start: np.ndarray, member: np.ndarray, groups: Groups) -> list[set[int]]:
    """Returns by plain elimination on a full matrix what each group leaves coupled."""
    n = len(groups.order)
    joined = np.eye(n, dtype=bool)
    for a, b in pairwise(start):
        joined[np.ix_(member[a:b], member[a:b])] = True
    left, found = set(range(n)), []
    for a, b in pairwise(groups.start):
        pivots = groups.order[a:b]
        left -= set(pivots.tolist())
        outer = {v for p in pivots for v in np.flatnonzero(joined[p]).tolist()} & left
        joined[np.ix_(list(outer), list(outer))] = True
        found.append(outer)
    return found


@pytest.mark.parametrize("seed", range(6))
def test_groups_leave_coupled_what_plain_elimination_leaves(seed: int) -> None:
    start, member, dims = cliques(seed, 60, 80)
    stage = np.random.default_rng(seed).integers(0, 1 + seed % 3, len(dims))
    groups = minimum_degree(start, member, dims, stage)
    assert sorted(groups.order.tolist()) == list(range(len(dims)))
    for g, outer in enumerate(coupled_after(start, member, groups)):
        bound = groups.bound[groups.bound_start[g] : groups.bound_start[g + 1]]
        assert set(bound.tolist()) == outer
        assert len(bound) == len(outer)


@pytest.mark.parametrize("seed", range(4))
def test_what_is_in_very_many_cliques_goes_last_and_is_coupled_to_all_that_saw_it(
    seed: int,
) -> None:
    rng = np.random.default_rng(seed)
    start, member, dims = cliques(seed, 240, 400)
    seen = [  # three variables, each in some of most cliques
        np.append(member[a:b], 240 + np.flatnonzero(rng.random(3) < 0.3))
        for a, b in pairwise(start)
    ]
    start = np.concatenate([[0], np.cumsum([len(part) for part in seen])])
    dims, stage = np.append(dims, [2, 2, 3]), rng.integers(0, 1 + seed % 2, 243)
    member = np.concatenate(seen)
    assert np.bincount(member)[240:].min() > DENSE * np.sqrt(400)
    assert np.bincount(member)[:240].max() <= DENSE * np.sqrt(400)
    groups = minimum_degree(start, member, dims, stage)
    assert sorted(groups.order.tolist()) == list(range(243))
    assert groups.order[-3:].tolist() == [240, 241, 242]
    for g, outer in enumerate(coupled_after(start, member, groups)):
        bound = groups.bound[groups.bound_start[g] : groups.bound_start[g + 1]]
        assert set(bound.tolist()) == outer
        assert len(bound) == len(outer)


def test_halves_of_a_field_share_nothing_but_what_goes_last() -> None:
    rng = np.random.default_rng(0)
    place = rng.uniform(0, 10, (400, 2))
    # variables are cells of a field; a clique holds the cell that it lies in and its neighbours
    cell = np.floor(place).astype(int)
    member = np.concatenate([[10 * y + x, 10 * y + min(x + 1, 9)] for x, y in cell])
    start = 2 * np.arange(401)
    stage = stages(place, start, member, 100)
    last = stage.max()
    assert 1 <= np.count_nonzero(stage == last) <= 20
    halves = np.argsort(place[:, np.argmax(np.ptp(place, axis=0))], kind="stable")
    sides = [set(member.reshape(-1, 2)[half].ravel()) for half in (halves[:200], halves[200:])]
    assert sides[0] & sides[1] == set(np.flatnonzero(stage == last))


@pytest.mark.parametrize("seed", range(3))
def test_every_front_finds_its_boundary_in_its_parent(seed: int) -> None:
    start, member, dims = cliques(seed, 200, 300)
    tree = analyse(start, member, dims, np.random.default_rng(0).normal(size=(300, 2)))
    eliminated = []
    for s, parent in enumerate(tree.parent):
        first, last = tree.scalar_start[s : s + 2]
        pivots, outer = np.split(tree.scalar[first:last], [tree.pivots[s]])
        eliminated.extend(pivots.tolist())
        if parent < 0:
            assert len(outer) == 0
            continue
        assert parent > s
        above = tree.scalar[tree.scalar_start[parent] : tree.scalar_start[parent + 1]]
        found = above[tree.relative[first + len(pivots) : last]]
        np.testing.assert_array_equal(found, outer)
    assert sorted(eliminated) == list(range(int(dims.sum())))


# ---- fronts -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("size", "pivots"), [(1, 1), (7, 3), (50, 45), (2 * BLOCK + 3, BLOCK + 1), (STRIP + 70, 37)]
)
def test_a_front_keeps_its_product_when_pivots_go(size: int, pivots: int) -> None:
    rng = np.random.default_rng(size)
    root = rng.normal(size=(size, size + 3))
    whole = root @ root.T
    front = np.tril(whole)
    room = np.empty((BLOCK, size))
    assert _partial_cholesky(front, pivots, size, np.diag(whole).copy(), room) == -1
    L = np.tril(front)[:, :pivots]
    rest = np.tril(front[pivots:, pivots:])
    np.testing.assert_allclose(np.tril(L @ L.T)[:pivots], np.tril(whole)[:pivots], atol=1e-9)
    below = np.tril(whole)[pivots:, pivots:] - np.tril(L[pivots:] @ L[pivots:].T)
    np.testing.assert_allclose(rest, below, atol=1e-9)


def test_a_front_without_information_names_the_pivot() -> None:
    whole = np.diag([4.0, 1.0, 1.0, 5.0])
    whole[2, 1] = 1.0
    assert _partial_cholesky(whole, 4, 4, np.diag(whole).copy(), np.empty((BLOCK, 4))) == 2


# ---- kinds of landmarks to come ---------------------------------------------------------------


@dataclass(frozen=True)
class Lamp:
    """A landmark of three parameters, (x, y, phi), read whole in the robot's frame."""

    kind: str = "a lamp"
    dim_z: int = 3
    dim_landmark: int = 3

    def residual(self, pose, landmark, z):  # type: ignore[no-untyped-def]
        c, s = np.cos(pose[..., 2]), np.sin(pose[..., 2])
        dx, dy = landmark[..., 0] - pose[..., 0], landmark[..., 1] - pose[..., 1]
        turn = wrap(landmark[..., 2] - pose[..., 2] - z[..., 2])
        e = np.stack([c * dx + s * dy - z[..., 0], -s * dx + c * dy - z[..., 1], turn], -1)
        J_landmark = np.zeros((*e.shape, 3))
        J_landmark[..., 0, 0], J_landmark[..., 0, 1] = c, s
        J_landmark[..., 1, 0], J_landmark[..., 1, 1] = -s, c
        J_landmark[..., 2, 2] = 1.0
        J_pose = -J_landmark
        J_pose[..., 0, 2], J_pose[..., 1, 2] = -s * dx + c * dy, -c * dx - s * dy
        return e, J_pose, J_landmark


@dataclass(frozen=True)
class Bearing:
    """A point (x, y) of which one number is seen: the direction in the robot's frame."""

    kind: str = "a bearing"
    dim_z: int = 1
    dim_landmark: int = 2

    def residual(self, pose, landmark, z):  # type: ignore[no-untyped-def]
        dx, dy = landmark[..., 0] - pose[..., 0], landmark[..., 1] - pose[..., 1]
        e = wrap(np.arctan2(dy, dx) - pose[..., 2] - z[..., 0])[..., None]
        J_landmark = (np.stack([-dy, dx], -1) / (dx**2 + dy**2)[..., None])[..., None, :]
        J_pose = np.concatenate([-J_landmark, np.full((*e.shape, 1), -1.0)], -1)
        return e, J_pose, J_landmark


@pytest.fixture
def more_kinds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Makes both kinds known to every module that looks kinds up."""
    models = {**MODELS, Lamp().kind: Lamp(), Bearing().kind: Bearing()}
    for name, module in list(sys.modules.items()):
        if name.startswith("graphslam") and getattr(module, "MODELS", None) is MODELS:
            monkeypatch.setattr(module, "MODELS", models)


def table(kind: str, node: np.ndarray, z: np.ndarray, sigma: float) -> Sightings:
    count, d = z.shape
    nothing = np.full(count, -1)
    return Sightings(
        kind,
        node,
        z,
        np.tile(sigma**2 * np.eye(d), (count, 1, 1)),
        np.full((count, 2), np.nan),
        0.1 * node,
        np.ones(count),
        nothing,
        nothing,
    )


@pytest.mark.usefixtures("more_kinds")
def test_landmarks_of_one_to_three_numbers_and_sightings_of_one_to_three_mix() -> None:
    rng = np.random.default_rng(4)
    measurements, truth = drive(4, nodes=150)
    lamps, points = rng.uniform(0, 3, (3, 3)), rng.uniform(6, 9, (2, 2))
    node = np.sort(rng.integers(0, 150, 60))
    which = {"a lamp": rng.integers(0, 3, 60), "a bearing": rng.integers(0, 2, 60)}
    tables = dict(measurements.sightings)
    for model, world, sigma in ((Lamp(), lamps, 0.02), (Bearing(), points, 0.01)):
        nothing = np.zeros((60, model.dim_z))
        z, _, _ = model.residual(truth[node], world[which[model.kind]], nothing)
        z = z + sigma * rng.standard_normal(z.shape)
        tables[model.kind] = table(model.kind, node, z, sigma)
    lines = np.unique(tables["line"].truth, return_inverse=True)[1]
    offset = lines.max() + 1
    everything = Measurements(
        measurements.t,
        measurements.start_pose,
        measurements.start_cov,
        Odometry(measurements.odometry.increment, measurements.odometry.cov),
        tables,
    )
    parts = {"line": lines, "a lamp": offset + which["a lamp"]}
    parts["a bearing"] = offset + 3 + which["a bearing"]
    match = np.concatenate([parts[kind] for kind in everything.sightings])
    kinds = ("line",) * offset + ("a lamp",) * 3 + ("a bearing",) * 2
    seen = np.unique(tables["line"].truth)
    params = np.full((len(kinds), 3), np.nan)
    params[:offset, :2], params[offset : offset + 3] = GRID[seen], lamps
    params[offset + 3 :, :2] = points
    problem = Problem(
        everything,
        match,
        kinds,
        np.arange(len(kinds)) == offset + 1,
        truth,
        params,
        np.ones(len(match)),
        np.ones(149),
    )
    tight = SmootherConfig(tolerance=1e-14)
    ours, theirs = minimise(problem, tight), engine_gtsam.minimise(problem, tight)
    assert ours.cost == pytest.approx(theirs.cost, rel=1e-9)
    assert correlation_units(ours.covariances()[1], theirs.covariances()[1]) < 1e-6
    node, landmark = np.array([3, 77, 149]), np.array([offset, offset + 2, offset])
    pairs = ours.pair_covariances(node, landmark)
    assert correlation_units(pairs, theirs.pair_covariances(node, landmark)) < 1e-6
