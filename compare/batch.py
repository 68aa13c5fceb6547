"""A batch: many logs, every method on each, perhaps under several settings; one table of all."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from compare.batch_files import check_batch_folder, write_batch
from compare.batch_inputs import NamedLog, find_logs
from compare.batch_job import JOURNAL, Done, Job
from compare.batch_table import (
    Duel,
    Failure,
    PointSummary,
    Row,
    duels,
    read_result,
    summarise,
)
from compare.batch_workers import in_processes, on_cluster
from compare.config import RunConfig
from compare.folders import writing
from compare.montecarlo import Progress
from compare.sweep import SweepPoint, sweep_points
from graphslam.errors import BadConfig, GraphSlamError


@dataclass(frozen=True, slots=True)
class Batch:
    """What a batch came to.

    Attributes:
        folder: where it was written.
        logs: the logs, in their order.
        config: all settings but the swept ones.
        points: the settings tried; one, without values, where nothing was swept.
        methods: the methods compared.
        rows: one for each point, log and method that gave a result.
        summary: one for each point, method and figure.
        duels: methods held against each other log by log.
        failures: logs, and methods on logs, that gave no result.
        computed: results that were computed now.
        kept: results that were there already.
    """

    folder: Path
    logs: tuple[NamedLog, ...]
    config: RunConfig
    points: tuple[SweepPoint, ...]
    methods: tuple[str, ...]
    rows: tuple[Row, ...]
    summary: tuple[PointSummary, ...]
    duels: tuple[Duel, ...]
    failures: tuple[Failure, ...]
    computed: int
    kept: int

    def result_folder(self, point: int, log: str) -> Path:
        """Returns the folder of one result."""
        return self.folder / self.points[point].folder / log

    def _repr_html_(self) -> str:
        """Returns what a notebook shows; see `compare.show_many`."""
        from compare.show_many import batch_html

        return batch_html(self)

    @property
    def failed_jobs(self) -> int:
        """How many logs, counted once for each point, gave no result or lack a method's."""
        return len({(failure.point, failure.log) for failure in self.failures})


def batch(
    logs: Sequence[Path | str],
    out: Path | str,
    config: RunConfig | None = None,
    *,
    sweep: Sequence[str] = (),
    jobs: int = 0,
    dask: str | None = None,
    reports: bool = True,
    progress: Progress | None = None,
) -> Batch:
    """Runs every log as `compare.run.run_log` does, each for itself, and writes a table of all.

    Results that are there already, of the same input, configuration and versions, are kept; a
    killed batch goes on where it stopped. Equal input gives equal bytes, killed or not, in
    whichever processes.

    Args:
        logs: see `compare.batch_inputs.find_logs`.
        out: folder to write: a result folder for each log (in a sweep, below one for each
            combination of values), batch.csv, summary.csv, batch.json and batch.html.
        config: what to compute; None for the defaults.
        sweep: settings to vary; see `compare.sweep.sweep_points`.
        jobs: worker processes, one BLAS thread each; 0: as many as the machine has cores.
        dask: address of a Dask scheduler whose workers are to do the jobs; None: this machine.
        reports: whether every log gets its own report.html.
        progress: told how many results are there, of how many.

    Raises:
        BadConfig: an argument cannot be used, or ``out`` holds something else.
        GraphSlamError: the cluster was lost.
        OSError: ``out`` cannot be written.
    """
    if jobs < 0:
        raise BadConfig(f"jobs = {jobs}: must be 0 (all cores) or a positive number")
    out, config = Path(out).resolve(), _anywhere(config or RunConfig())
    points = tuple(
        replace(point, config=_anywhere(point.config)) for point in sweep_points(sweep, config)
    )
    named = find_logs(logs)
    check_batch_folder(out)
    with writing(out):
        out.mkdir(parents=True, exist_ok=True)
        (out / JOURNAL).touch()
    work = _jobs(named, points, out, reports)
    ends = on_cluster(work, dask) if dask else in_processes(work, jobs)
    done = {end.number: end for end in _watched(ends, len(work), progress)}
    result = _collect(named, points, config, out, work, done)
    with writing(out):
        write_batch(result)
    return result


def _anywhere(config: RunConfig) -> RunConfig:
    """Returns a configuration that means the same in every working directory."""
    if config.places is not None:
        config = replace(config, places=str(Path(config.places).resolve()))
    if config.extract.robot is not None:
        robot = str(Path(config.extract.robot).resolve())
        config = replace(config, extract=replace(config.extract, robot=robot))
    if config.known_map is None:
        return config
    return replace(config, known_map=str(Path(config.known_map).resolve()))


def _jobs(
    logs: Sequence[NamedLog], points: Sequence[SweepPoint], out: Path, reports: bool
) -> list[Job]:
    """Returns all jobs; one point after the other, so that later ones find measurements."""
    folders = [[out / point.folder / log.name for point in points] for log in logs]
    return [
        Job(
            number=p * len(logs) + i,
            log=log.path,
            folder=folders[i][p],
            config=point.config,
            reports=reports,
            siblings=tuple(f for f in folders[i] if f != folders[i][p]),
            journal=out / JOURNAL,
        )
        for p, point in enumerate(points)
        for i, log in enumerate(logs)
    ]


def _watched(ends: Iterator[Done], total: int, progress: Progress | None) -> Iterator[Done]:
    """Yields what ends, and tells progress how many, how many failed, and the time left."""
    began, computed, failed = time.monotonic(), 0, 0
    if progress is not None:
        progress("batch", 0, total)
    for count, end in enumerate(ends, start=1):
        computed += end.state == "computed"
        failed += end.state == "failed"
        if progress is not None:
            parts = ["batch", f"{failed} failed" if failed else ""]
            if computed and count < total:
                left = (time.monotonic() - began) * (total - count) / computed
                parts.append(f"about {duration(left)} left")
            progress(", ".join(part for part in parts if part), count, total)
        yield end


def duration(seconds: float) -> str:
    """Returns a time in words, as coarse as a guess deserves."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    if seconds < 90 * 60:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"


def _collect(
    logs: Sequence[NamedLog],
    points: tuple[SweepPoint, ...],
    config: RunConfig,
    out: Path,
    work: Sequence[Job],
    done: dict[int, Done],
) -> Batch:
    """Returns the batch as its result folders tell it: how often it was killed shows nowhere."""
    rows: list[Row] = []
    failures: list[Failure] = []
    for job in work:
        point, log = job.number // len(logs), logs[job.number % len(logs)].name
        end = done[job.number]
        if end.state == "failed":
            failures.append(Failure(point, log, "", end.reason))
            continue
        try:
            found, failed = read_result(job.folder, point, log)
        except GraphSlamError as error:
            failures.append(Failure(point, log, "", str(error)))
            continue
        rows += found
        failures += failed
    methods = tuple(dict.fromkeys(m for point in points for m in point.config.methods))
    states = [end.state for end in done.values()]
    return Batch(
        folder=out,
        logs=tuple(logs),
        config=config,
        points=points,
        methods=methods,
        rows=tuple(rows),
        summary=tuple(summarise(rows, len(points), methods)),
        duels=tuple(duels(rows, len(points), methods)),
        failures=tuple(failures),
        computed=states.count("computed"),
        kept=states.count("kept"),
    )
