"""The project as a user gets it: a wheel, used outside the clone."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the packages of a freshly built wheel, and nothing else."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    for name in ("graphslam", "frontend", "compare", "pyproject.toml", "README.md", "LICENSE"):
        _copy(ROOT / name, source / name)
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    _run([*build, "--wheel-dir", str(folder), str(source)], folder)
    (wheel,) = folder.glob("*.whl")
    target = folder / "site"
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps"]
    _run([*install, "--target", str(target), str(wheel)], folder)
    return target


def _copy(source: Path, target: Path) -> None:
    if source.is_file():
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(source.read_bytes())
        return
    for path in source.rglob("*"):
        if path.is_file() and "__pycache__" not in path.parts:
            _copy(path, target / path.relative_to(source))


def _run(command: list[str], cwd: Path, **env: str) -> str:
    done = subprocess.run(
        command, cwd=cwd, env={**os.environ, **env}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_scenarios_and_templates_work_from_a_wheel_outside_the_clone(
    installed: Path, tmp_path: Path
) -> None:
    code = (
        "import sys, compare, frontend, graphslam\n"
        f"assert all(m.__file__.startswith({str(installed)!r}) for m in (compare, frontend))\n"
        "from compare.cli import main\n"
        "assert main(['simulate', 'santana-slam', '--out', 'log']) == 0\n"
        "assert main(['run', 'log', '--out', 'result', '--every', '8']) == 0\n"
        "from compare.printed import printed_paper\n"
        "assert printed_paper('SantanaLoc') and printed_paper('SantanaSLAM')\n"
    )
    _run([sys.executable, "-c", code], tmp_path, PYTHONPATH=str(installed))
    assert (tmp_path / "log" / "log.toml").is_file()
    assert (tmp_path / "result" / "report.html").stat().st_size > 50_000
