"""Value scorer: small objects are where furniture is (docs/tutorials/your-own-detector.md).

helios up --scorer helios_examples.on_furniture:OnFurniture
"""

from collections.abc import Mapping, Sequence

from helios_core.types import Frame
from helios_detector.backend import ScorerBackend, Seen

FURNITURE = {"table", "shelf", "desk", "counter", "nightstand", "side table", "sofa"}


class OnFurniture(ScorerBackend):
    """Scorer that gives every layer the best score of the furniture in the image; at least 0.1."""

    name = "on-furniture"
    reads_names = True

    def score(
        self, frame: Frame, seen: Sequence[Seen], prompts: Mapping[str, str]
    ) -> dict[str, float]:
        best = max([s.score for s in seen if s.class_name in FURNITURE], default=0.0)
        return {layer: max(best, 0.1) for layer in prompts}

    def warm_up(self) -> None:
        """Do nothing: there is no model."""

    def close(self) -> None:
        """Do nothing: there is no model."""
