"""The 2D map of a running robot as files."""

from __future__ import annotations

from pathlib import Path

from helios_core.errors import InvalidInput

from helios_client.sdk import Helios
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
            data = helios.map_file(what, ending)
            try:
                out.mkdir(parents=True, exist_ok=True)
                path.write_bytes(data)
            except OSError as error:
                raise InvalidInput(f"{path} cannot be written: {error.strerror}") from error
            written.append(path)
    return written
