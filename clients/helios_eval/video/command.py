"""`helios eval video`"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def video(
    seed: Annotated[int, typer.Option(help="of the home", min=0, max=99_999)],
    out: Annotated[
        Path | None, typer.Option(help="file to write  [default: runs/video/AGENT-SEED.mp4]")
    ] = None,
    preset: Annotated[str, typer.Option(help="kind of home")] = "ovmm-v1",
    agent: Annotated[str, typer.Option(help="who plays")] = "helios",
    semantics: Annotated[str, typer.Option(help="noisy or ground-truth")] = "noisy",
    benchmark: Annotated[str, typer.Option(help="ovmm or objectnav")] = "ovmm",
    fps: Annotated[float, typer.Option(help="frames a second", min=1, max=60)] = 8.0,
    noise_table: Annotated[
        str | None, typer.Option("--noise", help="noise table  [default: the preset's]")
    ] = None,
    noise_level: Annotated[float, typer.Option(help="multiplies the noise", min=0, max=10)] = 1.0,
    noise_correlation: Annotated[
        float | None, typer.Option(help="1: errors stay, 0: drawn per frame")
    ] = None,
    sensor: Annotated[
        str, typer.Option(help="noise of camera and pose: none or realistic")
    ] = "none",
    assignments: Annotated[
        list[str] | None, typer.Option("--set", help="setting of a service: a=1")
    ] = None,
    max_steps: Annotated[
        int | None, typer.Option(help="actions the episode may take", min=1)
    ] = None,
) -> None:
    """Play one episode and film it. Camera, maps and decisions side by side."""
    from typing import get_args

    from helios_client.wrong_use import WrongUse
    from helios_core.errors import InvalidInput
    from helios_sim.sensor import SENSORS
    from rich.console import Console
    from rich.progress import Progress

    from helios_eval.episodes import homes, service_settings
    from helios_eval.episodes import spec as specs
    from helios_eval.episodes.record import Benchmark, Semantics
    from helios_eval.video.episode import film

    known_benchmark = next((b for b in get_args(Benchmark) if b == benchmark), None)
    known_semantics = next((s for s in get_args(Semantics) if s == semantics), None)
    if known_benchmark is None:
        raise WrongUse(f"--benchmark is {benchmark!r}; wanted ovmm or objectnav")
    if known_semantics is None:
        raise WrongUse(f"--semantics is {semantics!r}; wanted noisy or ground-truth")
    specs.check_agents([agent], known_benchmark)
    if agent == specs.WALKER:
        raise WrongUse(f"{agent} has no maps to film; choose another agent")
    homes.check_kind(preset)
    if sensor not in SENSORS:
        raise WrongUse(f"--sensor is {sensor!r}; wanted one of {', '.join(SENSORS)}")
    path = out or Path("runs/video") / f"{agent}-{seed}.mp4"
    if path.suffix.lower() != ".mp4":
        raise WrongUse(f"--out is {str(path)!r}; a video is written as FILE.mp4")
    try:
        noise = (
            specs.noise_of(noise_table or homes.noise_of(preset), noise_level, noise_correlation)
            if semantics == "noisy"
            else None
        )
    except InvalidInput as error:
        raise WrongUse(error.message) from error
    settings = service_settings.parsed(assignments or [])
    if max_steps is not None:
        settings[specs.MAX_STEPS] = max_steps
    if sensor != "none":
        settings[specs.SENSOR] = sensor
    asked = specs.EpisodeSpec(
        known_benchmark,
        agent,
        known_semantics,
        preset,
        seed,
        noise,
        service_settings.that_change(agent, settings),
    )
    console = Console()
    with Progress(console=console, transient=True) as progress:
        bar = progress.add_task(f"home {seed}", total=asked.max_steps)
        told = film(asked, path, fps, lambda step: progress.update(bar, completed=step))
    console.print(f"{told}; written to {path}", highlight=False)
