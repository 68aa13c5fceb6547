"""The numbers that tables over many runs hold about each method."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from compare.comparison import MethodMetrics


@dataclass(frozen=True, slots=True)
class Figure:
    """One number about a method in a run.

    Attributes:
        name: column of runs.csv.
        label: what tables for people call it.
        unit: its unit in such tables.
        scale: factor from the column to that unit.
        of: takes the method's metrics; returns the number, NaN or None where it is not defined.
        worst: which of many is the worst.
    """

    name: str
    label: str
    unit: str
    scale: float
    of: Callable[[MethodMetrics], float | None]
    worst: Callable[[Sequence[float]], float] = max


FIGURES = (
    Figure("rmse_m", "path RMSE", "mm", 1e3, lambda m: m.trajectory and m.trajectory.rmse_m),
    Figure(
        "aligned_rmse_m",
        "path RMSE, aligned",
        "mm",
        1e3,
        lambda m: m.trajectory and m.trajectory.aligned_rmse_m,
    ),
    Figure(
        "final_error_m",
        "final error",
        "mm",
        1e3,
        lambda m: m.trajectory and m.trajectory.final_error_m,
    ),
    Figure(
        "aligned_final_error_m",
        "final error, aligned",
        "mm",
        1e3,
        lambda m: m.trajectory and m.trajectory.aligned_final_error_m,
    ),
    Figure(
        "heading_rmse_deg",
        "heading RMSE",
        "°",
        1.0,
        lambda m: m.trajectory and m.trajectory.heading_rmse_deg,
    ),
    Figure("map_rmse_m", "map RMSE", "mm", 1e3, lambda m: m.map and m.map.rho_rmse_m),
    Figure("alpha_rmse_deg", "map angle RMSE", "°", 1.0, lambda m: m.map and m.map.alpha_rmse_deg),
    Figure("matched", "lines matched", "", 1.0, lambda m: m.map and m.map.matched, min),
    Figure("missed", "lines missed", "", 1.0, lambda m: m.map and m.map.missed),
    Figure("spurious", "lines spurious", "", 1.0, lambda m: m.map and m.map.spurious),
    Figure("duplicates", "lines twice", "", 1.0, lambda m: m.map and m.map.duplicates),
    Figure("pose_nees", "pose NEES", "", 1.0, lambda m: m.pose_nees),
    Figure("map_nees", "map NEES", "", 1.0, lambda m: m.map and m.map.nees),
    Figure(
        "right_share",
        "right matches",
        "%",
        1e2,
        lambda m: m.matching and m.matching.right_share,
        min,
    ),
    Figure("nis", "NIS per dimension", "", 1.0, lambda m: m.nis_per_dof),
)

STUDY_FIGURES = (
    *FIGURES,
    Figure(
        "map_start_nees",
        "map NEES, start's frame",
        "",
        1.0,
        lambda m: m.map and m.map.start_nees,
    ),
    Figure(
        "unaligned_map_rmse_m",
        "map RMSE, start's frame",
        "mm",
        1e3,
        lambda m: m.map and m.map.unaligned_rho_rmse_m,
    ),
)
"""Those of a study: its start is known, so that the frame counts, too."""

BOUNDS = (
    ("path", "rmse_m", "path_m"),
    ("last pose", "final_error_m", "final_m"),
    ("heading", "heading_rmse_deg", "heading_deg"),
    ("map", "unaligned_map_rmse_m", "map_m"),
)
"""Quantity, the figure that is its error, and the field of `compare.bound.Bound` that bounds it."""
