"""A filter with some equations as printed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from graphslam.config import EkfConfig
from graphslam.ekf import Filter
from graphslam.errors import BadConfig
from graphslam.estimate import Estimate
from graphslam.measurements import Measurements
from graphslam.models.wheels import DifferentialDrive
from graphslam.printed.registry import ERRATA


def run_printed(
    measurements: Measurements,
    names: Sequence[str],
    config: EkfConfig | None = None,
    drive: DifferentialDrive | None = None,
) -> Estimate:
    """Returns what the filter makes of measurements with some errata as printed.

    Args:
        measurements: nodes, odometry, sightings, and known landmarks for localisation.
        names: errata of `ERRATA` that have a switch; none gives the right filter.
        config: matching, and what to do when lost.
        drive: wheels and noise that the increments were made with; for errata of the odometry.

    Raises:
        BadConfig: an erratum is unknown, has no switch, or needs ``drive``.
        BadMeasurements: an erratum needs raw wheel readings, and there are none.
        UnderConstrained: the printed form has ruined the filter's covariance.
    """
    unknown = [name for name in names if name not in ERRATA]
    if unknown:
        raise BadConfig(f"unknown erratum {unknown[0]!r}; known: {', '.join(ERRATA)}")
    for erratum in map(ERRATA.__getitem__, names):
        if not erratum.switchable:
            raise BadConfig(f"erratum {erratum.name!r} has no switch: {erratum.no_switch}")
        if erratum.change is not None:
            if drive is None:
                raise BadConfig(f"erratum {erratum.name!r} needs the robot's drive; give it")
            measurements = erratum.change(measurements, drive)
    switches = [e.switch for e in map(ERRATA.__getitem__, names) if e.switch is not None]
    kind = type("Printed", (*switches, Filter), {}) if switches else Filter
    estimate: Estimate = kind(measurements, config or EkfConfig(), None).run()
    return replace(estimate, method="ekf, as printed") if names else estimate
