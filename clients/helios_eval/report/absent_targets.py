"""Rates and report table of absent targets: tasks for an object that is not in the home."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from helios_sim.failure_causes import PICK_FAILED, WRONG_OBJECT
from numpy.typing import NDArray

from helios_eval.episodes.episode_record import EpisodeRecord
from helios_eval.report import number_format
from helios_eval.report.agent_groups import Arm
from helios_eval.report.interval_statistics import wilson
from helios_eval.report.record_metrics import value
from helios_eval.report.report_model import Cell, Rows, Table

SUCCESS = (
    "With an absent target, success is that the agent reports that it found no object, and what it "
    "picked lies where it was."
)
WHICH_EPISODES = (
    f"SR is over all episodes. {SUCCESS} FindObj, Pick, FindRec, Place and partial are means over "
    "the episodes with a present target alone."
)


def has_any(arm: Arm) -> bool:
    """True if the arm was to have absent targets, whether or not one was drawn."""
    return arm.absent_share > 0


def rates(
    records: Sequence[EpisodeRecord], picks: int | None = None
) -> dict[str, NDArray[np.float64]]:
    """Samples [n] of 0 or 1 by rate; empty if no record has an absent target.

    SR_present and SR_absent: success with a present, or an absent, target. false_not_found: the
    report "object not found" with a present one. With a limit of picks, an episode that exceeds it
    scores 0.
    """
    absent = [r for r in records if r.absent]
    present = [r for r in records if not r.absent]
    if not absent:
        return {}
    found = {
        "SR_present": [value(r, "SR", picks) for r in present],
        "SR_absent": [value(r, "SR", picks) for r in absent],
        "false_not_found": [
            false_not_found(r) and (picks is None or r.picks <= picks) for r in present
        ],
    }
    return {name: np.array(sample, dtype=np.float64) for name, sample in found.items()}


def false_not_found(record: EpisodeRecord) -> bool:
    """True if the agent reported that it found no object, although the home has it."""
    return not record.absent and record.not_found and not record.success


def ended_at_failed_pick(record: EpisodeRecord) -> bool:
    """True if the target is absent, and the agent reported a failed pick without taking
    anything."""
    said = record.state == "failed" and record.reported_cause == PICK_FAILED
    return record.absent and said and record.wrong_picks == 0


def table(arms: Sequence[Arm]) -> Table | None:
    """Table of the answers with present and with absent targets; None without such an arm."""
    rows = Rows()
    for arm in filter(has_any, arms):
        present = [r for r in arm.records if not r.absent]
        absent = [r for r in arm.records if r.absent]
        rows.add(
            [
                arm.label,
                _share([r.success for r in arm.records]),
                _share([r.success for r in present]),
                _share([false_not_found(r) for r in present]),
                str(len(present)),
                _share([r.success for r in absent]),
                _share([ended_at_failed_pick(r) for r in absent]),
                _share([r.cause == WRONG_OBJECT and not ended_at_failed_pick(r) for r in absent]),
                str(len(absent)),
            ]
        )
    if not rows.rows:
        return None
    return rows.table(
        "Present and absent targets",
        ["agent", "all: SR", "present: SR", "present: false not found", "n present",
         "absent: right not found", "absent: only a failed pick", "absent: wrong object",
         "n absent"],
        "Percent of the episodes with a present, or an absent, target; below it the 95 % Wilson "
        "interval. Picks are unlimited. A target is absent if the home has no object of the asked "
        "class. False not found: the agent reported that it found no object, although the home "
        "has it. Right not found: the same report with an absent target, and what was picked lies "
        "where it was. Only a failed pick: the agent took nothing, and reported that a pick of the "
        "object failed; this is no success, since it says that the object is there. Wrong object: "
        "the agent picked an object and left it elsewhere, reported success, or stopped at a "
        "failed pick. The other episodes with an absent target ended otherwise, such as by the "
        "step budget.",
    )  # fmt: skip


def _share(so: Sequence[bool]) -> Cell:
    """Share of the true ones, in percent, with its interval; "–" without episodes."""
    if not so:
        return Cell(number_format.NONE, "", "muted")
    i = wilson(sum(so), len(so))
    return Cell(
        number_format.number(100 * i.value, 1), number_format.bounds(100 * i.low, 100 * i.high, 1)
    )
