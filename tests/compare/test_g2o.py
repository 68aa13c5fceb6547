"""g2o graphs: what is written costs in g2o what it costs here, and comes back as it was."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from compare.interchange.g2o_read import FIXED_SIGMA, read_g2o
from compare.interchange.g2o_write import g2o_text
from graphslam.config import EkfConfig, MatchingConfig
from graphslam.ekf import run_ekf
from graphslam.errors import BadLog, BadMeasurements
from graphslam.estimate import Estimate
from graphslam.measurements import LandmarkMap, Measurements, Sightings
from graphslam.smoother import smooth
from tests.worlds import GRID, drive

KNOWN_MATCHES = EkfConfig(matching=MatchingConfig(method="known"))


def with_pose_fixes(measurements: Measurements) -> Measurements:
    """Adds a correlated pose fix at every twentieth node."""
    node = np.arange(10, len(measurements.t), 20)
    count = len(node)
    rng = np.random.default_rng(7)
    path = run_ekf(measurements).pose[node]
    root = 0.02 * (np.eye(3) + 0.3 * rng.standard_normal((3, 3)))
    none = np.full((count, 2), np.nan)
    table = Sightings(
        "pose_fix",
        node,
        path + 0.01 * rng.standard_normal((count, 3)),
        np.broadcast_to(root @ root.T, (count, 3, 3)),
        none,
        measurements.t[node],
        np.full(count, np.nan),
        np.full(count, -1),
        np.full(count, -1),
    )
    return replace(measurements, sightings={**measurements.sightings, "pose_fix": table})


@pytest.fixture(scope="module")
def made() -> tuple[Measurements, Estimate]:
    """A drive with lines seen under both names, pose fixes and an uncertain start; its smoother."""
    measurements, _ = drive(3, 120, start_sigma=0.05)
    measurements = with_pose_fixes(measurements)
    return measurements, smooth(measurements, run_ekf(measurements))


def wrapped(angle: float) -> float:
    return float(np.arctan2(np.sin(angle), np.cos(angle)))


def matrix(pose: list[float]) -> np.ndarray:
    x, y, theta = pose
    c, s = np.cos(theta), np.sin(theta)
    return np.array([[c, -s, x], [s, c, y], [0.0, 0.0, 1.0]])


def pose_error(measured: list[float], moved: np.ndarray) -> np.ndarray:
    """g2o's EdgeSE2::computeError: the measurement undone, as a vector."""
    delta = np.linalg.inv(matrix(measured)) @ moved
    return np.array([delta[0, 2], delta[1, 2], np.arctan2(delta[1, 0], delta[0, 0])])


def line_error(pose: list[float], line: list[float], measured: list[float]) -> np.ndarray:
    """g2o's EdgeSE2Line2D::computeError: (theta, rho), theta modulo a full turn."""
    inverse = np.linalg.inv(matrix(pose))
    theta = wrapped(line[0] + np.arctan2(inverse[1, 0], inverse[0, 0]))
    rho = line[1] + np.cos(theta) * inverse[0, 2] + np.sin(theta) * inverse[1, 2]
    return np.array([wrapped(theta - measured[0]), rho - measured[1]])


def g2o_chi2(text: str) -> float:
    """Returns the sum of e' I e over all edges, with g2o's own errors and order of entries."""
    pose: dict[int, list[float]] = {}
    line: dict[int, list[float]] = {}
    total = 0.0
    for tag, *cells in (row.split() for row in text.splitlines() if row[0] != "#"):
        numbers = [float(cell) for cell in cells]
        ids = [int(number) for number in numbers[:2]]
        if tag == "VERTEX_SE2":
            pose[ids[0]] = numbers[1:]
        elif tag == "VERTEX_LINE2D":
            line[ids[0]] = numbers[1:3]
        else:
            if tag == "EDGE_PRIOR_SE2":
                error, rest = pose_error(numbers[1:4], matrix(pose[ids[0]])), numbers[4:]
            elif tag == "EDGE_SE2":
                moved = np.linalg.inv(matrix(pose[ids[0]])) @ matrix(pose[ids[1]])
                error, rest = pose_error(numbers[2:5], moved), numbers[5:]
            elif tag == "EDGE_SE2_LINE2D":
                error = line_error(pose[ids[0]], line[ids[1]], numbers[2:4])
                rest = numbers[4:]
            information = np.zeros((len(error), len(error)))
            information[np.triu_indices(len(error))] = rest
            information += np.triu(information, 1).T
            total += float(error @ information @ error)
    return total


def test_a_graph_costs_in_g2o_what_it_costs_here(made: tuple[Measurements, Estimate]) -> None:
    measurements, estimate = made
    text = g2o_text(measurements, estimate)
    assert text.count("EDGE_PRIOR_SE2") == 1 + len(measurements.sightings["pose_fix"])
    assert 0.5 * g2o_chi2(text) == pytest.approx(estimate.cost, rel=1e-6)


def test_the_cost_away_from_the_optimum_is_the_same_too(
    made: tuple[Measurements, Estimate], tmp_path: Path
) -> None:
    measurements, estimate = made
    rng = np.random.default_rng(0)
    moved = replace(estimate, pose=estimate.pose + 0.03 * rng.standard_normal(estimate.pose.shape))
    text = g2o_text(measurements, moved)
    (tmp_path / "moved.g2o").write_text(text)
    graph = read_g2o(tmp_path / "moved.g2o")
    again = g2o_text(graph.measurements, graph.initial())
    assert g2o_chi2(text) > 100 * estimate.cost
    assert g2o_chi2(again) == pytest.approx(g2o_chi2(text), rel=1e-9)


def test_a_graph_comes_back_as_it_was_written(
    made: tuple[Measurements, Estimate], tmp_path: Path
) -> None:
    measurements, estimate = made
    (tmp_path / "a.g2o").write_text(g2o_text(measurements, estimate))
    graph = read_g2o(tmp_path / "a.g2o")
    back = graph.measurements
    np.testing.assert_array_equal(back.t, measurements.t)
    np.testing.assert_allclose(back.start_cov, measurements.start_cov, rtol=1e-9, atol=1e-15)
    np.testing.assert_array_equal(back.odometry.increment, measurements.odometry.increment)
    np.testing.assert_allclose(back.odometry.cov, measurements.odometry.cov, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(graph.pose, estimate.pose)
    np.testing.assert_array_equal(graph.landmarks.params, estimate.map.params)
    np.testing.assert_array_equal(graph.landmarks.extent, estimate.map.extent)
    np.testing.assert_array_equal(graph.match, estimate.match[estimate.used])
    fixes, before = back.sightings["pose_fix"], measurements.sightings["pose_fix"]
    np.testing.assert_array_equal(fixes.z, before.z)
    np.testing.assert_allclose(fixes.cov, before.cov, rtol=0, atol=1e-14)


def test_a_graph_read_is_estimated_to_the_same_path_and_map(
    made: tuple[Measurements, Estimate], tmp_path: Path
) -> None:
    measurements, estimate = made
    (tmp_path / "a.g2o").write_text(g2o_text(measurements, run_ekf(measurements)))
    graph = read_g2o(tmp_path / "a.g2o")
    again = smooth(graph.measurements, graph.initial())
    np.testing.assert_allclose(again.pose, estimate.pose, atol=1e-6)
    np.testing.assert_allclose(again.map.params, estimate.map.params, atol=1e-6)
    np.testing.assert_allclose(again.cov_joint, estimate.cov_joint, rtol=1e-4, atol=1e-9)
    filtered = run_ekf(graph.measurements, KNOWN_MATCHES)
    np.testing.assert_array_equal(filtered.match, graph.match)


def test_robust_weights_scale_information_and_rejected_sightings_are_left_out(
    made: tuple[Measurements, Estimate], tmp_path: Path
) -> None:
    measurements, estimate = made
    weight, match = estimate.weight.copy(), estimate.match.copy()
    weight[0], weight[1], match[2] = 0.25, 0.0, -1
    (tmp_path / "a.g2o").write_text(
        g2o_text(measurements, replace(estimate, weight=weight, match=match))
    )
    table = read_g2o(tmp_path / "a.g2o").measurements.sightings["line"]
    before = measurements.sightings["line"]
    assert len(table) == len(before) - 2
    np.testing.assert_allclose(table.cov[0, 0, 0], 4.0 * before.cov[0, 0, 0], rtol=1e-12)


def test_known_lines_are_fixed_and_known_again(tmp_path: Path) -> None:
    measurements, _ = drive(5, 60)
    count = len(GRID)
    extent = np.full((count, 2), np.nan)
    known = LandmarkMap(
        np.arange(count), ("line",) * count, GRID, extent, np.zeros(count, np.int64)
    )
    measurements = replace(measurements, known=known)
    estimate = smooth(measurements, run_ekf(measurements))
    text = g2o_text(measurements, estimate)
    assert [row for row in text.splitlines() if row.startswith("FIX")] == [
        " ".join(["FIX", *(str(60 + line) for line in range(count))])
    ]
    (tmp_path / "a.g2o").write_text(text)
    back = read_g2o(tmp_path / "a.g2o")
    assert back.measurements.known is not None
    np.testing.assert_array_equal(back.measurements.known.params, GRID)
    again = smooth(back.measurements, back.initial())
    np.testing.assert_allclose(again.pose, estimate.pose, atol=1e-6)


PLAIN = """# from somewhere else
VERTEX_LINE2D 9 0.5 2.0 -1 -1
VERTEX_SE2 7 1.0 2.0 0.0
VERTEX_SE2 3 0.0 0.0 0.0
VERTEX_SE2 5 2.0 2.0 0.0
VERTEX_XY 11 0 0
EDGE_SE2 7 5 1 0 0 100 0 0 100 0 400
EDGE_SE2 3 7 1 2 0 100 0 0 100 0 400
EDGE_SE2_LINE2D 7 9 0.5 0.2 100 1 400
"""


def graph_of(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "plain.g2o"
    path.write_text(text)
    return path


def test_the_chain_decides_the_order_and_a_first_pose_without_prior_is_known(
    tmp_path: Path,
) -> None:
    graph = read_g2o(graph_of(tmp_path, PLAIN))
    np.testing.assert_array_equal(graph.pose, [[0, 0, 0], [1, 2, 0], [2, 2, 0]])
    np.testing.assert_array_equal(graph.measurements.t, [0, 1, 2])
    np.testing.assert_allclose(np.diag(graph.measurements.start_cov), FIXED_SIGMA**2)
    line = graph.measurements.sightings["line"]
    np.testing.assert_array_equal(line.z, [[0.2, 0.5]])
    np.testing.assert_allclose(np.linalg.inv(line.cov[0]), [[400, 1], [1, 100]])
    assert line.node.tolist() == [1]


def test_a_first_pose_is_free_where_another_is_held(tmp_path: Path) -> None:
    graph = read_g2o(graph_of(tmp_path, PLAIN + "FIX 5\n"))
    assert graph.measurements.start_cov[0, 0] == 1e6
    fix = graph.measurements.sightings["pose_fix"]
    assert fix.node.tolist() == [2]
    estimate = smooth(graph.measurements, graph.initial())
    np.testing.assert_allclose(estimate.pose[2], [2, 2, 0], atol=1e-6)
    assert np.sqrt(estimate.cov_floor[0, 0, 0]) == pytest.approx(np.sqrt(0.02 + 4 / 200), rel=0.2)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("VERTEX_XY 11 0 0", "EDGE_SE2_XY 7 11 0 0 1 0 1", "plain.g2o:6: EDGE_SE2_XY is not read"),
        ("EDGE_SE2 3 7 1", "EDGE_SE2 3 5 1", "plain.g2o:8: EDGE_SE2 3 5 is a second way"),
        ("EDGE_SE2 3 7 1", "EDGE_SE2 3 9 1", "plain.g2o:8: there is no VERTEX_SE2 9"),
        ("EDGE_SE2 3 7 1 2 0 100 0 0 100 0 400", "#", "plain.g2o:3: VERTEX_SE2 7|plain.g2o:4"),
        ("0.2 100 1 400", "0.2 100 1", "plain.g2o:9: EDGE_SE2_LINE2D has 4 numbers"),
        ("0.2 100 1 400", "0.2 0 0 400", "plain.g2o:9: the information of this EDGE_SE2_LINE2D"),
        ("0.2 100 1 400", "0.2 100 nan 400", "plain.g2o:9: 'nan' is not a finite number"),
        ("VERTEX_SE2 5", "VERTEX_SE2 7", "plain.g2o:5: vertex 7 is there twice"),
        ("VERTEX_SE2 5", "VERTEX_SE2 five", "plain.g2o:5: 'five' are no vertices"),
        ("VERTEX_SE2", "VERTEX_SE3", "holds no VERTEX_SE2"),
        ("VERTEX_XY 11 0 0", "FIX 12", "plain.g2o:6: there is no vertex 12 to fix"),
    ],
)
def test_what_cannot_be_used_is_named_with_its_line(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    with pytest.raises(BadLog, match=message):
        read_g2o(graph_of(tmp_path, PLAIN.replace(old, new)))


def test_an_estimate_of_other_measurements_is_refused(made: tuple[Measurements, Estimate]) -> None:
    other, _ = drive(3, 60)
    with pytest.raises(BadMeasurements, match="other measurements"):
        g2o_text(other, made[1])
