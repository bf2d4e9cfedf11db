"""Error model of the detector, by the setting `error_model`: a file, or a shipped one by its name.

A map without one takes the broad prior of `name_sightings`, and the service says so.
"""

from __future__ import annotations

import logging
from functools import lru_cache
from importlib import resources
from pathlib import Path

from helios_core.detector_error_model import DetectorErrorModel, from_text, read_error_model
from helios_core.errors import InvalidInput

from helios_objectmap.instances.name_sightings import BROAD_PRIOR, NameErrors
from helios_objectmap.settings import ObjectMapSettings

log = logging.getLogger(__name__)

PACKAGE = "helios_objectmap"
NO_MODEL = "no error model of the detector: broad prior; see helios calibrate"


def shipped_models() -> list[str]:
    """Sorted names of the shipped error models."""
    names = [f.name for f in resources.files(PACKAGE).joinpath("error_models").iterdir()]
    return sorted(n.removesuffix(".json") for n in names if n.endswith(".json"))


@lru_cache(maxsize=16)
def opened(setting: str) -> DetectorErrorModel | None:
    """Error model that a setting names; None for an empty setting. Each is read once.

    Raises InvalidInput, in one sentence, for a file that is missing or is no error model.
    """
    if not setting:
        return None
    if setting in shipped_models():
        file = resources.files(PACKAGE).joinpath("error_models", f"{setting}.json")
        return from_text(file.read_bytes(), f"the shipped error model {setting}")
    try:
        return read_error_model(Path(setting).expanduser())
    except (InvalidInput, RuntimeError) as error:  # RuntimeError: ~ of an unknown user
        raise InvalidInput(f"{error}; shipped are {', '.join(shipped_models())}") from error


def name_errors(setting: str) -> NameErrors:
    """Errors of names that a setting stands for. Raises InvalidInput, as `opened` does."""
    model = opened(setting)
    if model is None:
        return BROAD_PRIOR
    n = model.names
    return NameErrors(n.hit.value, n.mistaken.value, n.sides_correlate.value, n.rival.value)


class ErrorModelInUse:
    """Error model of a service, and what its health says of it. A file that is refused does not end
    the service: it takes the broad prior."""

    def __init__(self, settings: ObjectMapSettings) -> None:
        self._compared = settings.look_alikes != "ignored"
        self._refused, self._other = "", ""
        self._model: DetectorErrorModel | None = None
        try:
            self._model = opened(settings.error_model)
        except InvalidInput as error:
            self._refused = (
                f"{error.message}; the object map uses the broad prior until you set another "
                "error_model and restart it"
            )
            log.warning("%s", self._refused)
        self.settings = (
            settings.model_copy(update={"error_model": ""}) if self._refused else settings
        )

    def hear(self, detector: str) -> bool:
        """Note the detector of an observation. Returns True if `said` changes."""
        before = self._other
        wrong = self._model is not None and detector not in ("", self._model.detector)
        self._other = detector if wrong else ""
        return self._other != before

    @property
    def said(self) -> str:
        """One sentence for the health; empty if names of look-alikes are not compared."""
        if self._refused or not self._compared:
            return self._refused
        if self._model is None:
            return NO_MODEL
        said = f"error model of {self._model.detector}"
        return f"{said}, but {self._other} gives the detections" if self._other else said
