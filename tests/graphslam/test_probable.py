"""What makes a map probable: how its lines are laid, and where they end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from frontend.extract import extract
from frontend.simulate import load_scenario, simulate_log
from graphslam.config import EkfConfig, MatchingConfig, RematchConfig, SmootherConfig
from graphslam.ekf import run_ekf
from graphslam.rematch.ends import Ends
from graphslam.rematch.fitted import Fitted
from graphslam.rematch.laid import laid_odds
from graphslam.rematch.reach import gap_price, widest_gap
from graphslam.rematch.view import watched
from graphslam.smoother import state_problem
from graphslam.smoother.batch import minimise

RULES = RematchConfig()
STRETCH = (0.0, 1.3)
"""Where the lines of `short` begin and end along themselves, m."""


def driven(stretch: tuple[float, float] | None) -> Fitted:
    """Returns a lap over lines at one spacing, endless or not, under the true matches."""
    scenario = load_scenario("periodic")
    grids = tuple(replace(grid, stretch=stretch) for grid in scenario.grids)
    measurements = extract(simulate_log(replace(scenario, repeat=1, grids=grids), 0))
    known = run_ekf(measurements, EkfConfig(MatchingConfig(method="known")))
    problem = state_problem(measurements, known.match, known)
    return Fitted.of(problem, minimise(problem, SmootherConfig(engine="chain")))


@pytest.fixture(scope="module")
def floor() -> Fitted:
    return driven(None)


@pytest.fixture(scope="module")
def short() -> Fitted:
    return driven(STRETCH)


def edge(fitted: Fitted) -> int:
    """Returns the line that is the first of its direction."""
    x = np.abs(np.cos(fitted.problem.params[:, 1])) > 0.9
    across = fitted.problem.params[:, 0] * np.sign(np.cos(fitted.problem.params[:, 1]))
    return int(np.argmin(np.where(x, across, np.inf)))


def with_line(fitted: Fitted, line: int, params: np.ndarray) -> Fitted:
    """Returns the same with a line elsewhere."""
    moved = fitted.problem.params.copy()
    moved[line, :2] = params
    return replace(fitted, problem=replace(fitted.problem, params=moved))


def test_a_line_where_the_spacing_has_one_is_hardly_a_coincidence(floor: Fitted) -> None:
    line = edge(floor)
    rho, alpha = floor.problem.params[line, :2]
    odds = laid_odds(floor)
    between = laid_odds(with_line(floor, line, np.array([rho + 0.15, alpha])))
    askew = laid_odds(with_line(floor, line, np.array([rho, alpha + np.radians(3.0)])))
    assert odds > between + 3.0
    assert odds > askew + 3.0


def test_lines_at_any_places_are_as_probable_as_if_nothing_were_known_of_floors(
    floor: Fitted,
) -> None:
    rng = np.random.default_rng(0)
    params = floor.problem.params.copy()
    params[:, 0] = rng.uniform(-4.0, 4.0, len(params))
    params[:, 1] = rng.uniform(-np.pi, np.pi, len(params))
    anywhere = replace(floor, problem=replace(floor.problem, params=params))
    assert abs(laid_odds(anywhere)) < 4.0


def test_the_twin_of_a_line_lies_where_the_line_does(floor: Fitted) -> None:
    line = edge(floor)
    rho, alpha = floor.problem.params[line, :2]
    twin = with_line(floor, line, np.array([-rho, alpha + np.pi]))
    extent = twin.extent.copy()
    extent[line] = -extent[line, ::-1]
    cov = twin.cov_joint.copy()
    at = int(twin.offsets[line])
    cov[at] *= -1.0
    cov[:, at] *= -1.0
    twin = replace(twin, extent=extent, cov_joint=cov)
    assert laid_odds(twin) == pytest.approx(laid_odds(floor), abs=1e-9)


def test_ends_of_lines_are_counted_where_they_were_in_view(floor: Fitted, short: Fitted) -> None:
    endless, ended = watched(floor.problem, RULES).ends, watched(short.problem, RULES).ends
    seen = len(short.problem.kinds)
    assert endless.count == 0
    assert 0.5 * seen < ended.count <= 2 * seen
    assert 0.5 < ended.metres / (seen * (STRETCH[1] - STRETCH[0])) < 1.05


def test_lines_go_on_where_they_were_seen_to_and_not_where_they_end(
    floor: Fitted, short: Fitted
) -> None:
    endless, ended = watched(floor.problem, RULES).ends, watched(short.problem, RULES).ends
    gap = np.array([1.0])
    assert gap_price(gap, RULES, endless) < 0.1 * gap_price(gap, RULES)
    assert gap_price(gap, RULES, ended) > gap_price(gap, RULES)
    assert endless.sure(RULES) > 2.0
    assert ended.sure(RULES) < 0.2


def test_a_gap_costs_what_is_known_and_never_everything() -> None:
    gap = np.array([0.0, 1.0, 10.0, 1000.0])
    price = gap_price(gap, RULES)
    assert price[0] == 0.0
    assert np.all(np.diff(price) > 0.0)
    assert np.all(np.isfinite(gap_price(gap, RULES, Ends(1000, 100.0))))
    assert float(gap_price(np.array(widest_gap(9.0, RULES)), RULES)) == pytest.approx(9.0)
    assert np.exp(-Ends(3, 20.0).price(np.array(Ends(3, 20.0).sure(RULES)), RULES)) == (
        pytest.approx(0.9)
    )


def test_lines_on_each_other_are_no_way_of_laying_them(floor: Fitted) -> None:
    line = edge(floor)
    rho, alpha = floor.problem.params[line, :2]
    there = np.sort(np.abs(floor.problem.params[:, 0] - rho))
    on_next = with_line(floor, line, np.array([rho + there[1] + 0.001, alpha]))
    anywhere = with_line(floor, line, np.array([rho + 0.1, alpha]))
    assert laid_odds(on_next) < laid_odds(anywhere) + 1.0
