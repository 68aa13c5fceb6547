"""Whether the start of a drive is found from the lamps seen alone, or left open where it must be.

python benchmarks/lamp_starts.py [--starts 100]

A floor of five corridors around two blocks, most lamps evenly spaced, three lamps in a hundred out
of order, which the map does not know. Each drive starts somewhere in a corridor, goes 6 to 20 m,
and turns where a corridor ends. *The map allows it* where no other motion lays the lamps that were
truly seen on lamps of the map (within 0.3 m and 10°) with the path inside the corridors.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from dataclasses import dataclass

import numpy as np

from compare.places.building import FORMAT, Building, Place, Tag
from compare.places.start import Answer, find_start
from frontend.extract import extract
from frontend.simulate import Scenario, load_scenario, simulate_log
from frontend.simulate.ceiling import Lamp
from frontend.simulate.scenario import Motion, Start
from graphslam.geometry import Array, compose, inverse, wrap

RIGHT_M, RIGHT_RAD = 0.3, math.radians(10.0)
SAME_M, SAME_RAD = 0.3, math.radians(10.0)
DARK_SHARE = 0.03
SPEED = 0.5
LEAST_SEEN = 3
"""Frames that must see a lamp for it to count as seen."""


def building() -> Building:
    """Returns the floor: lamps every 3 m along the long corridors, and uneven ones across."""
    even = np.arange(1.5, 30.0, 3.0)
    corridors = {
        "south corridor": ((0.0, 0.0), (30.0, 0.0), even),
        "north corridor": ((0.0, 18.0), (30.0, 18.0), even),
        "west corridor": ((0.0, 0.0), (0.0, 18.0), np.array([2.0, 4.6, 8.1, 10.4, 14.0, 16.2])),
        "middle corridor": ((15.0, 0.0), (15.0, 18.0), np.array([1.8, 5.2, 7.5, 11.0, 13.3, 16.4])),
        "east corridor": ((30.0, 0.0), (30.0, 18.0), np.arange(1.8, 18.0, 2.4)),
    }
    places, number = [], 0
    for name, (start, end, along) in corridors.items():
        step = np.array(end) - start
        step = step / np.hypot(*step)
        across = 90.0 if name == "middle corridor" else 0.0
        phi = math.degrees(math.atan2(step[1], step[0])) + across
        at = np.array(start) + along[:, None] * step
        lamps = tuple(Tag(number + i, *map(float, p), phi_deg=phi) for i, p in enumerate(at))
        number += len(lamps)
        places.append(Place(name, "corridor", (start, end), lamps=lamps))
    sides = {"south corridor", "north corridor"}
    ways = tuple((a, b) for a in sorted(sides) for b in corridors if b not in sides)
    return Building(FORMAT, "five corridors", tuple(places), ways)


def drive(floor: Building, rng: np.random.Generator) -> Scenario:
    """Returns a drive from a random start: to the end of the corridor, into the next, and so on."""
    base = load_scenario("four-lamps")
    assert base.ceiling is not None
    corridor = floor.places[rng.integers(len(floor.places))]
    ends = corridor.middle_line()[:: rng.choice([-1, 1])]
    here = ends[0] + rng.uniform(0.1, 0.8) * (ends[1] - ends[0])
    left, path = rng.uniform(6.0, 20.0), []
    heading = math.atan2(*(ends[1] - ends[0])[::-1])
    start = Start(*here.tolist(), math.degrees(heading))
    while left > 0.0:
        ahead = float(np.hypot(*(ends[1] - here)))
        path.append(Motion(forward=min(ahead, left)))
        left -= ahead
        if left <= 0.0:
            break
        here = ends[1]
        others = [p for p in floor.places if p is not corridor and p.distance(here) < 0.1]
        corridor = others[rng.integers(len(others))]
        line = corridor.middle_line()
        ends = np.array([here, max(line, key=lambda p: np.hypot(*(p - here)))])
        turned = math.atan2(*(ends[1] - here)[::-1])
        path.append(Motion(turn_deg=math.degrees(wrap(turned - heading))))
        heading = turned
    dark = rng.random(len(floor.lamps())) < DARK_SHARE
    lamps = tuple(
        Lamp(tag.x, tag.y, tag.phi_deg, bool(out))
        for tag, out in zip(floor.lamps(), dark, strict=True)
    )
    return Scenario(
        base.format,
        "start",
        base.robot,
        tuple(path),
        start=start,
        speed=SPEED,
        ceiling=type(base.ceiling)(lamps, base.ceiling.camera, known=False),
    )


@dataclass(frozen=True)
class Case:
    """One start.

    Attributes:
        answer: what was found.
        true: (3,) the true start.
        right: decided and right, or undecided with the true start among those left.
        allowed: whether the map allows to decide.
        seen: lamps truly seen.
    """

    answer: Answer
    true: Array
    right: bool
    allowed: bool
    seen: int


def run_case(floor: Building, seed: int) -> Case | None:
    """Returns one start; None where no lamp was seen."""
    log = simulate_log(drive(floor, np.random.default_rng(seed)), seed)
    assert log.lamps is not None
    assert log.truth is not None
    counts = Counter(log.lamps.truth.tolist())
    seen = sorted(lamp for lamp, count in counts.items() if count >= LEAST_SEEN)
    if not seen:
        return None
    answer = find_start(floor, extract(log), log.cameras["up"])
    near = [_near(start.pose, log.start_pose) for start in answer.starts]
    right = near[0] if answer.decided else any(near)
    path = log.truth.pose[log.truth.t >= log.lamps.t[0]][::20]
    return Case(answer, log.start_pose, right, _allowed(floor, seen, path), len(seen))


def _near(pose: Array, true: Array) -> bool:
    d = pose - true
    return bool(np.hypot(*d[:2]) < RIGHT_M and abs(wrap(d[2])) < RIGHT_RAD)


def _allowed(floor: Building, seen: list[int], path: Array) -> bool:
    """Returns whether only the true motion lays the lamps seen on the map, the path inside."""
    lamps = floor.landmarks().params
    own = lamps[seen]
    for lamp in lamps:
        for turn in (0.0, math.pi):
            g = compose(np.array([*lamp[:2], lamp[2] + turn]), inverse(own[0]))
            if np.hypot(*g[:2]) < SAME_M and abs(wrap(g[2])) < SAME_RAD:
                continue
            away = compose(g, own)[:, None] - lamps
            on = np.hypot(away[..., 0], away[..., 1]) < SAME_M
            on &= np.abs(0.5 * wrap(2.0 * away[..., 2])) < SAME_RAD
            moved = compose(g, path)[:, :2]
            inside = np.max([place.holds(moved) for place in floor.places], axis=0) > -0.4
            if on.any(axis=1).all() and inside.mean() > 0.95:
                return False
    return True


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--starts", type=int, default=100)
    options = parser.parse_args()
    floor, cases, seed = building(), [], 0
    while len(cases) < options.starts:
        case = run_case(floor, seed)
        if case is not None:
            cases.append(case)
            if not case.right:
                print(f"seed {seed}: wrong: {case.answer}; true {case.true.round(2).tolist()}")
        seed += 1
    allowed = [case for case in cases if case.allowed]
    decided = [case for case in cases if case.answer.decided]
    print("| | |\n|---|---:|")
    print(f"| starts | {len(cases)} |")
    right = sum(case.right for case in cases)
    print(f"| right, or undecided with the true one among those left | {right} |")
    print(f"| the map allows to decide | {len(allowed)} |")
    print(f"| of these decided | {sum(c.answer.decided for c in allowed)} |")
    print(f"| decided in all | {len(decided)} |")
    left = [len(case.answer.starts) for case in cases if not case.answer.decided]
    print(f"| starts left where undecided, median and most | {np.median(left):.0f}, {max(left)} |")


if __name__ == "__main__":
    main()
