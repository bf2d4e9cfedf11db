"""Error model of a detector: the file that `helios calibrate` writes and the object map reads.

The map uses `names` only; everything else says how the model was fitted and describes the detector.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from helios_core.errors import InvalidInput
from helios_core.printable_text import plain_error

FORMAT, VERSION = "helios-detector-error-model", 1
MOST_BYTES = 1_000_000

Share = Annotated[float, Field(ge=0, le=1)]
Positive = Annotated[float, Field(gt=0)]
Count = Annotated[int, Field(ge=0)]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Estimate(_Part):
    """A fitted number with its 95 % interval."""

    value: float
    low: float
    high: float


class NameErrorEstimates(_Part):
    """Errors of names, as `helios_objectmap.instances.name_sightings.NameErrors` explains them."""

    hit: Estimate
    mistaken: Estimate
    sides_correlate: Estimate
    rival: Estimate

    @model_validator(mode="after")
    def _in_range(self) -> Self:
        for name in ("hit", "mistaken"):
            value = getattr(self, name).value
            if not 0 < value < 1:
                raise ValueError(f"{name} is {value}; wanted a number above 0 and below 1")
        if not self.hit.value > self.mistaken.value:
            raise ValueError("hit is not above mistaken, so names would count against themselves")
        if not 0 <= self.sides_correlate.value <= 1:
            raise ValueError(f"sides_correlate is {self.sides_correlate.value}; wanted 0 to 1")
        if not self.rival.value > 0:
            raise ValueError(f"rival is {self.rival.value}; wanted a number above 0")
        return self


class FitSource(_Part):
    """What a model was fitted to."""

    what: str  # recordings, or simulated homes
    truth: Literal["truth", "agreement", "some truth"]  # agreement: between views alone
    views: Count
    things: Count
    things_with_truth: Count
    sides: float  # sum of the weights of all sides
    made_with: str  # version of HELIOS


class RateBand(_Part):
    """Shares of sightings from `low` to `high` (pixels, or metres): right name, only a wrong one,
    nothing."""

    low: float
    high: float
    right: Share
    wrong: Share
    none: Share
    sightings: Count


class NamingBand(_Part):
    """Shares of views that named a thing: with its right (or likeliest) name, and of each other
    name that it got, by distance (m)."""

    low: float
    high: float
    right: Share
    other: Share
    views: float


class VarianceShares(_Part):
    """Shares of the variance of "right name" by level; they add up to 1."""

    thing: Share
    side: Share
    view: Share
    frame: Share


class RepeatBand(_Part):
    """Shares of places seen again from an angle (degrees): the same name, another name only."""

    low_deg: float
    high_deg: float
    same: Share
    other: Share
    pairs: Count


class ScorePoint(_Part):
    """Share of right names among detections of a score; rises with the score."""

    score: Share
    right: Share
    detections: Count


class DetectorErrorModel(_Part):
    """Error model of one detector."""

    format: Literal["helios-detector-error-model"] = FORMAT
    version: Literal[1] = VERSION
    detector: str = Field(min_length=1, max_length=300)  # as observations name it
    digest: str = ""  # SHA-256 of the model file, empty without one
    source: FitSource
    names: NameErrorEstimates
    none: Estimate | None = None  # share of things whose right name was never given
    rates_by_pixels: tuple[RateBand, ...] = ()
    rates_by_distance: tuple[RateBand, ...] = ()
    naming_by_distance: tuple[NamingBand, ...] = ()
    false_alarms_per_image: float | None = None
    false_alarms_per_name: float | None = None
    variance: VarianceShares | None = None
    repeats_by_angle: tuple[RepeatBand, ...] = ()
    score_calibration: tuple[ScorePoint, ...] = ()


def to_text(model: DetectorErrorModel) -> str:
    """JSON text of the file."""
    return model.model_dump_json(indent=1) + "\n"


def from_text(text: str | bytes, where: str) -> DetectorErrorModel:
    """The model of a file's text. Raises InvalidInput, in one sentence that names `where`."""
    try:
        return DetectorErrorModel.model_validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        message = plain_error(first["msg"])
        said = f"{place}: {message}" if place else message
        raise InvalidInput(
            f"{where} is no error model of version {VERSION} ({said}); make one with helios "
            "calibrate"
        ) from error


def read_error_model(path: Path) -> DetectorErrorModel:
    """The model in a file. Raises InvalidInput, in one sentence."""
    try:
        with path.open("rb") as file:
            data = file.read(MOST_BYTES + 1)
    except (OSError, ValueError) as error:  # ValueError: no possible path
        reason = error.strerror if isinstance(error, OSError) else error
        raise InvalidInput(
            f"the error model {path} cannot be read ({reason}); make one with helios calibrate"
        ) from error
    if len(data) > MOST_BYTES:
        raise InvalidInput(f"{path} has more than {MOST_BYTES} bytes; it is no error model")
    return from_text(data, str(path))
