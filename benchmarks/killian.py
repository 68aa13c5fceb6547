"""The line back-end on MIT Killian Court, from the pose graph with scans in the package rtb-data.

    pip install rtb-data
    python benchmarks/killian.py

The log has no odometry of its own: the graph's sequential edges serve as odometry, its loop edges
as relations. The published scores use other relations; they are printed beside.
"""

from __future__ import annotations

import importlib.util
import time
import zipfile
from pathlib import Path

import numpy as np
from closures import judge

from frontend.readers.carmen_messages import laser_of, robotlaser
from frontend.recorded import Scan
from frontend.wall_config import WallConfig
from frontend.walls import detect_walls
from graphslam.baseline import dead_reckoning
from graphslam.config import EkfConfig, SmootherConfig
from graphslam.geometry import Array, between, wrap
from graphslam.long import close_all_loops, run_window
from graphslam.measurements import Measurements, Odometry, Sightings

NAME = "rtbdata/data/killian.g2o.zip"
PUBLISHED = (
    "published, by other relations: scan matching 1.65 m, particle filter 0.122, graph 0.050"
)


def read(path: Path) -> tuple[Measurements, Array]:
    """Returns the measurements, and the relations (K, 5): node, node, dx, dy, dtheta."""
    scans, sequential, loops = [], {}, []
    with zipfile.ZipFile(path) as archive:
        text = archive.read("killian.g2o").decode()
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split()
        if words and words[0] == "ROBOTLASER1":
            scans.append(robotlaser(number, words))
        elif words and words[0] == "EDGE_SE2":
            first, second = int(words[1]), int(words[2])
            values = [float(word) for word in words[3:12]]
            if second == first + 1:
                sequential[first] = values
            else:
                loops.append([first, second, *values[:3]])
    edges = np.array([sequential[n] for n in range(len(scans) - 1)])
    cov = np.zeros((len(edges), 3, 3))
    for k, column in enumerate((3, 6, 8)):
        cov[:, k, k] = 1.0 / edges[:, column]
    columns: tuple[list, ...] = ([], [], [], [], [])
    for node, message in enumerate(scans):
        pose, about = laser_of(message, {})
        walls = detect_walls(Scan(message.ranges.astype(float), **about), pose, WallConfig())
        for column, part in zip(
            columns, (walls.z, walls.cov, walls.extent, walls.quality), strict=False
        ):
            column.append(part)
        columns[4].append(np.full(len(walls), node))
    z, sighted, extent, quality, node = (np.concatenate(column) for column in columns)
    none = np.full(len(z), -1)
    lines = Sightings("line", node, z, sighted, extent, node.astype(float), quality, node, none)
    start = 1e-12 * np.eye(3)
    t = np.arange(len(scans), dtype=float)
    given = Measurements(t, np.zeros(3), start, Odometry(edges[:, :3], cov), {"line": lines})
    return given, np.array(loops)


def show(name: str, pose: Array, relations: Array, seconds: float) -> None:
    """Prints a line of the table."""
    node = relations[:, :2].astype(int)
    e = between(relations[:, 2:], between(pose[node[:, 0]], pose[node[:, 1]]))
    shift, turn = np.hypot(e[:, 0], e[:, 1]), np.degrees(np.abs(wrap(e[:, 2])))
    print(
        f"{name:22s} | {shift.mean():7.3f} ± {shift.std():7.3f} m"
        f" | {turn.mean():6.2f} ± {turn.std():6.2f} degrees | {seconds:6.1f} s of CPU",
        flush=True,
    )


def main() -> None:
    """Prints the table."""
    found = importlib.util.find_spec("rtbdata")
    if found is None or not found.submodule_search_locations:
        print("skipped: the package rtb-data is not installed: pip install rtb-data")
        return
    measurements, relations = read(Path(found.submodule_search_locations[0]).parent / NAME)
    show("sequential edges", dead_reckoning(measurements).pose, relations, 0.0)
    began = time.process_time()
    window = run_window(measurements, EkfConfig())
    show("filter over a window", window.pose, relations, time.process_time() - began)
    whole = close_all_loops(measurements, window, SmootherConfig())
    show("whole chain", whole.pose, relations, time.process_time() - began)
    print(judge(measurements, whole, relations))
    print(PUBLISHED)
    print(dict(whole.counts))


if __name__ == "__main__":
    main()
