"""How steadily lamps are found in a real recording of a ceiling, and a contact sheet of them.

python benchmarks/lamp_frames.py FRAMES.raw.gz [--sheet PICTURE]

The recording is ../shared/data/lamps/data.raw.gz: 200 grey frames, 640 x 480, of an upward fisheye
on a fast car whose parameters are not known, so that all is in pixels: the plane of the lamps is
the image. A lamp's track is held against three models of how it moves, each told nothing of the
frame that it predicts but, in the second and third, where the *other* lamps are.
"""

from __future__ import annotations

import argparse
import gzip
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from frontend.camera import Camera
from frontend.lamp_config import LampConfig
from frontend.lamp_pictures import draw_lamps
from frontend.lamps import DetectedLamps, detect_lamps
from frontend.overlay import caption, write_picture
from graphslam.geometry import Array

SIZE = (640, 480)
CAMERA = Camera("up", "ceiling", SIZE, np.eye(3))
"""One pixel of the image counts as one metre of the plane."""
CONFIG = LampConfig(area_m2=(250.0, 3000.0), least_fill=0.5, coarsest_pixel_m=5.0)
"""Near the middle of the image a lamp covers 700 to 1,700 pixels; a fisheye bends it."""
REACH_PX = 25.0
"""A lamp farther than this from where its track should go on begins a track of its own."""
STEADY_PX = 3.0
MODELS = {
    "constant velocity": "as from the last frame to this one",
    "one change of speed": "the same, faster or slower by a factor that the other lamps tell",
    "one change of motion": "the same, and a shift, turn and scale that the other lamps tell",
}
LEAST_OTHERS = 3
SHEET, COLUMNS = 20, 4

Track = list[tuple[int, Array]]


def read_frames(path: Path) -> NDArray[np.uint8]:
    """Returns the frames (F, 480, 640) of a recording."""
    data = np.frombuffer(gzip.decompress(path.read_bytes()), np.uint8)
    return data.reshape(-1, SIZE[1], SIZE[0])


def tracks_of(found: list[DetectedLamps]) -> list[Track]:
    """Returns the lamps followed from frame to frame, the nearest pair of track and lamp first."""
    tracks: list[Track] = []
    live: list[Track] = []
    for number, lamps in enumerate(found):
        pairs = []
        for i, track in enumerate(live):
            here = track[-1][1]
            there = 2.0 * here - track[-2][1] if len(track) > 1 else here
            away = np.hypot(*(lamps.z[:, :2] - there).T)
            pairs += [(float(d), i, j) for j, d in enumerate(away) if d < REACH_PX]
        grown: dict[int, int] = {}
        for _, i, j in sorted(pairs):
            if i not in grown and j not in grown.values():
                grown[i] = j
                live[i].append((number, lamps.z[j, :2]))
        fresh = [[(number, z[:2])] for j, z in enumerate(lamps.z) if j not in grown.values()]
        live = [live[i] for i in sorted(grown)] + fresh
        tracks += fresh
    return tracks


def jumps(tracks: list[Track]) -> dict[str, Array]:
    """Returns how far (J,) tracked lamps were from where each of `MODELS` had them, pixels."""
    triples: dict[int, list[list[complex]]] = defaultdict(list)
    for track in tracks:
        for i in range(2, len(track)):
            triples[track[i][0]].append([complex(*place) for _, place in track[i - 2 : i + 1]])
    away: dict[str, list[float]] = {name: [] for name in MODELS}
    for rows in triples.values():
        before, last, now = np.array(rows).T
        if len(rows) <= LEAST_OTHERS:
            continue
        change = now - 2.0 * last + before
        for i in range(len(rows)):
            others = np.arange(len(rows)) != i
            step = (last - before)[others]
            factor = np.vdot(step, change[others]).real / max(np.vdot(step, step).real, 1e-9)
            A = np.column_stack([last[others], np.ones(len(rows) - 1)])
            turn, shift = np.linalg.lstsq(A, change[others], rcond=None)[0]
            told = (0.0, factor * (last - before)[i], turn * last[i] + shift)
            for name, expected in zip(MODELS, told, strict=True):
                away[name].append(abs(change[i] - expected))
    return {name: np.array(values) for name, values in away.items()}


def contact_sheet(frames: NDArray[np.uint8], found: list[DetectedLamps]) -> NDArray[np.uint8]:
    """Returns a picture of `SHEET` frames with centre and axis of their lamps."""
    tiles = []
    for number in np.linspace(0, len(frames) - 1, SHEET).round().astype(int).tolist():
        tile: Any = cv2.cvtColor(frames[number] // 2, cv2.COLOR_GRAY2BGR)
        draw_lamps(tile, CAMERA, found[number].z, found[number].size, 1.0)
        tiles.append(caption(tile, f"frame {number}   lamps: {len(found[number])}"))
    rows = [np.hstack(tiles[i : i + COLUMNS]) for i in range(0, SHEET, COLUMNS)]
    return np.asarray(np.vstack(rows), np.uint8)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("frames", type=Path)
    parser.add_argument("--sheet", type=Path, help="picture to write, .png")
    options = parser.parse_args()
    frames = read_frames(options.frames)
    found = [detect_lamps(frame, CAMERA, CONFIG) for frame in frames]
    rejected = sum((Counter(lamps.rejected) for lamps in found), Counter())
    tracks = tracks_of(found)
    print(
        f"{len(frames)} frames, {sum(map(len, found))} lamps, {min(map(len, found))} to "
        f"{max(map(len, found))} in a frame; {len(tracks)} tracks"
    )
    for reason, count in rejected.most_common():
        print(f"  left out: {count} x {reason}")
    print("| a lamp goes on | cases | median, px | 95 %, px | below 3 px |")
    print("|---|---:|---:|---:|---:|")
    for name, away in jumps(tracks).items():
        median, most = np.percentile(away, [50, 95])
        share = 100.0 * np.mean(away < STEADY_PX)
        print(f"| {MODELS[name]} | {len(away)} | {median:.2f} | {most:.2f} | {share:.1f} % |")
    if options.sheet is not None:
        options.sheet.parent.mkdir(parents=True, exist_ok=True)
        write_picture(options.sheet, contact_sheet(frames, found))


if __name__ == "__main__":
    main()
