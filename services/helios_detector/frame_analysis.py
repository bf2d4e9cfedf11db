"""Analysis of one frame by the models: detections, scores and timing.

Every exception of a back end becomes a typed error, and every output is checked (`output_checks`).
An error names the back end, its method and the log.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from helios_core.errors import DeadlineExceeded, HeliosError, Internal, Unavailable
from helios_core.health import Health
from helios_core.log_location import log_place
from helios_core.log_rate_limit import LogRateLimit
from helios_core.types import Embedding, Frame, SearchContext

from helios_detector.backend import DetectorBackend, Findings, ScorerBackend
from helios_detector.memory_usage import resident_mb
from helios_detector.model_set import Models
from helios_detector.output_checks import (
    OutputFaults,
    checked_findings,
    checked_judgement,
    checked_refusals,
    checked_vocabulary,
)

log = logging.getLogger(__name__)

ATTEMPTS = 3  # per frame, while a dependency of the back end does not answer

T = TypeVar("T")


@dataclass(frozen=True)
class Ratings:
    """Image-text scores of one frame, 0 to 1."""

    layer_scores: dict[str, float]
    class_scores: dict[str, float]  # empty if the scorer reads the detector's names
    image: Embedding | None = None


class FrameAnalyzer:
    """The models with checks and metrics. Calls may come from several threads at once."""

    def __init__(self, models: Models, health: Health) -> None:
        self.models, self._health = models, health
        self._seldom = LogRateLimit(log)

    def vocabulary(self) -> tuple[str, ...] | None:
        """The detector's names; None for an open vocabulary. Raises HeliosError."""
        detector = self.models.detector
        return self._checked(
            detector, "vocabulary", lambda: checked_vocabulary(detector.vocabulary())
        )

    def refused(self, context: SearchContext) -> dict[str, str]:
        """Class name -> reason why the detector cannot find it. Raises HeliosError."""
        detector = self.models.detector
        return self._checked(
            detector, "refused", lambda: checked_refusals(detector.refused(context))
        )

    def detect(self, frame: Frame, context: SearchContext) -> tuple[Findings, str]:
        """(findings, one sentence on dropped entries, empty without any).

        Retries while the back end is Unavailable or exceeds its deadline. Without search classes it
        does not run the back end. Raises HeliosError.
        """
        if not context.classes:
            return Findings((), ()), ""
        detector = self.models.detector
        asked = {c.name for c in context.classes} | set(context.also)
        for attempt in range(1, ATTEMPTS + 1):
            try:
                findings, wrong = self._checked(
                    detector,
                    "detect",
                    lambda: checked_findings(
                        detector.detect(frame, context), frame.depth_m.shape, asked
                    ),
                )
                return findings, self._note(detector, "detect", frame, wrong)
            except (Unavailable, DeadlineExceeded) as error:
                self._health.count("detect_retries")
                if attempt == ATTEMPTS:
                    raise
                log.warning("frame %s: %s; asking again", frame.id, error.message)
        raise AssertionError("not reached")

    def judge(
        self, frame: Frame, findings: Findings, context: SearchContext
    ) -> tuple[Ratings, str]:
        """(scores of all prompts in one pass, one sentence on dropped entries). Does not run the
        scorer for a context without prompts and classes. Raises HeliosError."""
        if not (context.prompts or context.classes):
            return Ratings({}, {}), ""
        scorer = self.models.scorer
        key_of = {} if scorer.reads_names else class_keys(context)
        prompts = context.prompts | {
            key: context.class_prompts[name]
            for name, key in key_of.items()
            if key not in context.prompts
        }
        judgement, wrong = self._checked(
            scorer,
            "score",
            lambda: checked_judgement(scorer.judge(frame, findings.seen, prompts), prompts.keys()),
        )
        scores = judgement.scores
        rated = Ratings(
            {layer: scores[layer] for layer in context.prompts if layer in scores},
            {name: scores[key] for name, key in key_of.items() if key in scores},
            judgement.image,
        )
        return rated, self._note(scorer, "score", frame, wrong)

    def timed(self, what: str, began: float) -> float:
        """Milliseconds since `began` (of `time.perf_counter`), also recorded as a metric."""
        took_ms = (time.perf_counter() - began) * 1e3
        self._health.sample(f"{what}_ms", took_ms)
        return took_ms

    def measure(self) -> None:
        """Record the memory use after a frame as metrics."""
        self._health.set("memory_mb", resident_mb())
        peak_mb = self.models.accelerator_mb()
        if peak_mb > 0:
            self._health.sample("accelerator_mb", peak_mb)

    def _checked(self, of: DetectorBackend | ScorerBackend, method: str, ask: Callable[[], T]) -> T:
        """Call a back end's method. Raises HeliosError, which names the back end at fault."""
        who = f"the {kind_of(of)} {of.name}"
        try:
            return ask()
        except Internal as error:  # from `output_checks`: the whole output is unusable
            said = f"{who} gave what cannot be used, in {method}(): {error.message}"
            self._seldom.warn((of.name, method, said), said)
            raise Internal(f"{said}; see {log_place()}") from error
        except HeliosError:
            raise
        except (
            Exception,
            SystemExit,
        ) as error:  # a fault of the back end must not drop the frame silently
            said = f"{who} failed in {method}() ({type(error).__name__}: {error})"
            self._seldom.warn((of.name, method, type(error)), said, error)
            raise Internal(f"{said}; the traceback is in {log_place()}") from error

    def _note(
        self, of: DetectorBackend | ScorerBackend, method: str, frame: Frame, wrong: OutputFaults
    ) -> str:
        for what, count in wrong.counts.items():
            self._health.count(what, count)
        if not wrong.descriptions:
            return ""
        said = f"the {kind_of(of)} {of.name} gave in {method}() {wrong.sentence}"
        kinds = tuple(sorted(wrong.descriptions))
        self._seldom.warn((of.name, method, kinds), f"frame {frame.id}: {said}")
        return f"{said}; see {log_place()}"


def class_keys(context: SearchContext) -> dict[str, str]:
    """Class name -> key of its score: the value layer with the same prompt, else one of its own."""
    layer_of = {prompt: layer for layer, prompt in context.prompts.items()}
    return {
        name: layer_of.get(prompt, f"class {name}")
        for name, prompt in context.class_prompts.items()
    }


def kind_of(back_end: DetectorBackend | ScorerBackend) -> str:
    """Word for the back end in messages: detector or scorer."""
    return "detector" if isinstance(back_end, DetectorBackend) else "scorer"
