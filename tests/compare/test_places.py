"""The map of corridors: reading it, ways in words, where a robot is, lamps that are dark."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from compare.cli import main
from compare.known import on_building
from compare.places.building import Building, Place, read_building
from compare.places.route import plan_route
from compare.places.sight import Sight, lamp_records
from compare.places.start import find_start
from compare.places.whereabouts import NOWHERE, place_at, visits
from frontend.simulate import load_scenario, simulate, simulate_log, simulate_measurements
from graphslam import run_ekf
from graphslam.errors import BadConfig

MAP = """
format = "graphslam-places/1"
name = "second floor"
ways = [
    ["lift", "west corridor"], ["west corridor", "lab"], ["west corridor", "corner"],
    ["corner", "north corridor"], ["north corridor", "end"],
]

[[places]]
name = "lift"
kind = "end-corridor"
at = [0.0, 0.0]

[[places]]
name = "west corridor"
kind = "corridor"
course = [[0.0, 0.0], [16.0, 0.0]]
lamps = [
    { id = 0, x = 1.3, y = 0.1 }, { id = 1, x = 4.1, y = 0.1 }, { id = 2, x = 6.9, y = 0.1 },
    { id = 3, x = 9.7, y = 0.1 }, { id = 4, x = 12.5, y = 0.1 },
]

[[places]]
name = "lab"
kind = "door"
at = [13.0, 1.5]
width = 1.4

[[places]]
name = "corner"
kind = "corner"
at = [16.0, 0.0]

[[places]]
name = "north corridor"
kind = "corridor"
course = [[16.0, 0.0], [16.0, 9.0]]
lamps = [
    { id = 5, x = 16.0, y = 3.0, phi_deg = 90.0 },
    { id = 6, x = 16.0, y = 6.0, phi_deg = 90.0, dark = true },
]

[[places]]
name = "end"
kind = "end-corridor"
at = [16.0, 9.0]
"""


@pytest.fixture(scope="module")
def map_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("map") / "building.toml"
    path.write_text(MAP, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def building(map_file: Path) -> Building:
    return read_building(map_file)


@pytest.mark.parametrize(
    ("start", "goal", "words"),
    [
        (
            "lift",
            "lab",
            "leave 'lift', follow the corridor 'west corridor' past five lamps, turn left into the "
            "door 'lab'",
        ),
        (
            "lift",
            "end",
            "leave 'lift', follow the corridor 'west corridor' past five lamps, turn left at "
            "'corner', follow the corridor 'north corridor' past one lamp (one more out of order), "
            "go on to 'end'",
        ),
        (
            "end",
            "lab",
            "leave 'end', follow the corridor 'north corridor' past one lamp (one more out of "
            "order), turn right at 'corner', follow the corridor 'west corridor', turn right into "
            "the door 'lab'",
        ),
        ("lab", "lab", "you are there: lab"),
    ],
)
def test_a_way_is_told_in_words(building: Building, start: str, goal: str, words: str) -> None:
    assert str(plan_route(building, start, goal)) == words


def test_the_shortest_way_is_taken_and_its_length_known(building: Building) -> None:
    assert plan_route(building, "lift", "end").length_m == pytest.approx(25.0, abs=0.01)
    near = plan_route(building, "west corridor", "lift", at=np.array([3.0, 0.2]))
    assert near.length_m == pytest.approx(3.0, abs=0.01)
    assert near.legs[0].lamps == (0,)
    around = replace(building, ways=(*building.ways, ("lift", "end")))
    assert [leg.place for leg in plan_route(around, "lift", "end").legs] == ["lift", "end"]


def test_no_way_and_unknown_places_are_told(building: Building) -> None:
    with pytest.raises(BadConfig, match="did you mean 'lift'"):
        plan_route(building, "lit", "lab")
    island = replace(building, ways=building.ways[:2])
    with pytest.raises(BadConfig, match="no way leads from 'lift' to 'end'"):
        plan_route(island, "lift", "end")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('["corner", "north corridor"]', '["corner", "north"]', "there is no place 'north'"),
        ("id = 6", "id = 5", "lamp 5 is there twice"),
        ('name = "end"', 'name = "lift"', "the place 'lift' is there twice"),
        ("at = [0.0, 0.0]", "course = [[0.0, 0.0], [1.0, 0.0]]", "a corridor has a course"),
        ("dark = true", "darkk = true", "darkk"),
        ("width = 1.4", "width = -1.0", "must be positive"),
        ('kind = "door"', 'kind = "window"', "is not known"),
    ],
)
def test_a_wrong_map_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = tmp_path / "building.toml"
    path.write_text(MAP.replace(old, new), encoding="utf-8")
    with pytest.raises(BadConfig, match=message) as refused:
        read_building(path)
    assert str(path) in str(refused.value)


def test_points_are_in_places_by_name(building: Building) -> None:
    points = np.array([[0.1, 0.0], [5.0, 0.9], [13.0, 1.2], [16.2, 0.3], [16.0, 5.0], [5.0, 4.0]])
    names = place_at(building, points).tolist()
    assert names == ["lift", "west corridor", "lab", "corner", "north corridor", NOWHERE]


def test_where_the_robot_was_and_which_lamp_is_dark(building: Building) -> None:
    log = simulate_log(load_scenario("four-lamps"), seed=3)
    measurements = on_building(
        simulate_measurements(load_scenario("four-lamps"), 3), building, "known"
    )
    estimate = run_ekf(measurements)
    assert [visit.place for visit in visits(building, estimate)] == ["lift", "west corridor", "lab"]
    records = {r.id: r for r in lamp_records(building, measurements, estimate, log.cameras["up"])}
    assert records[2].out_of_order
    assert not any(records[number].out_of_order for number in (0, 1, 3, 4))
    assert records[0].seen > 20
    mapped = replace(measurements, known=None)
    assert lamp_records(building, mapped, run_ekf(mapped), log.cameras["up"]) == ()


def test_lamps_of_log_and_map_are_told_by_place_not_by_number(building: Building) -> None:
    log = simulate_log(load_scenario("four-lamps"), seed=3)
    measurements = simulate_measurements(load_scenario("four-lamps"), 3)
    assert measurements.known is not None
    renumbered = replace(measurements.known, id=measurements.known.id + 40)
    own = replace(measurements, known=renumbered)
    records = {r.id: r for r in lamp_records(building, own, run_ekf(own), log.cameras["up"])}
    assert [records[number].seen > 20 for number in range(5)] == [True, True, False, True, True]
    assert records[2].out_of_order


def test_a_lamp_is_not_expected_where_the_pose_is_unsure() -> None:
    sight = Sight(np.array([-0.5, -0.4]), np.array([0.5, 0.4]), 0.1)
    lamp, pose = np.array([[0.3, 0.0, 0.0]]), np.zeros((1, 3))
    assert sight.expects(pose, lamp).all()
    assert not sight.expects(pose, lamp, np.array([[0.3, 0.1]])).any()


def test_the_start_is_found_where_lamps_tell_it_and_open_where_they_do_not(
    building: Building,
) -> None:
    measurements = simulate_measurements(load_scenario("four-lamps"), seed=1)
    both_ways = find_start(building, measurements)  # the corridor looks alike from either end
    assert not both_ways.decided
    assert set(both_ways.places) == {"lift", "west corridor"}
    moved = (replace(tag, x=tag.x + 0.7) if tag.id == 3 else tag for tag in building.lamps()[:5])
    corridor = Place("hall", "corridor", ((0.0, 0.0), (16.0, 0.0)), lamps=tuple(moved))
    scenario = load_scenario("four-lamps")
    assert scenario.ceiling is not None
    lamps = tuple(
        replace(lamp, x=lamp.x + 0.7) if number == 3 else lamp
        for number, lamp in enumerate(scenario.ceiling.lamps)
    )
    seen = simulate_measurements(
        replace(scenario, ceiling=replace(scenario.ceiling, lamps=lamps)), seed=1
    )
    door = Place("lab", "door", at=(13.0, 1.0), width=2.0)
    answer = find_start(Building("graphslam-places/1", "hall", (corridor, door), ()), seen)
    assert answer.decided
    assert answer.starts[0].place == "hall"
    true = simulate_log(
        replace(scenario, ceiling=replace(scenario.ceiling, lamps=lamps)), 1
    ).start_pose
    assert answer.starts[0].pose == pytest.approx(true, abs=0.1)
    assert answer.starts[0].lamps == (0, 1, 3, 4)


def test_the_command_prints_places_ways_and_starts(
    map_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["places", str(map_file)]) == 0
    assert "west corridor" in capsys.readouterr().out
    assert main(["places", str(map_file), "--start", "lift", "--goal", "lab"]) == 0
    assert "turn left into the door 'lab'  (14.5 m)" in capsys.readouterr().out
    assert main(["places", str(map_file), "--start", "lift"]) == 1
    assert "--start and --goal come together" in capsys.readouterr().err
    log = simulate(load_scenario("four-lamps"), tmp_path / "log", seed=1, images=False)
    assert main(["places", str(map_file), "--locate", str(log)]) == 1
    assert "2 starts are possible" in capsys.readouterr().out


def test_a_run_tells_where_the_robot_was(
    map_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario = load_scenario("four-lamps")
    assert scenario.ceiling is not None
    unlisted = replace(scenario, ceiling=replace(scenario.ceiling, known=False))
    log = simulate(unlisted, tmp_path / "log", seed=1, images=False)
    out = tmp_path / "out"
    arguments = ["run", str(log), "--out", str(out), "--methods", "odometry", "ekf"]
    assert main([*arguments, "--places", str(map_file)]) == 0
    assert "At the end the robot is in 'lab'." in capsys.readouterr().out
    info = json.loads((out / "run.json").read_text(encoding="utf-8"))
    assert [visit["place"] for visit in info["places"]["visits"]][-1] == "lab"
    assert info["places"]["route"][-1] == "turn left into the door 'lab'"
    report = (out / "report.html").read_text(encoding="utf-8")
    assert "Where was the robot, by name?" in report
