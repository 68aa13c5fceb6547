"""How fast the front-end is, as ratios to the bare OpenCV calls that it is made of.

python -m benchmarks.front_end_speed [--log DIR] [--frames 200] [--rounds 9]

Each round times, one after the other on the same frames: bare decoding, the bare detector call,
ours on decoded frames, and decoding and detecting together. Ratios are medians over rounds of
processor time, so that other work on the machine counts little. Two threads are timed by the wall.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np

from benchmarks.detectors import CONDITIONS, SIZES, frames
from frontend.config import DetectorConfig, ExtractConfig
from frontend.image_lines import lines_in_images
from frontend.images import read_grey
from frontend.lines import detect_lines
from frontend.log import Log, open_log
from frontend.segments import grey_noise, lsd_quant
from frontend.simulate.view import camera_of

METHODS = ("lsd", "hough-p")


def bare(method: str, grey: np.ndarray, config: DetectorConfig, quant: float) -> None:
    """Calls OpenCV alone; lsd with the very arguments that ours gives it in such images."""
    if max(grey.shape) > 500:
        size = (grey.shape[1] // 2, grey.shape[0] // 2)
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    if method == "lsd":
        cv2.createLineSegmentDetector(cv2.LSD_REFINE_NONE, quant=quant).detect(grey)
        return
    smooth = cv2.GaussianBlur(grey, (0, 0), config.smoothing_px)
    edges = cv2.Canny(smooth, 10.0, 20.0, L2gradient=True)
    step, least = np.radians(config.hough_angle_deg) / 2.0, config.min_support
    cv2.HoughLinesP(edges, 1.0, step, least, minLineLength=least, maxLineGap=config.max_gap_px)


def made_log(folder: Path, count: int) -> Log:
    """Returns a log of rendered images of moderate quality, 640x480, JPEG 85."""
    rows = ["t,file"]
    camera = camera_of(CONDITIONS["moderate"].scenario(SIZES["640x480"]).camera)
    pictures = frames(CONDITIONS["moderate"], SIZES["640x480"], count)
    for number, (image, _, _) in enumerate(pictures):
        cv2.imwrite(str(folder / f"{number}.jpg"), image, [cv2.IMWRITE_JPEG_QUALITY, 85])
        rows.append(f"{0.1 * number:.1f},{number}.jpg")
    (folder / "images.csv").write_text("\n".join(rows) + "\n")
    (folder / "wheels.csv").write_text(f"t,left,right\n0,0,0\n{0.1 * count},1,1\n")
    (folder / "log.toml").write_text(
        'format = "graphslam-log/1"\n[robot]\nwheel_radius_left = 0.042\n'
        "wheel_radius_right = 0.042\nwheel_base = 0.2\n[camera]\nimage_size = [640, 480]\n"
        f"homography = {camera.homography.tolist()}\n"
    )
    return open_log(folder)


def seconds(work: Callable[[], object], clock: Callable[[], float]) -> float:
    began = clock()
    work()
    return clock() - began


def ratios(log: Log, method: str, rounds: int) -> list[str]:
    """Returns the cells of one row of the table."""
    assert log.images is not None
    config = DetectorConfig(method=method)
    files = log.images.file
    cameras = [log.cameras[name] for name in log.images.camera]
    greys = [read_grey(file) for file in files]
    assert all(grey is not None for grey in greys)
    size = (greys[0].shape[1] // 2, greys[0].shape[0] // 2)
    searched = cv2.resize(greys[0], size, interpolation=cv2.INTER_AREA)
    quant = lsd_quant(grey_noise(searched if max(greys[0].shape) > 500 else greys[0]), config)
    detect_lines(greys[0], cameras[0], config)
    work: dict[str, Callable[[], object]] = {
        "decode": lambda: [cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) for file in files],
        "bare": lambda: [bare(method, grey, config, quant) for grey in greys],
        "ours": lambda: [detect_lines(g, c, config) for g, c in zip(greys, cameras, strict=True)],
        "both": lambda: [
            detect_lines(read_grey(f), c, config) for f, c in zip(files, cameras, strict=True)
        ],
    }
    times = {name: np.zeros(rounds) for name in work}
    for k in range(rounds):
        for name, call in work.items():
            times[name][k] = seconds(call, time.process_time)
    ms = {name: 1e3 * np.median(t) / len(files) for name, t in times.items()}
    rate = np.median(times["bare"] / times["ours"])
    cost = np.median(times["both"] / (times["decode"] + times["bare"]))
    return [f"{ms[name]:.2f}" for name in work] + [f"{rate:.2f}", f"{cost:.2f}"]


def speed_up(log: Log, method: str, rounds: int) -> tuple[float, float]:
    """Returns how many times as fast two threads are: ours, and two threads of pure arithmetic.

    The second is what the machine has to give at that moment.
    """
    numbers = np.arange(len(log.images.file))
    detector = DetectorConfig(method=method)

    def search(workers: int) -> float:
        config = ExtractConfig(detector=detector, workers=workers, cache=False)
        return seconds(lambda: lines_in_images(log, numbers, config), time.perf_counter)

    def spin(workers: int) -> float:
        block = np.random.default_rng(0).random(4_000_000)
        with ThreadPoolExecutor(workers) as pool:
            return seconds(lambda: list(pool.map(np.sort, [block] * 4)), time.perf_counter)

    ours, machine = [], []
    for _ in range(rounds):
        ours.append(search(1) / search(2))
        machine.append(spin(1) / spin(2))
    return float(np.median(ours)), float(np.median(machine))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--log", type=Path, help="a log with images; absent: rendered, 640x480")
    parser.add_argument("--frames", type=int, default=150, help="frames of the rendered log")
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as folder:
        log = open_log(options.log) if options.log else made_log(Path(folder), options.frames)
        print("| detector | decode ms | bare ms | ours ms | decode + ours ms | rate / bare rate "
              "| decode + ours / both bare | two threads | two threads of sorting |")  # fmt: skip
        print("|---" * 9 + "|")
        for method in METHODS:
            cells = ratios(log, method, options.rounds)
            cells += [f"{ratio:.2f}" for ratio in speed_up(log, method, options.rounds)]
            print(f"| {method} | " + " | ".join(cells) + " |", flush=True)
        print(f"largest memory: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")


if __name__ == "__main__":
    main()
