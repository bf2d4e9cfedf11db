"""Complete detector that knows the objects of `room.py` by their paint, and nothing else.

`--detector paint`: an entry point of the group `helios.detectors` names it (pyproject.toml).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from helios_core.errors import InvalidInput
from helios_core.types import Detection, Frame, SearchContext
from helios_detector.backend import DetectorBackend, DetectorOptions, Findings, Seen
from numpy.typing import NDArray

PAINTS = {"table": (40, 70, 200), "box": (210, 40, 40), "shelf": (50, 150, 70)}  # RGB
MIN_PX = 10


class PaintDetector(DetectorBackend):
    """Detector with score 1 for every object of which at least 10 pixels are visible."""

    name = "paint"

    def vocabulary(self) -> tuple[str, ...]:
        return tuple(PAINTS)

    def refused(self, context: SearchContext) -> Mapping[str, str]:
        return {
            c.name: f"{c.name!r} is not painted; there are {', '.join(PAINTS)}"
            for c in context.classes
            if c.name not in PAINTS
        }

    def detect(self, frame: Frame, context: SearchContext) -> Findings:
        masks = {name: (frame.color == paint).all(-1) for name, paint in PAINTS.items()}
        shown = {name: mask for name, mask in masks.items() if mask.sum() >= MIN_PX}
        for sentence in self.refused(context).values():
            raise InvalidInput(sentence)
        return Findings(
            detections=tuple(
                Detection(c.name, 1.0, _box(shown[c.name]), shown[c.name])
                for c in context.classes
                if c.name in shown
            ),
            seen=tuple(Seen(name, 1.0) for name in shown),
        )

    def warm_up(self) -> None:
        """Do nothing: there is no model."""

    def close(self) -> None:
        """Do nothing: there is no model."""


def open_paint(argument: str, options: DetectorOptions) -> PaintDetector:
    """Entry point of the detector. Raises InvalidInput for any argument: it has no options."""
    if argument:
        raise InvalidInput(f"the detector paint takes no argument; {argument!r} came")
    return PaintDetector()


def _box(mask: NDArray[np.bool_]) -> tuple[int, int, int, int]:
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1
