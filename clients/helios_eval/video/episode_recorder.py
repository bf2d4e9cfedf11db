"""Plays one episode and films it as a video."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from helios_sim.failure_causes import AgentReport

from helios_eval.episodes.episode_judgement import verdict
from helios_eval.episodes.episode_player import LONGEST_S, running_stack
from helios_eval.episodes.episode_spec import EpisodeSpec
from helios_eval.video.bus_observer import Watcher, glides
from helios_eval.video.frame_content import Scene
from helios_eval.video.frame_layout import HEIGHT, WIDTH, frame_picture
from helios_eval.video.mp4_writer import VideoFile

FIRST_S, LAST_S = 1.0, 3.0  # durations of the first and the last frame


def film(
    spec: EpisodeSpec, out: Path, fps: float, on_step: Callable[[int], None] = lambda _: None
) -> str:
    """Write the video of an agent of the planner; return the verdict. Raises HeliosError."""
    with running_stack(spec) as (thread, stack), VideoFile(out, WIDTH, HEIGHT, fps) as video:
        world = thread.run(lambda w: w)
        last: Scene | None = None

        def shoot(scene: Scene) -> None:
            nonlocal last
            scene = replace(scene, step=world.progress.steps)
            if last is None:
                video.write(frame_picture(scene), max(0, round(FIRST_S * fps) - 1))
            for between in glides(last, scene):
                video.write(frame_picture(between))
            video.write(frame_picture(scene))
            last = scene
            on_step(scene.step)

        broken: list[Exception] = []  # a bus only logs exceptions of its handlers

        def shoot_or_note(scene: Scene) -> None:
            try:
                shoot(scene)
            except Exception as error:
                broken.append(error)

        watcher = Watcher(stack.bus(), _title(spec), shoot_or_note)
        task = stack.run(world.episode.instruction, spec.max_steps, LONGEST_S)
        if broken:
            raise broken[0]
        said = AgentReport(task.state, task.cause, task.message)
        found = thread.run(lambda w: verdict(spec.benchmark, w, said, spec.max_steps))
        verdict_line = "the truth: success" if found.success else f"the truth: {found.cause}"
        end = replace(
            watcher.now(),
            task=task,
            step=world.progress.steps,
            verdict=verdict_line,
            right=found.success,
        )
        watcher.close()
        video.write(frame_picture(end), max(1, round(LAST_S * fps)))
        return verdict_line


def _title(spec: EpisodeSpec) -> str:
    seen = {
        "noisy": "noisy detector",
        "ground-truth": "ground-truth detector",
        "detector": "real detector",
    }[spec.semantics]
    return f"{spec.agent} · home {spec.seed} of {spec.preset} · {seen}"
