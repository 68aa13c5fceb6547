"""All plots of a run."""

from __future__ import annotations

from compare.plots_errors import errors_over_time
from compare.plots_map import map_errors
from compare.plots_plan import floor_plan
from compare.plots_sightings import (
    innovations_along_the_way,
    innovations_over_time,
    matches_per_landmark,
    sightings_per_node,
)
from compare.plots_style import Plot, style
from compare.plots_uncertainty import line_variance, pose_consistency, variances
from compare.plots_walls import walls
from compare.record import Record

DRAWINGS = (
    floor_plan,
    walls,
    errors_over_time,
    map_errors,
    matches_per_landmark,
    sightings_per_node,
    innovations_over_time,
    innovations_along_the_way,
    variances,
    line_variance,
    pose_consistency,
)


def draw(record: Record) -> dict[str, Plot]:
    """Returns the plots of a run by name; those that the run has no data for are left out."""
    with style():
        plots = [drawing(record) for drawing in DRAWINGS]
    return {plot.name: plot for plot in plots if plot is not None}
