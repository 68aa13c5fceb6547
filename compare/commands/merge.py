"""`graphslam merge`."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import arg

from compare.commands.common import DONE
from compare.commands.compare import Near
from graphslam.line_maps.config import AlignmentConfig


@dataclass(frozen=True, slots=True)
class Merge:
    """Fuse two maps of one floor, by their joint covariances, into one in the first's frame.

    The maps must come from different measurements. Where the second lies in the first is found
    without a start value and estimated with the lines. The result is a map for --known-map.

    Example: graphslam merge results/monday results/friday --out floor.csv
    """

    a: Annotated[Path, tyro.conf.Positional, arg(metavar="A")]
    """A run's folder (its smoother), one method's folder in it, an estimate.npz or a map.csv with
    covariances. Its frame is kept."""
    b: Annotated[Path, tyro.conf.Positional, arg(metavar="B")]
    """The same."""
    out: Annotated[Path, arg(metavar="MAP")]
    """Map file to write, *.csv; the joint covariance goes beside it to *.npz, and where each line
    came from to *.json."""
    near: Near = None
    """Where B's frame lies in A's, about: metres, metres and degrees. Needed where B fits in
    several positions."""
    alignment: AlignmentConfig = field(default_factory=AlignmentConfig)
    """When lines agree."""

    def execute(self) -> int:
        """Writes the map and prints what became of the lines."""
        from compare.merge import merge_maps
        from compare.two_maps_words import verdict

        result = merge_maps(self.a, self.b, self.out, self.near, self.alignment)
        for warning in result.warnings:
            print(f"graphslam: warning: {warning}", file=sys.stderr)
        merged = result.merged
        both = sum(bool(i and j) for i, j in zip(merged.rows_a, merged.rows_b, strict=True))
        only_a = sum(not j for j in merged.rows_b)
        only_b = sum(not i for i in merged.rows_a)
        print(verdict(result.pair))
        print(
            f"{len(merged.map)} lines: {both} from both maps, {only_a} from {result.pair.a.label} "
            f"alone, {only_b} from {result.pair.b.label} alone"
        )
        print(self.out)
        return DONE
