"""A path that slipped by a spacing of lines, or by a turn between them, is put back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from frontend.extract import extract
from frontend.simulate import load_scenario, simulate_log
from graphslam.config import EkfConfig, MatchingConfig, RematchConfig, SmootherConfig
from graphslam.ekf import run_ekf
from graphslam.geometry import rotation
from graphslam.rematch import slips
from graphslam.rematch.fitted import Fitted, renumbered
from graphslam.rematch.moving import Move, Moved, matched, moved, near_lines, promise
from graphslam.rematch.objective import objective
from graphslam.rematch.rounds import rounds
from graphslam.rematch.shifting import SHIFTED, straightened
from graphslam.rematch.slips import moves
from graphslam.rematch.view import NOTHING, watched
from graphslam.smoother import state_problem
from graphslam.smoother.batch import minimise

RULES = RematchConfig()
AGAIN = SmootherConfig(engine="chain", rematch=True)
PITCH_M = 0.33
SLIPPED = 30
"""Node from which on the path slips."""


@pytest.fixture(scope="module")
def floor() -> Fitted:
    """Returns a lap over lines at one spacing under the true matches; its wheels slip a lot."""
    scenario = load_scenario("periodic")
    assert scenario.camera is not None
    robot = replace(scenario.robot, noise_left=0.3, noise_right=0.3, slip=(0.02, 0.02, 0.05))
    camera = replace(scenario.camera, rate=2.0)
    scenario = replace(scenario, repeat=1, camera=camera, robot=robot)
    measurements = extract(simulate_log(scenario, 0))
    known = run_ekf(measurements, EkfConfig(MatchingConfig(method="known")))
    problem = state_problem(measurements, known.match, known)
    return Fitted.of(problem, minimise(problem, AGAIN))


def slipped(floor: Fitted, motion: np.ndarray) -> Moved:
    """Returns what a slip makes of path and map from `SLIPPED` on."""
    move = Move(SLIPPED, len(floor.problem.pose), motion, 0.0)
    return moved(floor, move, near_lines(floor, float(np.hypot(*motion[:2])), RULES), RULES)


def turned(floor: Fitted, angle: float) -> np.ndarray:
    """Returns the turn about the node `SLIPPED` that lays the lines on each other again."""
    pivot = floor.problem.pose[SLIPPED, :2]
    first = -1.1  # where the scenario's grids begin
    corner = first + PITCH_M * np.round((pivot - first) / PITCH_M)
    about = corner - rotation(angle) @ corner
    return np.append(about, angle)


@pytest.mark.parametrize(
    "slip", ["by a spacing in x", "by a spacing in y", "by both", "by a quarter turn"]
)
def test_a_path_that_slipped_is_put_back(floor: Fitted, slip: str) -> None:
    motion = {
        "by a spacing in x": np.array([PITCH_M, 0.0, 0.0]),
        "by a spacing in y": np.array([0.0, -PITCH_M, 0.0]),
        "by both": np.array([PITCH_M, PITCH_M, 0.0]),
        "by a quarter turn": turned(floor, 0.5 * np.pi),
    }[slip]
    wrong = matched(slipped(floor, motion), floor, RULES)
    start = rounds(renumbered(wrong, wrong.match), AGAIN, minimise)
    assert np.abs(start.fitted.problem.pose - floor.problem.pose)[-1].max() > 0.9 * PITCH_M
    found = straightened(start, AGAIN, minimise)
    assert np.allclose(found.fitted.problem.pose, floor.problem.pose, atol=0.01)
    assert found.objective <= objective(floor, RULES) + 1e-3
    assert found.counts[SHIFTED] >= 1


def test_a_right_path_stays_where_it_is(floor: Fitted) -> None:
    start = rounds(floor.problem, AGAIN, minimise)
    found = straightened(start, AGAIN, minimise)
    assert SHIFTED not in found.counts
    assert np.array_equal(found.fitted.problem.match, start.fitted.problem.match)


def test_the_move_that_takes_a_slip_back_promises_most(floor: Fitted) -> None:
    motion = np.array([PITCH_M, 0.0, 0.0])
    wrong = matched(slipped(floor, motion), floor, RULES)
    wrong = renumbered(wrong, wrong.match)
    fitted = Fitted.of(wrong, minimise(wrong, AGAIN))
    near = near_lines(fitted, 2.0, RULES)
    best = max(
        moves(fitted, -10.0),
        key=lambda move: promise(moved(fitted, move, near, RULES), fitted, move, RULES),
    )
    assert np.allclose(best.motion, -motion, atol=0.02)
    assert abs(best.first - SLIPPED) <= 5


def test_a_slip_that_was_taken_back_much_later_is_found(
    floor: Fitted, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(slips, "NEXT_BACK", 2)
    motion, last = np.array([PITCH_M, 0.0, 0.0]), len(floor.problem.pose) - 4
    there = moved(floor, Move(5, last, motion, 0.0), near_lines(floor, PITCH_M, RULES), RULES)
    wrong = matched(there, floor, RULES)
    wrong = renumbered(wrong, wrong.match)
    fitted = Fitted.of(wrong, minimise(wrong, AGAIN))
    found = [move for move in moves(fitted, -15.0) if np.allclose(move.motion, -motion, atol=0.02)]
    assert any(abs(move.first - 5) <= 5 and abs(move.last - last) <= 5 for move in found)


def test_lines_in_view_that_are_not_seen_cost_something(floor: Fitted) -> None:
    price = watched(floor.problem, RULES).price
    double = floor.problem.match.copy()
    line = int(np.bincount(double[double >= 0]).argmax())
    own = np.flatnonzero(double == line)
    double[own[::2]] = len(floor.problem.kinds)
    two = replace(
        floor.problem,
        match=double,
        kinds=(*floor.problem.kinds, "line"),
        fixed=np.append(floor.problem.fixed, False),
        params=np.vstack([floor.problem.params, floor.problem.params[line]]),
    )
    assert watched(two, RULES).price > price + 0.5 * len(own)


def test_without_sightings_nothing_is_known_of_the_view(floor: Fitted) -> None:
    nothing = np.full(len(floor.problem.match), -1)
    assert watched(replace(floor.problem, match=nothing), RULES) == NOTHING
