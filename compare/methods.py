"""The methods that a run can compare, by name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType

from compare.config import RunConfig
from graphslam.errors import BadConfig, BadMeasurements, GraphSlamError, UnderConstrained
from graphslam.estimate import Estimate, Told
from graphslam.measurements import Measurements

Estimates = Mapping[str, Estimate]
Stage = Callable[[str, Callable[[], Estimate]], Estimate]


@dataclass(frozen=True, slots=True)
class Method:
    """One way from measurements to an estimate.

    Attributes:
        run: takes the measurements, the configuration and the estimates made so far, by name.
        after: methods whose estimates it starts from.
        stepwise: whether it goes from node to node; ``run`` then takes what to call after each.
    """

    run: Callable[..., Estimate]
    after: tuple[str, ...] = ()
    stepwise: bool = False


def _odometry(measurements: Measurements, config: RunConfig, done: Estimates) -> Estimate:
    from graphslam.baseline import dead_reckoning

    return dead_reckoning(measurements)


def _ekf(
    measurements: Measurements, config: RunConfig, done: Estimates, told: Told | None = None
) -> Estimate:
    from graphslam.ekf import run_ekf

    return run_ekf(measurements, config.ekf, told=told)


def _ekf_naive(
    measurements: Measurements, config: RunConfig, done: Estimates, told: Told | None = None
) -> Estimate:
    from graphslam.late import run_naive

    return run_naive(measurements, config.ekf, told)


def _ekf_fej(measurements: Measurements, config: RunConfig, done: Estimates) -> Estimate:
    from graphslam.consistent import run_first_estimates

    return run_first_estimates(measurements, config.ekf)


def _ekf_robot(measurements: Measurements, config: RunConfig, done: Estimates) -> Estimate:
    from graphslam.consistent import run_robot_centred

    return run_robot_centred(measurements, config.ekf)


def _isam2(
    measurements: Measurements, config: RunConfig, done: Estimates, told: Told | None = None
) -> Estimate:
    with _needs_gtsam("isam2"):
        from graphslam.smoother import run_isam2
    return run_isam2(measurements, done["ekf"], config.incremental, told)


def _fixed_lag(
    measurements: Measurements, config: RunConfig, done: Estimates, told: Told | None = None
) -> Estimate:
    with _needs_gtsam("fixed-lag"):
        from graphslam.smoother import run_fixed_lag
    return run_fixed_lag(measurements, done["ekf"], config.incremental, told)


def _triangulation(measurements: Measurements, config: RunConfig, done: Estimates) -> Estimate:
    from graphslam.memoryless import triangulate

    try:
        return triangulate(measurements, config.ekf)
    except BadMeasurements as missing:
        raise UnderConstrained(str(missing)) from None


def _fixes(measurements: Measurements, config: RunConfig, done: Estimates) -> Estimate:
    from graphslam.fixes import follow_fixes

    try:
        return follow_fixes(measurements)
    except BadMeasurements as missing:
        raise UnderConstrained(str(missing)) from None


def _smoother(measurements: Measurements, config: RunConfig, done: Estimates) -> Estimate:
    with _needs_gtsam("smoother"):
        from graphslam.smoother import smooth
    return smooth(measurements, initial=done["ekf"], config=config.smoother)


def _ekf_window(measurements: Measurements, config: RunConfig, done: Estimates) -> Estimate:
    with _needs_gtsam("ekf-window"):
        from graphslam.long import run_window
    return run_window(measurements, config.ekf, config.long)


def _loops(measurements: Measurements, config: RunConfig, done: Estimates) -> Estimate:
    with _needs_gtsam("loops"):
        from graphslam.long import close_all_loops
    return close_all_loops(measurements, done["ekf-window"], config.smoother, config.long)


@contextmanager
def _needs_gtsam(method: str) -> Iterator[None]:
    """Tells what to do where GTSAM is not installed."""
    try:
        yield
    except ModuleNotFoundError as missing:
        if missing.name != "gtsam":
            raise
        raise BadConfig(
            f"the method {method} needs GTSAM, which is not installed (there is no wheel for "
            "Windows): pip install gtsam, or leave it out with --methods odometry ekf"
        ) from missing


def _geometric(measurements: Measurements, config: RunConfig, done: Estimates) -> Estimate:
    from graphslam.geometric import geometric_correction

    _check_map("geometric", measurements)
    return geometric_correction(measurements, config.ekf)


def _particle(measurements: Measurements, config: RunConfig, done: Estimates) -> Estimate:
    from graphslam.particle import localise_by_particles

    _check_map("particle", measurements)
    return localise_by_particles(measurements, config.particle, config.ekf.matching)


def _check_map(method: str, measurements: Measurements) -> None:
    """Raises BadConfig where there is no map to localise on."""
    if measurements.known is None or not len(measurements.known):
        raise BadConfig(
            f"the method {method} localises on a known map, and there is none: give one with "
            "--known-map MAP, or leave the method out"
        )


METHODS: Mapping[str, Method] = MappingProxyType(
    {
        "odometry": Method(_odometry),
        "geometric": Method(_geometric),
        "ekf": Method(_ekf, stepwise=True),
        "ekf-naive": Method(_ekf_naive, stepwise=True),
        "ekf-fej": Method(_ekf_fej),
        "ekf-robot": Method(_ekf_robot),
        "particle": Method(_particle),
        "triangulation": Method(_triangulation),
        "fixes": Method(_fixes),
        "isam2": Method(_isam2, after=("ekf",), stepwise=True),
        "fixed-lag": Method(_fixed_lag, after=("ekf",), stepwise=True),
        "smoother": Method(_smoother, after=("ekf",)),
        "ekf-window": Method(_ekf_window),
        "loops": Method(_loops, after=("ekf-window",)),
    }
)


def run_methods(
    measurements: Measurements,
    config: RunConfig,
    stage: Stage,
    told: Callable[[str, int], None] | None = None,
) -> tuple[dict[str, Estimate], dict[str, GraphSlamError]]:
    """Returns the estimates of ``config.methods``, in that order, and why others failed, by name.

    A method that starts from another's estimate has that one run first, once, asked for or not. A
    method that the measurements do not suffice for does not stop the others.

    Args:
        measurements: what all methods estimate from.
        config: the methods and their configuration.
        stage: called with a method's name and the call that runs it; returns what the call does.
        told: called with a method's name and a node, after each node of those that go from node to
            node.

    Raises:
        BadConfig: a method is unknown, or cannot run here.
    """
    unknown = [name for name in config.methods if name not in METHODS]
    if unknown:
        raise BadConfig(f"unknown method {unknown[0]!r}; known: {', '.join(METHODS)}")
    done: dict[str, Estimate] = {}
    failed: dict[str, GraphSlamError] = {}

    def attempt(name: str) -> None:
        if name in done or name in failed:
            return
        for other in METHODS[name].after:
            attempt(other)
            if other in failed:
                failed[name] = failed[other]
                return
        method, given = METHODS[name], (measurements, config, done)
        if told is not None and method.stepwise:
            given = (*given, partial(told, name))
        try:
            done[name] = stage(name, lambda: method.run(*given))
        except UnderConstrained as error:
            failed[name] = error

    for name in config.methods:
        attempt(name)
    return {name: done[name] for name in config.methods if name in done}, failed
