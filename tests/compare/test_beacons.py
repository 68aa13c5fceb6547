"""The map of what beacons fix, the circle on which they do not, and advice."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from compare.beacon_map import SCALE, Field, beacon_map, one_more
from compare.cli import main
from graphslam.errors import BadConfig
from graphslam.triangulation import fix, pose_covariance
from tests.graphslam.test_bearing_model import reading

CONES = np.array([[0.0, 0.0], [0.0, 0.7], [1.0, 0.0]])
KATO = Field((0.0, 0.0), (1.0, 0.7))
SIGMA = 3e-4


def half_axis(pose: np.ndarray, beacons: np.ndarray) -> float:
    cov = pose_covariance(pose, beacons, np.full(len(beacons), SIGMA**2))
    return float(SCALE * np.sqrt(np.linalg.eigvalsh(cov[:2, :2])[1]))


def test_the_map_is_the_bound_and_shots_spread_as_it_says() -> None:
    drawn = beacon_map(CONES, KATO, SIGMA, cells=20)
    row, column = 9, 12
    pose = np.array([drawn.x[column], drawn.y[row], 0.7])
    assert drawn.half_axes()[row, column] == pytest.approx(half_axis(pose, CONES))
    rng = np.random.default_rng(0)
    z = reading(pose, CONES)[:, 0] + SIGMA * rng.standard_normal((300, 3))
    found = np.array([fix(CONES, row, np.full(3, SIGMA**2)).pose for row in z]) - pose
    inside = np.einsum(
        "ni,ij,nj->n", found[:, :2], np.linalg.inv(drawn.cov[row, column, :2, :2]), found[:, :2]
    )
    assert np.mean(inside < SCALE**2) == pytest.approx(0.95, abs=0.035)


def test_the_map_is_worst_along_the_circle_and_point_d_is_next_to_it() -> None:
    drawn = beacon_map(CONES, KATO, SIGMA)
    [(centre, radius)] = drawn.circles()
    np.testing.assert_allclose(centre, [0.5, 0.35])
    across, up = np.meshgrid(drawn.x, drawn.y)
    gap = np.abs(np.hypot(across - centre[0], up - centre[1]) - radius)
    half = drawn.half_axes()
    assert np.median(half[gap < 0.02]) > 10 * np.median(half[gap > 0.2])
    place = {"A": (0.5, 0.35), "D": (0.95, 0.65)}
    off = {name: radius - np.hypot(*(np.array(p) - centre)) for name, p in place.items()}
    assert off["D"] < 0.07 < off["A"]
    a, d = (half_axis(np.array([*p, 0.0]), CONES) for p in place.values())
    assert d > 20 * a


def test_one_more_beacon_is_advised_where_it_helps_most() -> None:
    drawn = beacon_map(CONES, KATO, SIGMA, cells=20)
    advice = one_more(drawn, cells=12, tried=10)
    assert advice.worst_then == pytest.approx(advice.worst.min())
    assert advice.worst_then < 0.4 * advice.worst_now
    assert advice.median_then < advice.median_now
    four = beacon_map(np.vstack([CONES, advice.place]), KATO, SIGMA, cells=20)
    inside = four.inside()
    assert np.quantile(four.half_axes()[inside], 0.95) < 1.3 * advice.worst_then


def test_four_beacons_off_one_circle_have_none() -> None:
    four = np.vstack([CONES, [[0.4, 0.5]]])
    assert beacon_map(four, KATO, SIGMA, cells=5).circles() == []


def test_beacons_on_one_circle_or_line_fix_nothing_there_however_many() -> None:
    angle = np.array([0.1, 1.5, 3.0, 4.4])
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    [(centre, radius)] = beacon_map(ring, Field((-1, -1), (1, 1)), SIGMA, cells=9).circles()
    np.testing.assert_allclose([*centre, radius], [0, 0, 1], atol=1e-9)
    line = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
    drawn = beacon_map(line, Field((3.0, -0.5), (4.0, 0.5)), SIGMA, cells=6)
    assert np.isinf(drawn.circles()[0][1])
    assert np.isinf(drawn.half_axes()[np.abs(drawn.y).argmin()]).all()


def test_the_command_tells_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "log"
    log.mkdir()
    rows = [f"{k},bearing,{x},{y}" for k, (x, y) in enumerate(CONES)]
    (log / "landmarks.csv").write_text("\n".join(["landmark,kind,x,y", *rows]) + "\n")
    out = tmp_path / "out"
    command = ["beacons", str(log), "--sigma-deg", "0.02", "--out", str(out)]
    assert main(command) == 0
    shown = capsys.readouterr().out
    assert "circle through the beacons (centre (0.5, 0.35) m, radius 0.61 m)" in shown
    assert "One more beacon helps most at" in shown
    assert (out / "beacons.svg").read_text().startswith("<?xml")
    with (out / "beacons.csv").open() as stream:
        table = list(csv.DictReader(stream))
    assert float(table[0]["half_axis_95_m"]) > 0
    field = ["--field", "2", "2", "1", "1"]
    assert main([*command, *field]) == 1
    assert "is empty; exchange its ends" in capsys.readouterr().err
    (log / "landmarks.csv").write_text("landmark,kind,x,y\n0,bearing,0,0\n")
    assert main(command) == 1
    assert "enclose no field" in capsys.readouterr().err
    with pytest.raises(BadConfig, match="2 beacons fix no pose"):
        beacon_map(CONES[:2], KATO, SIGMA)
