"""Tests `helios eval video` from the command to the file."""

import io

import cv2
import pytest
from helios_client import cli
from helios_client.usage_errors import UsageError
from helios_core.topics import CONTEXT
from helios_eval import eval_command
from helios_eval.episodes.episode_player import play
from helios_eval.episodes.episode_spec import EpisodeSpec
from helios_eval.episodes.in_process_stack import InProcessStack
from helios_eval.video import episode_recorder
from helios_eval.video.progress import counted
from helios_eval.video.video_command import video
from rich.console import Console


def test_a_short_episode_is_filmed(tmp_path, capsys):
    path = tmp_path / "film.mp4"
    video(seed=4, out=path, preset="demo-v1", semantics="ground-truth", fps=8.0, max_steps=2)
    reported = capsys.readouterr().out
    assert "home 4: step 0 of at most 2\n" in reported
    assert "written to" in reported
    reader = cv2.VideoCapture(str(path))
    frames = []
    while (got := reader.read())[0]:
        frames.append(got[1])
    reader.release()
    assert frames[0].shape == (720, 1280, 3)
    assert len(frames) >= 8 + 1 + 24  # 1 s for the first step, the second step, 3 s for the end
    assert frames[0][110:, :360].std() > 20  # the camera
    assert frames[0][110:, 380:840].std() > 20  # the maps


def test_filming_reports_its_steps_to_a_log_or_a_terminal():
    reported = {}
    for terminal in (False, True):
        out = io.StringIO()
        console = Console(file=out, force_terminal=terminal, width=100)
        with counted(console, "home 4", 500) as on_step:
            for step in (1, 24, 25, 26, 80, 81):
                on_step(step)
        reported[terminal] = out.getvalue()
    lines = [f"home 4: step {step} of at most 500" for step in (0, 25, 80)]
    assert reported[False].splitlines() == lines
    assert "step 81 of at most 500" in reported[True]


@pytest.mark.parametrize("agent", ["helios-paper", "helios"])
def test_a_filmed_episode_runs_with_the_settings_of_a_played_one(tmp_path, monkeypatch, agent):
    """In both cases the planner sends the same classes with the same detector thresholds."""
    asked = []
    run = InProcessStack.run

    def heard(stack, *given):
        asked.append([])
        stack.bus().subscribe(CONTEXT, lambda context: asked[-1].append(context.classes))
        return run(stack, *given)

    monkeypatch.setattr(InProcessStack, "run", heard)
    spec = EpisodeSpec("ovmm", agent, "ground-truth", "demo-v1", 4, None, {"max_steps": 1})
    play(spec, "here")
    episode_recorder.film(spec, tmp_path / "film.mp4", 8.0)
    played, filmed = asked
    assert played
    assert filmed == played
    weak_too = {round(c.threshold, 2) for c in played[0]} == {0.2}
    assert weak_too == (agent == "helios")


def test_the_same_flags_film_and_play_the_same_episode(tmp_path, monkeypatch):
    specs = []
    monkeypatch.setattr(eval_command, "run", lambda asked, _: specs.extend(asked.specs()) or [])
    monkeypatch.setattr(episode_recorder, "film", lambda spec, *_: specs.append(spec) or "success")
    flags = ["--preset", "demo-v1", "--noise-level", "2", "--sensor", "realistic",
             "--max-steps", "1250", "--pick-rule", "ovmm", "--set", "tau_g=0.3",
             "--set", "evidence=hindsight"]  # fmt: skip
    once = ["--agents", "helios", "--episodes", "1", "--seed0", "4", "--out", str(tmp_path)]
    film = ["--agent", "helios", "--seed", "4", "--out", str(tmp_path / "film.mp4")]
    assert cli.run(["eval", "ovmm", *once, *flags]) == 0
    assert cli.run(["eval", "video", *film, *flags]) == 0
    played, filmed = specs
    assert filmed == played
    assert filmed.settings == {
        "planner.tau_g": 0.3,
        "sensor": "realistic",
        "detector.scorer": "simulated:itc-v1",
        "pick_rule": "ovmm",
    }


@pytest.mark.parametrize(
    ("wrong", "reported"),
    [
        ({"agent": "nobody"}, "nobody"),
        ({"preset": "castle"}, "castle"),
        ({"semantics": "guessed"}, "guessed"),
        ({"benchmark": "chess"}, "chess"),
        ({"agent": "ground-truth-walker"}, "no maps"),
    ],
)
def test_invalid_arguments_are_usage_errors(tmp_path, wrong, reported):
    with pytest.raises(UsageError, match=reported):
        video(**{"seed": 1, "out": tmp_path / "a.mp4", "preset": "demo-v1", **wrong})
    with pytest.raises(UsageError, match=r"FILE\.mp4"):
        video(seed=1, out=tmp_path / "film.avi", preset="demo-v1")
    assert not list(tmp_path.iterdir())
