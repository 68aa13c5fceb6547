"""The main job: a log to measurements, estimates, their comparison and a folder of results."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from compare.clock import Clock, Progress
from compare.comparison import Comparison, compare
from compare.config import RunConfig
from compare.fingerprint import fingerprints, versions
from compare.folders import writing
from compare.known import on_building, on_known_map
from compare.methods import run_methods
from compare.opening import open_as, suited
from compare.record import Record, truth_at_nodes
from compare.replay import take_frames
from compare.report import write_report
from compare.results import RUN_FORMAT, check_replaceable, whole_folder, write_json
from compare.truth import truth_of
from frontend.extract import extract, extraction_warnings
from frontend.log import Log, with_camera_offset
from frontend.overlay_frames import check_overlays, write_overlays
from graphslam.estimate import Estimate
from graphslam.measurements import Measurements

RESULTS = Path("results")


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
    clock = Clock(progress, log.name)
    measurements = clock("extract", lambda: extract(log, config.extract, clock.inside("extract")))
    info = _info(log, measurements, config, {})
    with whole_folder(out) as folder:
        Record(info, measurements, {}, {}, truth_of(log, measurements), {}).save(folder)
    if overlay is not None:
        tell = clock.inside("overlay")
        with writing(Path(overlay)):
            to, settings = Path(overlay), config.extract
            clock("overlay", lambda: write_overlays(log, measurements, to, tell, settings))
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
    clock = Clock(progress, log.name)
    if measurements is None:
        inside = clock.inside("extract")
        measurements = clock("extract", lambda: extract(log, config.extract, inside))
        measurements = on_known_map(measurements, config.known_map)
    building = None
    if config.places is not None:
        from compare.places.building import read_building  # networkx, only where it is needed

        building = read_building(config.places)
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
    info |= _methods_info(estimates, failed)
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
    _write(record, out, clock, report)
    warnings = tuple(info["warnings"])
    failures = tuple(failed)
    check, told = info.get("check"), tuple(info.get("places", {}).get("sentences", ()))
    return RunResult(out, log, measurements, estimates, comparison, warnings, failures, check, told)


def _write(record: Record, out: Path, clock: Clock, report: bool) -> None:
    """Writes what a run came to, and how long it took, as one whole folder."""
    with whole_folder(out) as folder:
        clock("write", lambda: record.save(folder))
        if report:
            clock("report", lambda: write_report(record, folder))
        write_json(folder / "timings.json", clock.timings())


def _check(measurements: Measurements, estimates: dict[str, Estimate], config: RunConfig) -> str:
    """Returns in words how far the smoother's engines agree."""
    from graphslam.smoother import engines_agree

    return str(engines_agree(measurements, estimates["smoother"], config.smoother))


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


def _methods_info(
    estimates: Mapping[str, Estimate], failed: Mapping[str, Exception]
) -> dict[str, Any]:
    """Returns what run.json says of the methods beside their counts."""
    return {
        "failed": {name: str(error) for name, error in failed.items()},
        "quantities": {name: dict(e.quantities) for name, e in estimates.items() if e.quantities},
        "engine": {name: e.engine for name, e in estimates.items() if e.engine},
    }
