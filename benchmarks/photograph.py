"""Which lines the detectors see in a photograph of a tiled floor, and how square their lattice is.

python benchmarks/photograph.py PHOTOGRAPH [--picture DIR]

The photograph is ../shared/data/photos/tiles.png. Its camera is not known: four crossings of
grooves, read off by eye, give a first homography; the lines found with it are then fitted by one
homography to a square lattice.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from frontend.camera import Camera
from frontend.config import DetectorConfig
from frontend.images import read_grey
from frontend.lines import DetectedLines, detect_lines
from frontend.overlay_frames import frame_picture
from graphslam.geometry import Array, points_on_line

METHODS = ("lsd", "hough-p", "hough")
TILE = 0.6
"""Pitch of the grooves, m."""
CROSSINGS = np.array([[196, 312], [437, 197], [23, 172], [341, 82]], float)
"""Pixels of four crossings, to a pixel or two."""
TILES = np.array([[0, -1], [0, -4], [2, 0], [2, -4]], float)
"""Which crossings those are: x and y, tiles."""
FALSE = 0.1
"""A line that is farther than this from the lattice, in tiles, is no groove."""


@dataclass(frozen=True)
class Lattice:
    """Lines held against a square lattice.

    Attributes:
        found: the lines, under the first homography.
        axis: (K,) 0 of lines of constant x, 1 of constant y.
        number: (K,) which line of the lattice each is, counted in tiles.
        off: (K, 2) how far its ends are off that line after the fit, tiles.
    """

    found: DetectedLines
    axis: NDArray[np.int64]
    number: NDArray[np.int64]
    off: Array

    @property
    def false(self) -> int:
        """Lines that are on no groove, or on one that another line is on already."""
        on = np.abs(self.off).max(axis=1) < FALSE
        grooves = set(zip(self.axis[on].tolist(), self.number[on].tolist(), strict=True))
        return len(self.off) - len(grooves)

    def rms(self, axis: int) -> float:
        """Returns the root mean square residual of the lines of one axis, tiles."""
        return float(np.sqrt(np.mean(self.off[self.axis == axis] ** 2)))


def camera_of(grey: NDArray[np.uint8]) -> Camera:
    """Returns the camera that the four crossings give."""
    homography, _ = cv2.findHomography(TILE * TILES, CROSSINGS)
    return Camera("floor", "floor", (grey.shape[1], grey.shape[0]), homography)


def lattice_of(found: DetectedLines) -> Lattice:
    """Returns lines fitted to a square lattice by one homography of the floor (8 parameters)."""
    ends = points_on_line(found.z[:, None], found.extent) / TILE
    axis = (np.abs(np.sin(found.z[:, 1])) > np.sqrt(0.5)).astype(np.int64)
    rows = np.arange(len(axis))
    number = np.rint(ends.mean(axis=1)[rows, axis]).astype(np.int64)

    def off(parameters: Array) -> Array:
        moved = np.concatenate([ends, np.ones((*ends.shape[:2], 1))], axis=2)
        moved = moved @ (np.eye(3) + np.append(parameters, 0.0).reshape(3, 3)).T
        moved = moved[..., :2] / moved[..., 2:]
        return np.asarray(moved[rows, :, axis] - number[:, None])

    fit = least_squares(lambda p: off(p).ravel(), np.zeros(8), loss="soft_l1", f_scale=0.02)
    return Lattice(found, axis, number, off(fit.x))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("photograph", type=Path)
    parser.add_argument("--picture", type=Path, help="folder for a picture of each detector")
    options = parser.parse_args()
    grey = read_grey(options.photograph)
    assert grey is not None, f"{options.photograph} cannot be read"
    camera = camera_of(grey)
    print("| detector | grooves | false lines | RMS across x, % of a tile | across y | worst end |")
    print("|---|---:|---:|---:|---:|---:|")
    for method in METHODS:
        lattice = lattice_of(detect_lines(grey, camera, DetectorConfig(method=method)))
        cells = [len(lattice.off) - lattice.false, lattice.false]
        worst = 100.0 * np.abs(lattice.off).max()
        rms = [f"{100.0 * lattice.rms(axis):.2f}" for axis in (0, 1)]
        print(f"| {method} | " + " | ".join(map(str, [*cells, *rms, f"{worst:.2f}"])) + " |")
        if options.picture is not None:
            options.picture.mkdir(parents=True, exist_ok=True)
            found = lattice.found
            picture = frame_picture(grey, camera, found.z, found.extent, method)
            cv2.imwrite(str(options.picture / f"{method}.png"), picture)


if __name__ == "__main__":
    main()
