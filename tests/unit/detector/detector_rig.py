"""A detector service on an in-memory bus, with its ground truth and what it publishes."""

from detector_scene import SceneTruth, context_of
from helios_core import proto as pb
from helios_core.codec import context_to_proto, frame_to_proto
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import CONTEXT, DETECTOR_ACK, OBSERVATION, PREVIEW
from helios_core.types import SearchContext
from helios_detector.backend import DetectorBackend, Findings, ScorerBackend
from helios_detector.coco_classes import COCO_NAMES
from helios_detector.lexical_scorer import LexicalScorer
from helios_detector.service import DetectorService
from helios_detector.simulation.ground_truth_detector import GroundTruthDetector
from helios_detector.vocabulary_matching import fixed_wanted

CONTEXT_1 = SearchContext(
    "c1", context_of("mug", "dining table").classes, {"pick": "a mug", "place": "a bed"}
)


class Rig:
    """A detector service, its ground truth, and what it publishes."""

    def __init__(
        self, detector: DetectorBackend | None = None, scorer: ScorerBackend | None = None
    ) -> None:
        self.truth = SceneTruth()
        hub = MemoryHub()
        self.health = Health()
        self.bus = MemoryBus(hub)
        self.observations: list[pb.Observation] = []
        self.previews: list[pb.Preview] = []
        self.bus.subscribe(OBSERVATION, self.observations.append)
        self.bus.subscribe(PREVIEW, self.previews.append)
        self.acks: list[pb.Ack] = []
        self.bus.subscribe(DETECTOR_ACK, self.acks.append)
        backend = detector or GroundTruthDetector(self.truth)
        self.service = DetectorService(
            MemoryBus(hub), backend, scorer or LexicalScorer(), self.health
        )

    def frame(self, seq: int = 1) -> pb.Frame:
        return frame_to_proto(self.truth.frame(seq=seq))

    def look_for(self, context: SearchContext = CONTEXT_1) -> None:
        self.bus.publish(CONTEXT, context_to_proto(context))

    def count(self, name: str) -> float:
        return self.health.metrics().get(name, 0)


class Faulty(DetectorBackend):
    """Raises an error type that no back end should raise."""

    name = "faulty"

    def vocabulary(self) -> tuple[str, ...]:
        return COCO_NAMES

    def refused(self, context):
        return fixed_wanted(context, COCO_NAMES)[1]

    def detect(self, frame, context) -> Findings:
        raise ZeroDivisionError("model")

    def warm_up(self) -> None:
        """Needs no warm-up."""

    def close(self) -> None:
        """Holds no resources."""
