"""The main job: a log to measurements, estimates, their comparison and a folder of results."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from compare.comparison import Comparison, compare
from compare.config import RunConfig
from compare.fingerprint import fingerprints, versions
from compare.folders import writing
from compare.map_files import read_map
from compare.methods import run_methods
from compare.record import Record, truth_at_nodes
from compare.replay import take_frames
from compare.report import IndexEntry, check_index, write_index, write_report
from compare.results import RUN_FORMAT, check_replaceable, whole_folder, write_json
from compare.truth import truth_of
from frontend.extract import extract, extraction_warnings
from frontend.log import Log, is_log_folder, open_log, with_camera_offset
from frontend.overlay_frames import check_overlays, write_overlays
from graphslam.estimate import Estimate
from graphslam.measurements import Measurements

if TYPE_CHECKING:
    from compare.places.building import Building

T = TypeVar("T")
Progress = Callable[[str, int, int], None]
"""Called with a stage's name, how much of it is done, and of how much."""

RESULTS = Path("results")
LATENCY = ("median_ms", "p99_ms", "worst_ms", "last_tenth_ms")
"""Of a node: median, what 99 % stay below, worst, and the median of the log's last tenth."""


@dataclass(frozen=True, slots=True)
class RunResult:
    """What a run made of one log.

    Attributes:
        folder: where it was written.
        log: the recording.
        measurements: what was extracted from it.
        estimates: by method; empty after `extract_log`.
        comparison: the estimates judged; None after `extract_log`.
        warnings: what is doubtful about the log, what could not be used of it, and which methods
            failed and why.
        failed: methods that were asked for and failed.
        check: how far both of the smoother's engines agree, in words; None where not asked for.
        places: what a map of corridors says of the run, in sentences; empty where there is none.
    """

    folder: Path
    log: Log
    measurements: Measurements
    estimates: dict[str, Estimate]
    comparison: Comparison | None
    warnings: tuple[str, ...]
    failed: tuple[str, ...] = ()
    check: str | None = None
    places: tuple[str, ...] = ()

    def _repr_html_(self) -> str:
        """Returns what a notebook shows; see `compare.show`."""
        from compare.show import result_html

        metrics = {} if self.comparison is None else self.comparison.to_dict()
        return result_html(metrics, self.estimates)


@dataclass(frozen=True, slots=True)
class Outcome:
    """One of several logs.

    Attributes:
        path: the log as it was named.
        result: what came out; None where it failed.
        error: why it failed; None where it did not.
    """

    path: Path
    result: RunResult | None
    error: Exception | None


def run_log(
    path: Path | str,
    out: Path | str | None = None,
    config: RunConfig | None = None,
    progress: Progress | None = None,
) -> RunResult:
    """Extracts, estimates, compares and reports; writes the result folder.

    Args:
        path: the log.
        out: the result folder; ``results/<log name>`` where None. The folder of an earlier run is
            replaced, any other is refused.
        config: what to compute; None for the defaults.
        progress: told about each stage.

    Raises:
        BadLog: the log cannot be used.
        BadConfig: the folder or the configuration cannot be used.
        OSError: the folder cannot be written.
    """
    log = open_as(path, config, progress)
    return run_opened(log, RESULTS / log.name if out is None else Path(out), config, progress)


def run_logs(
    paths: Sequence[Path | str],
    out: Path | str | None = None,
    config: RunConfig | None = None,
    progress: Progress | None = None,
) -> tuple[Outcome, ...]:
    """Runs several logs, each into ``out/<log name>``, and writes ``out/index.html``.

    A log that fails does not stop the others. Logs of one name get -2, -3, ... in their order.

    Args:
        paths: the logs.
        out: folder of the result folders; ``results`` where None.
        config: what to compute; None for the defaults.
        progress: told about each stage of each log.

    Raises:
        BadConfig: ``out`` holds an index.html that is not ours.
        OSError: the index cannot be written.
    """
    out = RESULTS if out is None else Path(out)
    check_index(out)
    taken: set[str] = set()
    config = config or RunConfig()
    outcomes = tuple(
        _attempt(Path(path), out, taken, settings_for(path, config), progress) for path in paths
    )
    with writing(out):
        write_index(out, [_index_entry(outcome) for outcome in outcomes])
    return outcomes


def settings_for(path: Path | str, config: RunConfig) -> RunConfig:
    """Returns the settings of one log among several: a robot file is for bags only.

    Log folders describe their robot themselves.
    """
    if config.extract.robot is None or not is_log_folder(Path(path)):
        return config
    return replace(config, extract=replace(config.extract, robot=None))


def open_as(
    path: Path | str, config: RunConfig | None = None, progress: Progress | None = None
) -> Log:
    """Returns a log, opened as the settings say: with their robot file and clock of the camera.

    Args:
        path: the log.
        config: its ``extract`` part counts; None for the defaults.
        progress: told how much of a bag is read.
    """
    settings = (config or RunConfig()).extract
    tell = None if progress is None else reading(progress, Path(path).name)
    return with_camera_offset(open_log(path, settings.robot, tell), settings.camera_offset_s)


def reading(progress: Progress, name: str) -> Callable[[int, int], None]:
    """Returns what tells the progress of reading a bag, in MB, from bytes."""
    return lambda done, total: progress(f"{name}: read, MB", -(-done // 10**6), -(-total // 10**6))


def extract_log(
    path: Path | str,
    out: Path | str,
    config: RunConfig | None = None,
    progress: Progress | None = None,
    overlay: Path | str | None = None,
) -> RunResult:
    """Turns a log into measurements: run.json, measurements.npz and sightings.csv, as `run_log`.

    Args:
        path: the log.
        out: the folder; that of an earlier run is replaced, any other is refused.
        config: its ``extract`` part counts; None for the defaults.
        progress: told about each image.
        overlay: folder for a picture of each image with the lines seen in it, see
            `frontend.overlay_frames`; None for none.

    Raises:
        BadLog: the log cannot be used.
        BadConfig: a folder or the configuration cannot be used.
        OSError: a folder cannot be written.
    """
    config, out = config or RunConfig(), Path(out)
    log = open_as(path, config, progress)
    check_replaceable(out)
    if overlay is not None:
        check_overlays(log, Path(overlay))
    clock = _Clock(progress, log)
    measurements = clock("extract", lambda: extract(log, config.extract, clock.inside("extract")))
    info = _info(log, measurements, config, {})
    with whole_folder(out) as folder:
        Record(info, measurements, {}, {}, truth_of(log, measurements), {}).save(folder)
    if overlay is not None:
        tell = clock.inside("overlay")
        with writing(Path(overlay)):
            clock("overlay", lambda: write_overlays(log, measurements, Path(overlay), tell))
    return RunResult(out, log, measurements, {}, None, tuple(info["warnings"]))


def run_opened(
    log: Log,
    out: Path,
    config: RunConfig | None = None,
    progress: Progress | None = None,
    *,
    measurements: Measurements | None = None,
    report: bool = True,
) -> RunResult:
    """Does what `run_log` does with a log that is open already.

    Args:
        log: the recording.
        out: the result folder.
        config: what to compute; None for the defaults.
        progress: told about each stage.
        measurements: what the log and ``config`` give, where it is at hand; else it is extracted.
        report: whether to draw the plots and write report.html.
    """
    config = suited(config or RunConfig(), log)
    log = with_camera_offset(log, config.extract.camera_offset_s)
    check_replaceable(out)
    clock = _Clock(progress, log)
    if measurements is None:
        inside = clock.inside("extract")
        measurements = clock("extract", lambda: extract(log, config.extract, inside))
        measurements = on_known_map(measurements, config.known_map)
    building = None if config.places is None else _building(config.places)
    if building is not None:
        measurements = on_building(measurements, building, config.extract.landmarks)
    estimates, failed = run_methods(measurements, config, clock, clock.told)
    if failed and not estimates:
        raise next(iter(failed.values()))
    engine = config.smoother.engine
    comparison = clock(
        "compare", lambda: compare(log, measurements, list(estimates.values()), engine)
    )
    frames = clock("thumbnails", lambda: take_frames(log, measurements, estimates))
    info = _info(log, measurements, config, estimates)
    info["failed"] = {name: str(error) for name, error in failed.items()}
    info["quantities"] = {name: dict(e.quantities) for name, e in estimates.items() if e.quantities}
    info["engine"] = {name: e.engine for name, e in estimates.items() if e.engine}
    if config.smoother.check and "smoother" in estimates:
        info["check"] = clock("check", lambda: _check(measurements, estimates, config))
    if building is not None:
        from compare.places.section import places_section

        camera = next(iter(log.looking_at("ceiling").values()), None)
        info["places"] = places_section(building, measurements, estimates, camera)
    info["warnings"] += [f"{name} failed: {error}" for name, error in failed.items()]
    record = Record(
        info,
        measurements,
        estimates,
        comparison.to_dict(),
        truth_at_nodes(comparison.truth, measurements),
        clock.timings(),
        frames,
    )
    with whole_folder(out) as folder:
        clock("write", lambda: record.save(folder))
        if report:
            clock("report", lambda: write_report(record, folder))
        write_json(folder / "timings.json", clock.timings())
    warnings = tuple(info["warnings"])
    failures = tuple(failed)
    check, told = info.get("check"), tuple(info.get("places", {}).get("sentences", ()))
    return RunResult(out, log, measurements, estimates, comparison, warnings, failures, check, told)


def suited(config: RunConfig, log: Log) -> RunConfig:
    """Returns a configuration with a laser's methods, if the log is one and none were chosen."""
    if not log.has_walls() or config.methods != RunConfig().methods:
        return config
    return replace(config, methods=config.laser_methods)


def _check(measurements: Measurements, estimates: dict[str, Estimate], config: RunConfig) -> str:
    """Returns in words how far the smoother's engines agree."""
    from graphslam.smoother import engines_agree

    return str(engines_agree(measurements, estimates["smoother"], config.smoother))


def on_known_map(measurements: Measurements, path: str | None) -> Measurements:
    """Returns measurements with the landmarks of a map file as known ones, beside the log's own.

    Raises:
        BadConfig: the file is no map.
    """
    if path is None:
        return measurements
    known = read_map(path)
    if measurements.known is not None:
        known = known.joined(measurements.known)
    return replace(measurements, known=known)


def _building(path: str) -> Building:
    from compare.places.building import read_building  # networkx, only where there is such a map

    return read_building(path)


def on_building(measurements: Measurements, building: Building, landmarks: str) -> Measurements:
    """Returns measurements with the lamps of a map of corridors as known ones.

    Not where lamps are known already, nor where ``landmarks`` says that they are to be mapped.
    """
    known, lamps = measurements.known, building.landmarks()
    if landmarks != "known" or not len(lamps) or (known is not None and "lamp" in known.kind):
        return measurements
    return replace(measurements, known=lamps if known is None else known.joined(lamps))


def _attempt(
    path: Path, out: Path, taken: set[str], config: RunConfig | None, progress: Progress | None
) -> Outcome:
    try:
        log = open_as(path, config, progress)
        name, number = log.name, 1
        while name in taken:
            number += 1
            name = f"{log.name}-{number}"
        taken.add(name)
        return Outcome(path, run_opened(log, out / name, config, progress), None)
    except Exception as error:  # whatever it is, the other logs go on
        return Outcome(path, None, error)


def _index_entry(outcome: Outcome) -> IndexEntry:
    if outcome.result is None:
        return IndexEntry(str(outcome.path), None, {}, str(outcome.error))
    result = outcome.result
    metrics = {} if result.comparison is None else result.comparison.to_dict()
    return IndexEntry(result.log.name, result.folder.name, metrics, "")


class _Clock:
    """Times stages by name and tells about them."""

    def __init__(self, progress: Progress | None, log: Log) -> None:
        self.progress, self.log = progress, log
        self.seconds: dict[str, float] = {}
        self.nodes: dict[str, list[float]] = {}

    def __call__(self, stage: str, work: Callable[[], T]) -> T:
        self.tell(stage, 0, 1)
        began = time.perf_counter()
        self.nodes[stage] = [began]
        done = work()
        self.seconds[stage] = round(time.perf_counter() - began, 4)
        self.tell(stage, 1, 1)
        return done

    def tell(self, stage: str, done: int, total: int) -> None:
        if self.progress is not None:
            self.progress(f"{self.log.name}: {stage}", done, total)

    def told(self, method: str, node: int) -> None:
        """Takes the time at which a method was through with a node."""
        self.nodes[method].append(time.perf_counter())

    def timings(self) -> dict[str, Any]:
        """Returns seconds by stage, and by method how long a node took, `LATENCY`."""
        latency = {}
        for method, times in self.nodes.items():
            if len(times) > 1:
                each = np.diff(times)
                late = np.median(each[-max(1, len(each) // 10) :])
                figures = (np.median(each), np.percentile(each, 99), np.max(each), late)
                milliseconds = [round(1e3 * float(figure), 4) for figure in figures]
                latency[method] = dict(zip(LATENCY, milliseconds, strict=True))
        return {**self.seconds, "latency": latency} if latency else dict(self.seconds)

    def inside(self, stage: str) -> Callable[[int, int], None]:
        """Returns a callback for progress within a stage."""
        return lambda done, total: self.tell(stage, done, total)


def _info(
    log: Log, measurements: Measurements, config: RunConfig, estimates: dict[str, Estimate]
) -> dict[str, Any]:
    """Returns the content of run.json: nothing in it depends on when or where the run was made."""
    warnings = (*log.warnings, *extraction_warnings(log, measurements))
    content = {
        "format": RUN_FORMAT,
        "log": {"name": log.name, "digest": log.digest, "start_given": log.start_given},
        "methods": list(estimates),
        "config": asdict(config),
        "seed": None,
        "versions": versions(),
        "fingerprints": fingerprints(log, config),
        "nodes": len(measurements.t),
        "sightings": {kind: len(table) for kind, table in measurements.sightings.items()},
        "rejected": dict(measurements.rejected),
        "counts": {name: dict(estimate.counts) for name, estimate in estimates.items()},
        "warnings": [text.replace(str(log.folder), log.folder.name) for text in warnings],
    }
    return dict(json.loads(json.dumps(content)))
