"""Files of the study: the saved map of a home, and the maps of a later session step by step."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from helios_core.atomic_file import write_file
from helios_core.errors import InvalidInput
from helios_core.geometry import Matrix
from helios_core.map_snapshot import UNKNOWN
from helios_core.npz_reading import unpacked
from helios_map2d.relocalisation.grid_fields import OccupancyGrid
from helios_map2d.relocalisation.landmarks import Landmark
from numpy.typing import NDArray

from helios_eval.studies.relocalisation.sessions import Moment, SavedMap, Session


@dataclass(frozen=True)
class RecordedMoment:
    """Maps of a later session after an action, and the truth about its frame."""

    step: int
    grid: OccupancyGrid
    landmarks: tuple[Landmark, ...]
    T_estimated_true: Matrix

    @property
    def middle_m(self) -> NDArray[np.float64]:
        """Middle [2] of the known cells, at which errors are measured."""
        return self.grid.centres_of(self.grid.occupancy != UNKNOWN).mean(axis=0)


@dataclass(frozen=True)
class Recording:
    """First visit of a home, and a later session from a random start."""

    seed: int
    sensor: str
    first_found_step: int  # actions until the first visit found the object; 0: not found
    saved: SavedMap
    moments: tuple[RecordedMoment, ...]


def path_of(folder: Path, seed: int, sensor: str) -> Path:
    return folder / f"{seed}-{sensor}.npz"


def write(folder: Path, seed: int, sensor: str, first: Session, moments: list[Moment]) -> Path:
    """Write the recording of a home."""
    about = {
        "seed": seed,
        "sensor": sensor,
        "first_found_step": first.found_step,
        "moments": [
            {
                "step": m.step,
                "origin_m": list(m.view.origin_m),
                "cell_m": m.view.cell_m,
                "T_estimated_true": m.T_estimated_true.ravel().tolist(),
                "objects": [[o.center_m.tolist(), dict(o.probabilities)] for o in m.objects],
            }
            for m in moments
        ],
    }
    arrays: dict[str, NDArray] = {
        "about": np.frombuffer(json.dumps(about).encode(), np.uint8),
        "map2d": np.frombuffer(first.saved.map2d, np.uint8),
        "objects": np.frombuffer(first.saved.objects, np.uint8),
    }
    arrays |= {f"occupancy.{i}": m.view.occupancy for i, m in enumerate(moments)}
    out = io.BytesIO()
    np.savez_compressed(out, allow_pickle=False, **arrays)
    path = path_of(folder, seed, sensor)
    write_file(path, out.getvalue())
    return path


def read(path: Path) -> Recording:
    """Recording of a file. Raises InvalidInput for another file, OSError."""
    try:
        arrays = unpacked(path.read_bytes())
        about = json.loads(arrays["about"].tobytes())
        return Recording(
            about["seed"],
            about["sensor"],
            about["first_found_step"],
            SavedMap(arrays["map2d"].tobytes(), arrays["objects"].tobytes()),
            tuple(_moment(m, arrays[f"occupancy.{i}"]) for i, m in enumerate(about["moments"])),
        )
    except (ValueError, KeyError) as error:
        raise InvalidInput(f"{path} is no recording of this study: `play` writes them") from error


def _moment(about: Mapping, occupancy: NDArray[np.int8]) -> RecordedMoment:
    x_m, y_m = about["origin_m"]
    marks = tuple(landmark(center, probabilities) for center, probabilities in about["objects"])
    T = np.array(about["T_estimated_true"]).reshape(4, 4)
    grid = OccupancyGrid(occupancy, (x_m, y_m), about["cell_m"])
    return RecordedMoment(about["step"], grid, marks, T)


def landmark(center_m: list[float], probabilities: Mapping[str, float]) -> Landmark:
    """Landmark of an object."""
    x, y, z = center_m
    return Landmark((x, y, z), {n: p for n, p in probabilities.items() if n != "other"})
