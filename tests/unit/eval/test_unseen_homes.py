"""Runs of homes from seed 1000 on: committed code alone, and no figure before the last episode."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from io import StringIO
from pathlib import Path

import pytest
from eval_constructed_records import record
from helios_core.errors import InvalidInput
from helios_eval.episodes.episode_player import PlayedEpisode
from helios_eval.episodes.episode_spec import EpisodeSpec
from helios_eval.runs import evaluation_run, unseen_homes
from helios_eval.runs.evaluation_run import Run, run
from helios_eval.runs.process_pool import Outcome
from rich.console import Console

HERE = "c"


def play(out: Path, seed0: int, monkeypatch: pytest.MonkeyPatch, stop_after: int = 3) -> str:
    """Play three homes, or be interrupted; the text on the terminal."""

    def outcomes(_: Run, missing: Sequence[EpisodeSpec], here: str) -> Generator[Outcome]:
        for k, spec in enumerate(missing):
            if k == stop_after:
                raise KeyboardInterrupt
            made = record(spec.seed, agent=spec.agent, preset=spec.preset, noise=spec.noise)
            yield spec, PlayedEpisode(made.model_copy(update={"commit": here}))

    monkeypatch.setattr(evaluation_run, "_outcomes", outcomes)
    console = Console(file=StringIO(), width=80)
    asked = Run("ovmm", ("trusting",), (1,), "ground-truth", "ovmm-v1", 3, seed0, out, 1, None, {})
    try:
        run(asked, console)
    except KeyboardInterrupt:
        assert stop_after < 3
    assert isinstance(console.file, StringIO)
    return console.file.getvalue()


def test_an_interrupted_run_of_unseen_homes_shows_no_figure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = play(tmp_path, 1200, monkeypatch, stop_after=2)
    assert "2/3 trusting seed 1201; " in said
    assert "2 of 3 episodes are played" in said
    assert "SR" not in said
    assert "success" not in said
    assert not (tmp_path / "report.md").exists()
    assert not (tmp_path / "results.json").exists()
    assert "SR" not in play(tmp_path, 1200, monkeypatch)
    assert (tmp_path / "report.md").exists()
    assert (tmp_path / "results.json").exists()


def test_development_homes_show_their_figures_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "SR" in play(tmp_path, 200, monkeypatch, stop_after=2)
    assert (tmp_path / "report.md").exists()


def test_unseen_homes_are_played_by_committed_code_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(evaluation_run, "commit", lambda: f"{HERE}-dirty")
    with pytest.raises(InvalidInput, match="files differ from commit c"):
        play(tmp_path, 1200, monkeypatch)
    assert not (tmp_path / "run.json").exists()
    play(tmp_path, 200, monkeypatch)


def test_unseen_homes_are_continued_by_the_same_code_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    play(tmp_path, 1200, monkeypatch, stop_after=1)
    monkeypatch.setattr(evaluation_run, "commit", lambda: "4567cdef")
    with pytest.raises(InvalidInput, match=f"holds episodes of commit {HERE}"):
        play(tmp_path, 1200, monkeypatch)
    monkeypatch.setattr(unseen_homes, "same_code", lambda *_: True)
    play(tmp_path, 1200, monkeypatch)
    monkeypatch.setattr(unseen_homes, "same_code", lambda *_: False)
    play(tmp_path, 1200, monkeypatch)  # nothing is missing
