"""How images and scans are searched: in parallel, in order, and gathered into one answer."""

from __future__ import annotations

import os
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from frontend.columns import later
from frontend.log import AnyCamera, Log
from frontend.recorded import RecordedImage
from graphslam.errors import BadLog
from graphslam.geometry import Array
from graphslam.measurements import IntArray

Progress = Callable[[int, int], None]
Read = Callable[[Path | RecordedImage], NDArray[np.uint8] | None]


class Detected(Protocol):
    """What one image or scan shows: a dataclass of columns, and `rejected`."""

    @property
    def rejected(self) -> Mapping[str, int]:
        """How many things were left out, by reason."""
        ...

    def __len__(self) -> int:
        """Returns how many things it shows."""
        ...


Answer = TypeVar("Answer")
Columns = TypeVar("Columns", bound=Detected)


@dataclass(frozen=True, slots=True)
class Found(Generic[Columns]):
    """What a search of a log's images or scans came to.

    Attributes:
        seen: all that they show, one after the other.
        source: (K,) number of the image or scan of each.
        unreadable: how many could not be read.
    """

    seen: Columns
    source: IntArray
    unreadable: int


class Search(NamedTuple, Generic[Columns]):
    """What is looked for in images.

    Attributes:
        read: returns an image, grey or coloured; None where it cannot be read.
        detect: returns what an image of a camera shows.
        nothing: what an empty image shows.
    """

    read: Read
    detect: Callable[[NDArray[np.uint8], Any], Columns]
    nothing: Columns


def looked_at(
    log: Log, number: int, read: Read, detect: Callable[[NDArray[np.uint8], Any], Answer]
) -> Answer | None:
    """Returns what ``detect`` makes of an image and its camera; None where it cannot be read.

    Args:
        log: with images, and cameras that took them.
        number: row in the log's images.
        read: returns the image, grey or coloured.
        detect: what is looked for.

    Raises:
        BadLog: the image has not the size that the log states.
    """
    assert log.images is not None, "only logs with images are looked at"
    image, camera = log.images.file[number], log.cameras[log.images.camera[number]]
    pixels = read(image)
    if pixels is None:
        return None
    called = image if isinstance(image, Path) else f"{log.folder}: {image.name}"
    _check_size(pixels, camera, called, log.described)
    return detect(pixels, camera)


def _check_size(
    image: NDArray[np.uint8], camera: AnyCamera, called: object, described: str
) -> None:
    """Raises BadLog where an image has not the size that the log states.

    Args:
        image: (H, W) or (H, W, 3).
        camera: that took it.
        called: what messages call the image.
        described: what messages call the file that describes the camera.
    """
    size, stated = image.shape[1::-1], camera.image_size
    if size != stated:
        belongs = "centre" if camera.looks_at == "omni" else "homography"
        raise BadLog(
            f"{called}: is {size[0]} x {size[1]} pixels, but {described} says image_size = "
            f"{list(stated)} for camera {camera.name!r}; correct it, and the {belongs}"
        )


def search_images(
    log: Log,
    numbers: IntArray,
    search: Search[Columns],
    workers: int | None,
    progress: Progress | None,
) -> Found[Columns]:
    """Returns all that images show, image by image.

    Args:
        log: with images, and cameras that took them.
        numbers: which of the log's images to search.
        search: what is looked for.
        workers: how many images are searched at a time; None for as many as there are processors.
        progress: called with (images done, images in all).

    Raises:
        BadLog: an image has not the size that the log states.
    """

    def look(number: int) -> Columns | None:
        return looked_at(log, number, search.read, search.detect)

    return gathered(numbers, in_order(look, numbers, workers), search.nothing, progress)


def gathered(
    numbers: IntArray,
    answers: Iterable[Columns | None],
    nothing: Columns,
    progress: Progress | None,
) -> Found[Columns]:
    """Returns the answers as one.

    Args:
        numbers: of the images or scans that were searched.
        answers: of each in order, None where it cannot be read.
        nothing: an answer without a row.
        progress: called with (images or scans done, in all).
    """
    seen: list[Columns] = []
    source: list[int] = []
    for done, (number, answer) in enumerate(zip(numbers.tolist(), answers, strict=True), start=1):
        if answer is not None:
            seen.append(answer)
            source += [number] * len(answer)
        if progress is not None:
            progress(done, len(numbers))
    return Found(_joined(seen, nothing), np.array(source, np.int64), len(numbers) - len(seen))


def in_order(
    look: Callable[[int], Answer], numbers: IntArray, workers: int | None
) -> Iterator[Answer]:
    """Yields what ``look`` says of each number, in order.

    OpenCV releases the interpreter lock, so threads do; only a few answers are waited for at a
    time, so that only a few images are held.
    """
    count = workers or os.cpu_count() or 1
    waiting: deque[Future[Answer]] = deque()
    pool = ThreadPoolExecutor(count)
    try:
        for number in numbers.tolist():
            waiting.append(pool.submit(look, number))
            if len(waiting) > 2 * count:
                yield waiting.popleft().result()
        for answer in waiting:
            yield answer.result()
    finally:
        pool.shutdown(cancel_futures=True)


def _joined(parts: list[Columns], nothing: Columns) -> Columns:
    """Returns the rows of all parts, and their rejected ones added up."""
    rejected: Counter[str] = Counter()
    for part in parts:
        rejected.update(part.rejected)
    columns = [field.name for field in fields(nothing) if field.name != "rejected"]  # type: ignore[arg-type]
    rows = {
        name: np.concatenate([getattr(part, name) for part in (nothing, *parts)])
        for name in columns
    }
    return replace(nothing, **rows, rejected=rejected)  # type: ignore[type-var]


def received(log: Log, source: IntArray) -> Array:
    """Returns when what each of the images ``source`` (K,) shows is known, s."""
    assert log.images is not None, "sightings come from images"
    names = [log.images.camera[number] for number in source.tolist()]
    delay = np.array([log.cameras[name].delay_s for name in names], float)
    t = log.images.t[source]
    return np.where(delay > 0, later(t, delay), t)
