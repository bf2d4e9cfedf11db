"""What a running robot knows as files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from helios_core.errors import InvalidInput

from helios_client.sdk import Helios
from helios_client.tasks import SeenView
from helios_client.wrong_use import WrongUse

OCCUPANCY = "occupancy"


def export_map(helios: Helios, out: Path, only: str | None) -> list[Path]:
    """`occupancy.png`, `.npz`, and the same for `value-<layer>`; the paths written.

    Raises WrongUse for a layer that is not there, InvalidInput where nothing can be written.
    """
    layers = [layer["name"] for layer in helios.map_info()["layers"]]
    if only is not None and only not in (OCCUPANCY, *layers):
        raise WrongUse(f"the map has no {only!r}; wanted one of {', '.join((OCCUPANCY, *layers))}")
    written = []
    for name in [only] if only else [OCCUPANCY, *layers]:
        what, stem = (name, name) if name == OCCUPANCY else (f"value/{name}", f"value-{name}")
        for ending in ("png", "npz"):
            path = out / f"{stem}.{ending}"
            write_file(path, helios.map_file(what, ending))
            written.append(path)
    return written


def export_ros(helios: Helios, out: Path) -> list[Path]:
    """`map.pgm` and `map.yaml` for ROS's map_server; the paths written. Raises InvalidInput where
    nothing can be written."""
    written = []
    for name, data in helios.ros_map().items():
        path = out / Path(name).name
        write_file(path, data)
        written.append(path)
    return written


def write_views(views: Sequence[SeenView], out: Path) -> list[Path]:
    """The pictures of past views, best first; the paths written."""
    pictured = [view for view in views if view.jpeg]
    paths = [out / f"view-{k}.jpg" for k in range(1, len(pictured) + 1)]
    for path, view in zip(paths, pictured, strict=True):
        write_file(path, view.jpeg)
    return paths


def write_file(path: Path, data: bytes) -> None:
    """With the folders on its way. Raises InvalidInput where that cannot be."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    except OSError as error:
        raise InvalidInput(f"{path} cannot be written: {error.strerror}") from error


def read_file(path: Path) -> bytes:
    """Raises WrongUse where it cannot be read."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise WrongUse(
            f"{path} cannot be read: {error.strerror}; name a file that `helios map save` wrote"
        ) from error
