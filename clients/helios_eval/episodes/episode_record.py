"""Record of one episode: one line of `episodes.jsonl`, complete enough for every report.

`key` identifies an episode: a killed run continues where it stopped, and two folders can be
compared episode by episode.
"""

from __future__ import annotations

import gzip
import json
import os
import zlib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Literal

from helios_core.errors import InvalidInput, Unavailable
from helios_sim.failure_causes import OBJECT_NOT_FOUND, SYSTEM_ERROR
from helios_sim.objectnav_metrics import spl
from pydantic import BaseModel, ConfigDict, Field, ValidationError

EPISODES = "episodes.jsonl"
PACKED = f"{EPISODES}.gz"  # written by `merge_runs.pack`

Benchmark = Literal["ovmm", "objectnav"]
Semantics = Literal["noisy", "ground-truth", "detector"]
Setting = str | float | int | bool


class _Frozen(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Noise(_Frozen):
    """Noise of the simulated detector."""

    table: str
    digest: str = Field(description="of the table's file")
    level: float = Field(description="multiplies how often and how much it errs")
    correlation: float | None = Field(description="0: drawn per frame; 1: fixed; None: the table's")


class Belief(_Frozen):
    """State of one instance of the object map at one step, and its correctness by ground truth."""

    step: int
    instance: int = Field(description="id in the object map, never used again in an episode")
    role: Literal["object", "start", "goal"]
    class_name: str
    class_score: float = Field(description="S, section 3.1.3")
    score: float = Field(description="Psi, eq. 7")
    uncertainty: float = Field(description="U, of the Dirichlet")
    views: int
    gaussians: int
    correct: bool = Field(description="a thing of that class is there")
    image_text_nats: float = Field(
        default=0.0,
        description="log-likelihood ratio by image-text scores; class_score and score have it",
    )


def key_of(
    benchmark: Benchmark,
    agent: str,
    semantics: Semantics,
    preset: str,
    seed: int,
    noise: Noise | None,
    settings: Mapping[str, Setting],
) -> str:
    """Key that identifies an episode, before and after it is played."""
    noise_json = noise.model_dump_json() if noise else ""
    parts = (benchmark, agent, semantics, preset, seed, noise_json)
    return "|".join(map(str, (*parts, json.dumps(dict(settings), sort_keys=True))))


class AbsenceEstimate(_Frozen):
    """Probability that the sought object is absent, as the agent gave it after a complete search.

    start_score: highest Psi of a start receptacle. tried: unnamed things that were looked at in
    the hand. best_score: highest decisive score of a candidate, 0 without one.
    """

    step: int
    searches: int
    probability: float
    start_score: float
    tried: int
    best_score: float


class EpisodeRecord(_Frozen):
    """One episode. Metrics as in `helios_sim.ovmm_metrics`, from the simulator's ground truth."""

    # --- identity ---
    benchmark: Benchmark
    agent: str
    semantics: Semantics
    preset: str
    seed: int
    noise: Noise | None = Field(description="None unless the semantics are noisy")
    settings: dict[str, Setting] = Field(
        default_factory=dict, description="what differs from the services' defaults"
    )

    # --- the task ---
    instruction: str
    object_class: str
    start_receptacle_class: str = ""
    goal_receptacle_class: str = ""
    absent: bool = Field(
        default=False, description="the home has no object of the class that the task asks for"
    )

    # --- ground truth ---
    find_object: bool
    pick: bool
    find_receptacle: bool
    place: bool
    success: bool
    collisions: int = Field(description="steps in which the robot touched the scene")
    collided_with: tuple[str, ...] = ()
    steps: int
    path_m: float
    shortest_path_m: float | None = Field(
        default=None,
        description="from the start to the nearest viewpoint of a right object; None without one, "
        "and in records of move tasks that lack it",
    )
    find_object_steps: int | None = Field(
        default=None, description="steps until FindObj; None without it, or in records that lack it"
    )
    find_object_path_m: float | None = Field(default=None, description="the same, path")
    picks: int = Field(description="picks that were tried, right or wrong")
    wrong_picks: int | None = Field(
        default=None,
        description="picks that took an object that is no candidate, of another class or from "
        "another receptacle, which the robot so disturbed; None in records that lack it",
    )
    cause: str = Field(description="of failure, closed list; empty on success")

    # --- report of the agent ---
    state: str = Field(description="succeeded, failed or cancelled")
    message: str
    reported_cause: str = Field(
        default="", description="cause that the agent reports; empty in records that lack it"
    )

    # --- timing and beliefs ---
    wall_s: float
    step_ms: float = Field(description="median over the steps")
    cpu_s: float | None = Field(
        default=None,
        description="CPU time of the whole episode, with its home; None in records that lack it",
    )
    stage_ms: dict[str, float] = Field(
        default_factory=dict, description="median per stage of the services"
    )
    beliefs: tuple[Belief, ...] = ()
    absence: tuple[AbsenceEstimate, ...] = Field(
        default=(), description="after each complete search, by agents that estimate it"
    )

    # --- provenance ---
    commit: str
    preset_hash: str = Field(description="of the preset's settings")
    structure_hash: str = Field(description="of the home")
    home_file: str = Field(
        default="", description="name and SHA-256 of the plan file of the home; empty without one"
    )

    @property
    def key(self) -> str:
        """Identifier of the episode: same key, same episode, same result."""
        return key_of(
            self.benchmark,
            self.agent,
            self.semantics,
            self.preset,
            self.seed,
            self.noise,
            self.settings,
        )

    @property
    def was_played(self) -> bool:
        """False if the episode could not be played, for example since its process was ended."""
        return bool(self.structure_hash) or self.cause != SYSTEM_ERROR

    @property
    def not_found(self) -> bool:
        """True if the agent ended with the report that it found no object."""
        return self.state == "failed" and self.reported_cause == OBJECT_NOT_FOUND

    @property
    def partial_success(self) -> float:
        """(FindObj + Pick + FindRec + SR) / 4"""
        return (self.find_object + self.pick + self.find_receptacle + self.success) / 4

    @property
    def spl(self) -> float:
        """Success weighted by path length (object navigation)."""
        if self.shortest_path_m is None:
            return 0.0
        return spl(self.success, self.path_m, self.shortest_path_m)

    @property
    def find_object_spl(self) -> float | None:
        """FindObj weighted by path length; None if the record lacks the paths."""
        if self.shortest_path_m is None:
            return None
        if not self.find_object:
            return 0.0
        path_m = self.find_object_path_m
        return None if path_m is None else spl(True, path_m, self.shortest_path_m)


def append(folder: Path, record: EpisodeRecord) -> None:
    """Append an episode to those of a folder, as `append_line` does."""
    append_line(folder / EPISODES, record.model_dump_json())


def append_line(path: Path, line: str) -> None:
    """Append one line and sync it to disk. A torn last line is ended first."""
    with path.open("ab+") as file:
        if file.seek(0, os.SEEK_END) > 0:
            file.seek(-1, os.SEEK_END)
            if file.read(1) != b"\n":
                file.write(b"\n")
        file.write(f"{line}\n".encode())
        file.flush()
        os.fsync(file.fileno())


def read(folder: Path) -> list[EpisodeRecord]:
    """Episodes of a folder; of several records with one key the last.

    Packed episodes come first, then those of a run that continued from them. Torn lines are left
    out, so these episodes run again. Raises InvalidInput for a line that is not an episode, and
    Unavailable for a file that cannot be read.
    """
    path, packed = folder / EPISODES, folder / PACKED
    found: dict[str, EpisodeRecord] = {}
    if (small := content_of(packed)) is not None:
        found |= {r.key: r for r in _parsed(packed, _unpacked(packed, small).split(b"\n"))}
    if (lines := content_of(path)) is not None:
        found |= {r.key: r for r in _parsed(path, lines.split(b"\n"))}
    return list(found.values())


def content_of(path: Path) -> bytes | None:
    """Content of a file; None without the file. Raises Unavailable if it cannot be read."""
    try:
        return path.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise Unavailable(
            f"{path} cannot be read ({error.strerror or error}); make it a readable file, then "
            "give the same command again"
        ) from error


def _unpacked(path: Path, content: bytes) -> bytes:
    try:
        return gzip.decompress(content)
    except (OSError, EOFError, zlib.error) as error:
        raise InvalidInput(f"{path} is damaged ({error}); take another copy") from error


def _parsed(path: Path, lines: Iterable[bytes]) -> Iterator[EpisodeRecord]:
    for number, line in enumerate(lines, 1):
        if not line.strip() or _torn(line):
            continue
        try:
            yield EpisodeRecord.model_validate_json(line)
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(map(str, first["loc"]))
            raise InvalidInput(
                f"{path}, line {number} is no episode ({where}: {first['msg']}); move the file "
                "away, or run into another folder"
            ) from error


def _torn(line: bytes) -> bool:
    """True if a line is the beginning of a record whose writing was cut short."""
    begins = line.startswith(_FIRST) or _FIRST.startswith(line)
    if not begins:
        return False
    try:
        json.loads(line)
    except ValueError:
        return True
    return False


_FIRST = b'{"benchmark":'  # beginning of every record
