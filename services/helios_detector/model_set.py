"""The models of one detector: opening from the settings, loading with retries, unloading."""

from __future__ import annotations

import logging
import threading
from contextlib import ExitStack
from dataclasses import dataclass, replace

from helios_core.errors import HeliosError, Unavailable
from helios_core.health import Health
from helios_core.log_location import log_place

from helios_detector.backend import DepthBackend, DetectorBackend, DetectorOptions, ScorerBackend
from helios_detector.lexical_scorer import furniture_names
from helios_detector.model_loading import open_depth, open_detector, open_scorer
from helios_detector.settings import Settings
from helios_detector.simulator_truth import TruthSource

log = logging.getLogger(__name__)

LONGEST_RETRY_S = 60.0

Backend = DetectorBackend | ScorerBackend | DepthBackend


@dataclass(frozen=True)
class Models:
    """The back ends of one detector."""

    detector: DetectorBackend
    scorer: ScorerBackend
    depth: DepthBackend | None = None

    @property
    def all(self) -> tuple[Backend, ...]:
        return tuple(m for m in (self.detector, self.scorer, self.depth) if m is not None)

    def warm_up(self) -> None:
        """Raises Unavailable when a back end cannot work."""
        for model in self.all:
            model.warm_up()

    def unload(self) -> None:
        for model in self.all:
            model.unload()

    def accelerator_mb(self) -> float:
        """Peak of the accelerator's memory (MB) since the last call; 0 without an accelerator."""
        return max(model.accelerator_mb() for model in self.all)

    def close(self) -> None:
        for model in self.all:
            _close(model)


def _close(model: Backend) -> None:
    """Close a back end; a fault of an external one is logged."""
    try:
        model.close()
    except Exception:
        log.exception("the %s could not be closed", type(model).__name__)


def landmarks_of(setting: str, scorer: ScorerBackend) -> tuple[str, ...]:
    """Landmark names for the setting: `auto`, `none`, or names separated by commas."""
    if setting == "auto":
        return furniture_names() if scorer.reads_names else ()
    if setting == "none":
        return ()
    return tuple(name.strip() for name in setting.split(",") if name.strip())


def open_models(s: Settings, truth: TruthSource | None) -> Models:
    """Open the models that the settings name.

    Raises InvalidInput (wrong setting) or Unavailable; then none stays open.
    """
    options = DetectorOptions(
        truth=truth,
        threads=s.threads,
        noise=s.noise,
        noise_seed=s.noise_seed,
        noise_level=s.noise_level,
        noise_correlation=s.noise_correlation,
        device=s.device,
        precision=s.precision,
        masks=s.masks,
        score_head=s.score_head,
        by_similarity=s.by_similarity,
    )
    with ExitStack() as opened:
        scorer = open_scorer(s.scorer, options)
        opened.callback(_close, scorer)
        options = replace(options, landmarks=landmarks_of(s.landmarks, scorer))
        detector = open_detector(s.detector, options)
        opened.callback(_close, detector)
        models = Models(detector, scorer, open_depth(s.depth, options, s.depth_focal))
        opened.pop_all()
    return models


def _warm_models(s: Settings, truth: TruthSource | None) -> Models:
    """Open the models and warm them up; close them if that fails."""
    models = open_models(s, truth)
    try:
        models.warm_up()
    except BaseException:
        models.close()
        raise
    return models


def load_models(
    s: Settings, truth: TruthSource | None, health: Health, ending: threading.Event
) -> Models | None:
    """Open and warm up the models; retry with doubling pauses while they are Unavailable.

    Returns None when `ending` is set, a setting is wrong or a back end fails. `health` reports
    the reason.
    """
    pause_s = s.retry_s
    health.waiting(f"loading {s.detector} and the scorer {s.scorer}")
    while not ending.is_set():
        try:
            return _warm_models(s, truth)
        except Unavailable as error:
            health.waiting(error.message)
            ending.wait(pause_s)
            pause_s = min(2 * pause_s, LONGEST_RETRY_S)
        except HeliosError as error:
            health.degraded(error.message)
            return None
        except Exception as error:  # raised by a back end of an external package
            log.exception("%s or %s cannot be loaded", s.detector, s.scorer)
            health.degraded(
                f"{s.detector} or {s.scorer} cannot be loaded ({type(error).__name__}: {error}); "
                f"the traceback is in {log_place()}"
            )
            return None
    return None
