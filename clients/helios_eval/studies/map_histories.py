"""Study of the object map on recorded histories: the same observations under other settings.

    python -m helios_eval.studies.map_histories record --seeds 200-209 --out runs/histories
    python -m helios_eval.studies.map_histories replay runs/histories --set core_from=0.3

`record` plays episodes and writes what their object map received, with the true objects at some
steps. `replay` gives that to a new object map, without the simulator, and prints how well its
instances are believed. The robot walks as it did when the history was recorded, whatever the map
believes now.

- AUROC: how well the score Ψ separates correct instances from wrong ones, over all moments;
- best is right: share of moments at which the best-scored instance of a class is correct, where one
  of its instances is;
- time below half: share of moments at which a true object that was believed has less than half of
  the highest score that it had so far.
"""

from __future__ import annotations

import argparse
import gzip
import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import TypeVar

import numpy as np
from google.protobuf.message import Message
from helios_core import proto as pb
from helios_core.agent_presets import DEFAULT_AGENT
from helios_core.atomic_file import write_file
from helios_core.codec import context_from_proto, observation_from_proto
from helios_core.errors import HeliosError, InvalidInput
from helios_core.topics import CONTEXT, OBSERVATION, ROBOT_STATE
from helios_core.types import ObjectInstance
from helios_objectmap.object_map import ObjectMap
from helios_objectmap.settings import ObjectMapSettings
from rich.console import Console
from rich.progress import track
from rich.table import Table

from helios_eval.calibration.statistics import auroc
from helios_eval.episodes import home_presets
from helios_eval.episodes.belief_truth import Role, is_at
from helios_eval.episodes.episode_player import LONGEST_S, running_stack
from helios_eval.episodes.episode_record import Setting
from helios_eval.episodes.episode_spec import DEFAULT_SCORER, SCORER, EpisodeSpec, noise_of
from helios_eval.episodes.service_settings import of_service, of_stack, parsed
from helios_eval.studies.development_homes import seeds

TRUTH_EVERY = 10  # observations
BELIEVED_FROM = 0.15  # score from which a true object counts as believed
ROLES: tuple[Role, ...] = ("object", "start", "goal")
_KINDS: dict[bytes, type[Message]] = {
    b"C": pb.SearchContext,
    b"O": pb.Observation,
    b"S": pb.RobotState,
}


@dataclass(frozen=True)
class TrueThing:
    """Object or receptacle at its current pose; see `belief_truth.TrueObject`."""

    name: str
    class_name: str
    center_m: tuple[float, float, float]
    size_m: tuple[float, float, float]
    yaw_rad: float


@dataclass(frozen=True)
class Truth:
    """True things after an observation, and the classes that have a role in the task."""

    things: tuple[TrueThing, ...]
    roles: Mapping[str, Role]


Event = Message | Truth
T = TypeVar("T")
R = TypeVar("R")


@dataclass(frozen=True)
class Moment:
    """Instances of one class at one moment; those of one role of the task."""

    role: Role
    score: tuple[float, ...]  # Ψ of each instance
    at: tuple[str, ...]  # name of the true thing at its place, "" for none


@dataclass
class Figures:
    """Figures of one role over several histories."""

    scores: list[float] = field(default_factory=list)
    correct: list[bool] = field(default_factory=list)
    best_is_right: list[bool] = field(default_factory=list)
    below_half: list[bool] = field(default_factory=list)

    def add(self, moment: Moment, highest: dict[str, float]) -> None:
        """Add a moment. highest: thing -> highest score in its history so far; is updated."""
        correct = [bool(name) for name in moment.at]
        self.scores += moment.score
        self.correct += correct
        if any(correct):
            self.best_is_right.append(correct[int(np.argmax(moment.score))])
        now: dict[str, float] = {}
        for name, score in zip(moment.at, moment.score, strict=True):
            if name:
                now[name] = max(score, now.get(name, 0.0))
                highest[name] = max(score, highest.get(name, 0.0))
        self.below_half += [
            now.get(name, 0.0) < most / 2 for name, most in highest.items() if most >= BELIEVED_FROM
        ]

    def row(self) -> list[str]:
        score, correct = np.array(self.scores), np.array(self.correct)
        area = float(auroc(score, correct)[0]) if correct.any() and not correct.all() else np.nan
        shares = (np.mean(v) if v else np.nan for v in (self.best_is_right, self.below_half))
        return [f"{area:.3f}", *(f"{v:.2f}" for v in shares), f"{len(score)}"]


# --- recording ------------------------------------------------------------------------------------
def record(
    seed: int, agent: str, preset: str, table: str, out: Path, extra: Mapping[str, Setting]
) -> Path:
    """Play an episode and write its history. Raises HeliosError, OSError."""
    noise = noise_of(table or home_presets.noise_of(preset), 1.0, None)
    settings = {SCORER: DEFAULT_SCORER, **extra}
    spec = EpisodeSpec("ovmm", agent, "noisy", preset, seed, noise, settings)
    parts: list[bytes] = []
    held, seen = "", 0
    with running_stack(spec, colored=False) as (thread, stack):
        bus, episode = stack.bus(), thread.run(lambda world: world.episode)
        roles = {
            episode.goal_receptacle_class: "goal",
            episode.start_receptacle_class: "start",
            episode.object_class: "object",
        }

        def note(kind: bytes, message: Message) -> None:
            parts.append(packed(kind, message.SerializeToString()))

        def on_state(message: pb.RobotState) -> None:
            nonlocal held
            if message.held != held:
                held = message.held
                note(b"S", message)

        def on_observation(message: pb.Observation) -> None:
            nonlocal seen
            note(b"O", message)
            seen += 1
            if seen % TRUTH_EVERY == 0:
                states = thread.run(lambda world: world.object_states())
                things = [
                    [
                        s.name,
                        s.class_name,
                        [float(v) for v in s.center_m],
                        [float(v) for v in s.size_m],
                        float(s.yaw_rad),
                    ]
                    for s in states
                ]
                text = json.dumps({"things": things, "roles": roles})
                parts.append(packed(b"T", text.encode()))

        bus.subscribe(CONTEXT, partial(note, b"C"))
        bus.subscribe(ROBOT_STATE, on_state)
        bus.subscribe(OBSERVATION, on_observation)
        stack.run(episode.instruction, spec.max_steps, LONGEST_S)
    path = _path(out, agent, seed)
    write_file(path, gzip.compress(b"".join(parts), 4))
    return path


def packed(kind: bytes, data: bytes) -> bytes:
    """Bytes of an event in the file of a history."""
    return kind + len(data).to_bytes(4, "little") + data


def events_of(path: Path) -> Iterator[Event]:
    """Events of a history in their order. Raises InvalidInput, OSError."""
    with gzip.open(path) as file:
        while head := file.read(5):
            data = file.read(int.from_bytes(head[1:], "little"))
            kind = head[:1]
            if kind == b"T":
                told = json.loads(data)
                things = (
                    TrueThing(name, of_class, tuple(center), tuple(size), yaw)
                    for name, of_class, center, size, yaw in told["things"]
                )
                yield Truth(tuple(things), told["roles"])
            elif kind in _KINDS:
                yield _KINDS[kind].FromString(data)
            else:
                raise InvalidInput(f"{path} is no history: it has an event of kind {kind!r}")


# --- replay ---------------------------------------------------------------------------------------
def replay(path: Path, settings: ObjectMapSettings) -> list[Moment]:
    """Moments of a new object map that receives the history. Raises HeliosError, OSError."""
    objects, context, held, out = ObjectMap(settings), None, "", []
    for event in events_of(path):
        if isinstance(event, pb.SearchContext):
            context = context_from_proto(event)
        elif isinstance(event, pb.RobotState):
            held = event.held
        elif isinstance(event, pb.Observation):
            observation = observation_from_proto(event)
            if context is not None and context.id == observation.context_id:
                objects.update(observation, context, held)
        elif isinstance(event, Truth):
            out += moments_of(objects.objects(), event)
    return out


def moments_of(objects: Sequence[ObjectInstance], truth: Truth) -> list[Moment]:
    out = []
    for class_name, role in truth.roles.items():
        own = [o for o in objects if o.class_name == class_name]
        things = [t for t in truth.things if t.class_name == class_name]
        at = (next((t.name for t in things if is_at(o, t, role)), "") for o in own)
        out.append(Moment(role, tuple(o.score for o in own), tuple(at)))
    return out


def figures_of(histories: Sequence[Sequence[Moment]]) -> dict[Role, Figures]:
    """Figures of each role over histories."""
    out: dict[Role, Figures] = {role: Figures() for role in ROLES}
    for moments in histories:
        highest: dict[Role, dict[str, float]] = {role: {} for role in ROLES}
        for moment in moments:
            out[moment.role].add(moment, highest[moment.role])
    return out


def table(names: Sequence[str], figures: Sequence[Mapping[Role, Figures]]) -> Table:
    """Rows by role, one for each setting."""
    out = Table("instances of", "settings", "AUROC", "best is right", "time below half", "n")
    for role in ROLES:
        for name, of_role in zip(names, figures, strict=True):
            out.add_row(role, name, *of_role[role].row())
    return out


# --- command --------------------------------------------------------------------------------------
def main(argv: list[str] | None = None) -> int:
    given = _arguments().parse_args(argv)
    console = Console(width=120)
    try:
        if given.command == "record":
            given.out.mkdir(parents=True, exist_ok=True)
            play = partial(
                record,
                agent=given.agent,
                preset=given.preset,
                table=given.noise,
                out=given.out,
                extra=parsed(given.set or ()),
            )
            new = [s for s in given.seeds if not _path(given.out, given.agent, s).exists()]
            for path in track(_each(play, new, given.jobs), "histories", len(new), console=console):
                console.print(path)
            return 0
        paths = sorted(given.folder.glob("*.history.gz"))
        if not paths:
            raise InvalidInput(f"{given.folder} has no histories; `record` writes them")
        names, figures = [], []
        for text in given.set or [""]:
            assigned = parsed(filter(None, text.split(" ")))
            settings = ObjectMapSettings(**of_service("objectmap", of_stack(given.agent, assigned)))
            played = _each(partial(replay, settings=settings), paths, given.jobs)
            names.append(text or "as they are")
            figures.append(figures_of(list(track(played, names[-1], len(paths), console=console))))
        console.print(table(names, figures))
    except (HeliosError, OSError) as error:
        print(f"map_histories: {error}", file=sys.stderr)
        return 2
    return 0


def _path(folder: Path, agent: str, seed: int) -> Path:
    return folder / f"{agent}-{seed}.history.gz"


def _each(work: Callable[[T], R], items: Sequence[T], jobs: int) -> Iterator[R]:
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        yield from pool.map(work, items)


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m helios_eval.studies.map_histories",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest="command", required=True)
    recording = commands.add_parser("record", help="play episodes and write their histories")
    recording.add_argument("--seeds", type=seeds, required=True, help="3 or 200-209")
    recording.add_argument("--preset", default="ovmm-v1")
    recording.add_argument("--noise", default="", help="noise table; default: the preset's")
    recording.add_argument("--set", action="append", help="settings of the agent's services")
    recording.add_argument("--out", type=Path, required=True, help="folder for the histories")
    replaying = commands.add_parser("replay", help="give histories to a new object map")
    replaying.add_argument("folder", type=Path)
    replaying.add_argument(
        "--set",
        action="append",
        help='settings of the object map, as "core_from=0.3 named_from=0.2"; may be repeated',
    )
    for command in (recording, replaying):
        command.add_argument("--agent", default=DEFAULT_AGENT)
        command.add_argument("--jobs", type=int, default=2)
    return parser


if __name__ == "__main__":
    sys.exit(main())
