"""The ways of matching that are compared: filters and smoothers, each by its name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from matching_cases import Case

from graphslam.association import Compatibility
from graphslam.config import EkfConfig, Matching, MatchingConfig, Robust, SmootherConfig
from graphslam.ekf import Filter, run_ekf
from graphslam.estimate import Estimate
from graphslam.measurements import IntArray, Sightings
from graphslam.models import Model
from graphslam.smoother import smooth


class Proposed(Filter):
    """A filter that is told which line each sighting is of, and believes what passes its gate."""

    def fit(
        self, model: Model, table: Sightings, rows: IntArray, landmarks: IntArray
    ) -> Compatibility:
        """Returns distances to the proposed landmark only; what does not fit it is dropped."""
        fit = super().fit(model, table, rows, landmarks)
        own = table.truth[rows][:, None] == self.roster.identity[landmarks]
        return Compatibility(np.where(own, fit.match, np.inf), np.where(own, 0.0, np.inf))


def by_filter(method: Matching, case: Case) -> Estimate:
    """Returns the filter's estimate with one way of matching; of a case's proposals if any."""
    config = EkfConfig(MatchingConfig(method=method))
    if case.labels is None or method == "known":
        return run_ekf(case.measurements, config)
    return Proposed(case.labelled(), config, None).run()


def by_smoother(
    robust: Robust,
    case: Case,
    start: Matching = "gated",
    odometry: bool = False,
    rematch: bool = False,
) -> Estimate:
    """Returns the smoother's estimate from a filter's; from all of a case's proposals if any.

    Args:
        robust: kernel on sightings.
        case: what to estimate.
        start: how the filter matches whose matches it takes; "known": the true ones.
        odometry: whether the kernel is on odometry, too.
        rematch: whether matches are decided again.
    """
    config = SmootherConfig(
        engine="chain", robust=robust, robust_odometry=odometry, rematch=rematch
    )
    measurements = case.measurements
    if case.labels is not None and start != "known":
        measurements, start = case.labelled(), "known"
    initial = run_ekf(measurements, EkfConfig(MatchingConfig(method=start)))
    return smooth(case.measurements, initial, config)


METHODS: Mapping[str, Callable[[Case], Estimate]] = {
    "filter, known": partial(by_filter, "known"),
    "filter, nearest": partial(by_filter, "nearest"),
    "filter, gated": partial(by_filter, "gated"),
    "filter, jcbb": partial(by_filter, "jcbb"),
    "smoother, known": partial(by_smoother, "none", start="known"),
    "smoother": partial(by_smoother, "none"),
    "smoother, huber": partial(by_smoother, "huber"),
    "smoother, cauchy": partial(by_smoother, "cauchy"),
    "smoother, gnc": partial(by_smoother, "gnc"),
    "smoother, gnc, odometry too": partial(by_smoother, "gnc", odometry=True),
    "smoother, rematch": partial(by_smoother, "none", rematch=True),
    "smoother, rematch, gnc": partial(by_smoother, "gnc", rematch=True),
    "smoother, rematch, gnc, odometry too": partial(
        by_smoother, "gnc", odometry=True, rematch=True
    ),
}
