"""The detector's models from a setting to a service: loaded, warmed up, retried, unloaded."""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace

from helios_core.bus import Bus
from helios_core.errors import HeliosError, Unavailable
from helios_core.health import Health

from helios_detector.backend import (
    DepthBackend,
    DetectorBackend,
    DetectorOptions,
    ScorerBackend,
    open_depth,
    open_detector,
    open_scorer,
)
from helios_detector.scorer import furniture_names
from helios_detector.service import DetectorService
from helios_detector.settings import Settings
from helios_detector.truth import BusTruth, TruthSource

LONGEST_RETRY_S = 60.0
IDLE_CHECK_S = 1.0


@dataclass(frozen=True)
class Models:
    """All back ends of one detector."""

    detector: DetectorBackend
    scorer: ScorerBackend
    depth: DepthBackend | None

    def warm_up(self) -> None:
        """Raises Unavailable when one cannot work."""
        for model in (self.detector, self.scorer, self.depth):
            if model is not None:
                model.warm_up()


def landmarks_of(setting: str, scorer: ScorerBackend) -> tuple[str, ...]:
    """The names that a setting asks for: auto, none, or names by comma."""
    if setting == "auto":
        return furniture_names() if scorer.reads_names else ()
    if setting == "none":
        return ()
    return tuple(name.strip() for name in setting.split(",") if name.strip())


def open_models(s: Settings, truth: TruthSource) -> Models:
    """Raises InvalidInput (wrong setting) or Unavailable."""
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
    scorer = open_scorer(s.scorer, options)
    options = replace(options, landmarks=landmarks_of(s.landmarks, scorer))
    detector = open_detector(s.detector, options)
    return Models(detector, scorer, open_depth(s.depth, options, s.depth_focal))


class Hosted:
    """The detector, from the moment its models work. Until then it says what is missing."""

    def __init__(self, bus: Bus, health: Health, settings: Settings) -> None:
        self._bus, self._health, self._settings = bus, health, settings
        self._ending = threading.Event()
        self._service: DetectorService | None = None
        self._thread = threading.Thread(target=self._run, name="load", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        models = self._load()
        if models is None:
            return
        s = self._settings
        self._service = DetectorService(
            self._bus, models.detector, models.scorer, self._health, s.preview_quality, models.depth
        )
        while s.unload_after_s > 0 and not self._ending.wait(IDLE_CHECK_S):
            self._service.unload_if_idle(s.unload_after_s)

    def _load(self) -> Models | None:
        """Retries what may come right by itself; None when told to end, or a setting is wrong."""
        s, pause_s = self._settings, self._settings.retry_s
        truth = BusTruth(self._bus, s.truth_timeout_s)
        self._health.waiting(f"loading {s.detector} and the scorer {s.scorer}")
        while not self._ending.is_set():
            try:
                models = open_models(s, truth)
                models.warm_up()
                return models
            except Unavailable as error:
                self._health.waiting(error.message)
                self._ending.wait(pause_s)
                pause_s = min(2 * pause_s, LONGEST_RETRY_S)
            except HeliosError as error:
                self._health.degraded(error.message)
                return None
            except Exception as error:  # an outside package's back end
                self._health.degraded(
                    f"{s.detector} cannot be loaded ({type(error).__name__}: {error}); see the log"
                )
                raise
        return None

    def close(self) -> None:
        self._ending.set()
        self._thread.join(1.0)
        if self._service is not None:
            self._service.close()
