"""Gaussians of the object map as arrays, and their display colours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from helios_core import proto as pb
from helios_core.errors import Internal
from numpy.typing import NDArray

from helios_gateway.class_colors import class_rgb

ColorBy = Literal["color", "class", "probability", "uncertainty"]
OTHER_RGB = (150, 156, 168)  # of the *other* class
MOST_DEVIATION = 0.3  # top of the colour ramp; without evidence: sqrt(1/12)


@dataclass(frozen=True)
class Gaussians:
    """n Gaussians, c classes with "other" as the first. World frame: z up, metres."""

    means_m: NDArray[np.float32]  # [n, 3]
    radii_m: NDArray[np.float32]  # [n], one standard deviation
    rgb: NDArray[np.uint8]  # [n, 3]
    opacities: NDArray[np.float32]  # [n]
    concentration: NDArray[np.float32]  # [n, c], Dirichlet concentration γ (eq. 2)
    class_names: tuple[str, ...]  # c

    @classmethod
    def of(cls, reply: pb.GaussiansReply) -> Gaussians:
        """Gaussians of a reply. Raises Internal if the array lengths do not match."""
        names, n = tuple(reply.class_names), reply.count
        try:
            return cls(
                _floats(reply.means_m).reshape(n, 3),
                _floats(reply.scales_m).reshape(n),
                np.frombuffer(reply.colors, np.uint8).reshape(n, 3),
                _floats(reply.opacities).reshape(n),
                _floats(reply.concentration).reshape(n, len(names)),
                names,
            )
        except ValueError as error:
            raise Internal(f"the object map sent Gaussians that do not fit: {error}") from error

    def __len__(self) -> int:
        return len(self.means_m)


def colored(gaussians: Gaussians, by: ColorBy) -> NDArray[np.uint8]:
    """RGB [n, 3] of the Gaussians, by one of four criteria.

    Observed colour; most likely class; probability of that class, blue to yellow; or standard
    deviation of that probability (eq. 4), blue to yellow.
    """
    if by == "color" or not len(gaussians):
        return gaussians.rgb
    total = gaussians.concentration.sum(axis=1)
    believed = gaussians.concentration.argmax(axis=1)
    if by == "class":
        palette = np.array([class_or_other_rgb(name) for name in gaussians.class_names], np.uint8)
        return palette[believed]
    share = gaussians.concentration[np.arange(len(gaussians)), believed] / total
    if by == "probability":
        return _ramp(share)
    return _ramp(np.sqrt(share * (1 - share) / (1 + total)) / MOST_DEVIATION)  # eq. 4


def class_or_other_rgb(name: str) -> tuple[int, int, int]:
    """Colour of a class; grey for "other"."""
    return OTHER_RGB if name == "other" else class_rgb(name)


def _ramp(values: NDArray[np.floating]) -> NDArray[np.uint8]:
    levels = np.clip(np.nan_to_num(values) * 255, 0, 255).astype(np.uint8)
    return np.asarray(cv2.applyColorMap(levels[None], cv2.COLORMAP_VIRIDIS)[0, :, ::-1], np.uint8)


def _floats(data: bytes) -> NDArray[np.float32]:
    return np.frombuffer(data, "<f4")
