"""Report table on absent targets: tasks that ask for an object that is not in the home."""

from __future__ import annotations

from collections.abc import Sequence

from helios_sim.failure_causes import WRONG_OBJECT

from helios_eval.report import number_format
from helios_eval.report.agent_groups import Arm
from helios_eval.report.interval_statistics import wilson
from helios_eval.report.report_model import Cell, Rows, Table

SUCCESS = (
    "With an absent target, success is that the agent reports that it found no object, and picks "
    "nothing."
)
WHICH_EPISODES = (
    f"SR is over all episodes. {SUCCESS} FindObj, Pick, FindRec, Place and partial are means over "
    "the episodes with a present target alone."
)


def has_any(arm: Arm) -> bool:
    """True if the arm was to have absent targets, whether or not one was drawn."""
    return arm.absent_share > 0


def table(arms: Sequence[Arm]) -> Table | None:
    """Table of the answers with present and with absent targets; None without such an arm."""
    rows = Rows()
    for arm in filter(has_any, arms):
        present = [r for r in arm.records if not r.absent]
        absent = [r for r in arm.records if r.absent]
        rows.add([
            arm.label,
            _share([r.success for r in present]),
            _share([r.not_found and not r.success for r in present]),
            str(len(present)),
            _share([r.success for r in absent]),
            _share([r.cause == WRONG_OBJECT for r in absent]),
            str(len(absent)),
        ])  # fmt: skip
    if not rows.rows:
        return None
    return rows.table(
        "Present and absent targets",
        ["agent", "present: SR", "present: false not found", "n present",
         "absent: right not found", "absent: wrong object", "n absent"],
        "Percent of the episodes with a present, or an absent, target; below it the 95 % Wilson "
        "interval. Picks are unlimited. A target is absent if the home has no object of the asked "
        "class. False not found: the agent reported that it found no object, although the home "
        "has it. Right not found: the same report with an absent target, and no object picked. "
        "Wrong object: the agent picked an object, or believed to the end in one that it could "
        "not pick. The other episodes with an absent target ended otherwise, such as by the step "
        "budget.",
    )  # fmt: skip


def _share(so: Sequence[bool]) -> Cell:
    """Share of the true ones, in percent, with its interval; "–" without episodes."""
    if not so:
        return Cell(number_format.NONE, "", "muted")
    i = wilson(sum(so), len(so))
    return Cell(
        number_format.number(100 * i.value, 1), number_format.bounds(100 * i.low, 100 * i.high, 1)
    )
