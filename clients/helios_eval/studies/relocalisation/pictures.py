"""Picture of an alignment: saved map, present map, and both together."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from helios_core.atomic_file import write_file
from helios_core.errors import InvalidInput
from helios_core.map_snapshot import FREE, OCCUPIED
from helios_map2d.relocalisation.alignment import align
from helios_map2d.relocalisation.grid_fields import OccupancyGrid, present_points
from numpy.typing import NDArray

from helios_eval.studies.relocalisation.judging import stored_map
from helios_eval.studies.relocalisation.recordings import Recording

SIDE_PX = 460
_MARGIN_PX, _TITLE_PX = 12, 34
_UNKNOWN, _FREE, _OCCUPIED = (225, 225, 225), (255, 255, 255), (70, 60, 55)  # BGR
_PRESENT = (30, 90, 230)

Picture = NDArray[np.uint8]  # [h, w, 3] BGR


def write_picture(recording: Recording, step: int, out: Path) -> None:
    """Draw the alignment after an action of the later session. Raises InvalidInput, OSError."""
    stored = stored_map(recording.saved)
    moment = next((m for m in recording.moments if m.step >= step), None)
    found = None
    if stored is not None and moment is not None:
        found = align(stored, moment.grid, moment.landmarks)
    if stored is None or moment is None or found is None:
        raise InvalidInput(f"there is nothing to align after action {step}: give another --step")
    saved = stored.fields.grid
    together = _drawn(saved)
    surface = found.T_stored_present.of(present_points(moment.grid).surface_m)
    at = np.floor((surface - saved.origin_m) / saved.cell_m).astype(int)
    rows, columns = saved.occupancy.shape
    at = at[(at >= 0).all(axis=1) & (at[:, 0] < columns) & (at[:, 1] < rows)]
    for column, row in at.tolist():
        cv2.circle(together, (column, row), 1, _PRESENT, -1)
    panels = [
        _panel(_drawn(saved), "saved map"),
        _panel(_drawn(moment.grid), f"present map after {moment.step} actions"),
        _panel(together, "present walls and furniture in the saved map"),
    ]
    gap = np.full((panels[0].shape[0], _MARGIN_PX, 3), 255, np.uint8)
    picture = np.hstack([gap, *(part for panel in panels for part in (panel, gap))])
    write_file(out, cv2.imencode(".png", picture)[1].tobytes())


def _drawn(grid: OccupancyGrid) -> Picture:
    """One pixel per cell; rows upwards."""
    out = np.full((*grid.occupancy.shape, 3), _UNKNOWN, np.uint8)
    out[grid.occupancy == FREE] = _FREE
    out[grid.occupancy == OCCUPIED] = _OCCUPIED
    return out


def _panel(picture: Picture, title: str) -> Picture:
    """Square panel with a title; y points up."""
    picture = picture[::-1]
    scale = SIDE_PX / max(picture.shape[:2])
    size = (round(picture.shape[1] * scale), round(picture.shape[0] * scale))
    drawn = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    out = np.full((SIDE_PX + _TITLE_PX + _MARGIN_PX, SIDE_PX, 3), 255, np.uint8)
    top, left = _TITLE_PX + (SIDE_PX - size[1]) // 2, (SIDE_PX - size[0]) // 2
    out[top : top + size[1], left : left + size[0]] = drawn
    at = (0, _TITLE_PX - 12)
    cv2.putText(out, title, at, cv2.FONT_HERSHEY_SIMPLEX, 0.55, (40, 40, 40), 1, cv2.LINE_AA)
    return out
