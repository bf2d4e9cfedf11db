"""Evaluation run: plays the missing episodes of a folder, and writes results and report.

An episode that could not be played counts as a failure by "system error", until a later run into
the same folder plays it.
"""

from __future__ import annotations

import json
import logging
import sys
import time
from collections.abc import Collection, Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from helios_core.atomic_file import write_file
from helios_core.errors import InvalidInput
from helios_sim.failure_causes import SYSTEM_ERROR
from rich.console import Console

from helios_eval import ledger, run_folder
from helios_eval.episodes import episode_record, failure_snapshot, home_presets, service_settings
from helios_eval.episodes.episode_player import PlayedEpisode
from helios_eval.episodes.episode_record import Benchmark, EpisodeRecord, Noise, Semantics, Setting
from helios_eval.episodes.episode_spec import DETECTOR, TASK_CLASSES, EpisodeInputs, EpisodeSpec
from helios_eval.episodes.real_detector import equal_but_for_digest
from helios_eval.episodes.service_settings import differing_settings
from helios_eval.episodes.worker import Skipped
from helios_eval.provenance import commit, machine, usable_cores
from helios_eval.report import played_before, write_report
from helios_eval.report.played_before import SHOWN, Folder, folders_of
from helios_eval.report.requested_episodes import KEYS, commands_of, requests_of
from helios_eval.report.run_description import RUN, machines_of, run_of
from helios_eval.report.skipped_homes import WITHOUT_TASK, SkippedHomes, without_task_key
from helios_eval.runs import played_with, results, unseen_homes
from helios_eval.runs.played_with import ALL_VERSIONS, VERSIONS
from helios_eval.runs.process_pool import Outcome, play_all
from helios_eval.runs.progress import Board
from helios_eval.runs.results import Picks

log = logging.getLogger(__name__)

# Keys that describe how the episodes were played.
OF_THE_PLAYED = (
    "commit", "machine", "machines", "cores", VERSIONS, ALL_VERSIONS, "started", "wall_s",
)  # fmt: skip
# Keys kept from the former file; scripts/relabel_agents.py writes the first.
_KEPT = ("relabelled", SHOWN)


@dataclass(frozen=True)
class Run:
    """Request of one `helios eval` command."""

    benchmark: Benchmark
    agents: tuple[str, ...]
    picks: tuple[Picks, ...]
    semantics: Semantics
    preset: str
    episodes: int
    seed0: int
    out: Path
    jobs: int
    noise: Noise | None
    settings: dict[str, Setting]
    ray: str | None = None
    why: str = ""  # reason for the ledger
    inputs: EpisodeInputs = field(default_factory=EpisodeInputs)

    def specs(self) -> list[EpisodeSpec]:
        """Episodes ordered by home, so that an interrupted run has compared its agents."""
        return [
            EpisodeSpec(
                self.benchmark,
                agent,
                self.semantics,
                self.preset,
                seed,
                self.noise,
                differing_settings(agent, self.settings),
                self.inputs,
            )
            for seed in range(self.seed0, self.seed0 + self.episodes)
            for agent in self.agents
        ]


def run(asked: Run, console: Console) -> list[EpisodeRecord]:
    """Play the missing episodes, then write results and report; return the records of this run.

    Results and report are written however the run ends; but in a folder with requests for homes
    from seed 1000 on only when these are all played. Raises Unavailable if nothing can be played or
    written, UsageError if the path is a file or a file of a setting cannot be used, InvalidInput
    for a folder with other content or with episodes that this run cannot continue, and for unseen
    homes with changed code or libraries, Conflict while another run plays into it, and
    KeyboardInterrupt after an interruption.
    """
    with run_folder.locked_folder(asked.out):
        return _run(asked, console)


def _run(asked: Run, console: Console) -> list[EpisodeRecord]:
    skipped = SkippedHomes(asked.preset, asked.settings, asked.seed0, asked.episodes)
    former = run_of(asked.out)
    skipped.add_known(former)
    specs = [spec for spec in asked.specs() if spec.seed not in skipped.seeds]
    there = episode_record.read(asked.out)
    check_goes_on(asked, there, former)
    known = {r.key: r for r in there if r.was_played}
    missing = [spec for spec in specs if spec.key not in known]
    here, began = commit(), time.time()
    is_unseen = unseen_homes.has_unseen(spec.seed for spec in specs)
    if missing and is_unseen:
        unseen_homes.check_commit(there, here, asked.out)
    if missing and (
        told := played_with.line_on_versions(there, former, here, asked.out, is_unseen)
    ):
        console.print(told, style="yellow", markup=False, highlight=False, soft_wrap=True)
    with run_folder.write_errors_as_unavailable(asked.out):
        write_run_description(asked, here, began, None, skipped.seeds, plays=bool(missing))
    where = "on Ray" if asked.ray else f"{asked.jobs} at a time"
    started = [known[s.key] for s in specs if s.key in known]
    board = Board(console, started, specs, where, shows_figures=not is_unseen)
    try:
        if missing:
            if told := played_before.line_before_a_run(missing, run_of(asked.out)):
                console.print(told, style="yellow", markup=False, highlight=False, soft_wrap=True)
            ledger.enter(missing, asked.out, here, asked.why)
            with closing(_outcomes(asked, missing, here)) as outcomes, board:
                for spec, came in outcomes:
                    if isinstance(came, Skipped):
                        board.skip(spec, came.reason, told=spec.seed in skipped.seeds)
                        skipped.seeds.add(spec.seed)
                        continue
                    known[spec.key] = _kept_record(asked.out, spec, came, here)
                    board.add(known[spec.key])
    except BaseException:
        try:
            said = finish(asked, here, began, skipped.seeds, bool(missing))
            said = said or f"A report on the finished episodes is in {asked.out}."
            console.print(said, markup=False, highlight=False, soft_wrap=True)
        except Exception:  # the first error is the one to tell
            log.exception("the report could not be written")
        raise
    if said := finish(asked, here, began, skipped.seeds, bool(missing)):
        console.print(said, highlight=False, soft_wrap=True)
    if skipped.seeds:
        console.print(skipped.sentence(), highlight=False, soft_wrap=True)
    return [known[spec.key] for spec in specs if spec.key in known]


def _kept_record(
    out: Path, spec: EpisodeSpec, came: PlayedEpisode | str, here: str
) -> EpisodeRecord:
    """The record of an outcome, appended to the folder's episodes. came: as of `Outcome`."""
    record = failed_record(spec, came, here) if isinstance(came, str) else came.record
    with run_folder.write_errors_as_unavailable(out):
        if not isinstance(came, str) and came.snapshot is not None:
            failure_snapshot.keep(out, came.snapshot)
        episode_record.append(out, record)
    return record


def finish(
    asked: Run,
    here: str,
    began_s: float,
    skipped: Collection[int],
    plays: bool,
) -> str:
    """Write the description of a run that ends, its results and its report.

    Returns a sentence if there are no results and report to write yet; else an empty text.
    """
    with run_folder.write_errors_as_unavailable(asked.out):
        wall_s = time.time() - began_s
        write_run_description(asked, here, began_s, wall_s, skipped, plays)
        there = episode_record.read(asked.out)
        if lacks := unseen_homes.unfinished(there, run_of(asked.out)):
            return str(lacks)
        results.write(asked.out, there, asked.picks)
        if not there:
            return "No episode is played yet, so there is no report."
        unseen_homes.mark_shown(asked.out)
        write_report(asked.out)
        return ""


def check_goes_on(asked: Run, there: Sequence[EpisodeRecord], former: Mapping[str, Any]) -> None:
    """Check that a run can continue the episodes of a folder.

    Raises InvalidInput if these were played in homes or under noise of the same name but other
    content, by an agent with other settings, or with another file of a setting. Another commit is
    allowed, since every record names its own; so is a setting added since then.
    """
    for agent in {r.agent for r in there} & set(asked.agents):
        now, before = (
            service_settings.default_settings_of(agent),
            former.get("ran_with", {}).get(agent, {}),
        )
        for name in sorted(now.keys() & before.keys()):
            if now[name] != before[name]:
                raise InvalidInput(
                    f"{asked.out} holds episodes that {agent} played with {name} = {before[name]}; "
                    f"it is {now[name]} here, so this run cannot go on from them; take another "
                    "folder"
                )
    digest = home_presets.digest_of(asked.preset, asked.inputs.plans)
    files = played_with.files_of(asked.agents, asked.settings) if there else {}
    for r in there:
        if r.preset == asked.preset and r.preset_hash != digest:
            what, was, now = f"preset {r.preset}", r.preset_hash[:12], digest[:12]
        elif asked.noise and r.noise and _renewed(r.noise, asked.noise):
            what = f"noise table {r.noise.table}"
            was, now = r.noise.digest[:12], asked.noise.digest[:12]
        elif other := _other_content(r, asked) or played_with.changed_file(r, files, former):
            what, was, now = other
        else:
            continue
        raise InvalidInput(
            f"{asked.out} holds episodes of another {what} ({was}; here it is {now}), so "
            "this run cannot go on from them; take another folder"
        )


def _other_content(r: EpisodeRecord, asked: Run) -> tuple[str, str, str] | None:
    """(what, name there, name here) of a detector or table of classes with another digest."""
    for key, what in ((DETECTOR, "file of the detector"), (TASK_CLASSES, "table of classes")):
        was, now = str(r.settings.get(key, "")), str(asked.settings.get(key, ""))
        if was and now and was != now and equal_but_for_digest(was, now):
            return what, was, now
    return None


def _renewed(was: Noise, now: Noise) -> bool:
    return was.table == now.table and was.digest != now.digest


def failed_record(spec: EpisodeSpec, why: str, here: str) -> EpisodeRecord:
    """The record of an episode that could not be played."""
    return EpisodeRecord(
        benchmark=spec.benchmark, agent=spec.agent, semantics=spec.semantics, preset=spec.preset,
        seed=spec.seed, noise=spec.noise, settings=spec.settings, instruction="", object_class="",
        absent=spec.target_absent,
        find_object=False, pick=False, find_receptacle=False, place=False, success=False,
        collisions=0, steps=0, path_m=0.0, picks=0, cause=SYSTEM_ERROR, state="failed",
        message=why, wall_s=0.0, step_ms=0.0, commit=here,
        preset_hash=home_presets.digest_of(spec.preset, spec.inputs.plans),
        structure_hash="", home_file=spec.home_file,
    )  # fmt: skip


def write_run_description(
    asked: Run,
    here: str,
    began_s: float,
    wall_s: float | None,
    skipped: Collection[int] = (),
    plays: bool = True,
) -> None:
    """Write `run.json`: the request, the commands, the program's version and the machine.

    `began_s` is in seconds since 1970. A new folder keeps the time of its first start. skipped:
    seeds of homes without a task of the run's classes. plays: False if no episode is missing; the
    commit and the machine then stay those that played.
    """
    command = ["helios", *sys.argv[1:]]
    former = run_of(asked.out)
    started = datetime.fromtimestamp(began_s, UTC).isoformat(timespec="seconds")
    folders = folders_of(former)
    if str(asked.out) not in {f.out for f in folders}:
        folders.append(Folder(str(asked.out), started))
    before = [c for c in commands_of(former) if c != command]
    plain: dict[str, Any] = asdict(asked)
    plain["noise"] = asked.noise.model_dump() if asked.noise else None
    plain["inputs"].pop("plans")
    plans = asked.inputs.plans
    if plans is not None:
        plain["homes"] = [plans.label_of(k) for k in range(len(plans.sources))]
    without = dict(former.get(WITHOUT_TASK, {}))
    if skipped:
        key = without_task_key(plain)
        without[key] = sorted({*without.get(key, ()), *skipped})
    order = json.loads(json.dumps({key: plain[key] for key in KEYS}))
    description: dict[str, Any] = (
        plain
        | {k: former[k] for k in _KEPT if k in former}
        | {
            "out": str(asked.out),
            **({WITHOUT_TASK: without} if without else {}),
            "folders": [asdict(f) for f in folders],
            "asked": [*(o for o in requests_of(former) if o != order), order],
            "ran_with": former.get("ran_with", {})
            | {agent: service_settings.default_settings_of(agent) for agent in asked.agents},
            "command": command,
            "commands": [*before, command],
            "preset_hash": home_presets.digest_of(asked.preset, asked.inputs.plans),
            "noise_hash": asked.noise.digest if asked.noise else None,
            **played_with.described(asked.agents, asked.settings, former),
            **_how_played(here, former),
            "started": started,
            "wall_s": None if wall_s is None else round(wall_s, 1),
        }
        | ({} if plays else {key: former[key] for key in OF_THE_PLAYED if key in former})
    )
    write_file(asked.out / RUN, json.dumps(description, indent=1) + "\n")


def _how_played(here: str, former: Mapping[str, Any]) -> dict[str, Any]:
    """Code and machine of this run, for `run.json`."""
    versions = played_with.versions_here()
    return {
        "commit": here,
        "machine": machine(),
        "machines": list(dict.fromkeys([*machines_of(former), machine()])),
        "cores": usable_cores(),
        VERSIONS: versions,
        ALL_VERSIONS: [*(v for v in played_with.versions_of(former) if v != versions), versions],
    }


def _outcomes(asked: Run, missing: Sequence[EpisodeSpec], here: str) -> Generator[Outcome]:
    if asked.ray is None:
        return play_all(missing, asked.jobs, here)
    from helios_eval.runs.ray_pool import play_all_on_ray

    return play_all_on_ray(missing, asked.ray, here)
