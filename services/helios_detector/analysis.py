"""A frame through the models: what was found, how it scores, and what each of it took.

Whatever a back end raises becomes a typed error; whatever it gives is held to its contract.
"""

from __future__ import annotations

import logging
import time
from collections import Counter

from helios_core.errors import DeadlineExceeded, HeliosError, Internal, Unavailable
from helios_core.health import Health
from helios_core.types import Frame, SearchContext

from helios_detector.backend import Findings, Judgement
from helios_detector.contract import held_findings, held_judgement
from helios_detector.memory import resident_mb
from helios_detector.models import Models

log = logging.getLogger(__name__)

ATTEMPTS = 3  # at a frame when what the back end needs does not answer


class Analyst:
    """The models with their figures. Calls may come from several threads at once."""

    def __init__(self, models: Models, health: Health) -> None:
        self.models, self._health = models, health

    def detect(self, frame: Frame, context: SearchContext) -> Findings:
        """Asks again where what the back end needs did not answer; nothing is asked where no class
        is sought. Raises HeliosError."""
        if not context.classes:
            return Findings((), ())
        detector = self.models.detector
        for attempt in range(1, ATTEMPTS + 1):
            try:
                findings, wrong = held_findings(
                    detector.detect(frame, context), frame.depth_m.shape
                )
                self._note(detector.name, wrong)
                return findings
            except (Unavailable, DeadlineExceeded) as error:
                self._health.count("detect_retries")
                if attempt == ATTEMPTS:
                    raise
                log.warning("frame %s: %s; asking again", frame.id, error.message)
            except HeliosError:
                raise
            except Exception as error:  # a back end's own fault must not lose the frame silently
                raise _fault(detector.name, frame, error) from error
        raise AssertionError("not reached")

    def judge(self, frame: Frame, findings: Findings, context: SearchContext) -> Judgement:
        """Scores of all prompts in one pass; nothing is asked where the context seeks nothing.
        Raises HeliosError."""
        if not (context.prompts or context.classes):
            return Judgement({})
        scorer = self.models.scorer
        try:
            judgement, wrong = held_judgement(
                scorer.judge(frame, findings.seen, context.prompts), scorer.name
            )
        except HeliosError:
            raise
        except Exception as error:
            raise _fault(scorer.name, frame, error) from error
        self._note(scorer.name, wrong)
        return judgement

    def timed(self, what: str, began: float) -> float:
        """Milliseconds since `began` (of `time.perf_counter`), kept as a figure."""
        took_ms = (time.perf_counter() - began) * 1e3
        self._health.sample(f"{what}_ms", took_ms)
        return took_ms

    def measure(self) -> None:
        """Memory as it is after a frame."""
        self._health.set("memory_mb", resident_mb())
        peak_mb = self.models.accelerator_mb()
        if peak_mb > 0:
            self._health.sample("accelerator_mb", peak_mb)

    def _note(self, name: str, wrong: Counter[str]) -> None:
        for what, count in wrong.items():
            self._health.count(what, count)
            log.warning("%s: %d %s", name, count, what.replace("_", " "))


def _fault(name: str, frame: Frame, error: Exception) -> Internal:
    log.exception("%s failed at frame %s", name, frame.id)
    return Internal(f"{name} failed ({type(error).__name__}: {error}); see its log")
