"""A show as one page: images, plan and covariance, played by the page's own script."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from compare.pages import source, template
from compare.plots_style import themed
from compare.report_replay import DEGREES, NORMAL_95, rounded
from frontend.images import jpeg_of
from frontend.marks import Shot, picture_of
from frontend.show import Show, Track

Progress = Callable[[int, int], None]

IMAGE_WIDTH = 560
"""Largest width of an image on the page, pixels."""
MOST_IMAGES = 600
"""Images on the page; of more, so many evenly spread over the log."""
SCRIPTS = ("drawing.js", "play.js")


def write_page(show: Show, out: Path, speed: float = 1.0, progress: Progress | None = None) -> None:
    """Writes a page that plays a show without a network; equal shows give equal bytes.

    Args:
        show: what to play.
        out: file to write.
        speed: at which it begins: seconds of the log in a second.
        progress: called with (images done, images in all).
    """
    kept = np.unique(
        np.linspace(0, len(show.shots) - 1, min(len(show.shots), MOST_IMAGES)).round().astype(int)
    )
    shots = [show.shots[k] for k in kept.tolist()] if len(show.shots) else []
    frames = []
    for done, shot in enumerate(shots, start=1):
        frame = _frame(show, shot)
        if frame is not None:
            frames.append(frame)
        if progress is not None:
            progress(done, len(shots))
    content = {
        "t": rounded(show.t - show.t[0], 3),
        "box": rounded(np.array(show.box), 4),
        "truth": None if show.truth is None else rounded(show.truth, 4),
        "tracks": [_track(track) for track in show.tracks],
        "frames": frames,
        "cameras": list(show.cameras),
        "speed": speed,
    }
    data = json.dumps(content, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    data = data.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
    script = "\n".join(source(name) for name in SCRIPTS)
    left_out = len(show.shots) - len(shots)
    html = template("play.html").render(
        name=show.name,
        warnings=show.warnings,
        data=data,
        script=script,
        script_hash=base64.b64encode(sha256(script.encode()).digest()).decode(),
        images=len(show.shots),
        left_out=left_out,
        has_truth=show.truth is not None,
        speeds=sorted({0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 25.0, speed}),
        speed=speed,
    )
    out.write_text(html, encoding="utf-8", newline="\n")


def _track(track: Track) -> dict[str, Any]:
    return {
        "name": track.name,
        "colour": themed(track.colour),
        "causal": track.causal,
        "dots": track.dots,
        "x": rounded(track.pose[:, 0], 4),
        "y": rounded(track.pose[:, 1], 4),
        "theta": rounded(DEGREES * track.pose[:, 2], 2),
        "half": [rounded(track.half[:, 0], 5), rounded(track.half[:, 1], 5)],
        "angle": rounded(DEGREES * track.angle, 1),
        "heading95": rounded(DEGREES * NORMAL_95 * track.sigma_heading, 3),
        "shown": track.shown.tolist() if track.dots else None,
        "lines": [
            [int(first), *rounded(ends, 3)]
            for ends, first in zip(track.lines, track.line_from.tolist(), strict=True)
            if np.isfinite(ends).all()
        ],
    }


def _frame(show: Show, shot: Shot) -> dict[str, Any] | None:
    picture = picture_of(show.log, shot.number)
    if picture is None:
        return None
    jpeg, width, height = jpeg_of(picture, IMAGE_WIDTH)
    scale = width / picture.shape[1]
    return {
        "t": round(shot.t - float(show.t[0]), 3),
        "camera": shot.camera,
        "name": shot.name,
        "note": shot.note,
        "size": [width, height],
        "jpeg": base64.b64encode(jpeg).decode("ascii"),
        "marks": [
            [int(m.used), m.text, *rounded((scale * (m.points + 0.5)).ravel(), 1)]
            for m in shot.marks
        ],
    }
