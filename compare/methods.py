"""The methods that a run can compare, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from compare.config import RunConfig
from graphslam.errors import BadConfig, GraphSlamError, UnderConstrained
from graphslam.estimate import Estimate
from graphslam.measurements import Measurements

Estimates = Mapping[str, Estimate]
Stage = Callable[[str, Callable[[], Estimate]], Estimate]


@dataclass(frozen=True, slots=True)
class Method:
    """One way from measurements to an estimate.

    Attributes:
        run: takes the measurements, the configuration and the estimates made so far, by name.
        after: methods whose estimates it starts from.
    """

    run: Callable[[Measurements, RunConfig, Estimates], Estimate]
    after: tuple[str, ...] = ()


def _odometry(measurements: Measurements, config: RunConfig, done: Estimates) -> Estimate:
    from graphslam.baseline import dead_reckoning

    return dead_reckoning(measurements)


def _ekf(measurements: Measurements, config: RunConfig, done: Estimates) -> Estimate:
    from graphslam.ekf import run_ekf

    return run_ekf(measurements, config.ekf)


def _ekf_fej(measurements: Measurements, config: RunConfig, done: Estimates) -> Estimate:
    from graphslam.consistent import run_first_estimates

    return run_first_estimates(measurements, config.ekf)


def _ekf_robot(measurements: Measurements, config: RunConfig, done: Estimates) -> Estimate:
    from graphslam.consistent import run_robot_centred

    return run_robot_centred(measurements, config.ekf)


def _smoother(measurements: Measurements, config: RunConfig, done: Estimates) -> Estimate:
    try:
        from graphslam.smoother import smooth
    except ModuleNotFoundError as missing:
        if missing.name != "gtsam":
            raise
        raise BadConfig(
            "the method smoother needs GTSAM, which is not installed (there is no wheel for "
            "Windows): pip install gtsam, or leave it out with --methods odometry ekf"
        ) from missing
    return smooth(measurements, initial=done["ekf"], config=config.smoother)


METHODS: Mapping[str, Method] = MappingProxyType(
    {
        "odometry": Method(_odometry),
        "ekf": Method(_ekf),
        "ekf-fej": Method(_ekf_fej),
        "ekf-robot": Method(_ekf_robot),
        "smoother": Method(_smoother, after=("ekf",)),
    }
)


def run_methods(
    measurements: Measurements, config: RunConfig, stage: Stage
) -> tuple[dict[str, Estimate], dict[str, GraphSlamError]]:
    """Returns the estimates of ``config.methods``, in that order, and why others failed, by name.

    A method that starts from another's estimate has that one run first, once, asked for or not. A
    method that the measurements do not suffice for does not stop the others.

    Args:
        measurements: what all methods estimate from.
        config: the methods and their configuration.
        stage: called with a method's name and the call that runs it; returns what the call does.

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
        try:
            done[name] = stage(name, lambda: METHODS[name].run(measurements, config, done))
        except UnderConstrained as error:
            failed[name] = error

    for name in config.methods:
        attempt(name)
    return {name: done[name] for name in config.methods if name in done}, failed
