"""How much memory a large bag takes: an MCAP file of 2 GB and one of a tenth of it, side by side.

    python benchmarks/bag_streaming.py [--gigabytes 2.1] [--folder DIR]

Both are made of repeated frames (640x480, grey, not compressed) with wheels at 50 Hz, in a
temporary folder that is removed afterwards. Each is opened, and every 20th frame searched for
lines, in a process of its own, whose peak memory the system tells. Progress must grow with the
bytes and end at the file's size. One more process opens nothing: what the program itself takes.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from frontend.camera import Camera
from frontend.images import decoded
from frontend.log import Log
from frontend.log_parts import ImageList, Wheels
from frontend.write_bag import robot_file_text, write_bag
from graphslam.models.wheels import DifferentialDrive

SIZE = (640, 480)
FRAME_BYTES = SIZE[0] * SIZE[1]
RATE_HZ, WHEEL_HZ, SPEED = 10.0, 50.0, 6.0

CHILD = """
import json, resource, sys, time
from frontend.config import ExtractConfig
from frontend.extract import extract
from frontend.log import open_log
told, out = [], {}
if len(sys.argv) > 1:
    began = time.perf_counter()
    log = open_log(sys.argv[1], sys.argv[2], lambda done, total: told.append((done, total)))
    out["open_s"] = time.perf_counter() - began
    out["opened_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    found = extract(log, ExtractConfig(every=20, cache=False))
    out["images"], out["searched"] = len(log.images.t), len(found.t)
    out["told"] = len(told)
    done = [d for d, _ in told]
    out["right"] = done == sorted(done) and told[-1][0] == told[-1][1] == int(sys.argv[3])
    middle = told[len(told) // 2][0] / told[-1][1]
    out["middle"] = middle
out["peak_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
print(json.dumps(out))
"""


class Frame:
    """One of a few frames, repeated."""

    def __init__(self, grey: np.ndarray) -> None:
        self._grey = grey
        self.name, self.digest = "frame", "0" * 64

    def grey(self) -> np.ndarray:
        """Returns the grey levels."""
        return self._grey

    def bgr(self) -> np.ndarray:
        """Returns the grey levels three times."""
        return np.repeat(self._grey[..., None], 3, axis=2)

    def packed(self) -> None:
        """Returns None: it is not a file."""
        return


def frames() -> list[Frame]:
    """Returns the first frames of the bundled sample, at the size of the bag's."""
    import cv2

    folder = Path(__file__).resolve().parents[1] / "data" / "sample" / "images"
    found = []
    for path in sorted(folder.iterdir())[:8]:
        grey = decoded(path.read_bytes())
        assert grey is not None
        found.append(Frame(np.asarray(cv2.resize(grey, SIZE), np.uint8)))
    return found


def repeated(count: int) -> Log:
    """Returns a log of so many frames, without truth."""
    t = np.arange(count) / RATE_HZ
    wheel_t = np.arange(0.0, t[-1] + 1.0, 1.0 / WHEEL_HZ)
    few = frames()
    homography = np.array([[808.1, -1972.1, 319.5], [-725.7, 0.0, 867.3], [2.533, 0.0, 1.0]])
    return Log(
        name="repeated",
        folder=Path(),
        robot=DifferentialDrive(0.042, 0.042, 0.2),
        cameras={"floor": Camera("floor", "floor", SIZE, homography)},
        start_pose=np.zeros(3),
        start_sigma=np.zeros(3),
        start_given=True,
        wheels=Wheels(wheel_t, np.column_stack([SPEED * wheel_t] * 2)),
        odometry=None,
        images=ImageList(t, tuple(few[k % len(few)] for k in range(count)), ("floor",) * count),
        sightings=None,
        pose_fixes=None,
        truth=None,
        map=None,
        warnings=(),
        digest="",
    )


def measured(*arguments: str) -> dict[str, float]:
    """Returns what a process of its own measured."""
    command = [sys.executable, "-c", CHILD, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return dict(json.loads(done.stdout))


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--gigabytes", type=float, default=2.1)
    parser.add_argument("--folder", type=Path, default=None)
    given = parser.parse_args()
    print(f"process that opens nothing: {measured()['peak_mb']:.0f} MB")
    print(
        "| file (MB) | images | opened (s) | peak, opened (MB) | peak, searched (MB) | progress |"
    )
    print("|---:|---:|---:|---:|---:|---|")
    with tempfile.TemporaryDirectory(dir=given.folder) as name:
        for share in (0.1, 1.0):
            path, robot = Path(name) / "big.mcap", Path(name) / "robot.toml"
            path.unlink(missing_ok=True)
            log = repeated(math.ceil(share * given.gigabytes * 1e9 / FRAME_BYTES))
            write_bag(log, path, "mcap", raw=True)
            robot.write_text(robot_file_text(log), encoding="utf-8")
            size = path.stat().st_size
            found = measured(str(path), str(robot), str(size))
            right = "right" if found["right"] else "WRONG"
            print(
                f"| {size / 1e6:,.0f} | {found['images']:,} | {found['open_s']:.1f} | "
                f"{found['opened_mb']:.0f} | {found['peak_mb']:.0f} | {right}, "
                f"told {found['told']:,} times, at {found['middle']:.0%} half-way |"
            )


if __name__ == "__main__":
    main()
