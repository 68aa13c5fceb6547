"""The plot of what would help."""

from __future__ import annotations

import numpy as np

from compare.plots_style import INK, METHOD_COLOURS, WIDTH, Plot, figure, legend, stride, to_svg
from compare.what_if import LENGTHS, QUANTITIES, WhatIf
from graphslam.geometry import points_on_line
from graphslam.models.line import LINE

HEIGHTS = (2.4, 5.0)
"""Of the plan, least and most, inches."""


def draw_what_if(result: WhatIf) -> Plot:
    """Returns the bound of each quantity after each change, as bars beside that of today."""
    count = len(result.predictions)
    made, [row] = figure(1.0 + 0.38 * max(count, 2), 1, len(LENGTHS), gap=(0.35, 0.15), sharey=True)
    made.subplots_adjust(left=0.33, bottom=0.5 / (1.0 + 0.38 * max(count, 2)))
    names = [entry.change for entry in result.predictions]
    data: dict[str, list[object]] = {"change": ["as it is", *names]}
    for ax, quantity in zip(row, LENGTHS, strict=True):
        field = QUANTITIES[quantity]
        now = 1e3 * float(getattr(result.now.bound, field))
        then = [1e3 * float(getattr(entry.bound, field)) for entry in result.predictions]
        data[f"{field.removesuffix('_m')}_mm"] = [now, *then]
        ax.barh(np.arange(count), then, height=0.62, color=METHOD_COLOURS["smoother"], alpha=0.6)
        if np.isfinite(now):
            ax.axvline(now, color=INK, lw=1.2)
            ax.set_xlim(0.0, 1.15 * max([now, *[v for v in then if np.isfinite(v)]]))
        ax.set(xlabel=f"{quantity} (mm)", yticks=range(count))
        ax.grid(visible=False, axis="y")
    row[0].set_yticklabels(names)
    row[0].invert_yaxis()
    return Plot(
        "what-if",
        "What would help",
        "Bars: the best possible RMS error after each change, in millimetres, floor frame, one "
        "sigma from the known start; black: as it is.",
        to_svg(made, "what-if", "Bound after each change"),
        data,
    )


def draw_plan(result: WhatIf) -> Plot:
    """Returns the plan of the floor: the way, today's lines, and those that would be added."""
    now = result.situation
    path = now.pose[:: stride(len(now.pose)), :2]
    _, lines = now.landmarks.of_kind(LINE.kind)
    margin = 0.3 + 0.05 * np.ptp(path, axis=0).max()
    low, high = path.min(axis=0) - margin, path.max(axis=0) + margin
    height = WIDTH * 0.86 * (high[1] - low[1]) / (high[0] - low[0]) + 0.7
    made, [[ax]] = figure(float(np.clip(height, *HEIGHTS)))
    ax.set_aspect("equal", adjustable="box")
    reach = 2.0 * float(np.abs([low, high]).max()) * np.array([[-1.0, 1.0]])
    kinds = (
        ("lines", lines, {"color": INK, "lw": 0.8, "alpha": 0.5}),
        ("lines added", result.added, {"color": METHOD_COLOURS["odometry"], "dashes": (6, 3)}),
    )
    data: dict[str, list[object]] = {"what": ["way"] * len(path), "number": [0] * len(path)}
    points = [path]
    for label, params, style in kinds:
        for number, ends in enumerate(points_on_line(params[:, None, :], reach)):
            ax.plot(*ends.T, label=label if number == 0 else None, **style)
            data["what"] += [label] * 2
            data["number"] += [number] * 2
            points.append(ends)
    ax.plot(*path.T, color=METHOD_COLOURS["smoother"], lw=1.6, label="way")
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x (m)", ylabel="y (m)")
    legend(made)
    x, y = np.concatenate(points).T
    return Plot(
        "plan",
        "Where added lines would lie",
        "Floor frame, metres: the robot's way, the lines that it saw, drawn right across, and "
        "dashed the lines that the first change adds. Where along their normals they begin does "
        "not matter.",
        to_svg(made, "plan", "Floor plan with added lines"),
        {**data, "x_m": x, "y_m": y},
    )
