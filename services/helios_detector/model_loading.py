"""Opening of detectors, scorers and depth models by the name in a setting.

    simulated              simulator ground truth with seeded noise
    ground-truth           simulator ground truth without noise
    onnx:FILE              YOLOX model with a fixed vocabulary, COCO's or its own (onnx_class_names)
    transformers:ID        text-prompted model from the hub or a folder (docs/how-to/models.md)
    package:Class          back end of an external package; package:Class:ARGUMENT
    NAME or NAME:ARGUMENT  entry point of an external package in the group `helios.detectors`

An external class, or a function that returns an instance, may take the parameters `argument` (str)
and `options` (DetectorOptions). Scorers work the same way; their group is `helios.scorers`.
"""

from __future__ import annotations

from typing import TypeVar

from helios_core.errors import InvalidInput
from helios_core.models.model_folder import onnx_file
from helios_core.plugins import DETECTORS, SCORERS, Kind, find, load_factory, make

from helios_detector.backend import DepthBackend, DetectorBackend, DetectorOptions, ScorerBackend

T = TypeVar("T", DetectorBackend, ScorerBackend)

_OUR_DETECTORS = ("simulated", "ground-truth", "recorded", "onnx", "transformers")
_OUR_SCORERS = ("lexical", "simulated", "minilm", "transformers")


def open_detector(spec: str, options: DetectorOptions) -> DetectorBackend:
    """The detector that `spec` names. Raises InvalidInput (wrong setting) or Unavailable."""
    kind, _, argument = spec.partition(":")
    if kind in ("simulated", "ground-truth") and not argument:
        from helios_detector.simulation.frame_noise import NoiseTable, load_noise
        from helios_detector.simulation.frame_noise_detector import FrameNoiseDetector
        from helios_detector.simulation.ground_truth_detector import GroundTruthDetector
        from helios_detector.simulation.view_noise_detector import ViewNoiseDetector

        if options.truth is None:
            raise InvalidInput(f"detector {spec!r} needs the simulator's truth; none was given")
        if kind == "ground-truth":
            return GroundTruthDetector(options.truth)
        table = load_noise(options.noise).scaled(options.noise_level, options.noise_correlation)
        if isinstance(table, NoiseTable):
            return FrameNoiseDetector(options.truth, table, options.noise_seed)
        return ViewNoiseDetector(options.truth, table, options.noise_seed)
    if kind == "onnx" and argument:
        from helios_detector.yolox_detector import YoloxDetector

        return YoloxDetector(onnx_file(argument), options.threads, options.by_similarity)
    if kind == "transformers" and argument:
        from helios_detector.hf.detector import HfDetector
        from helios_detector.hf.model_runtime import Placement

        placement = Placement(options.device, options.precision, options.threads)
        return HfDetector(spec, placement, options.masks, options.landmarks)
    if kind not in _OUR_DETECTORS and (
        made := _of_package(DETECTORS, spec, DetectorBackend, options)
    ):
        return made
    raise _unknown(DETECTORS, spec, "simulated, ground-truth, onnx:FILE, transformers:ID")


def check_plugins(detector: str, scorer: str) -> None:
    """Import the external packages that two settings name, without creating back ends.

    Raises InvalidInput.
    """
    if detector.partition(":")[0] not in _OUR_DETECTORS and (named := find(DETECTORS, detector)):
        load_factory(DETECTORS, named, DetectorBackend)
    if scorer.partition(":")[0] not in _OUR_SCORERS and (named := find(SCORERS, scorer)):
        load_factory(SCORERS, named, ScorerBackend)


def open_scorer(spec: str, options: DetectorOptions | None = None) -> ScorerBackend:
    """The scorer that `spec` names. Raises InvalidInput (wrong setting) or Unavailable."""
    options = options or DetectorOptions()
    kind, _, argument = spec.partition(":")
    if spec == "lexical":
        from helios_detector.lexical_scorer import LexicalScorer

        return LexicalScorer()
    if kind == "simulated":
        from helios_detector.simulation.view_scorer import DEFAULT_TABLE, ViewScorer

        if options.truth is None:
            raise InvalidInput(f"scorer {spec!r} needs the simulator's truth; none was given")
        return ViewScorer(options.truth, argument or DEFAULT_TABLE, options.noise_seed)
    if spec == "minilm":
        from helios_detector.minilm_scorer import MiniLmScorer

        return MiniLmScorer(options.threads)
    if kind == "transformers" and argument:
        from helios_detector.hf.model_runtime import Placement
        from helios_detector.hf.scorer import HfScorer

        placement = Placement(options.device, options.precision, options.threads)
        return HfScorer(spec, placement, options.score_head)
    if kind not in _OUR_SCORERS and (made := _of_package(SCORERS, spec, ScorerBackend, options)):
        return made
    raise _unknown(SCORERS, spec, "lexical, simulated, minilm, transformers:ID")


def open_depth(spec: str, options: DetectorOptions, focal: str) -> DepthBackend | None:
    """The depth model that `spec` names; None for `none`.

    Raises InvalidInput (wrong setting) or Unavailable.
    """
    if spec == "none":
        return None
    if spec.startswith("transformers:"):
        from helios_detector.hf.depth import HfDepth
        from helios_detector.hf.model_runtime import Placement

        return HfDepth(spec, Placement(options.device, options.precision, options.threads), focal)
    raise InvalidInput(f"there is no depth model {spec!r}; set none or transformers:ID")


def _of_package(kind: Kind, spec: str, base: type[T], options: DetectorOptions) -> T | None:
    """The back end of an external package; None if `spec` does not name one."""
    named = find(kind, spec)
    if named is None:
        return None
    offered = {"argument": named.argument, "options": options}
    return make(kind, named, base, offered, into=_nameless)


def _nameless(made: object) -> str:
    name = getattr(made, "name", None)
    if isinstance(name, str) and name.strip():
        return ""
    return f'its name is {name!r}; give the class a name, such as name = "mine"'


def _unknown(kind: Kind, spec: str, ours: str) -> InvalidInput:
    outside = ", ".join(kind.entry_names())
    also = f", or one of {outside}" if outside else ""
    return InvalidInput(
        f"there is no {kind.name} {spec!r} in this build; set {ours}, package:Class of your "
        f"own{also}; a package can add one by an entry point of the group {kind.group}"
    )
