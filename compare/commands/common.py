"""What subcommands share: exit codes, kinds of arguments, and how an error is told."""

from __future__ import annotations

import os
import sys
import traceback
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import arg

from graphslam.errors import GraphSlamError

DONE, FAILED, USAGE, SOME_FAILED, INTERRUPTED = 0, 1, 2, 3, 130

Log = Annotated[Path, tyro.conf.Positional, arg(metavar="LOG")]
Logs = Annotated[
    tuple[Path, ...], tyro.conf.Positional, arg(metavar="LOG ...", help_behavior_hint="(required)")
]
Folder = Annotated[Path, arg(metavar="DIR")]
ResultFolder = Annotated[Path | None, arg(metavar="DIR", help_behavior_hint="")]
ConfigFile = Annotated[Path | None, arg(name="config", metavar="FILE", help_behavior_hint="")]


def complain(error: BaseException | None, log: Path | None = None) -> None:
    """Prints one line about an error, and how to report it if it is not the user's."""
    if os.environ.get("GRAPHSLAM_TRACEBACK") == "1":
        traceback.print_exception(error)
    if isinstance(error, GraphSlamError):
        text = str(error)
    elif isinstance(error, OSError):
        text = f"{error.filename or 'a file'}: {error.strerror or error}"
    else:
        text = (
            f"{type(error).__name__}: {error}; this is a defect of graphslam: please report it "
            "with what the same command prints under GRAPHSLAM_TRACEBACK=1"
        )
    where = "" if log is None or str(log) in text else f"{log}: "
    print(f"graphslam: error: {where}{' '.join(text.split())}", file=sys.stderr)
