"""Rules of a run that plays homes from seed 1000 on: one commit, and no figure before the end."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from helios_core.errors import InvalidInput

from helios_eval.episodes.episode_record import EpisodeRecord
from helios_eval.ledger import FIRST_SEED, LEDGER
from helios_eval.provenance import DIRTY, UNKNOWN, same_code

AT_THE_END = (
    "{done} of {total} episodes are played. Results and report of homes from seed "
    f"{FIRST_SEED} on are written with the last one; give the command again."
)


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
