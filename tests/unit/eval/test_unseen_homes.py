"""Runs of homes from seed 1000 on: committed code alone, and no figure before the last episode."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from io import StringIO
from pathlib import Path

import pytest
from eval_constructed_records import record_of
from helios_client import cli
from helios_core.errors import InvalidInput
from helios_eval.episodes.episode_player import PlayedEpisode
from helios_eval.episodes.episode_spec import EpisodeSpec
from helios_eval.runs import evaluation_run, played_with, unseen_homes
from helios_eval.runs.evaluation_run import Run, run
from helios_eval.runs.process_pool import Outcome
from rich.console import Console

HERE = "c"


def play(
    out: Path, seed0: int, monkeypatch: pytest.MonkeyPatch, stop_after: int = 9, homes: int = 3
) -> str:
    """Play these homes, or be interrupted; the text on the terminal."""

    def outcomes(_: Run, missing: Sequence[EpisodeSpec], here: str) -> Generator[Outcome]:
        for k, spec in enumerate(missing):
            if k == stop_after:
                raise KeyboardInterrupt
            yield spec, PlayedEpisode(record_of(spec, commit=here))

    monkeypatch.setattr(evaluation_run, "_outcomes", outcomes)
    console = Console(file=StringIO(), width=80)
    asked = Run(
        "ovmm", ("trusting",), (1,), "ground-truth", "ovmm-v1", homes, seed0, out, 1, None, {}
    )
    try:
        run(asked, console)
    except KeyboardInterrupt:
        assert stop_after < homes
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


def test_unseen_homes_are_continued_with_the_same_libraries_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    play(tmp_path, 1200, monkeypatch, stop_after=1)
    here = played_with.versions_here()
    monkeypatch.setattr(played_with, "versions_here", lambda: here | {"mujoco": "9.9"})
    wanted = rf"played with mujoco {here['mujoco']} \(here 9.9\); install those versions"
    with pytest.raises(InvalidInput, match=wanted):
        play(tmp_path, 1200, monkeypatch)
    monkeypatch.setattr(played_with, "versions_here", lambda: here)
    play(tmp_path, 1200, monkeypatch)


# --- no figure before the last episode ------------------------------------------------------------
def test_a_report_on_an_unfinished_run_of_unseen_homes_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    play(tmp_path, 1200, monkeypatch, stop_after=2)
    assert cli.run(["eval", "report", str(tmp_path)]) == 1
    error = capsys.readouterr().err
    assert "2 of the 3 requested episodes of homes from seed 1000 on are played" in error
    assert "--unfinished" in error
    assert not (tmp_path / "report.md").exists()
    assert not (tmp_path / "results.json").exists()
    assert cli.run(["eval", "report", str(tmp_path), "--unfinished"]) == 0
    assert "Not complete: 1 of the 3 episodes" in (tmp_path / "report.md").read_text()
    packed = tmp_path / "packed"
    assert cli.run(["eval", "report", str(tmp_path), "--unfinished", "--out", str(packed)]) == 0
    for folder in (tmp_path, packed):
        play(folder, 1200, monkeypatch)
        assert "figures were over 2, then 3 homes" in (folder / "report.md").read_text()
        assert cli.run(["eval", "report", str(folder)]) == 0


def test_a_part_of_a_run_of_unseen_homes_is_packed_without_a_figure_and_without_a_notice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    played, packed = tmp_path / "played", tmp_path / "packed"
    play(played, 1200, monkeypatch, stop_after=2)
    assert cli.run(["eval", "report", str(played), "--out", str(packed)]) == 0
    assert f"packed into {packed}. 2 of 3" in capsys.readouterr().out
    assert not (packed / "report.md").exists()
    assert not (packed / "results.json").exists()
    play(packed, 1200, monkeypatch)
    assert "figures were over" not in (packed / "report.md").read_text()


def test_development_homes_show_no_figure_of_unfinished_unseen_homes_in_their_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    play(tmp_path, 1200, monkeypatch, stop_after=2)
    assert "2 of 3 episodes are played" in play(tmp_path, 0, monkeypatch)
    assert not (tmp_path / "report.md").exists()
    assert not (tmp_path / "results.json").exists()
    play(tmp_path, 1200, monkeypatch)
    assert (tmp_path / "report.md").exists()
    assert "are played." not in play(tmp_path, 0, monkeypatch, homes=4)


def test_a_report_tells_of_homes_that_were_added_after_figures_were_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    play(tmp_path, 1200, monkeypatch, stop_after=1)
    play(tmp_path, 1200, monkeypatch)
    assert "added after figures" not in (tmp_path / "report.md").read_text()
    play(tmp_path, 1200, monkeypatch, homes=4)
    play(tmp_path, 1200, monkeypatch, homes=4)
    text = (tmp_path / "report.md").read_text()
    assert (
        "Homes were added after figures had been shown: figures were over 3, then 4 homes" in text
    )


def test_an_interruption_does_not_offer_the_report_of_a_former_request(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    play(tmp_path, 1200, monkeypatch)
    assert (tmp_path / "report.md").exists()
    said = play(tmp_path, 1200, monkeypatch, stop_after=1, homes=6)
    assert "4 of 6 episodes are played" in said
    assert "A report" not in said
    said = play(tmp_path / "of development", 0, monkeypatch, stop_after=1)
    assert f"A report on the finished episodes is in {tmp_path / 'of development'}" in said
    said = play(tmp_path / "at once", 0, monkeypatch, stop_after=0)
    assert "No episode is played yet, so there is no report" in said
