"""Write the figures of the runs in docs/results into its pages; `--check` exits 1 if stale.

A run whose episodes were not all played gets no figures, only the number of episodes so far.
"""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from helios_eval.episodes import episode_record
from helios_eval.episodes.episode_record import EpisodeRecord
from helios_eval.episodes.episode_spec import SENSOR
from helios_eval.report import (
    absent_targets,
    number_format,
    paper_comparison,
    played_before,
    research_questions,
)
from helios_eval.report.agent_groups import Arm, arms_of, in_common
from helios_eval.report.interval_statistics import (
    paired_difference,
    score_difference,
    wilson,
)
from helios_eval.report.number_format import plural, scale, signed
from helios_eval.report.record_metrics import METRICS, NAMES, paired_values, values
from helios_eval.report.report_model import Table
from helios_eval.report.requested_episodes import Identity, seeds_asked
from helios_eval.report.run_description import is_dirty, missing, run_of
from helios_eval.studies import search_effort
from helios_sim.failure_causes import SYSTEM_ERROR
from helios_sim.home.presets import LARGE

from scripts.markdown_tables import DOCS, Block, code, table, write_or_check

SCRIPT = "scripts/page_of_results.py"
RESULTS = DOCS / "results"
EARLIER_PAGE = RESULTS / "earlier-helios-paper.md"
BRACKETS = str.maketrans("[]", "()")
PICK_LIMITS = {"SR, 5 picks": 5, "SR, 1 pick": 1}
NONE_COMPLETE = "No run is complete.\n"


@dataclass(frozen=True)
class Run:
    """Run in a folder of docs/results, under the title of its table. base: folder of a run of the
    same homes whose agents it is compared with; its own, if it plays each agent with and without
    errors of the sensors. arms: how many its commands play."""

    folder: str
    title: str
    base: str = ""
    arms: int = 1

    @property
    def path(self) -> Path:
        return RESULTS / self.folder


PAPER = (  # the paper's tables, by the agents as they are printed
    Run("table-1-printed-ovmm", "Table 1: by the benchmark's rule of a pick", arms=3),
    Run(
        "table-1-printed",
        "Table 1: if a wrong pick takes what lies there",
        "table-1-printed-ovmm",
        3,
    ),
    Run("table-2", "Table 2: object navigation", arms=4),
    Run("table-4-printed", "Table 4: ground-truth semantics", arms=2),
    Run(
        "table-4-printed-ovmm",
        "Table 4 by the benchmark's rule of a pick",
        "table-4-printed",
        2,
    ),
    Run("table-5-printed", "Table 5: assumption of the information gain", "table-1-printed"),
    Run("tables-6-8-printed", "Tables 6 to 8: sensitivity", "table-1-printed", 7),
    Run("realistic-sensor", "Errors of the camera and drift of the pose", "realistic-sensor", 4),
)
EARLIER = (  # the same tables by an earlier `helios-paper`, in other homes
    Run("table-1", "Table 1: components and baselines", arms=6),
    Run("table-4", "Table 4: ground-truth semantics", arms=2),
    Run("table-5", "Table 5: assumption of the information gain", "table-1"),
    Run("tables-6-8", "Tables 6 to 8: sensitivity", "table-1", 7),
    Run("table-1-ovmm-picks", "Table 1 by the benchmark's rule of a pick", "table-1", 3),
    Run("table-4-ovmm-picks", "Table 4 by the benchmark's rule of a pick", "table-4", 2),
)
BY_PICKS = ("table-1", "table-1-ovmm-picks", "table-1-printed-ovmm", "table-1-printed")
OURS = Run("our-agent", "helios and the paper's agents", arms=3)
JUDGE = (
    Run("judge", "One object in four is not in the home", arms=3),
    Run("judge-ovmm-v2", "With errors fitted to a real detector", arms=3),
    Run("judge-real-detector", "With a real detector", arms=3),
    Run("judge-real-furniture", "With a real detector and realistic furniture", arms=3),
    Run("judge-large", "Larger homes", arms=5),
    Run("judge-large-exact", "Larger homes, with a scorer without random errors", "judge-large", 2),
)


@functools.cache
def arms(folder: str) -> tuple[Arm, ...]:
    """Arms of a run; none before its first episode."""
    path = RESULTS / folder
    if not path.is_dir():
        return ()
    return tuple(arms_of(episode_record.read(path), _asked(folder)))


def is_complete(run: Run) -> bool:
    """True if all agents of a run were requested, and all that was requested was played."""
    found, asked = arms(run.folder), _asked(run.folder)
    return bool(found) and len(asked) >= run.arms and not missing(found, asked)


def _asked(folder: str) -> dict[Identity, set[int]]:
    return seeds_asked(run_of(RESULTS / folder))


def tables(runs: Sequence[Run], level: str = "####") -> str:
    """A table of means for each run, under headings of one level."""
    return "\n".join(f"{level} {run.title}\n\n{_of_run(run)}" for run in runs)


def judge() -> str:
    """A table of means for each run of the judge."""
    return "\n".join(f"### {run.title}\n\n{_of_run(run)}" for run in JUDGE)


def _of_run(run: Run) -> str:
    found = arms(run.folder)
    if not found:
        return "Not played yet.\n"
    if not is_complete(run):
        played = sum(len(arm.records) for arm in found)
        return f"Being played: {played} episodes so far. No figure is shown before the last.\n"
    blocks = [means(found)]
    if run.folder in BY_PICKS:
        blocks.append(by_picks(found))
    if run in JUDGE:
        blocks.append(among(found))
    if any(arm.task_classes for arm in found):
        blocks.append(by_class(found))
    if any(arm.preset == LARGE for arm in found):
        blocks.append(table(search_effort.HEAD, search_effort.rows(found)))
    if answers := absent_targets.table(found):
        blocks.insert(0, "Tasks whose object is in the home:\n")
        blocks += ["All tasks:\n", present_and_absent(answers)]
    base = next((r for r in (*PAPER, *EARLIER, *JUDGE) if r.folder == run.base), None)
    if base is not None and is_complete(base):
        blocks.append(beside(found, arms(base.folder)))
        if told := _other_code(found, arms(base.folder)):
            blocks.append(told)
    records = [record for arm in found for record in arm.records]
    if broken := sum(record.cause == SYSTEM_ERROR for record in records):
        blocks.append(
            f"{number_format.plural(broken, 'episode')} ended by an error of the system and "
            "counts as failed.\n"
        )
    blocks.append(f"Played by {_commits(records)}.\n")
    if said := played_before.sentence(records, run_of(run.path)):
        blocks.append(f"{said}\n")
    return "\n".join(blocks)


def _commits(records: Sequence[EpisodeRecord]) -> str:
    """Commits of a run; of several, or of changed code, with the number of episodes of each."""
    commits = Counter(
        record.commit[: played_before.SHORT_COMMIT] + "-dirty" * is_dirty(record.commit)
        for record in records
    )
    if len(commits) == 1 and not any(map(is_dirty, commits)):
        return code(next(iter(commits)))
    return " and ".join(
        f"{code(name)} ({number_format.plural(n, 'episode')})" for name, n in commits.most_common()
    )


def _other_code(found: Sequence[Arm], base: Sequence[Arm]) -> str:
    """Sentence that warns of another commit of the compared run; empty if they have the same."""
    mine, theirs = (
        {r.commit[: played_before.SHORT_COMMIT] for arm in side for r in arm.records}
        for side in (found, base)
    )
    if mine == theirs:
        return ""
    named = " and ".join(map(code, sorted(theirs)))
    return f"The compared run was played by {named}: the code differs too.\n"


def by_class(found: Sequence[Arm]) -> str:
    """Table of the whole tasks that succeeded, of how many, for each class of object."""
    classes = Counter(r.object_class for r in found[0].records)
    rows = [
        [
            name,
            str(homes),
            *(str(sum(r.success for r in arm.records if r.object_class == name)) for arm in found),
        ]
        for name, homes in classes.most_common()
    ]
    head = ["object", "homes", *(f"{_named(arm)} succeeds" for arm in found)]
    return table(head, rows)


def present_and_absent(answers: Table) -> str:
    """Table of the report about present and absent objects, as Markdown."""
    rows = [
        [f"{cell.text} {_plain(cell.note)}".strip() for cell in row.cells] for row in answers.rows
    ]
    return table([column.name for column in answers.columns], rows)


def beside(found: Sequence[Arm], base: Sequence[Arm]) -> str:
    """Table of differences of each arm to the same agent of another run, over the homes of both; an
    agent that the other run lacks is compared with `helios-paper`. An arm is not compared with
    itself."""
    others = {arm.agent: arm for arm in base if not dict(arm.settings).get(SENSOR)}
    pairs = [(arm, others.get(arm.agent, others["helios-paper"])) for arm in found]
    return _differences([(arm, other) for arm, other in pairs if arm is not other])


def among(found: Sequence[Arm]) -> str:
    """Table of differences of each arm to `helios-paper` of the same run."""
    paper = next(arm for arm in found if arm.agent == "helios-paper")
    return _differences([(arm, paper) for arm in found if arm is not paper])


def _differences(pairs: Sequence[tuple[Arm, Arm]]) -> str:
    """Table of paired differences, first minus second, of tasks whose object is in the home. Where
    fewer than six homes differ, the interval is a score interval."""
    rows: list[list[str]] = []
    for arm, other in pairs:
        mine, theirs = in_common(_present(arm), _present(other))
        cells: list[str] = []
        for name in ("FindObj", "Pick", "FindRec", "SR", "steps"):
            (x, y), k = paired_values(mine, theirs, name), scale(name)
            d = paired_difference(x, y)
            if not d.has_bounds and METRICS[name].binary:
                d = score_difference(x, y)
            digits = 0 if name == "steps" else 1
            bounds = number_format.bounds(d.low * k, d.high * k, digits, plus=True)
            cells.append(
                signed(d.value * k, digits) + (f" {_plain(bounds)}" if d.has_bounds else "")
            )
        rows.append([_label(arm, other), str(len(mine)), *cells])
    return table(["difference", "homes", "FindObj", "Pick", "FindRec", "SR", "steps"], rows)


def by_picks(found: Sequence[Arm]) -> str:
    """Table of paired differences of `helios-paper` to its ablations, by the limit of picks."""
    columns: list[tuple[str, int | None]] = [
        ("Pick", 1), ("Pick", None), ("SR", 1), ("SR", 5), ("SR", None),
    ]  # fmt: skip
    arm_of = {arm.agent: arm for arm in found}
    rows: list[list[str]] = []
    for agent in ("no-global-objective", "trusting"):
        mine, theirs = in_common(arm_of["helios-paper"], arm_of[agent])
        cells: list[str] = []
        for name, most in columns:
            d = paired_difference(values(mine, name, most), values(theirs, name, most))
            k = scale(name)
            bounds = number_format.bounds(d.low * k, d.high * k, 1, plus=True)
            cells.append(f"{signed(d.value * k, 1)} {_plain(bounds)}")
        rows.append([f"`helios-paper` − {code(agent)}", str(len(mine)), *cells])
    heads = [name if most is None else f"{name}, {plural(most, 'pick')}" for name, most in columns]
    return table(["difference", "homes", *heads], rows)


def _label(arm: Arm, other: Arm) -> str:
    """Names of two compared arms; of one agent under two rules of a pick, the rules."""
    if arm.agent == other.agent and arm.pick_rule != other.pick_rule:
        return f"{code(arm.agent)}, pick rule {code(arm.pick_rule)} − {code(other.pick_rule)}"
    mark = "" if arm.scorer == other.scorer else f", {code(arm.scorer)} − {code(other.scorer)}"
    return f"{_named(arm)} − {code(other.agent)}{mark}"


def _present(arm: Arm) -> Arm:
    """The arm without the tasks whose object is absent."""
    return replace(arm, records=tuple(r for r in arm.records if not r.absent))


def means(found: Sequence[Arm]) -> str:
    """Table with a row for each arm: shares in percent, the whole task with its interval. Tasks
    whose object is absent are left out."""
    shares = [name for name in NAMES[found[0].benchmark] if METRICS[name].binary and name != "SR"]
    rest = ["SPL"] if found[0].benchmark == "objectnav" else []
    limits = PICK_LIMITS if found[0].benchmark == "ovmm" else {}
    head = ["agent", "homes", *shares, "SR", *limits, *rest, "collisions", "steps"]
    rows: list[list[str]] = []
    for arm in map(_present, found):
        success = values(arm.records, "SR")
        w = wilson(int(success.sum()), len(success))
        rows.append(
            [
                _named(arm),
                str(len(arm.records)),
                *(_mean(arm, name) for name in shares),
                f"**{_mean(arm, 'SR')}** ({100 * w.low:.1f} to {100 * w.high:.1f})",
                *(_mean(arm, "SR", picks=most) for most in limits.values()),
                *(_mean(arm, name) for name in rest),
                _mean(arm, "collisions"),
                _mean(arm, "steps", 0),
            ]
        )
    return table(head, rows)


def pick_and_place() -> str:
    """Tables of means of Table 1 by each rule of a pick; then those of the agents that were played
    in other homes alone, and of Table 4."""
    blocks: list[str] = []
    rest: list[Arm] = []
    played: set[str] = set()
    for run in PAPER[:2]:
        if is_complete(run):
            found = arms(run.folder)
            played |= {arm.agent for arm in found}
            title = run.title.removeprefix("Table 1: ").capitalize()
            blocks += [f"{title}, homes {_range(found)}:\n", means(found)]
    for run in filter(is_complete, EARLIER[:2]):
        rest += [a for a in arms(run.folder) if a.semantics != "noisy" or a.agent not in played]
    blocks += [f"Other agents and ground-truth semantics, homes {_range(rest)}:\n", means(rest)]
    return "\n".join(blocks)


def _range(found: Sequence[Arm]) -> str:
    """First and last home of some arms."""
    seeds = [record.seed for arm in found for record in arm.records]
    return f"{min(seeds)}–{max(seeds)}"


def object_navigation() -> str:
    """Table of means of Table 2."""
    run = next(run for run in PAPER if run.folder == "table-2")
    return means(arms(run.folder)) if is_complete(run) else "Not played yet.\n"


def our_agent() -> str:
    """Means of our own agent and of those beside it, and their differences."""
    text = _of_run(OURS)
    return f"{text}\n{_answers(arms(OURS.folder))}" if is_complete(OURS) else text


def differences() -> str:
    """Tables of the answers to the questions of the runs, by each rule of a pick."""
    blocks: list[str] = []
    for rule in ("ovmm", "physical"):
        answers = _answers([arm for arm in _complete(PAPER) if arm.pick_rule == rule])
        if answers != NONE_COMPLETE:
            blocks.append(f"Pick rule `{rule}`:\n\n{answers}")
    return "\n".join(blocks) or NONE_COMPLETE


def earlier_differences() -> str:
    """Table of the answers of the earlier runs, with the pick rule of most of them."""
    return _answers(_complete(EARLIER))


def _answers(found: Sequence[Arm]) -> str:
    answers = research_questions.section(found)
    blocks = answers.blocks if answers else ()
    compared = next((block for block in blocks if isinstance(block, Table)), None)
    if compared is None:
        return NONE_COMPLETE
    rows: list[list[str]] = []
    group = ""
    for row in compared.rows:
        metric, first, second, difference, bounds, ratio, homes, verdict = (
            cell.text for cell in row.cells
        )
        if row.group != group:
            group = row.group
            rows.append([f"*{group}*", *[""] * 6])
        rows.append(
            [
                metric,
                first,
                second,
                f"{difference} {_plain(bounds)}",
                _plain(ratio),
                homes,
                verdict.partition(":")[0],
            ]
        )
    return table(["", "first, %", "second, %", "difference", "ratio", "homes", "verdict"], rows)


def relations() -> str:
    """Table of the ratios that the paper claims, with ours over the same homes, by each rule of a
    pick; object navigation has none. Ratios are of the agents as they are printed, once those runs
    are complete."""
    printed_arms, others = _complete(PAPER), _complete(EARLIER)
    rows: list[list[str]] = []
    for rule in ("ovmm", "physical"):
        found: dict[str, list[str]] = {}
        for arms_of_runs in (printed_arms, others):
            for benchmark in ("ovmm", "objectnav"):
                same = [a for a in arms_of_runs if (a.pick_rule, a.benchmark) == (rule, benchmark)]
                for row in _relations(same):
                    found.setdefault(row[0], row)
        rows += found.values()
    if not rows:
        return NONE_COMPLETE
    return table(["ratio of", "pick rule", "paper", "ours", "homes", "verdict"], rows)


def _relations(found: Sequence[Arm]) -> list[list[str]]:
    """Rows of the ratios between some arms of one benchmark and one rule of a pick, which were
    played from one home on."""
    compared = paper_comparison.relations(found)
    rows: list[list[str]] = []
    for row in compared.rows if compared is not None else ():
        claim, paper, ours, homes, verdict = row.cells
        first = min(record.seed for arm in found for record in arm.records)
        rows.append(
            [
                claim.text,
                "–" if "VLFM" in claim.text else f"`{found[0].pick_rule}`",
                f"{paper.text} ({paper.note})",
                f"{ours.text} {_plain(ours.note)}",
                f"{first}–{first + int(homes.text) - 1}",
                verdict.text,
            ]
        )
    return rows


def _complete(runs: Sequence[Run]) -> list[Arm]:
    """Arms of all runs that are complete, without errors of the sensors; of arms that were played
    twice, the first."""
    found: dict[Identity, Arm] = {}
    for run in filter(is_complete, runs):
        for arm in arms(run.folder):
            if not dict(arm.settings).get(SENSOR):
                found.setdefault(arm.identity, arm)
    return list(found.values())


def _named(arm: Arm) -> str:
    """Agent as code, and what differs from the plain run."""
    semantics = "" if arm.semantics == "noisy" else f", {arm.semantics}"
    rest = arm.label.removeprefix(arm.agent)
    return code(arm.agent) + (rest.replace(" · ", ", ") or semantics)


def _mean(arm: Arm, name: str, digits: int | None = None, picks: int | None = None) -> str:
    found = values(arm.records, name, picks)
    mean = float(found.mean()) if len(found) else math.nan
    return number_format.number(
        mean * number_format.scale(name), METRICS[name].digits if digits is None else digits
    )


def _plain(bounds: str) -> str:
    """Bounds "[low, high]" as "(low to high)"."""
    return "" if bounds == number_format.NONE else bounds.translate(BRACKETS).replace(", ", " to ")


def _blocks() -> list[Block]:
    def block(page: Path, name: str, made: Callable[[], str]) -> Block:
        return Block(page, name, SCRIPT, made)

    return [
        block(RESULTS / "README.md", "our agent", our_agent),
        block(RESULTS / "README.md", "judge", judge),
        block(RESULTS / "README.md", "tables of the paper", lambda: tables(PAPER)),
        block(RESULTS / "README.md", "paired differences", differences),
        block(RESULTS / "README.md", "relations", relations),
        block(EARLIER_PAGE, "tables of the earlier agent", lambda: tables(EARLIER, "###")),
        block(EARLIER_PAGE, "paired differences of the earlier agent", earlier_differences),
        block(RESULTS / "beside-the-field.md", "pick and place", pick_and_place),
        block(RESULTS / "beside-the-field.md", "object navigation", object_navigation),
        block(RESULTS / "beside-the-field.md", "relations", relations),
    ]


BLOCKS = _blocks()

if __name__ == "__main__":
    write_or_check(BLOCKS)
