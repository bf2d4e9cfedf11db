"""Memory of the object map over many episodes, objects only and full scene (Figure 4 of the paper).

Each episode is one line of `episodes.jsonl` in the folder, so a killed run loses at most one. The
memory is the size of the arrays of all Gaussians in main memory. The paper measures GPU memory.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from helios_core.atomic_file import write_file
from helios_core.errors import InvalidInput
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from helios_eval import provenance
from helios_eval.episodes.episode_record import EPISODES, Noise, append_line
from helios_eval.report.interval_statistics import Interval, paired_ratio
from helios_eval.report.paper_figures import FIGURE_4_GB
from helios_eval.studies.map_growth import full_scene_comparison, observation_log, plots

FEW, ALL = tuple(full_scene_comparison.MAPS)  # names of the two maps
TABLE, SUMMARY, CHART = "memory.md", "memory.json", "memory.png"


@dataclass(frozen=True)
class Request:
    """The episodes that a run plays: `homes` seeds from `seed0` on."""

    preset: str
    seed0: int
    homes: int
    max_steps: int
    stride_px: int

    @property
    def seeds(self) -> range:
        return range(self.seed0, self.seed0 + self.homes)


class EpisodeGrowth(BaseModel):
    """Growth of both maps over one episode. Sequences have one entry per keyframe."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    preset: str
    seed: int
    max_steps: int
    stride_px: int
    agent: str
    noise: Noise | None
    commit: str
    steps: tuple[int, ...] = Field(min_length=1, description="actions done at each keyframe")
    gaussians: dict[str, tuple[int, ...]] = Field(description="by name of the map")
    mb: dict[str, tuple[float, ...]] = Field(description="size of all Gaussians, by map")

    @model_validator(mode="after")
    def _whole(self) -> EpisodeGrowth:
        for of in (self.gaussians, self.mb):
            if set(of) != {FEW, ALL} or {len(v) for v in of.values()} != {len(self.steps)}:
                raise ValueError(f"wanted {len(self.steps)} entries for {FEW} and for {ALL}")
        return self

    def is_of(self, request: Request) -> bool:
        """True if a run with this request plays this episode."""
        asked = (request.preset, request.max_steps, request.stride_px)
        own = (self.preset, self.max_steps, self.stride_px)
        return asked == own and self.seed in request.seeds


def play(folder: Path, request: Request, say: Callable[[str], object] = print) -> None:
    """Play the episodes that the folder lacks; write the results anew after each.

    Raises HeliosError.
    """
    commit = provenance.commit()  # of the code that this process has loaded
    done = {record.seed for record in read(folder, request)}
    for seed in request.seeds:
        if seed in done:
            continue
        record = _played(request, seed, commit)
        append_line(folder / EPISODES, record.model_dump_json())
        write(folder, read(folder, request), request)
        most = ", ".join(f"{name} {max(record.mb[name]):.1f} MB" for name in (FEW, ALL))
        say(f"{seed - request.seed0 + 1}/{request.homes} seed {seed}: {most}")


def _played(request: Request, seed: int, commit: str) -> EpisodeGrowth:
    spec = observation_log.by_helios(request.preset, seed, {})
    seen = observation_log.play(request.preset, seed, request.max_steps, request.stride_px)
    maps = full_scene_comparison.measure(seen)
    return EpisodeGrowth(
        preset=request.preset,
        seed=seed,
        max_steps=request.max_steps,
        stride_px=request.stride_px,
        agent=spec.agent,
        noise=spec.noise,
        commit=commit,
        steps=tuple(s.observation.frame.id.seq for s in seen),
        gaussians={name: tuple(grown.gaussians.tolist()) for name, grown in maps.items()},
        mb={name: tuple(np.round(grown.mb, 4).tolist()) for name, grown in maps.items()},
    )


def read(folder: Path, request: Request) -> list[EpisodeGrowth]:
    """Recorded episodes of a request, by seed; of several of one seed the last.

    A torn line is left out. Raises InvalidInput for a whole line that is no such record.
    """
    path = folder / EPISODES
    lines = path.read_text().splitlines() if path.exists() else []
    found = {r.seed: r for r in _parsed(path, lines) if r.is_of(request)}
    return [found[seed] for seed in sorted(found)]


def _parsed(path: Path, lines: Iterable[str]) -> Iterator[EpisodeGrowth]:
    for number, line in enumerate(lines, 1):
        try:
            content = json.loads(line)
        except ValueError:
            continue
        try:
            yield EpisodeGrowth.model_validate(content)
        except ValidationError as error:
            raise InvalidInput(
                f"{path}, line {number} is no episode of this study; take another folder"
            ) from error


def by_step(records: Sequence[EpisodeGrowth], name: str, max_steps: int) -> NDArray[np.float64]:
    """MB of the Gaussians of a map after each step: [episodes, max_steps + 1].

    0 before the first keyframe; an episode that has ended keeps its last value.
    """
    out = np.zeros((len(records), max_steps + 1))
    for row, record in zip(out, records, strict=True):
        known = np.searchsorted(record.steps, np.arange(max_steps + 1), side="right")
        row[:] = np.concatenate([[0.0], record.mb[name]])[known]
    return out


@dataclass(frozen=True)
class Memory:
    """Memory of one map over the episodes, in MB."""

    highest_mean: float  # highest mean over the episodes, of all steps
    maximum: float

    @classmethod
    def of(cls, mb: NDArray[np.float64]) -> Memory:
        """From the memory by step, [episodes, steps]."""
        return cls(float(mb.mean(axis=0).max()), float(mb.max()))


def ratio(mb: Mapping[str, NDArray[np.float64]]) -> Interval:
    """Full scene over objects only: highest means, with a 95 % bootstrap interval over episodes."""
    full, few = (of[:, of.mean(axis=0).argmax()] for of in (mb[ALL], mb[FEW]))
    return paired_ratio(full, few)


def write(folder: Path, records: Sequence[EpisodeGrowth], request: Request) -> None:
    """Write table, summary and chart of the recorded episodes; nothing without a record."""
    if not records:
        return
    mb = {name: by_step(records, name, request.max_steps) for name in (FEW, ALL)}
    write_file(folder / TABLE, table(mb) + "\n")
    write_file(folder / SUMMARY, json.dumps(summary(records, request), indent=1) + "\n")
    plots.memory(mb, folder / CHART)


def summary(records: Sequence[EpisodeGrowth], request: Request) -> dict[str, object]:
    """Values for the report; memory in MB, rounded."""
    mb = {name: by_step(records, name, request.max_steps) for name in (FEW, ALL)}
    found = ratio(mb)
    bounds = [round(found.low, 2), round(found.high, 2)] if found.has_bounds else None
    return {
        "episodes": len(records),
        "episodes_asked": request.homes,
        "seeds": [record.seed for record in records],
        "max_steps": request.max_steps,
        "stride_px": request.stride_px,
        "commits": sorted({record.commit for record in records}),
        "mb": {n: {k: round(v, 3) for k, v in vars(Memory.of(of)).items()} for n, of in mb.items()},
        "ratio_of_highest_means": {
            "value": round(found.value, 2) if math.isfinite(found.value) else None,
            "interval": bounds,
        },
    }


def table(mb: Mapping[str, NDArray[np.float64]]) -> str:
    """Markdown table beside the paper's figures. mb: by map, [episodes, steps]."""
    few, everything = Memory.of(mb[FEW]), Memory.of(mb[ALL])
    found = ratio(mb)
    bounds = f" ({found.low:.1f} to {found.high:.1f})" if found.has_bounds else ""
    mean = ("highest mean of a step", few.highest_mean, everything.highest_mean, bounds)
    rows = [
        (*mean, "allocated, highest mean"),
        (*mean, "reserved, highest mean"),
        ("maximum", few.maximum, everything.maximum, "", "reserved, maximum"),
    ]
    lines = [
        f"| {len(mb[FEW])} episodes, MB of Gaussians in main memory | {FEW} | {ALL} | ratio "
        "| the paper, GB on a GPU | ratio |",
        "|---|--:|--:|--:|--:|--:|",
    ]
    for what, a, b, interval, name in rows:
        less, more = FIGURE_4_GB[name]
        lines.append(
            f"| {what} | {a:.1f} | {b:.1f} | {_over(b, a)}{interval} "
            f"| {name}: {less} against {more} | {_over(more, less)} |"
        )
    return "\n".join(lines)


def _over(a: float, b: float) -> str:
    return f"{a / b:.1f}" if b else "–"
