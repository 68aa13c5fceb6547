"""What a result folder holds, as one value: all that plots and report are made from."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from compare.methods import METHODS
from compare.metrics import nees
from compare.replay import Frames
from compare.results import (
    read_run,
    write_bearings,
    write_estimate,
    write_json,
    write_lamps,
    write_sightings,
)
from compare.truth import Truth
from graphslam.arrays import load_arrays, save_arrays
from graphslam.errors import BadConfig, BadMeasurements
from graphslam.estimate import Estimate
from graphslam.geometry import Array, compose, inverse, line_to_robot, transform_points, wrap
from graphslam.measurements import IntArray, Measurements

FRAMES_FILE = "thumbnails.npz"


@dataclass(frozen=True, slots=True)
class Record:
    """One run, complete enough to write its report again.

    Attributes:
        info: content of ``run.json``.
        measurements: what all methods estimated from.
        estimates: by method.
        metrics: content of ``metrics.json``; empty where no method ran.
        truth: what is true about the run, its path reduced to the nodes.
        timings: seconds by stage, and how long nodes took; content of ``timings.json``.
        frames: some of the images, with the lines seen in them; None without images.
    """

    info: Mapping[str, Any]
    measurements: Measurements
    estimates: Mapping[str, Estimate]
    metrics: Mapping[str, Any]
    truth: Truth
    timings: Mapping[str, Any]
    frames: Frames | None = None

    @property
    def true_pose(self) -> Array:
        """(N, 3) true poses in the floor frame, moved to begin at the start; NaN where unknown."""
        pose, covered = self.truth.at(self.measurements.t)
        pose[covered] = compose(inverse(self.truth.truth_T_start), pose[covered])
        return pose

    @property
    def has_true_pose(self) -> bool:
        """Whether the true path covers any node."""
        return len(self.truth.t) > 0

    @property
    def true_lines(self) -> Array:
        """(L, 2) true lines in the floor frame, moved with the true path; not canonical."""
        return line_to_robot(self.truth.lines, self.truth.truth_T_start)

    @property
    def true_points(self) -> Array:
        """(P, 2) true points in the floor frame, m, moved with the true path."""
        return transform_points(inverse(self.truth.truth_T_start), self.truth.points)

    def pose_error(self, method: str) -> Array:
        """Returns a method's pose minus `true_pose` (N, 3), heading wrapped; NaN where unknown."""
        error = self.estimates[method].pose - self.true_pose
        known = np.isfinite(error[:, 2])
        error[known, 2] = wrap(error[known, 2])
        return error

    def pose_nees(self, method: str) -> Array:
        """Returns e' C^-1 e / 3 of each pose (N,), errors as in `pose_error`.

        NaN at node 0, where the error is none by definition, and where truth is unknown.
        """
        error = self.pose_error(method)
        known = np.isfinite(error).all(axis=1)
        known[0] = False
        out = np.full(len(error), np.nan)
        out[known] = nees(error[known], self.estimates[method].cov_floor[known])
        return out

    def match_counts(self, method: str) -> IntArray:
        """Returns right, wrong and unjudged matches (M, 3) of each landmark of a method.

        A landmark stands for the true one that most of its sightings are of, as in
        `compare.matching.MatchingTable`.
        """
        estimate = self.estimates[method]
        counts = np.zeros((len(estimate.map), 3), np.int64)
        for row in range(len(counts)):
            true = self.truth.landmark[(estimate.match == row) & estimate.used]
            known = true[true >= 0]
            right = int(np.unique(known, return_counts=True)[1].max(initial=0))
            counts[row] = right, len(known) - right, len(true) - len(known)
        return counts

    def _repr_html_(self) -> str:
        """Returns what a notebook shows; see `compare.show`."""
        from compare.show import result_html

        return result_html(self.metrics, self.estimates)

    def save(self, folder: Path) -> None:
        """Writes every file of the run but report and plots into an empty folder."""
        write_json(folder / "run.json", self.info)
        self.measurements.save(folder / "measurements.npz")
        lines = self.measurements.sightings.get("line")
        if lines is not None:
            write_sightings(folder / "sightings.csv", self.measurements, lines)
        bearings = self.measurements.sightings.get("bearing")
        if bearings is not None:
            write_bearings(folder / "bearings.csv", self.measurements, bearings)
        lamps = self.measurements.sightings.get("lamp")
        if lamps is not None:
            write_lamps(folder / "lamps.csv", self.measurements, lamps)
        for name, estimate in self.estimates.items():
            write_estimate(folder / name, self.measurements, estimate, self.truth.landmark)
        if self.estimates:
            write_json(folder / "metrics.json", self.metrics)
            _save_truth(folder / "truth.npz", self.truth)
        if self.frames is not None:
            self.frames.save(folder / FRAMES_FILE)

    @staticmethod
    def load(folder: Path) -> Record:
        """Returns the record that a run wrote.

        Raises:
            BadConfig: the folder is not one of a run, or holds measurements only.
            BadMeasurements: one of its files is missing or was changed.
        """
        info = read_run(folder)
        if not info.get("methods"):
            raise BadConfig(f"{folder}: holds measurements but no estimate; use `graphslam run`")
        if any(name not in METHODS for name in info["methods"]):
            raise BadMeasurements(f"{folder / 'run.json'}: names an unknown method; run it again")
        record = Record(
            info=info,
            measurements=Measurements.load(folder / "measurements.npz"),
            estimates={n: Estimate.load(folder / n / "estimate.npz") for n in info["methods"]},
            metrics=_load_json(folder / "metrics.json"),
            truth=_load_truth(folder / "truth.npz"),
            timings=_load_json(folder / "timings.json"),
            frames=Frames.load(folder / FRAMES_FILE) if (folder / FRAMES_FILE).exists() else None,
        )
        sizes = len(record.measurements.t), record.measurements.sighting_count
        for name, estimate in record.estimates.items():
            whole = name in record.metrics.get("methods", {})
            if not whole or (len(estimate.t), len(estimate.match)) != sizes:
                raise BadMeasurements(
                    f"{folder}: {name}, metrics.json and measurements.npz are not of one run; run "
                    "it again"
                )
        return record


def load_result(folder: Path | str) -> Record:
    """Returns a run that `run` wrote, in one line: ``load_result("results/my-log")``.

    Raises:
        BadConfig: the folder is not one of a run, or holds measurements only.
        BadMeasurements: its files contradict each other.
    """
    return Record.load(Path(folder))


def truth_at_nodes(truth: Truth, measurements: Measurements) -> Truth:
    """Returns ``truth`` with its path reduced to the nodes that it covers."""
    pose, covered = truth.at(measurements.t)
    columns = {f.name: getattr(truth, f.name) for f in fields(Truth)}
    return Truth(**columns | {"t": measurements.t[covered], "pose": pose[covered]})


def _save_truth(path: Path, truth: Truth) -> None:
    columns = {f.name: getattr(truth, f.name) for f in fields(Truth)}
    save_arrays(path, {k: np.asarray(v) for k, v in columns.items() if v is not None})


def _load_truth(path: Path) -> Truth:
    columns: dict[str, Any] = load_arrays(path)
    try:
        labelled = bool(columns.pop("labelled"))
        return Truth(**{"seen": None} | columns, labelled=labelled)
    except (KeyError, TypeError, ValueError) as error:
        raise BadMeasurements(f"{path}: is not what a run wrote ({error}); run it again") from error


def _load_json(path: Path) -> dict[str, Any]:
    try:
        return dict(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError, RecursionError) as error:
        raise BadMeasurements(f"{path}: cannot be read ({error}); run it again") from error
