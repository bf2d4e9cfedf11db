"""Files of the map commands: exports, saved maps, images of past views."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import typer
from helios_core import atomic_file
from helios_core.errors import Conflict, InvalidInput
from helios_core.name_rules import plain

from helios_client.answer_types import SeenView
from helios_client.sdk import Helios
from helios_client.usage_errors import UsageError

OCCUPANCY = "occupancy"


def export_map(helios: Helios, out: Path, only: str | None) -> list[Path]:
    """Write `occupancy.png` and `.npz`, and both for each `value-<layer>`; return the paths.

    Raises UsageError for an unknown layer, InvalidInput if a file cannot be written.
    """
    kinds = (OCCUPANCY, *(layer["name"] for layer in helios.map_info()["layers"]))
    wanted = kinds if only is None else [kind for kind in kinds if plain(only) == plain(kind)]
    if not wanted:
        raise UsageError(f"the map has no layer {only!r}; wanted one of {', '.join(kinds)}")
    make_folder(out)
    written = []
    for name in wanted:
        what, stem = (name, name) if name == OCCUPANCY else (f"value/{name}", f"value-{name}")
        for ending in ("png", "npz"):
            path = out / f"{stem}.{ending}"
            write_file(path, helios.map_file(what, ending))
            written.append(path)
    return written


def export_ros(helios: Helios, out: Path) -> list[Path]:
    """Write `map.pgm` and `map.yaml` for ROS's map_server; return the paths. Raises InvalidInput if
    a file cannot be written."""
    make_folder(out)
    written = []
    for name, data in helios.ros_map().items():
        path = out / Path(name).name
        write_file(path, data)
        written.append(path)
    return written


def write_views(views: Sequence[SeenView], out: Path) -> list[Path]:
    """Write the images of past views, best first; return the paths. Raises InvalidInput if a file
    cannot be written."""
    make_folder(out)
    pictured = [view for view in views if view.jpeg]
    paths = [out / f"view-{k}.jpg" for k in range(1, len(pictured) + 1)]
    for path, view in zip(paths, pictured, strict=True):
        write_file(path, view.jpeg)
    return paths


def write_file(path: Path, data: bytes) -> None:
    """Write a file atomically. Raises UsageError if its folder does not exist, and InvalidInput if
    it cannot be written; an existing file is then unchanged."""
    check_folder_of(path)
    try:
        atomic_file.write_file(path, data)
    except OSError as error:
        raise InvalidInput(
            f"{path} cannot be written: {error.strerror}; free up disk space, or name another file"
        ) from error


def make_folder(folder: Path) -> None:
    """Create a folder and its parents. Raises InvalidInput if that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InvalidInput(
            f"{folder} cannot be created: {error.strerror}; name another folder with --out"
        ) from error


def check_folder_of(file: Path) -> None:
    """Raise UsageError if the folder of a file to be written does not exist, or if the file is a
    folder."""
    if why := atomic_file.unwritable_reason(file):
        raise UsageError(why)


def confirm_reset(address: str, only: str | None) -> None:
    """Ask for confirmation on a terminal; do nothing in a script. Raises Conflict for a no."""
    if not sys.stdin.isatty():
        return
    what = "both maps, objects and occupancy" if only is None else f"the map of {only}"
    question = f"Discard {what}, of the robot at {address}? `helios map save` keeps a copy."
    if not typer.confirm(question, err=True):
        raise Conflict("nothing was discarded")


def read_file(path: Path) -> bytes:
    """Content of a saved map. Raises UsageError if it cannot be read."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise UsageError(
            f"{path} cannot be read: {error.strerror}; name a file that `helios map save` wrote"
        ) from error
