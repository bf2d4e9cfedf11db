"""Detectors, scorers and depth models by the name that a setting gives them.

    simulated              the simulator's truth through seeded noise
    ground-truth           the simulator's truth as it is
    onnx:FILE              a YOLOX model of a fixed vocabulary: COCO's, or its own (onnx_names.py)
    transformers:ID        a text-prompted model of the hub or of a folder (docs/models.md)
    NAME or NAME:ARGUMENT  an outside package's entry point in the group `helios.detectors`

An outside package's entry point is a callable `(argument: str, options: DetectorOptions) ->
DetectorBackend`.
"""

from __future__ import annotations

from importlib.metadata import entry_points
from pathlib import Path

from helios_core.errors import InvalidInput

from helios_detector.backend import (
    DepthBackend,
    DetectorBackend,
    DetectorOptions,
    ScorerBackend,
)

ENTRY_POINTS = "helios.detectors"
SCORER_ENTRY_POINTS = "helios.scorers"


def open_detector(spec: str, options: DetectorOptions) -> DetectorBackend:
    """The back end that a setting names. Raises InvalidInput (wrong setting) or Unavailable."""
    kind, _, argument = spec.partition(":")
    if kind in ("simulated", "ground-truth") and not argument:
        from helios_detector.simulation.ground_truth import GroundTruthDetector
        from helios_detector.simulation.noise import NoiseTable, load_noise
        from helios_detector.simulation.simulated import SimulatedDetector
        from helios_detector.simulation.view_simulated import ViewDetector

        if options.truth is None:
            raise InvalidInput(f"detector {spec!r} needs the simulator's truth; none was given")
        if kind == "ground-truth":
            return GroundTruthDetector(options.truth)
        table = load_noise(options.noise).scaled(options.noise_level, options.noise_correlation)
        if isinstance(table, NoiseTable):
            return SimulatedDetector(options.truth, table, options.noise_seed)
        return ViewDetector(options.truth, table, options.noise_seed)
    if kind == "onnx" and argument:
        from helios_detector.yolox import YoloxDetector

        return YoloxDetector(Path(argument), options.threads, options.by_similarity)
    if kind == "transformers" and argument:
        from helios_detector.hf.detector import HfDetector
        from helios_detector.hf.runtime import Placement

        placement = Placement(options.device, options.precision, options.threads)
        return HfDetector(spec, placement, options.masks, options.landmarks)
    for entry in entry_points(group=ENTRY_POINTS, name=kind):
        return entry.load()(argument, options)
    outside = sorted(entry.name for entry in entry_points(group=ENTRY_POINTS))
    also = f", or one of {', '.join(outside)}" if outside else ""
    raise InvalidInput(
        f"there is no detector {spec!r} in this build; set simulated, ground-truth, onnx:FILE "
        f"or transformers:ID{also}; a package can add one by an entry point of the group "
        f"{ENTRY_POINTS}"
    )


def open_scorer(spec: str, options: DetectorOptions | None = None) -> ScorerBackend:
    """The back end that a setting names. Raises InvalidInput (wrong setting) or Unavailable."""
    options = options or DetectorOptions()
    kind, _, argument = spec.partition(":")
    if spec == "lexical":
        from helios_detector.scorer import LexicalScorer

        return LexicalScorer()
    if spec == "minilm":
        from helios_detector.minilm import MiniLmScorer

        return MiniLmScorer(options.threads)
    if kind == "transformers" and argument:
        from helios_detector.hf.runtime import Placement
        from helios_detector.hf.scorer import HfScorer

        placement = Placement(options.device, options.precision, options.threads)
        return HfScorer(spec, placement, options.score_head)
    for entry in entry_points(group=SCORER_ENTRY_POINTS, name=kind):
        return entry.load()(argument, options)
    raise InvalidInput(
        f"there is no scorer {spec!r} in this build; set lexical, minilm or transformers:ID; a "
        f"package can add one by an entry point of the group {SCORER_ENTRY_POINTS}"
    )


def open_depth(spec: str, options: DetectorOptions, focal: str) -> DepthBackend | None:
    """None for `none`. Raises InvalidInput (wrong setting) or Unavailable."""
    if spec == "none":
        return None
    if spec.startswith("transformers:"):
        from helios_detector.hf.depth import HfDepth
        from helios_detector.hf.runtime import Placement

        return HfDepth(spec, Placement(options.device, options.precision, options.threads), focal)
    raise InvalidInput(f"there is no depth model {spec!r}; set none or transformers:ID")
