"""The rules of the house, checked on the source."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("graphslam", "frontend", "compare")
ALLOWED = {
    "graphslam": {"graphslam"},
    "frontend": {
        "frontend",
        "graphslam.geometry",
        "graphslam.measurements",
        "graphslam.models",
        "graphslam.errors",
    },
    "compare": {"compare", "frontend", "graphslam"},
}


def imports(path: Path) -> set[str]:
    """Returns the full names of all modules and names that a file imports, wherever it does."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def files(package: str) -> list[Path]:
    return sorted((ROOT / package).rglob("*.py"))


@pytest.mark.parametrize("package", PACKAGES)
def test_imports_point_one_way(package: str) -> None:
    for path in files(package):
        ours = {name for name in imports(path) if name.split(".")[0] in PACKAGES}
        for name in ours:
            inside = any((name + ".").startswith(allowed + ".") for allowed in ALLOWED[package])
            assert inside, f"{path} imports {name}"


@pytest.mark.parametrize(
    ("library", "doors"),
    [
        ("gtsam", ("graphslam/smoother/",)),
        ("cv2", ("frontend/",)),
        ("matplotlib", ("compare/plots",)),
        ("rosbags", ("frontend/readers/bag_types", "frontend/write_bag")),
        ("networkx", ("compare/places/",)),
        ("rerun", ("compare/interchange/rerun_view",)),
        ("tyro", ("compare/cli", "compare/commands/")),
    ],
)
def test_each_library_has_its_own_door(library: str, doors: tuple[str, ...]) -> None:
    for package in PACKAGES:
        for path in files(package):
            place = path.relative_to(ROOT).as_posix()
            uses = any(name.split(".")[0] == library for name in imports(path))
            assert not uses or place.startswith(doors), f"{place} imports {library}"


def test_filter_and_smoother_never_import_each_other() -> None:
    assert not any("smoother" in name for name in imports(ROOT / "graphslam" / "ekf.py"))
    for path in (ROOT / "graphslam" / "smoother").glob("*.py"):
        assert not any(name.startswith("graphslam.ekf") for name in imports(path))


def test_filter_and_smoother_know_no_kind_of_sighting_by_name() -> None:
    for path in [ROOT / "graphslam" / "ekf.py", *(ROOT / "graphslam" / "smoother").glob("*.py")]:
        source = path.read_text(encoding="utf-8")
        assert '"line"' not in source, path
        assert '"pose_fix"' not in source, path
        for kind in ("lamp", "bearing"):
            assert f'"{kind}"' not in source, path
            assert f"models.{kind}" not in source, path
        assert "models.line" not in source, path


def test_importing_the_packages_is_light() -> None:
    heavy = ("numpy", "numba", "cv2", "gtsam", "matplotlib", "scipy", "jinja2")
    code = (
        "import sys, graphslam, frontend, compare\n"
        f"loaded = [name for name in {heavy!r} if name in sys.modules]\n"
        "sys.exit(f'loaded {loaded}' if loaded else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
