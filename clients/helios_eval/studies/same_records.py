"""Comparison of episodes that were played again with their published records, field by field.

    helios eval ovmm --preset ovmm-v1 --seed0 2000 --episodes 20 --agents helios --out runs/again \\
        --why replay-of-published-episodes
    python -m helios_eval.studies.same_records docs/results/our-agent runs/again

All fields that the published record has must be equal: steps, path, picks, verdicts and messages.
Times and the commit may differ. Ends with status 1 if an episode differs.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from helios_core.errors import HeliosError, InvalidInput

from helios_eval.episodes import episode_record
from helios_eval.episodes.episode_record import EpisodeRecord

MAY_DIFFER = frozenset({"wall_s", "cpu_s", "step_ms", "stage_ms", "commit"})


@dataclass
class Comparison:
    """Episodes that both runs have. differing: key of an episode -> fields that differ."""

    episodes: int = 0
    differing: dict[str, list[str]] = field(default_factory=dict)

    @property
    def sentence(self) -> str:
        equal = self.episodes - len(self.differing)
        return f"{equal} of {self.episodes} episodes are equal in every published field"


def compare(published: Iterable[EpisodeRecord], again: Iterable[EpisodeRecord]) -> Comparison:
    """Raises InvalidInput if no episode is in both."""
    known = {record.key: record for record in published}
    found = Comparison()
    for record in again:
        old = known.get(record.key)
        if old is None:
            continue
        found.episodes += 1
        fields = sorted(old.model_fields_set - MAY_DIFFER)
        if other := [name for name in fields if getattr(old, name) != getattr(record, name)]:
            found.differing[record.key] = other
    if not found.episodes:
        raise InvalidInput("no episode is in both folders; play the published seeds and agents")
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m helios_eval.studies.same_records",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("published", type=Path, help="folder of published results")
    parser.add_argument("again", type=Path, help="folder of the same episodes, played again")
    given = parser.parse_args(arguments)
    try:
        found = compare(episode_record.read(given.published), episode_record.read(given.again))
    except HeliosError as error:
        print(f"same_records: {error.message}", file=sys.stderr)
        return 2
    for key, fields in found.differing.items():
        print(f"{key}: {', '.join(fields)}")
    print(found.sentence)
    return 1 if found.differing else 0


if __name__ == "__main__":
    sys.exit(main())
