"""Simulated image-text scorer: rates what is truly in view, with errors of its own.

It stands for BLIP-2 in the paper (section 3.1.2), whose errors do not depend on the detector's. It
reads the simulator's ground truth and never the detector's reports. A table of `scorer_tables/`
holds its numbers and explains the formula.

Its error is a standard normal number with two parts. One is a smooth random field over the camera's
place and heading, drawn for each seed and sought class, so that neighbouring views share it. The
other is drawn for each frame.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated

import numpy as np
from helios_core.errors import InvalidInput
from helios_core.printable_text import plain_error
from helios_core.types import Frame
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from helios_detector.backend import ScorerBackend, Seen
from helios_detector.lexical_scorer import key_of as canonical
from helios_detector.lexical_scorer import load_affinity, names_in
from helios_detector.simulation.table_files import SCORERS, read_table
from helios_detector.simulation.view_noise import key_of, keys_of, mixed, normals
from helios_detector.simulator_truth import Truth, TruthSource, truth_of

DEFAULT_TABLE = "itc-v1"
WAVES = 64  # waves of the random field

Share = Annotated[float, Field(ge=0, le=1)]
Positive = Annotated[float, Field(gt=0)]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Signal(_Part):
    half_share: Positive
    kin: Share
    context_weight: Share


class Output(_Part):
    low: Share
    high: Share


class Error(_Part):
    spread: float = Field(ge=0)
    view: Share
    frame: Share
    length_m: Positive
    heading_deg: Positive

    @model_validator(mode="after")
    def _whole(self) -> Error:
        if abs(self.view + self.frame - 1) > 1e-9:
            raise ValueError(f"the shares add up to {self.view + self.frame:g}, not to 1")
        return self


class Kin(_Part):
    groups: tuple[tuple[str, ...], ...]


class ScorerTable(_Part):
    """Numbers of a simulated image-text scorer; see `scorer_tables/itc-v1.toml`."""

    name: str
    signal: Signal
    output: Output
    error: Error
    kin: Kin

    def kin_of(self, name: str) -> frozenset[str]:
        """Canonical names of the kin of a class, without itself."""
        own = canonical(name)
        groups = [{canonical(n) for n in group} for group in self.kin.groups]
        return frozenset().union(*(group for group in groups if own in group)) - {own}


def load_scorer_table(name_or_path: str) -> tuple[ScorerTable, str]:
    """Table by name or from a file, and the hash of its file and of its bases (`table_files.py`).

    Raises InvalidInput for a missing or invalid table.
    """
    entries, digest = read_table(name_or_path, SCORERS)
    try:
        table = ScorerTable.model_validate(entries)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise InvalidInput(
            f"the scorer table {name_or_path!r} is wrong ({where}: {plain_error(first['msg'])}); "
            f"it needs the entries of {DEFAULT_TABLE}.toml"
        ) from error
    return table, digest


@dataclass(frozen=True)
class ViewField:
    """Smooth random field over camera place and heading: mean 0 and variance 1 over draws.

    At a distance d and a difference of heading a, values correlate by about exp(-d²/2L² - a²/2H²).
    """

    waves_xy: NDArray[np.float64]  # [waves, 2] rad/m
    waves_heading: NDArray[np.float64]  # [waves] whole numbers, so that a full turn is no change
    phases: NDArray[np.float64]  # [waves] rad

    def __call__(self, x_m: float, y_m: float, heading_rad: float) -> float:
        """Value for a camera at (x, y), world metres, with a heading from the x axis."""
        angle = self.waves_xy @ np.array([x_m, y_m])
        angle += self.waves_heading * heading_rad + self.phases
        return float(math.sqrt(2 / len(angle)) * np.cos(angle).sum())


@lru_cache(maxsize=64)
def view_field(key: int, length_m: float, heading_rad: float) -> ViewField:
    """Field drawn by a key (64 bits). length_m, heading_rad: where correlation falls to 0.61."""
    names = keys_of([f"{what} {n}" for what in ("x", "y", "heading") for n in range(WAVES)])
    drawn = normals(mixed(np.array([key], np.uint64), names)).reshape(3, WAVES)
    phase_keys = mixed(np.array([key], np.uint64), keys_of([f"phase {n}" for n in range(WAVES)]))
    phases = (phase_keys >> np.uint64(11)).astype(np.float64) / 2**53 * math.tau
    return ViewField(drawn[:2].T / length_m, np.round(drawn[2] / heading_rad), phases)


class ViewScorer(ScorerBackend):
    """Scorer of what is truly in view; its errors are smooth over views and its own."""

    def __init__(self, source: TruthSource, table: str = DEFAULT_TABLE, seed: int = 0) -> None:
        """seed: each home needs its own. Raises InvalidInput for a wrong table."""
        self._source, self._seed = source, seed
        self.table, digest = load_scorer_table(table)
        self.name = f"simulated:{self.table.name}@{digest}"
        self._affinity = load_affinity()

    def score(
        self, frame: Frame, seen: Sequence[Seen], prompts: Mapping[str, str]
    ) -> dict[str, float]:
        truth = truth_of(frame, self._source)
        frame, areas = truth.in_world(frame), areas_in_view(truth)
        return {
            layer: self._similarity(frame, areas, names_in(prompt))
            for layer, prompt in prompts.items()
        }

    def signal(self, areas: Mapping[str, float], sought: str) -> float:
        """Error-free similarity, 0 to 1, of an image with one class.

        areas: share of the image that the largest thing of each class covers.
        """
        s, kin, own = self.table.signal, self.table.kin_of(sought), canonical(sought)
        visible, total, related = 0.0, 0.0, 0.0
        for name, share in areas.items():
            size = 1 - 2 ** (-share / s.half_share)
            relation = self._affinity.relation(name, sought)
            if canonical(name) == own or relation == 1.0:
                visible = max(visible, size)
            elif canonical(name) in kin:
                visible = max(visible, s.kin * size)
            if self._affinity.knows(name):
                total += share
                related += share * relation
        context = related / total if total > 0 else 0.0
        return visible + (1 - visible) * s.context_weight * context

    def warm_up(self) -> None:
        self._source.check()
        names_in("")

    def close(self) -> None:
        """No resources to free."""

    def _similarity(
        self, frame: Frame, areas: Mapping[str, float], sought: tuple[str, ...]
    ) -> float:
        out = self.table.output
        signal = max((self.signal(areas, name) for name in sought), default=0.0)
        error = self.table.error.spread * self._error(frame, "/".join(sought))
        return out.low + (out.high - out.low) * min(1.0, max(0.0, signal + error))

    def _error(self, frame: Frame, sought: str) -> float:
        """Standard normal error of one frame for the sought class."""
        e = self.table.error
        text = f"{self._seed}/{self.table.name}/scorer/{sought}"
        field = view_field(key_of(text), e.length_m, math.radians(e.heading_deg))
        ahead = frame.T_world_cam[:2, 2]
        x_m, y_m = (float(v) for v in frame.T_world_cam[:2, 3])
        smooth = field(x_m, y_m, math.atan2(ahead[1], ahead[0]))
        own = float(normals(keys_of([f"{text}/{frame.stamp_ns}"]))[0])
        return math.sqrt(e.view) * smooth + math.sqrt(e.frame) * own


def areas_in_view(truth: Truth) -> dict[str, float]:
    """Share of the image that the largest thing of each class covers, by class name."""
    out: dict[str, float] = {}
    extents = truth.extents
    for id, pixels in zip(extents.ids.tolist(), extents.pixels.tolist(), strict=True):
        thing = truth.instances.get(id)
        if id and thing is not None:
            share = pixels / truth.ids.size
            out[thing.class_name] = max(out.get(thing.class_name, 0.0), share)
    return out
