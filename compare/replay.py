"""What a run keeps of its images: thumbnails at some nodes, and what was seen in them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from compare.arrays import freeze_arrays
from frontend.log import Log
from frontend.strokes import KINDS, shown, strokes
from graphslam.arrays import load_arrays, save_arrays
from graphslam.errors import BadMeasurements
from graphslam.estimate import Estimate
from graphslam.geometry import Array
from graphslam.measurements import IntArray, Measurements

THUMBNAIL_WIDTH = 200
"""Pixels."""
MOST_FRAMES = 280
"""Frames kept of a run, spread evenly, beside those of the worst residuals."""
WORST = 8
"""Sightings of each method that count as the worst."""


@dataclass(frozen=True, slots=True)
class Frames:
    """Thumbnails of some of the run's images, and strokes for what was seen in them.

    Those of the floor are without the distortion of the lens.

    Attributes:
        node: (F,) node of each, not decreasing.
        name: (F,) its file, from the log's folder.
        size: (F, 2) width and height, pixels.
        jpeg: (F,) the image.
        frame: (S,) which of them shows each sighting.
        sighting: (S,) its row over all tables of sightings.
        ends: (S, 2, 2) where its stroke begins and ends, pixels from the image's upper left corner.
    """

    node: IntArray
    name: tuple[str, ...]
    size: IntArray
    jpeg: tuple[bytes, ...]
    frame: IntArray
    sighting: IntArray
    ends: Array

    def __post_init__(self) -> None:
        freeze_arrays(self)

    def save(self, path: Path) -> None:
        """Writes an .npz without pickle; equal frames give equal bytes."""
        texts = {"name": [n.encode() for n in self.name], "jpeg": self.jpeg}
        arrays = {k: getattr(self, k) for k in ("node", "size", "frame", "sighting", "ends")}
        for key, parts in texts.items():
            arrays[key] = np.frombuffer(b"".join(parts), np.uint8)
            arrays[f"{key}_end"] = np.cumsum([len(part) for part in parts], dtype=np.int64)
        save_arrays(path, arrays)

    @staticmethod
    def load(path: Path) -> Frames:
        """Returns frames that `save` wrote.

        Raises:
            BadMeasurements: the file is not one of those.
        """
        arrays = load_arrays(path)
        try:
            parts = {}
            for key in ("name", "jpeg"):
                whole, ends = arrays.pop(key).tobytes(), arrays.pop(f"{key}_end").tolist()
                parts[key] = [
                    whole[a:b] for a, b in zip([0, *ends[:-1]], ends, strict=len(ends) > 0)
                ]
            names = tuple(part.decode() for part in parts["name"])
            return Frames(name=names, jpeg=tuple(parts["jpeg"]), **arrays)
        except (KeyError, TypeError, ValueError) as error:
            raise BadMeasurements(
                f"{path}: is not what a run wrote ({error}); run it again"
            ) from error


def take_frames(
    log: Log, measurements: Measurements, estimates: Mapping[str, Estimate]
) -> Frames | None:
    """Returns thumbnails of a run, spread evenly, and of its worst residuals; None without images.

    Args:
        log: the recording.
        measurements: what was extracted from it.
        estimates: say which residuals are worst, by method.
    """
    from frontend.images import thumbnail

    if log.images is None:
        return None
    numbers = _chosen(log, measurements, estimates)
    floor, pictures = log.looking_at("floor"), {}
    for number in numbers.tolist():
        camera = floor.get(log.images.camera[number])
        picture = thumbnail(log.images.file[number], THUMBNAIL_WIDTH, camera)
        if picture is not None:
            pictures[number] = picture
    if not pictures:
        return None
    chosen = np.array(list(pictures), np.int64)
    node = np.searchsorted(measurements.t, log.images.t[chosen])
    size = np.array([(p.width, p.height) for p in pictures.values()], np.int64)
    jpeg = tuple(picture.jpeg for picture in pictures.values())
    frame, sighting, ends = _strokes_in(log, measurements, chosen, size)
    names = (log.images.name(number, log.folder) for number in pictures)
    return Frames(node, tuple(names), size, jpeg, frame, sighting, ends)


def worst_sightings(measurements: Measurements, estimate: Estimate) -> IntArray:
    """Returns the rows over all tables of the `WORST` sightings with the largest NIS, worst first.

    Tables of several dimensions compare by NIS per degree of freedom.
    """
    nis = estimate.nis.copy()
    for first, table in measurements.tables():
        nis[first : first + len(table)] /= table.z.shape[1]
    known = np.flatnonzero(np.isfinite(nis))
    order = np.argsort(-nis[known], kind="stable")
    return np.asarray(known[order[:WORST]])


def sighting_nodes(measurements: Measurements) -> IntArray:
    """Returns the node (K,) of each sighting, over all tables in order."""
    return np.concatenate([np.zeros(0, np.int64), *(t.node for _, t in measurements.tables())])


def _chosen(log: Log, measurements: Measurements, estimates: Mapping[str, Estimate]) -> IntArray:
    """Returns image numbers in the order of time, at most one a node of those spread evenly."""
    assert log.images is not None
    numbers = np.unique(np.concatenate([log.images_of(where) for where in KINDS]))
    numbers = numbers[np.isin(log.images.t[numbers], measurements.t)]
    source = np.concatenate([np.zeros(0, np.int64), *(t.source for _, t in measurements.tables())])
    count = np.bincount(source[source >= 0], minlength=len(log.images.t))[numbers]
    node = np.searchsorted(measurements.t, log.images.t[numbers])
    order = np.lexsort((-count, node))  # of one node's images the one that shows most
    best = numbers[order[np.unique(node[order], return_index=True)[1]]]
    even = best[np.unique(np.linspace(0, len(best) - 1, min(len(best), MOST_FRAMES)).astype(int))]
    worst = [source[worst_sightings(measurements, estimate)] for estimate in estimates.values()]
    chosen = np.unique(np.concatenate([even, *worst]))
    chosen = chosen[chosen >= 0]
    return np.asarray(chosen[np.argsort(log.images.t[chosen], kind="stable")])


def _strokes_in(
    log: Log, measurements: Measurements, chosen: IntArray, size: IntArray
) -> tuple[IntArray, IntArray, Array]:
    """Returns frame, row and ends (S, 2, 2) of all sightings that the chosen images show."""
    assert log.images is not None
    frames, rows, ends = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], [np.zeros((0, 2, 2))]
    for first, table in measurements.tables():
        for i, number in enumerate(chosen.tolist()):
            camera = log.cameras.get(log.images.camera[number])
            if camera is None or KINDS.get(camera.looks_at) != table.kind:
                continue
            seen, pixels = strokes(camera, table, shown(log, measurements, table, number))
            rows.append(first + seen)
            frames.append(np.full(len(seen), i))
            ends.append((pixels + 0.5) * size[i] / camera.image_size)
    return np.concatenate(frames), np.concatenate(rows), np.concatenate(ends)
