"""The command `helios eval` and its sub-commands."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from helios_client.terminal_output import Screen
from helios_client.usage_errors import UsageError
from helios_core.errors import InvalidInput, Unavailable

from helios_eval import run_folder
from helios_eval.calibration.command import calibration
from helios_eval.command_options import (
    Absent,
    Agents,
    Assignments,
    Correlation,
    Detector,
    Episodes,
    Homes,
    Jobs,
    Level,
    Limits,
    NoiseLevel,
    Out,
    PickRule,
    Preset,
    Ray,
    Scorer,
    Seed0,
    Semantics,
    Sensor,
    Steps,
    Table,
    TaskClasses,
    Why,
)
from helios_eval.episodes.episode_record import EpisodeRecord, read
from helios_eval.episodes.episode_spec import DEFAULT_PICK_RULE
from helios_eval.episodes.run_conditions import Condition, parse_condition
from helios_eval.plan_command import plan
from helios_eval.provenance import usable_cores
from helios_eval.report import write_report_of
from helios_eval.report.number_format import plural
from helios_eval.runs import merge_runs, results, unseen_homes
from helios_eval.runs.evaluation_run import Run, run
from helios_eval.video.video_command import video

FIRST_HELD_OUT_SEED = 100_000  # first seed of the homes that are held out for independent checks

app = typer.Typer(
    name="eval",
    help="Run episodes in simulated homes and judge them by ground truth.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
)


@app.command()
def ovmm(
    agents: Agents,
    out: Out,
    picks: Limits = "unlimited",
    semantics: Semantics = "noisy",
    preset: Preset = "ovmm-v1",
    episodes: Episodes = 10,
    seed0: Seed0 = 0,
    jobs: Jobs = None,
    noise: Table = None,
    noise_level: NoiseLevel = 1.0,
    noise_correlation: Correlation = None,
    sensor: Sensor = "none",
    scorer: Scorer = None,
    pick_rule: PickRule = DEFAULT_PICK_RULE,
    assignments: Assignments = None,
    max_steps: Steps = None,
    ray: Ray = None,
    why: Why = "",
    absent: Absent = 0.0,
    detector: Detector = None,
    task_classes: TaskClasses = None,
    homes: Homes = None,
    level: Level = "",
) -> None:
    """Open-vocabulary mobile manipulation: move an object from one kind of furniture to another."""
    under = parse_condition(
        _names(agents, "--agents"), "ovmm", semantics=semantics, preset=preset, table=noise,
        level=noise_level, correlation=noise_correlation, sensor=sensor,
        assignments=assignments or [], max_steps=max_steps, scorer=scorer, pick_rule=pick_rule,
        absent=absent, detector=detector, task_classes=task_classes, homes=homes, home_level=level,
    )  # fmt: skip
    _run(under, picks, episodes, seed0, out=out, jobs=jobs, ray=ray, why=why)


@app.command()
def objectnav(
    agents: Agents,
    out: Out,
    semantics: Semantics = "noisy",
    preset: Preset = "ovmm-v1",
    episodes: Episodes = 10,
    seed0: Seed0 = 0,
    jobs: Jobs = None,
    picks: Limits = "unlimited",
    noise: Table = None,
    noise_level: NoiseLevel = 1.0,
    noise_correlation: Correlation = None,
    sensor: Sensor = "none",
    scorer: Scorer = None,
    pick_rule: PickRule = DEFAULT_PICK_RULE,
    assignments: Assignments = None,
    max_steps: Steps = None,
    ray: Ray = None,
    why: Why = "",
    absent: Absent = 0.0,
    detector: Detector = None,
    homes: Homes = None,
    level: Level = "",
) -> None:
    """Object navigation: find a kind of furniture and stop there. Nothing is picked."""
    under = parse_condition(
        _names(agents, "--agents"), "objectnav", semantics=semantics, preset=preset, table=noise,
        level=noise_level, correlation=noise_correlation, sensor=sensor,
        assignments=assignments or [], max_steps=max_steps, scorer=scorer, pick_rule=pick_rule,
        absent=absent, detector=detector, homes=homes, home_level=level,
    )  # fmt: skip
    _run(under, picks, episodes, seed0, out=out, jobs=jobs, ray=ray, why=why)


@app.command()
def report(
    folders: Annotated[list[Path], typer.Argument(help="folders of runs", metavar="FOLDER...")],
    out: Annotated[
        Path | None,
        typer.Option(
            help="folder for the report and a compact copy of all episodes; required for "
            "several folders"
        ),
    ] = None,
    unfinished: Annotated[
        bool,
        typer.Option(
            "--unfinished", help="report also if requested homes from seed 1000 on are not played"
        ),
    ] = False,
) -> None:
    """Regenerate results.json, report.md and report.html of a folder, even of a killed run.

    With --out, write one report on several folders; another report can use that folder. Episodes
    of homes from seed 1000 on are packed there before the last one, without a report.
    """
    if out is None and len(folders) > 1:
        raise UsageError("a report on several folders needs a folder of its own: give --out FOLDER")
    into = out or folders[0]
    records = merge_runs.episodes(folders)
    with run_folder.write_errors_as_unavailable(into):
        lacks = unseen_homes.prepare_report(
            records, merge_runs.run(folders), folders, unfinished, packs=out is not None
        )
        description = merge_runs.run(folders)
        if out is not None and records:
            merge_runs.pack(out, records, description)
            records = read(out)  # report exactly the records that the packed file holds
        if lacks is not None:
            print(f"packed into {into}. {lacks}")
            return
        write_report_of(into, records, description)
        results.write(into, records, results.picks_in(description))
    elsewhere = "" if out else "; with --out FOLDER it is written elsewhere"
    print(f"written to {into / 'report.md'} and {into / 'report.html'}{elsewhere}")


app.command()(calibration)
app.command()(video)
app.command()(plan)


def _run(
    under: Condition,
    picks: str,
    episodes: int,
    seed0: int,
    *,
    out: Path,
    jobs: int | None,
    ray: str | None,
    why: str,
) -> None:
    try:
        limits = tuple(results.picks_of(p) for p in _names(picks, "--picks"))
    except InvalidInput as error:
        raise UsageError(error.message) from error
    if seed0 + episodes > FIRST_HELD_OUT_SEED:
        print(
            f"helios: seeds from {FIRST_HELD_OUT_SEED} on are held out for independent checks of "
            "what was built; do not examine single episodes of them",
            file=sys.stderr,
        )
    asked = Run(
        under.benchmark, under.agents, limits, under.semantics, under.preset, episodes, seed0, out,
        jobs or usable_cores(), under.noise, under.settings, ray, why,
        under.inputs,
    )  # fmt: skip
    console = Screen()
    try:
        with _ended_by_sigterm():
            played = run(asked, console)
    except KeyboardInterrupt as interrupt:
        print("helios: interrupted; run the same command to continue", file=sys.stderr)
        number = interrupt.args[0] if interrupt.args else signal.SIGINT
        raise SystemExit(128 + number) from None  # the message is already printed
    console.print(f"written to {out}", highlight=False)
    _check_all_played(played)


def _check_all_played(records: Sequence[EpisodeRecord]) -> None:
    """Raise Unavailable if some of the episodes could not be played."""
    lost = [r for r in records if not r.was_played]
    if lost:
        raise Unavailable(
            f"{len(lost)} of {plural(len(records), 'episode')} could not be played, and count as "
            f"failures (seed {lost[0].seed} of {lost[0].agent}: {lost[0].message}); correct that "
            "and give the same command again"
        )


@contextmanager
def _ended_by_sigterm() -> Iterator[None]:
    """Raise KeyboardInterrupt on SIGTERM within the block, as Ctrl-C does."""

    def interrupt(number: int, _: object) -> None:
        raise KeyboardInterrupt(number)

    former = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, former)


def _names(text: str, flag: str) -> list[str]:
    names = list(dict.fromkeys(name.strip() for name in text.split(",")))
    if "" in names:
        raise UsageError(f"{flag} {text!r} has an empty name; write a,b")
    return names
