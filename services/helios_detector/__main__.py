"""`python -m helios_detector`: settings, session, run."""

from __future__ import annotations

import sys
import threading

from helios_core.bus import Bus
from helios_core.errors import HeliosError, Unavailable
from helios_core.health import Health
from helios_core.service import run_service

from helios_detector.backend import DetectorOptions, ScorerBackend, open_detector, open_scorer
from helios_detector.scorer import furniture_names
from helios_detector.service import DetectorService
from helios_detector.settings import Settings
from helios_detector.truth import BusTruth


def landmarks_of(setting: str, scorer: ScorerBackend) -> tuple[str, ...]:
    """The names that a setting asks for: auto, none, or names by comma."""
    if setting == "auto":
        return furniture_names() if scorer.reads_names else ()
    if setting == "none":
        return ()
    return tuple(name.strip() for name in setting.split(",") if name.strip())


class Hosted:
    """The detector, from the moment its models work. Until then it says what is missing."""

    def __init__(self, bus: Bus, health: Health, settings: Settings) -> None:
        self._bus, self._health, self._settings = bus, health, settings
        self._ending = threading.Event()
        self._service: DetectorService | None = None
        self._thread = threading.Thread(target=self._load, name="load", daemon=True)
        self._thread.start()

    def _load(self) -> None:
        s = self._settings
        options = DetectorOptions(
            BusTruth(self._bus, s.truth_timeout_s), s.threads, s.noise, s.noise_seed,
            s.noise_level, s.noise_correlation, s.device, s.precision, s.masks,
            s.score_head,
        )  # fmt: skip
        while not self._ending.is_set():
            try:
                detector, scorer = (
                    open_detector(s.detector, options),
                    open_scorer(s.scorer, options),
                )
                detector.warm_up()
                scorer.warm_up()
            except Unavailable as error:
                self._health.waiting(error.message)
                self._ending.wait(s.retry_s)
                continue
            except HeliosError as error:
                self._health.degraded(error.message)
                return
            self._service = DetectorService(
                self._bus, detector, scorer, self._health, s.preview_quality
            )
            return

    def close(self) -> None:
        self._ending.set()
        self._thread.join(1.0)
        if self._service is not None:
            self._service.close()


if __name__ == "__main__":
    settings = Settings.load()
    sys.exit(run_service("detector", settings, lambda bus, health: Hosted(bus, health, settings)))
