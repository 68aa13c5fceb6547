"""Recordings as other formats: a log folder, an MCAP file, a ROS 1 or a ROS 2 bag."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from compare.folders import whole_file, writing
from compare.interchange.formats import RECORDINGS, Format
from compare.results import whole_folder
from frontend.images import image_file
from frontend.log import Log
from frontend.readers.scans_npz import write_scans
from frontend.write_bag import left_out, robot_file_text, write_bag
from frontend.write_folder import write_images_csv, write_landmarks, write_log, write_map
from graphslam.errors import BadConfig

Progress = Callable[[int, int], None]


def export_recording(
    log: Log, to: Format, out: Path | str, progress: Progress | None = None
) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Writes a recording in another format; one image or scan is held at a time.

    Beside a bag stand ``NAME.robot.toml``, the robot file for reading it, ``NAME.map.csv`` where
    the log has true lines, and ``NAME.landmarks.csv`` where it has known lamps or points.

    Args:
        log: the recording.
        to: "folder", "mcap", "rosbag1" or "rosbag2".
        out: the file, or for "folder" and "rosbag2" the folder, which must not exist.
        progress: called with (messages or images written, all).

    Returns:
        What was written; and what of the log the format cannot hold, or could not be read.

    Raises:
        BadConfig: ``out`` exists and is not replaced, or the format cannot hold the log's times.
        OSError: it cannot be written; the message names the place and the cure.
    """
    if to not in RECORDINGS:
        raise BadConfig(f"a recording cannot be written as {to!r}; known: {', '.join(RECORDINGS)}")
    out = Path(out)
    if to == "folder":
        with whole_folder(out, _absent) as fresh:
            notes = _folder(log, fresh, progress)
        return (out,), notes
    if to == "rosbag2":
        _absent(out)
        with whole_folder(out, _absent) as fresh:
            fresh.rmdir()
            write_bag(log, fresh, to, progress=progress)
            for file in fresh.iterdir():  # named after the folder, as rosbag2 does
                content = file.with_name(file.name.replace(fresh.name, out.name, 1))
                if file.name == "metadata.yaml":
                    text = file.read_text(encoding="utf-8")
                    file.write_text(text.replace(f"{fresh.name}.db3", f"{out.name}.db3"), "utf-8")
                else:
                    file.rename(content)
    else:
        if out.is_dir():
            raise BadConfig(f"{out}: is a folder; give the file to write")
        with writing(out):
            out.parent.mkdir(parents=True, exist_ok=True)
            with whole_file(out) as beside:
                beside.unlink(missing_ok=True)
                write_bag(log, beside, to, progress=progress)  # type: ignore[arg-type]
    parts = [f"{part} are left out: no message of a bag holds them" for part in left_out(log)]
    return (out, *_beside(log, out)), tuple(parts)


def _absent(folder: Path) -> None:
    if folder.exists() or folder.is_symlink():
        raise BadConfig(f"{folder}: exists already; give another --out, or remove it first")


def _beside(log: Log, out: Path) -> list[Path]:
    """Writes the robot file of a bag, its map and its landmarks; returns their paths."""
    stem = out.name if out.is_dir() else out.stem
    robot = out.with_name(f"{stem}.robot.toml")
    written: dict[str, Path] = {}
    for part, known, write in (
        ("map", log.map, write_map),
        ("landmarks", log.landmarks, write_landmarks),
    ):
        if known is not None:
            written[part] = out.with_name(f"{stem}.{part}.csv")
            write(written[part], known)
    names = {f"{part}_file": path.name for part, path in written.items()}
    robot.write_text(robot_file_text(log, **names), encoding="utf-8", newline="\n")
    return [robot, *written.values()]


def _folder(log: Log, folder: Path, progress: Progress | None) -> tuple[str, ...]:
    write_log(folder, log, exact=True)
    notes = []
    if log.scans is not None:
        lost = write_scans(folder / "scans.npz", log.scans)
        if lost:
            notes.append(f"{lost} scans could not be read and were left out")
    if log.images is not None:
        images = log.images
        (folder / "images").mkdir()
        rows, lost = [], 0
        for number, image in enumerate(images.file):
            found = image_file(image)
            if found is None:
                lost += 1
            else:
                file = f"images/{number:06d}{found[0]}"
                (folder / file).write_bytes(found[1])
                rows.append((number, file))
            if progress is not None:
                progress(number + 1, len(images.file))
        if rows:
            kept, files = zip(*rows, strict=True)
            cameras = [images.camera[k] for k in kept]
            write_images_csv(folder, images.t[list(kept)], files, cameras)
        if lost:
            notes.append(f"{lost} images could not be read and were left out")
    return tuple(notes)
