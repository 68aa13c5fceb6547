"""The plot of what would help."""

from __future__ import annotations

import numpy as np

from compare.plots_style import INK, METHOD_COLOURS, Plot, figure, to_svg
from compare.what_if import QUANTITIES, WhatIf

SHOWN = ("last pose", "map", "path")


def draw_what_if(result: WhatIf) -> Plot:
    """Returns the bound of each quantity after each change, as bars beside that of today."""
    count = len(result.predictions)
    made, [row] = figure(1.0 + 0.38 * max(count, 2), 1, len(SHOWN), gap=(0.35, 0.15), sharey=True)
    made.subplots_adjust(left=0.33, bottom=0.5 / (1.0 + 0.38 * max(count, 2)))
    names = [entry.change for entry in result.predictions]
    data: dict[str, list[object]] = {"change": ["as it is", *names]}
    for ax, quantity in zip(row, SHOWN, strict=True):
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
