"""Detector process of one robot. It reports the missing parts until the models work."""

from __future__ import annotations

import threading

from helios_core.bus import Bus
from helios_core.health import Health

from helios_detector.exception_guard import ended_well
from helios_detector.model_set import load_models
from helios_detector.query_methods import LoadingQueryMethods
from helios_detector.service import DetectorService
from helios_detector.settings import Settings
from helios_detector.simulator_truth import BusTruth

CHECK_S = 1.0  # period of context retries and of checks for idle models


class RobotDetector:
    """Loads the models in a thread, then runs the `DetectorService` until closed."""

    def __init__(self, bus: Bus, health: Health, settings: Settings) -> None:
        self._bus, self._health, self._settings = bus, health, settings
        self._ending = threading.Event()
        self._service: DetectorService | None = None
        self._truth = BusTruth(bus)
        self._thread = threading.Thread(target=self._host, name="load", daemon=True)
        self._thread.start()

    def _host(self) -> None:
        ended_well("the detector is not at work", self._health, self._run)

    def _run(self) -> None:
        s = self._settings
        not_yet = LoadingQueryMethods(self._bus, self._health)
        not_yet.open()
        models = load_models(s, self._truth, self._health, self._ending)
        if models is None:
            return  # `LoadingQueryMethods` and `health` keep reporting the reason
        not_yet.close()
        self._service = DetectorService(
            self._bus, models.detector, models.scorer, self._health, models.depth
        )
        while not self._ending.wait(CHECK_S):
            self._service.retry_context()
            if s.unload_after_s > 0:
                self._service.unload_if_idle(s.unload_after_s)

    def close(self) -> None:
        self._ending.set()
        self._truth.close()
        self._thread.join(1.0)
        if self._service is not None:
            self._service.close()
