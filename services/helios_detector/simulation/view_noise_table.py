"""Noise table of the detector with view-correlated errors (`view_noise.py`): validated TOML.

`noise_tables/ovmm-v1.toml` explains every entry, `ovmm-v1-smooth.toml` the entry `sides`. A rate is

    min(1, level · scale · rate of the file)

with `level` from a setting and `scale` of the kind of error from the file. The rate of wrong names
is limited to `confusion.most` instead of 1, so an object's own class stays its most likely name.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, Literal, Self

import numpy as np
from helios_core.errors import InvalidInput
from helios_core.name_rules import plain
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, field_validator, model_validator

from helios_detector.simulation.smooth_view_noise import SmoothViews
from helios_detector.simulation.view_noise import (
    SECTORS,
    SectorViews,
    Shares,
    Views,
    angles_of,
    sectors_of,
)
from helios_detector.vocabulary_matching import synonyms_of


def _ascending(values: tuple[float, ...]) -> tuple[float, ...]:
    if not values or list(values) != sorted(values):
        raise ValueError(f"{values} does not ascend")
    return values


Probability = Annotated[float, Field(ge=0, le=1)]
Positive = Annotated[float, Field(gt=0)]
Probabilities = tuple[Probability, ...]
Places = Annotated[tuple[Positive, ...], AfterValidator(_ascending)]
Quantiles = Annotated[Probabilities, Field(min_length=2), AfterValidator(_ascending)]
Range = Annotated[tuple[Positive, Positive], AfterValidator(_ascending)]
Kind = Literal["true", "confused", "false"]  # kind of detection that gets a score
Name = Annotated[str, AfterValidator(plain)]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class VarianceShares(_Part):
    thing: Probability
    side: Probability
    view: Probability
    frame: Probability

    @model_validator(mode="after")
    def _whole(self) -> Self:
        total = self.thing + self.side + self.view + self.frame
        if abs(total - 1) > 1e-9:
            raise ValueError(f"the shares add up to {total:g}, not to 1")
        return self

    @property
    def shares(self) -> Shares:
        """The entries as `Shares`."""
        return Shares(self.thing, self.side, self.view, self.frame)


class Persistence(VarianceShares):
    sides: Literal["sectors", "smooth"] = "sectors"  # how side and view are drawn
    name: VarianceShares | None = None  # of the choice of the wrong name; None: as for the rest


class Scale(_Part):
    confuse: float = Field(ge=0)
    second: float = Field(ge=0)
    miss: float = Field(ge=0)
    false: float = Field(ge=0)


class Bands(_Part):
    distance_m: Places
    pixels: Places


class Miss(_Part):
    pixels: Places
    by_pixels: Probabilities
    by_distance: Probabilities  # of each band: one more than the entries of `bands.distance_m`
    factor: dict[Name, Positive]

    @model_validator(mode="after")
    def _pairs(self) -> Miss:
        if len(self.pixels) != len(self.by_pixels):
            raise ValueError(f"{len(self.pixels)} places, {len(self.by_pixels)} probabilities")
        return self


class Score(_Part):
    true: Quantiles
    confused: Quantiles
    false: Quantiles
    pixels: Places
    factor_by_pixels: Probabilities
    seen_above: Probability
    together: Annotated[float, Field(ge=-1, le=1)] = 0.0  # correlation of the names of one view

    @model_validator(mode="after")
    def _pairs(self) -> Score:
        if len(self.pixels) != len(self.factor_by_pixels):
            raise ValueError(f"{len(self.pixels)} places, {len(self.factor_by_pixels)} factors")
        return self


class Mask(_Part):
    erode_px: int = Field(ge=0, le=10)
    partial: Probability
    partial_keeps: Range
    leak: Probability
    leak_share: Probability
    leak_most_px: int = Field(ge=1, le=40)
    leak_depth_m: Positive

    @model_validator(mode="after")
    def _exclusive(self) -> Mask:
        if self.partial + self.leak > 1 or self.partial_keeps[1] > 1:
            raise ValueError("partial and leak, or what partial masks keep, are more than all")
        return self


class FalsePositive(_Part):
    on_furniture: Probability
    on_structure: Probability
    structure: frozenset[Name]
    never_on: frozenset[Name]
    receptacle_factor: Probability
    cell_m: Positive
    max_distance_m: Positive
    object_radius_m: Range
    receptacle_radius_m: Range
    min_px: int = Field(ge=1)


class Group(_Part):
    names: tuple[Name, ...] = Field(min_length=2)
    each: Probability


class Confusion(_Part):
    group: tuple[Group, ...] = ()
    row: dict[Name, dict[Name, Probability]] = Field(default={})
    factor: dict[Name, float] = Field(default={})  # of the wrong names of a class; 1 without entry
    most: Probability
    anything: Probability

    @field_validator("group")
    @classmethod
    def _different(cls, groups: tuple[Group, ...]) -> tuple[Group, ...]:
        for group in groups:
            if len(set(group.names)) < len(group.names):
                raise ValueError(f"a name stands twice in {group.names}")
        return groups

    def rows(self) -> dict[str, dict[str, float]]:
        """True class -> reported class -> probability: from the groups, overridden by the rows."""
        out: dict[str, dict[str, float]] = {}
        for group in self.group:
            for true in group.names:
                row = out.setdefault(true, {})
                for other in group.names:
                    if other != true:
                        row[other] = row.get(other, 0.0) + group.each
        for true, row in self.row.items():
            out.setdefault(true, {}).update(row)
        return out

    @model_validator(mode="after")
    def _possible(self) -> Confusion:
        for true, row in self.rows().items():
            if sum(row.values()) > 1:
                raise ValueError(f"{true!r} is confused with probability {sum(row.values()):.2f}")
            if same := synonyms_of(true) & row.keys():
                raise ValueError(f"{true!r} cannot be mistaken for {sorted(same)}: it is the same")
        return self


class ViewTableFile(_Part):
    """The contents of the TOML file."""

    format: str = Field(pattern="^views$")
    name: str
    persistence: Persistence
    scale: Scale
    bands: Bands
    miss: Miss
    score: Score
    mask: Mask
    false_positive: FalsePositive
    confusion: Confusion

    @model_validator(mode="after")
    def _banded(self) -> ViewTableFile:
        if len(self.miss.by_distance) != len(self.bands.distance_m) + 1:
            raise ValueError(
                f"{len(self.bands.distance_m)} distances make one band more, but "
                f"{len(self.miss.by_distance)} probabilities are given"
            )
        return self


@dataclass(frozen=True)
class Row:
    """The classes that one true class may be reported as."""

    names: tuple[str, ...]
    upto: NDArray[np.float64]  # [n] cumulative shares, the last is 1
    total: float  # total probability of a wrong class, from the file

    def pick(self, u: float) -> str:
        """The reported class for a uniform draw `u`."""
        return self.names[min(int(np.searchsorted(self.upto, u, "right")), len(self.names) - 1)]


@dataclass(frozen=True)
class ViewNoiseTable:
    """The table at one level and correlation."""

    file: ViewTableFile
    digest: str  # hash of the file and its bases, which identifies the table in use
    shares: Shares
    name_shares: Shares  # of the choice of the wrong name
    level: float = 1.0

    @property
    def name(self) -> str:
        return self.file.name

    @cached_property
    def rows(self) -> dict[str, Row]:
        """Confusion rows by normalised true class."""
        out = {}
        for true, row in self.file.confusion.rows().items():
            values = np.array(list(row.values()))
            if (total := float(values.sum())) > 0:
                out[true] = Row(tuple(row), np.cumsum(values) / total, total)
        return out

    @cached_property
    def _quantiles(self) -> dict[Kind, tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Kind of detection -> (uniform numbers, scores at them)."""
        s = self.file.score
        kinds: dict[Kind, Quantiles] = {"true": s.true, "confused": s.confused, "false": s.false}
        return {
            kind: (np.linspace(0, 1, len(values)), np.array(values))
            for kind, values in kinds.items()
        }

    @cached_property
    def _score_factors(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(logarithms of visible pixels, factors of the score at them)."""
        s = self.file.score
        return np.log(s.pixels), np.array(s.factor_by_pixels)

    def scaled(self, level: float, correlation: float | None = None) -> ViewNoiseTable:
        """The table with every rate multiplied by `level`; 0 gives ground truth. `correlation` 1
        redraws nothing per frame, 0 everything; None: the table's shares. Raises InvalidInput
        outside their ranges."""
        if not 0 <= level <= 10:
            raise InvalidInput(f"the noise level is {level}; wanted 0 to 10")
        if correlation is not None and not 0 <= correlation <= 1:
            raise InvalidInput(f"the noise correlation is {correlation}; wanted 0 to 1")
        own, of_name = _all_shares(self.file.persistence)
        if correlation is not None:
            own, of_name = own.correlated(correlation), of_name.correlated(correlation)
        return ViewNoiseTable(self.file, self.digest, own, of_name, level)

    def rate(self, probability: float, scale: float = 1.0) -> float:
        """The rate min(1, level · scale · probability)."""
        return min(1.0, self.level * scale * probability)

    def miss(
        self, class_names: list[str], pixels: NDArray[np.int64], distance_m: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """[n] probability that an object is not reported; names normalised."""
        m = self.file.miss
        by_pixels = np.interp(np.log(np.maximum(pixels, 1)), np.log(m.pixels), m.by_pixels)
        by_distance = np.array(m.by_distance)[self._distance_bands(distance_m)]
        factor = np.array([m.factor.get(name, 1.0) for name in class_names])
        rate = factor * (1 - (1 - by_pixels) * (1 - by_distance))
        return np.minimum(1.0, self.level * self.file.scale.miss * rate)

    def confuse(self, class_name: str) -> float:
        """Probability that a reported object has another class's name; the name normalised."""
        row = self.rows.get(class_name)
        if row is None:
            return 0.0
        rate = self.rate(row.total * self._factor(class_name), self.file.scale.confuse)
        return min(self.file.confusion.most, rate)

    def second(self, class_name: str) -> float:
        """Probability that an object is also reported under a second name; the name normalised."""
        row = self.rows.get(class_name)
        if row is None:
            return 0.0
        return self.rate(row.total * self._factor(class_name), self.file.scale.second)

    def _factor(self, class_name: str) -> float:
        return self.file.confusion.factor.get(class_name, 1.0)

    def anything(self) -> float:
        """Probability that an object is also reported as one search class outside its row."""
        return self.rate(self.file.confusion.anything, self.file.scale.second)

    def false(self, structure: bool, is_object: bool) -> float:
        """Probability that one surface cell shows one search class as a false positive."""
        f = self.file.false_positive
        rate = f.on_structure if structure else f.on_furniture
        rate *= 1.0 if is_object else f.receptacle_factor
        return self.rate(rate, self.file.scale.false)

    def score(self, kind: Kind, u: float, pixels: int) -> float:
        """Score for a uniform draw `u`. Below level 1 scores of true detections approach 1; scores
        of errors do not change, so errors become fewer but not more confident."""
        score = float(np.interp(u, *self._quantiles[kind]))
        if kind != "false":
            score *= float(np.interp(np.log(pixels), *self._score_factors))
        return 1 - min(1.0, self.level) * (1 - score) if kind == "true" else score

    def cells(
        self,
        sectors: NDArray[np.int64],
        pixels: NDArray[np.int64] | None,
        distance_m: NDArray[np.float64],
    ) -> NDArray[np.int64]:
        """[n] viewing sector, distance band and pixel band in one number."""
        bands = self.file.bands.pixels
        large = 0 if pixels is None else np.searchsorted(bands, pixels, "right")
        return sectors + SECTORS * (self._distance_bands(distance_m) + 64 * large)

    def _distance_bands(self, distance_m: NDArray[np.float64]) -> NDArray[np.int64]:
        return np.searchsorted(self.file.bands.distance_m, distance_m, "right")

    def views(
        self,
        keys: NDArray[np.uint64],
        eye_m: NDArray[np.float64],
        centers_m: NDArray[np.float64],
        pixels: NDArray[np.int64] | None,
    ) -> tuple[Views, NDArray[np.float64]]:
        """(views, distances [n] in metres) of objects seen from the camera position.

        keys: [n] hashes; eye_m: [3] and centers_m: [n, 3], world; pixels: [n] visible pixels, None
        for things without a size. Smooth draws do not depend on the pixels.
        """
        offset_m = eye_m - centers_m
        distance_m = np.linalg.norm(offset_m, axis=1)
        if self.file.persistence.sides == "smooth":
            return SmoothViews(keys, angles_of(offset_m[:, :2]), distance_m), distance_m
        sectors = sectors_of(offset_m[:, :2])
        return SectorViews(keys, sectors, self.cells(sectors, pixels, distance_m)), distance_m


def _all_shares(p: Persistence) -> tuple[Shares, Shares]:
    """Shares of all draws, and of the choice of the wrong name."""
    return p.shares, (p.name or p).shares


def view_table(data: dict[str, Any], digest: str) -> ViewNoiseTable:
    """The table from parsed TOML. Raises ValueError with the fault of the file."""
    file = ViewTableFile.model_validate(data)
    return ViewNoiseTable(file, digest, *_all_shares(file.persistence))
