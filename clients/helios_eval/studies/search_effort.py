"""Effort of the search for the object, by agent, from the episodes of `helios eval ovmm`.

    python -m helios_eval.studies.search_effort runs/large --against helios-paper

Prints, as Markdown: the share of homes with FindObj, the mean steps until it, the mean over all
homes in which one without FindObj counts with the whole step budget, SPL of FindObj (share times
the shortest path over the path driven until then, 0 without FindObj), and the differences to one
agent over the same homes, with 95 % intervals. Of the whole task, Newcombe's score interval stands
where fewer than six homes differ. A run whose records lack the paths is refused: they are older.
An incomplete run is named on the standard error.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from helios_core.errors import HeliosError, InvalidInput

from helios_eval.episodes import episode_record
from helios_eval.episodes.episode_spec import MAX_STEPS
from helios_eval.episodes.home_presets import default_steps
from helios_eval.report.agent_groups import Arm, arms_of, in_common
from helios_eval.report.interval_statistics import (
    Interval,
    Mean,
    Values,
    mean_sem,
    paired_difference,
    score_difference,
    wilson,
)
from helios_eval.report.number_format import number, share, signed
from helios_eval.report.requested_episodes import seeds_asked
from helios_eval.report.run_description import missing, run_of

HEAD = ("agent", "homes", "FindObj, %", "steps to FindObj", "to FindObj, else budget",
        "difference", "SPL of FindObj, %", "difference", "whole task: difference")  # fmt: skip
AGAINST = "helios-paper"


def steps_of(arm: Arm) -> Values:
    """Steps [n] to FindObj where the object is there; without FindObj the budget of the run, so
    that no agent gains by giving up."""
    present = [r for r in arm.records if not r.absent]
    return np.array(
        [
            (r.find_object and r.find_object_steps)
            or r.settings.get(MAX_STEPS, default_steps(r.preset, r.benchmark))
            for r in present
        ],
        float,
    )


def spl_of(arm: Arm) -> Values:
    """SPL of FindObj [n] of the episodes whose object is in the home. Raises InvalidInput if a
    record lacks its paths."""
    found: list[float] = []
    for record in arm.records:
        if record.absent:
            continue
        if not record.find_object:
            found.append(0.0)
            continue
        if record.find_object_spl is None:
            raise InvalidInput(
                f"episode {record.key} lacks the path to the object, as older records do; "
                "play it again into another folder"
            )
        found.append(record.find_object_spl)
    return np.array(found)


def rows(arms: Sequence[Arm], against: str = AGAINST) -> list[tuple[str, ...]]:
    """A row of `HEAD` for each arm; differences to the arm `against`. Raises InvalidInput without
    that arm, and for records without paths."""
    first = next((arm for arm in arms if arm.label == against), None)
    if first is None:
        names = ", ".join(arm.label for arm in arms)
        raise InvalidInput(f"there is no arm {against}; give one of {names}")
    out: list[tuple[str, ...]] = []
    for arm in arms:
        spl = mean_sem(spl_of(arm))
        present = [r for r in arm.records if not r.absent]
        by_steps, by_spl, by_success = _differences(arm, first)
        w = wilson(sum(r.find_object for r in present), len(present))
        steps = np.array([r.find_object_steps for r in present if r.find_object_steps], float)
        spent = mean_sem(steps) if len(steps) else Mean(math.nan, math.nan, 0)
        out.append(
            (
                arm.label,
                str(len(present)),
                share(w),
                f"{number(spent.mean, 0)} ± {number(spent.sem, 0)}",
                number(float(steps_of(arm).mean()), 0),
                by_steps,
                f"{100 * spl.mean:.1f} ± {100 * spl.sem:.1f}",
                by_spl,
                by_success,
            )
        )
    return out


def _differences(arm: Arm, first: Arm) -> tuple[str, str, str]:
    """Differences of an arm to the first in steps, SPL and the whole task, as text."""
    if arm is first:
        return "", "", ""
    pairs = in_common(arm, first)
    mine, theirs = ([r for r in records if not r.absent] for records in pairs)
    own, other = replace(arm, records=tuple(mine)), replace(first, records=tuple(theirs))
    success, success_of_other = (
        np.array([float(r.success) for r in records]) for records in (mine, theirs)
    )
    whole = paired_difference(success, success_of_other)
    if not whole.has_bounds:
        whole = score_difference(success, success_of_other)
    return (
        _told(paired_difference(steps_of(own), steps_of(other)), 1, 0),
        _told(paired_difference(spl_of(own), spl_of(other)), 100, 1),
        _told(whole, 100, 1),
    )


def _told(d: Interval, scale: float, digits: int) -> str:
    text = signed(scale * d.value, digits)
    if d.has_bounds:
        text += f" ({signed(scale * d.low, digits)} to {signed(scale * d.high, digits)})"
    return text


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m helios_eval.studies.search_effort",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("folder", type=Path, help="folder of `helios eval ovmm`")
    parser.add_argument("--against", default=AGAINST, help="agent of the differences")
    given = parser.parse_args(argv)
    folder: Path = given.folder
    try:
        records = episode_record.read(folder)
        if not records:
            raise InvalidInput(f"{folder} holds no episode; give a folder of `helios eval ovmm`")
        asked = seeds_asked(run_of(folder))
        arms = [arm for arm in arms_of(records, asked) if arm.benchmark == "ovmm"]
        lacking = sum(missing(arms, asked).values())
        if lacking:
            print(f"search_effort: not complete, {lacking} episodes lack", file=sys.stderr)
        found = rows(arms, given.against)
    except HeliosError as error:
        print(f"search_effort: {error.message}", file=sys.stderr)
        return 2
    print("| " + " | ".join(HEAD) + " |\n|---|" + "--:|" * (len(HEAD) - 1))
    for row in found:
        print("| " + " | ".join(row) + " |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
