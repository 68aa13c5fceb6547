"""Points and ellipses on a plan."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Ellipse

from compare.plots_style import INK, method_colour
from compare.points import point_rows
from compare.record import Record
from graphslam.estimate import Estimate
from graphslam.geometry import Array

ELLIPSE_PROBABILITY = 0.95
ELLIPSE_SCALE = float(np.sqrt(-2.0 * np.log(1.0 - ELLIPSE_PROBABILITY)))
"""Half axes of a plane Gaussian's ellipse of that probability, in standard deviations."""


def draw_true_points(ax: Axes, record: Record) -> None:
    """Draws the true points as open triangles."""
    x, y = record.true_points.T
    ax.plot(x, y, "^", ms=6, mfc="none", mec=INK, mew=1.0, alpha=0.7, zorder=3)


def draw_points(ax: Axes, name: str, estimate: Estimate) -> None:
    """Draws an estimate's points, and the ellipses of those that are not known."""
    colour = method_colour(name)
    for row in point_rows(estimate.map).tolist():
        place, cov = estimate.map.params[row, :2], estimate.landmark_cov(row)
        ax.plot(*place, "o", ms=3.2, color=colour, zorder=4)
        if cov.any():
            half, angle = ellipses(cov[None])
            size = {"width": 2.0 * half[0, 0], "height": 2.0 * half[0, 1]}
            turn = float(np.degrees(angle[0]))
            ax.add_patch(Ellipse(place, **size, angle=turn, fc="none", ec=colour, lw=1.0, zorder=4))


def ellipses(cov_floor: Array) -> tuple[Array, Array]:
    """Returns half axes (n, 2), m, and angle (n,), rad, of the first, of positions' ellipses.

    They hold `ELLIPSE_PROBABILITY` of the plane Gaussians of pose covariances (n, 3, 3).
    """
    values, vectors = np.linalg.eigh(cov_floor[:, :2, :2])
    half = ELLIPSE_SCALE * np.sqrt(np.maximum(values, 0.0))
    return half, np.arctan2(vectors[:, 1, 0], vectors[:, 0, 0])
