"""The command `helios eval video`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from helios_eval.command_options import (
    Absent,
    Assignments,
    Correlation,
    Detector,
    Homes,
    Level,
    NoiseLevel,
    PickRule,
    Scorer,
    Semantics,
    Sensor,
    Steps,
    Table,
    TaskClasses,
)

if TYPE_CHECKING:
    from helios_eval.episodes.episode_spec import EpisodeSpec


def video(
    seed: Annotated[int, typer.Option(help="seed of the home", min=0, max=99_999)],
    out: Annotated[
        Path | None, typer.Option(help="file to write  [default: runs/video/AGENT-SEED.mp4]")
    ] = None,
    preset: Annotated[str, typer.Option(help="preset of the home")] = "ovmm-v1",
    agent: Annotated[str, typer.Option(help="agent to film")] = "helios",
    semantics: Semantics = "noisy",
    benchmark: Annotated[str, typer.Option(help="ovmm or objectnav")] = "ovmm",
    fps: Annotated[float, typer.Option(help="frames per second", min=1, max=60)] = 8.0,
    noise: Table = None,
    noise_level: NoiseLevel = 1.0,
    noise_correlation: Correlation = None,
    sensor: Sensor = "none",
    scorer: Scorer = None,
    pick_rule: PickRule = "physical",
    assignments: Assignments = None,
    max_steps: Steps = None,
    absent: Absent = 0.0,
    detector: Detector = None,
    task_classes: TaskClasses = None,
    homes: Homes = None,
    level: Level = "",
) -> None:
    """Run one episode and film it. Shows camera, maps and decisions side by side."""
    from helios_client.usage_errors import UsageError

    from helios_eval import ledger
    from helios_eval.episodes.episode_spec import WALKER, EpisodeSpec
    from helios_eval.episodes.run_conditions import parse_condition
    from helios_eval.episodes.service_settings import differing_settings
    from helios_eval.provenance import commit

    under = parse_condition(
        [agent], benchmark, semantics=semantics, preset=preset, table=noise,
        level=noise_level, correlation=noise_correlation, sensor=sensor,
        assignments=assignments or [], max_steps=max_steps, scorer=scorer, pick_rule=pick_rule,
        absent=absent, detector=detector, task_classes=task_classes,
        homes=homes, home_level=level,
    )  # fmt: skip
    agent = under.agents[0]
    if agent == WALKER:
        raise UsageError(f"{agent} has no maps to film; choose another agent")
    path = _checked_file(out or Path("runs/video") / f"{agent}-{seed}.mp4")
    asked = EpisodeSpec(
        under.benchmark,
        agent,
        under.semantics,
        under.preset,
        seed,
        under.noise,
        differing_settings(agent, under.settings),
        under.inputs,
    )
    ledger.enter([asked], path, commit(), "video")
    _film(asked, path, fps)


def _film(spec: EpisodeSpec, path: Path, fps: float) -> None:
    from rich.console import Console

    from helios_eval.video.episode_recorder import film
    from helios_eval.video.progress import counted

    console = Console()
    with counted(console, f"home {spec.seed}", spec.max_steps) as on_step:
        outcome = film(spec, path, fps, on_step)
    console.print(f"{outcome}; written to {path}", highlight=False)


def _checked_file(path: Path) -> Path:
    from helios_client.usage_errors import UsageError

    if path.suffix.lower() != ".mp4":
        raise UsageError(f"--out is {str(path)!r}; a video is written as FILE.mp4")
    return path
