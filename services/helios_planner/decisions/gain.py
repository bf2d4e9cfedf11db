"""Information gain of a candidate (eq. 12), and the units in which eq. 10 uses it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from helios_core.errors import InvalidInput

from helios_planner.settings import GainNorm


@dataclass(frozen=True)
class Gain:
    """Information gain of a local search (eq. 12), and what it may be divided by.

    gaussians: their number in the instance; area_m2: its surface seen so far; pixels: number of
    pixels that show it in the expected views, each by its coverage.
    """

    nats: float
    gaussians: int
    area_m2: float = 0.0
    pixels: float = 0.0

    def as_terms(self) -> dict[str, float]:
        """Terms of a candidate record, for `of_terms`."""
        return {
            "gain_nats": self.nats,
            "gaussians": float(self.gaussians),
            "area_m2": self.area_m2,
            "pixels": self.pixels,
        }

    @staticmethod
    def of_terms(terms: Mapping[str, float]) -> Gain | None:
        """Inverse of `as_terms`; None if the terms hold no gain."""
        if "gain_nats" not in terms:
            return None
        return Gain(terms["gain_nats"], int(terms["gaussians"]), terms["area_m2"], terms["pixels"])


def normalised_gain(gain: Gain, norm: GainNorm) -> float:
    """Information gain of a candidate in the units of eq. 10; never below 0.

    Per Gaussian and per pixel it is in nats, per area in nats per square metre. Raises InvalidInput
    if the object map has not reported the area or the pixels of a gain.
    """
    if gain.nats <= 0:
        return 0.0
    if norm == "sum":
        return gain.nats
    if norm == "per_gaussian":
        return gain.nats / max(gain.gaussians, 1)
    what, divisor = ("area", gain.area_m2) if norm == "per_area" else ("pixels", gain.pixels)
    if divisor <= 0:
        raise InvalidInput(
            f"the object map reports an information gain without its {what}, which "
            f"gain_norm={norm} needs; update the object map, or choose another gain_norm"
        )
    return gain.nats / divisor
