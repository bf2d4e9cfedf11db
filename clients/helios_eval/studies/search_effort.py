"""Effort of the search for the object, by agent, from the episodes of `helios eval ovmm`.

    python -m helios_eval.studies.search_effort runs/large

Prints, as Markdown: the share of homes with FindObj, the mean steps until it, SPL of FindObj (share
times the shortest path over the path driven until then, 0 without FindObj), and the differences of
both to the first agent over the same homes, with 95 % intervals. A run whose records lack the paths
is refused: they are older.
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
from helios_eval.report.agent_groups import Arm, arms_of, in_common
from helios_eval.report.interval_statistics import (
    Interval,
    Mean,
    Values,
    mean_sem,
    paired_difference,
    wilson,
)
from helios_eval.report.number_format import number, signed

HEAD = ("agent", "homes", "FindObj, %", "steps to FindObj", "SPL of FindObj, %", "SPL: difference",
        "whole task: difference")  # fmt: skip


def spl_of(arm: Arm) -> Values:
    """SPL of FindObj [n] of the episodes whose object is in the home. Raises InvalidInput if a
    record lacks its paths."""
    found: list[float] = []
    for record in arm.records:
        if record.absent:
            continue
        if record.find_object_spl is None:
            raise InvalidInput(
                f"episode {record.key} lacks the path to the object, as older records do; "
                "play it again into another folder"
            )
        found.append(record.find_object_spl)
    return np.array(found)


def rows(arms: Sequence[Arm]) -> list[tuple[str, ...]]:
    """A row of `HEAD` for each arm; differences to the first."""
    out: list[tuple[str, ...]] = []
    for arm in arms:
        spl = mean_sem(spl_of(arm))
        present = [r for r in arm.records if not r.absent]
        w = wilson(sum(r.find_object for r in present), len(present))
        steps = np.array([r.find_object_steps for r in present if r.find_object_steps], float)
        spent = mean_sem(steps) if len(steps) else Mean(math.nan, math.nan, 0)
        out.append((
            arm.label, str(len(present)),
            f"{100 * w.value:.1f} ({100 * w.low:.1f} to {100 * w.high:.1f})",
            f"{number(spent.mean, 0)} ± {number(spent.sem, 0)}",
            f"{100 * spl.mean:.1f} ± {100 * spl.sem:.1f}", *_differences(arm, arms[0]),
        ))  # fmt: skip
    return out


def _differences(arm: Arm, first: Arm) -> tuple[str, str]:
    if arm is first:
        return "", ""
    mine, theirs = in_common(arm, first)
    own, other = replace(arm, records=tuple(mine)), replace(first, records=tuple(theirs))
    success, success_of_other = (
        np.array([float(r.success) for r in records]) for records in (mine, theirs)
    )
    return (
        _told(paired_difference(spl_of(own), spl_of(other))),
        _told(paired_difference(success, success_of_other)),
    )


def _told(d: Interval) -> str:
    text = signed(100 * d.value, 1)
    if d.has_bounds:
        text += f" ({signed(100 * d.low, 1)} to {signed(100 * d.high, 1)})"
    return text


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m helios_eval.studies.search_effort", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("folder", type=Path, help="folder of `helios eval ovmm`")
    folder: Path = parser.parse_args(argv).folder
    try:
        records = episode_record.read(folder)
        if not records:
            raise InvalidInput(f"{folder} holds no episode; give a folder of `helios eval ovmm`")
        found = rows([arm for arm in arms_of(records) if arm.benchmark == "ovmm"])
    except HeliosError as error:
        print(f"search_effort: {error.message}", file=sys.stderr)
        return 2
    print("| " + " | ".join(HEAD) + " |\n|---|" + "--:|" * (len(HEAD) - 1))
    for row in found:
        print("| " + " | ".join(row) + " |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
