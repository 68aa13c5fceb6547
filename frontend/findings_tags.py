"""What looks wrong in a sample of a log's overhead images."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np

from frontend.config import ExtractConfig
from frontend.findings import Finding
from frontend.log import Log

SAMPLE = 24
"""Overhead images of each camera that are looked at, evenly spaced over the log."""
ENOUGH = 0.5
"""Share of them with a pose that is not worth a word."""


def tag_findings(log: Log) -> Iterator[Finding]:
    """Yields a finding for each overhead camera that hardly ever sees the tags, with the reason."""
    numbers = log.images_of("overhead")
    if log.images is None or not len(numbers):
        return
    from frontend.image_tags import look

    names = np.array(log.images.camera, dtype=object)[numbers]
    for name in log.looking_at("overhead"):
        mine = numbers[names == name]
        if not len(mine):
            continue
        few = mine[np.unique(np.linspace(0, len(mine) - 1, SAMPLE).round().astype(int))]
        seen = [look(log, number, ExtractConfig()) for number in few.tolist()]
        reasons = Counter("image cannot be read" if s is None else s.refused for s in seen)
        good = reasons.pop("", 0)
        if good < ENOUGH * len(few):
            reason, count = reasons.most_common(1)[0]
            yield Finding(
                f"log.toml camera {name!r}",
                f"{good} of {len(few)} images give a pose; {count} of the others: {reason}",
                "odometry goes on alone where the tags are not seen",
                "look at the images with `graphslam play`; colours are extract.tags, places and "
                f"size of the tags [cameras.{name}.tags] (docs/overhead.md)",
            )
