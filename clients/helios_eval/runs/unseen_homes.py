"""Rules of a run that plays homes from seed 1000 on: one commit, and no figure before the end.

The end is that of all requests for such homes in the folder. `run.json` keeps how many homes of
each arm the figures were over whenever they were written, so that a report can tell of homes that
were added afterwards.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from helios_core.atomic_file import write_file
from helios_core.errors import InvalidInput

from helios_eval.episodes.episode_record import EpisodeRecord, read
from helios_eval.ledger import FIRST_SEED, LEDGER
from helios_eval.provenance import DIRTY, UNKNOWN, same_code
from helios_eval.report.played_before import SHOWN
from helios_eval.report.requested_episodes import seeds_asked
from helios_eval.report.run_description import RUN, run_of

AT_THE_END = (
    "{done} of {total} episodes are played. Results and report of homes from seed "
    f"{FIRST_SEED} on are written with the last one; give their command again."
)


@dataclass(frozen=True)
class Unfinished:
    """Requests of a folder for homes from seed 1000 on that lack episodes."""

    done: int  # episodes that are there
    total: int  # episodes that were requested
    agents: tuple[str, ...]  # those that lack episodes

    def __str__(self) -> str:
        return AT_THE_END.format(done=self.done, total=self.total)


def unfinished(there: Iterable[EpisodeRecord], run: Mapping[str, Any]) -> Unfinished | None:
    """What the requests of a `run.json` lack among the episodes; None if nothing.

    An episode that could not be played is there: it counts as a failure.
    """
    played: dict[object, set[int]] = {}
    for r in there:
        settings = tuple(sorted(r.settings.items()))
        arm = (r.benchmark, r.agent, r.semantics, r.preset, r.noise, settings)
        played.setdefault(arm, set()).add(r.seed)
    total, lacking, agents = 0, 0, list[str]()
    for identity, seeds in seeds_asked(run).items():
        unseen = {seed for seed in seeds if seed >= FIRST_SEED}
        absent = unseen - played.get(identity, set())
        total, lacking = total + len(unseen), lacking + len(absent)
        agents += [identity[1]] * bool(absent)
    if not lacking:
        return None
    return Unfinished(total - lacking, total, tuple(dict.fromkeys(agents)))


def prepare_report(
    there: Iterable[EpisodeRecord],
    run: Mapping[str, Any],
    folders: Sequence[Path],
    even_unfinished: bool,
    packs: bool,
) -> Unfinished | None:
    """Check that a report would be on all requested homes from seed 1000 on.

    there, run: episodes and `run.json` of the folders together. If some are lacking,
    `even_unfinished` marks the folders as shown, and `packs` (the episodes go to another folder)
    returns what is lacking: then no report may be written. Else raises InvalidInput.
    """
    lacks = unfinished(there, run)
    if lacks is None:
        return None
    if packs and not even_unfinished:
        return lacks
    if not even_unfinished:
        raise InvalidInput(
            f"{', '.join(map(str, folders))}: {lacks.done} of the {lacks.total} requested episodes "
            f"of homes from seed {FIRST_SEED} on are played ({', '.join(lacks.agents)} not in "
            "full); play the others first, or add --unfinished for a report that says so"
        )
    for folder in folders:
        mark_shown(folder)
    return None


def mark_shown(folder: Path) -> None:
    """Add to `run.json` over how many homes from seed 1000 on the figures of a folder are.

    The entry `SHOWN` has these numbers by arm, each that differs from the one before. A folder
    without `run.json` stays as it is.
    """
    run = run_of(folder)
    numbers: dict[str, int] = {}
    for r in read(folder) if run else []:
        if r.seed >= FIRST_SEED:
            arm = r.model_copy(update={"seed": 0}).key
            numbers[arm] = numbers.get(arm, 0) + 1
    shown = {arm: list(steps) for arm, steps in run.get(SHOWN, {}).items()}
    for arm, number in numbers.items():
        steps = shown.setdefault(arm, [])
        if steps[-1:] != [number]:
            steps.append(number)
    if shown != run.get(SHOWN, {}):
        write_file(folder / RUN, json.dumps({**run, SHOWN: shown}, indent=1) + "\n")


def has_unseen(seeds: Iterable[int]) -> bool:
    """True if some of the homes are not for development."""
    return any(seed >= FIRST_SEED for seed in seeds)


def check_commit(there: Sequence[EpisodeRecord], here: str, out: Path) -> None:
    """Check that a run of unseen homes may play on with the code of a commit.

    there: the episodes of the folder. here: the present commit; that of an installation outside a
    checkout is not checked. Raises InvalidInput if files were changed, or if played episodes have
    other code.
    """
    if here == UNKNOWN:
        return
    if here.endswith(DIRTY):
        raise InvalidInput(
            f"files differ from commit {here.removesuffix(DIRTY)}; homes from seed {FIRST_SEED} on "
            f"are played by committed code alone, so that others can repeat them: commit the "
            f"changes (not {LEDGER}), or play from another checkout"
        )
    played = (r for r in there if r.was_played and r.seed >= FIRST_SEED)
    for commit in sorted({r.commit.removesuffix(DIRTY) for r in played} - {here}):
        if not same_code(commit, here):
            raise InvalidInput(
                f"{out} holds episodes of commit {commit}, and its code is not that of {here}, "
                f"which is checked out; check out {commit} to go on, or take another folder"
            )
