"""Fixtures shared by all tests."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session", autouse=True)
def cache_of_its_own(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Keeps the tests out of the user's cache; commands that they start inherit it."""
    os.environ["GRAPHSLAM_CACHE"] = str(tmp_path_factory.mktemp("cache"))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real recordings that is not part of the project; skips where it is absent."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("GRAPHSLAM_SHARED_DATA", default))
    if not folder.is_dir():
        pytest.skip(f"real recordings are not here: {folder} (set GRAPHSLAM_SHARED_DATA)")
    return folder
