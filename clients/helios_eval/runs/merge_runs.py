"""Several runs as one: their episodes, their requests, and the packed form for committing.

A packed episode is a line without beliefs and stage times: those are nine tenths of it, and no
table of the paper needs them. A folder of packed episodes can be reported like any other, and a run
into a copy of it continues from there.
"""

from __future__ import annotations

import gzip
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from helios_client.usage_errors import UsageError
from helios_core.atomic_file import write_file
from helios_core.errors import InvalidInput

from helios_eval.episodes.episode_record import EPISODES, PACKED, EpisodeRecord, read
from helios_eval.report.played_before import SHOWN, folders_of
from helios_eval.report.requested_episodes import commands_of, requests_of
from helios_eval.report.run_description import RUN, run_of
from helios_eval.report.skipped_homes import WITHOUT_TASK
from helios_eval.runs.played_with import ALL_VERSIONS, FILES, versions_of

# Fields that may differ between two plays of an episode.
_PASSING = frozenset(
    {"wall_s", "step_ms", "cpu_s", "stage_ms", "beliefs", "commit", "reported_cause"}
)


def episodes(folders: Sequence[Path]) -> list[EpisodeRecord]:
    """Episodes of all folders, each once.

    An episode that could not be played gives way to one that was. Raises UsageError if one of
    several folders holds none, and InvalidInput if two folders differ on an episode, on the content
    of a preset, noise table or file of a setting, or on the settings of an agent.
    """
    _check_same_content(folders)
    found: dict[str, tuple[EpisodeRecord, Path]] = {}
    for folder in folders:
        there = read(folder)
        if not there and len(folders) > 1:
            raise UsageError(
                f"{folder} holds no episode ({EPISODES} or {PACKED}); name folders of runs, or "
                "leave it out"
            )
        for record in there:
            first, where = found.setdefault(record.key, (record, folder))
            if not (first.was_played and record.was_played):
                if record.was_played:
                    found[record.key] = record, folder
                continue
            if fields := differing_fields(first, record):
                raise InvalidInput(
                    f"seed {record.seed} of {record.agent} went differently in {where} and in "
                    f"{folder} ({', '.join(fields)}); leave one of them out"
                )
    return [record for record, _ in found.values()]


def differing_fields(first: EpisodeRecord, second: EpisodeRecord) -> list[str]:
    """Names of the fields in which two plays of an episode went differently, sorted.

    Fields that one of the records lacks are not compared: former records lack some, and packed
    ones those with the default value.
    """
    both = (first.model_fields_set & second.model_fields_set) - _PASSING
    pairs = {name: (getattr(first, name), getattr(second, name)) for name in sorted(both)}
    return [name for name, (a, b) in pairs.items() if None not in (a, b) and a != b]


def _check_same_content(folders: Sequence[Path]) -> None:
    known: dict[tuple[str, ...], tuple[object, Path]] = {}
    for folder in folders:
        content: dict[tuple[str, ...], object] = {}
        for record in read(folder):
            content["preset", record.preset] = record.preset_hash
            if record.noise is not None:
                content["noise table", record.noise.table] = record.noise.digest
        described = run_of(folder)
        for agent, settings in described.get("ran_with", {}).items():
            content |= {("setting", agent, name): value for name, value in settings.items()}
        content |= {("file of", name): value for name, value in described.get(FILES, {}).items()}
        for what, value in content.items():
            first, where = known.setdefault(what, (value, folder))
            if first != value:
                raise InvalidInput(
                    f"{' '.join(what)} is {first} in {where} and {value} in {folder}; report them "
                    "apart"
                )


def run(folders: Sequence[Path]) -> dict[str, Any]:
    """Common `run.json`: of one folder its own; of several their commands and shared facts."""
    runs = [run_of(folder) for folder in folders]
    if len(runs) == 1:
        return runs[0]
    described = [r for r in runs if r]
    shared = {
        key: described[0][key]
        for key in ("machine", "cores", "jobs", "versions", "commit", "why")
        if described
        and all(r.get(key) == described[0].get(key) for r in described)
        and key in described[0]
    }
    limits = max((r.get("picks", []) for r in described), key=len, default=[])
    together = {"commands": [c for r in described for c in commands_of(r)], "picks": limits}
    together |= {"asked": [order for r in described for order in requests_of(r)]}
    together |= {"folders": [asdict(f) for r in described for f in folders_of(r)]}
    ran: dict[str, Any] = {}
    for r in described:
        ran = r.get("ran_with", {}) | ran
    skipped: dict[str, list[int]] = {}
    for key, seeds in ((k, s) for r in described for k, s in r.get(WITHOUT_TASK, {}).items()):
        skipped[key] = sorted({*skipped.get(key, ()), *seeds})
    together |= {"ran_with": ran} if ran else {}
    together |= _merged(described)
    return shared | together | ({WITHOUT_TASK: skipped} if skipped else {})


def _merged(described: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Files of settings and steps of several `run.json`, and versions if there are several."""
    versions = [v for r in described for v in versions_of(r)]
    files: dict[str, str] = {}
    shown: dict[str, list[int]] = {}
    for r in described:
        files |= r.get(FILES, {})
        for arm, numbers in r.get(SHOWN, {}).items():
            shown[arm] = max(shown.get(arm, []), numbers, key=len)
    every = [v for k, v in enumerate(versions) if v not in versions[:k]]
    made = {ALL_VERSIONS: every if len(every) > 1 else [], FILES: files, SHOWN: shown}
    return {key: value for key, value in made.items() if value}


def pack(folder: Path, records: Sequence[EpisodeRecord], run: dict[str, Any]) -> None:
    """Write the packed form; equal episodes give equal bytes.

    Raises UsageError for the folder of a run, whose own episodes would hide these.
    """
    if (folder / EPISODES).exists():
        raise UsageError(f"{folder} holds a run; give another folder with --out")
    folder.mkdir(parents=True, exist_ok=True)
    write_file(folder / RUN, json.dumps(run, indent=1) + "\n")
    small = (r.model_copy(update={"beliefs": (), "stage_ms": {}}) for r in records)
    lines = "".join(r.model_dump_json(exclude_defaults=True) + "\n" for r in small)
    write_file(folder / PACKED, gzip.compress(lines.encode(), 9, mtime=0))
