"""Tests usage errors and help of `helios eval`."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from pathlib import Path

import pytest
from eval_constructed_records import record_of
from helios_client import cli
from helios_eval.episodes.episode_player import PlayedEpisode
from helios_eval.episodes.episode_spec import EpisodeSpec
from helios_eval.runs import evaluation_run
from helios_eval.runs.evaluation_run import Run
from helios_eval.runs.process_pool import Outcome


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--agents", "hal"], "hal"),
        (["--preset", "palace"], "palace"),
        (["--picks", "none"], "picks"),
        (["--semantics", "vague"], "semantics"),
        (["--seed0", "-1"], "seed0"),
        (["--set", "nonsense=1"], "nonsense"),
        (["--sensor", "eyes"], "eyes"),
        (["--noise", "nowhere"], "nowhere"),
        (["--agents", "helios,"], "empty"),
        (["--episodes", "0"], "episodes"),
        (["--jobs", "none"], "jobs"),
        (["--nonsense"], "nonsense"),
        (["--absent", "1.5"], "absent"),
        (["--scorer", "simulated:nowhere"], "there is no scorer table 'nowhere'"),
        (["--scorer", "nonsense"], "nonsense"),
        (["--scorer", "not_there:Scorer"], "not_there"),
        (["--set", "objectmap.error_model=nowhere.json"], "nowhere.json"),
    ],
)
@pytest.mark.parametrize("benchmark", ["ovmm", "objectnav"])
def test_a_usage_error_is_one_sentence_with_exit_status_2(
    benchmark: str,
    more: list[str],
    words: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "out"
    args = ["eval", benchmark, "--agents", "helios", "--preset", "demo-v1", "--out", str(out)]
    assert cli.run([*args, *more]) == 2
    error = capsys.readouterr().err
    assert error.startswith("helios: ")
    assert error.count("\n") == 1
    assert words in error
    assert not out.exists()


def test_an_unknown_pick_rule_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    args = ["eval", "ovmm", "--agents", "helios", "--out", str(tmp_path / "out")]
    assert cli.run([*args, "--pick-rule", "magic"]) == 2
    assert "--pick-rule is 'magic'; wanted physical or ovmm" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_help_names_every_benchmark(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["eval", "--help"]) == 0
    shown = capsys.readouterr().out
    assert all(name in shown for name in ("ovmm", "objectnav", "report", "calibration"))


def test_a_folder_without_episodes_has_no_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.run(["eval", "report", str(tmp_path)]) == 1
    assert "no episode" in capsys.readouterr().err


def test_a_command_whose_episodes_could_not_all_be_played_ends_with_status_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def outcomes(_: Run, missing: Sequence[EpisodeSpec], __: str) -> Generator[Outcome]:
        for spec in missing:
            yield spec, PlayedEpisode(record_of(spec)) if spec.seed else "no such luck"

    monkeypatch.setattr(evaluation_run, "_outcomes", outcomes)
    args = ["eval", "ovmm", "--agents", "helios", "--episodes", "2", "--out", str(tmp_path / "out")]
    assert cli.run(args) == 1
    error = capsys.readouterr().err
    assert "1 of 2 episodes could not be played" in error
    assert "(seed 0 of helios: no such luck)" in error
    assert (tmp_path / "out" / "report.md").exists()
    assert cli.run([*args, "--seed0", "1"]) == 0
