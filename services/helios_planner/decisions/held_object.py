"""What the robot knows about the object in its hand."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class HeldObject:
    """Names of the object that the robot shows to the camera.

    probability: that the asked class is right; 1 without any detection. sides: shown sides with a
    detection. names: with the share of these sides, largest first. image_text_nats: log-likelihood
    ratio of the class by image-text scores, which is in the probability; None if it is not rated.
    """

    probability: float
    sides: int
    names: tuple[tuple[str, float], ...]
    image_text_nats: float | None = None

    def share(self, name: str) -> float:
        """Share of the sides that were called by a name."""
        return dict(self.names).get(name, 0.0)
