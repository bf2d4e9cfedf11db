"""What the robot knows about the object in its hand."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class HeldObject:
    """Names of the object that the robot shows to the camera.

    probability: that the asked class is right; 1 without any detection. sides: shown sides with a
    detection. names: with the share of these sides, largest first.
    """

    probability: float
    sides: int
    names: tuple[tuple[str, float], ...]

    def share(self, name: str) -> float:
        """Share of the sides that were called by a name."""
        return dict(self.names).get(name, 0.0)
