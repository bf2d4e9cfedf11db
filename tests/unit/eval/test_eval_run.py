"""Tests a run with a fake pool: it plays each missing episode once and always writes results."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
from collections.abc import Generator, Sequence
from dataclasses import replace
from io import StringIO
from pathlib import Path

import pytest
from eval_constructed_records import record
from helios_client.usage_errors import UsageError
from helios_core.errors import Conflict, InvalidInput, Unavailable
from helios_eval import run_folder
from helios_eval.episodes import episode_record as records
from helios_eval.episodes import service_settings
from helios_eval.episodes.episode_player import PlayedEpisode
from helios_eval.episodes.episode_record import EpisodeRecord
from helios_eval.episodes.episode_spec import EpisodeSpec, noise_of
from helios_eval.runs import evaluation_run as runs
from helios_eval.runs import merge_runs, played_with, results
from helios_eval.runs.evaluation_run import Run, run
from helios_eval.runs.process_pool import Outcome
from helios_objectmap import error_model
from rich.console import Console

from tests.full_disk import refuse_writing

NOISE = noise_of("ovmm-v1", 1.0, None)


def asked(
    out: Path, episodes: int = 3, agents: tuple[str, ...] = ("helios-paper", "trusting")
) -> Run:
    return Run("ovmm", agents, (1, "unlimited"), "noisy", "ovmm-v1", episodes, 0, out, 1, NOISE, {})


class FakePool:
    """Replaces the process pool: logs the episodes, and may end before the n-th episode."""

    def __init__(self) -> None:
        self.played: list[tuple[int, str]] = []
        self.end_before: int | None = None
        self.end: BaseException = KeyboardInterrupt()

    def outcomes(self, _: Run, missing: Sequence[EpisodeSpec], __: str) -> Generator[Outcome]:
        for k, spec in enumerate(missing):
            if k == self.end_before:
                raise self.end
            self.played.append((spec.seed, spec.agent))
            yield spec, PlayedEpisode(recorded(spec))


def recorded(spec: EpisodeSpec) -> EpisodeRecord:
    return record(
        spec.seed, agent=spec.agent, preset=spec.preset, noise=spec.noise, settings=spec.settings
    )


@pytest.fixture
def fake_pool(monkeypatch: pytest.MonkeyPatch) -> FakePool:
    fake_pool = FakePool()
    monkeypatch.setattr(runs, "_outcomes", fake_pool.outcomes)
    return fake_pool


def quiet() -> Console:
    return Console(quiet=True)


def test_episodes_are_played_home_by_home_and_each_once(
    fake_pool: FakePool, tmp_path: Path
) -> None:
    everything = [(seed, agent) for seed in range(3) for agent in ("helios-paper", "trusting")]
    assert len(run(asked(tmp_path), quiet())) == 6
    assert fake_pool.played == everything
    assert len(run(asked(tmp_path), quiet())) == 6
    assert fake_pool.played == everything
    assert len((tmp_path / records.EPISODES).read_text().splitlines()) == 6


def test_a_partial_run_is_completed(fake_pool: FakePool, tmp_path: Path) -> None:
    run(asked(tmp_path, 2, ("helios-paper",)), quiet())
    fake_pool.played.clear()
    run(asked(tmp_path), quiet())
    assert fake_pool.played == [
        (0, "trusting"),
        (1, "trusting"),
        (2, "helios-paper"),
        (2, "trusting"),
    ]


def test_a_torn_last_line_is_played_again(fake_pool: FakePool, tmp_path: Path) -> None:
    run(asked(tmp_path), quiet())
    fake_pool.played.clear()
    path = tmp_path / records.EPISODES
    path.write_bytes(path.read_bytes()[:-40])
    assert len(run(asked(tmp_path), quiet())) == 6
    assert fake_pool.played == [(2, "trusting")]


def test_other_settings_make_other_episodes(fake_pool: FakePool, tmp_path: Path) -> None:
    """One folder may hold several benchmarks, presets or settings."""
    run(asked(tmp_path, 1, ("helios-paper",)), quiet())
    other = Run(
        "ovmm", ("helios-paper",), (1,), "noisy", "ovmm-v1", 1, 0, tmp_path, 1, NOISE, {"a": 1}
    )
    run(other, quiet())
    assert len(fake_pool.played) == 2
    rows = json.loads((tmp_path / results.RESULTS).read_text())
    assert [(row["settings"], row["metrics"]["SR"]["n"]) for row in rows] == [
        ({}, 1),
        ({"a": 1}, 1),
    ]


def test_a_setting_of_the_agents_preset_makes_no_new_episode(
    fake_pool: FakePool, tmp_path: Path
) -> None:
    settings = {"planner.tau_g": 0.5, "objectmap.evidence": "hindsight"}
    agents = ("helios-paper", "helios")
    reported = Run("ovmm", agents, (1,), "noisy", "ovmm-v1", 2, 0, tmp_path, 1, NOISE, settings)
    played = run(reported, quiet())
    assert [tuple(r.settings) for r in played[:2]] == [("objectmap.evidence",), ("planner.tau_g",)]
    assert "Not complete" not in (tmp_path / "report.md").read_text()


@pytest.mark.parametrize("end", [KeyboardInterrupt(), Unavailable("no OpenGL context")])
def test_an_ended_run_writes_results_of_its_played_episodes(
    end: BaseException, fake_pool: FakePool, tmp_path: Path
) -> None:
    fake_pool.end_before, fake_pool.end = 2, end
    with pytest.raises((KeyboardInterrupt, Unavailable)):
        run(asked(tmp_path), quiet())
    assert len(records.read(tmp_path)) == 2
    assert json.loads((tmp_path / results.RESULTS).read_text())
    assert "Not complete: 4 of the 6 episodes" in (tmp_path / "report.md").read_text()
    fake_pool.end_before = None
    run(asked(tmp_path), quiet())
    assert len(fake_pool.played) == 6
    assert "Not complete" not in (tmp_path / "report.md").read_text()


def test_a_run_resumes_from_a_copy_of_a_packed_run(fake_pool: FakePool, tmp_path: Path) -> None:
    """On another machine, on another day: only missing episodes are played, and none is lost."""
    before, committed, after = (tmp_path / name for name in ("before", "committed", "after"))
    run(asked(before, 2), quiet())
    merge_runs.pack(committed, records.read(before), merge_runs.run([before]))
    shutil.copytree(committed, after)
    fake_pool.played.clear()
    assert len(run(asked(after, 3), quiet())) == 6
    assert fake_pool.played == [(2, "helios-paper"), (2, "trusting")]
    there = records.read(after)
    assert len(there) == 6
    merge_runs.pack(committed, there, merge_runs.run([after]))  # packs again
    assert len(records.read(committed)) == 6
    reported = json.loads((after / runs.RUN).read_text())["asked"]
    assert [order["episodes"] for order in reported] == [2, 3]


@pytest.mark.parametrize(
    ("changed", "what"),
    [
        ({"preset_hash": "another"}, "preset ovmm-v1"),
        ({"noise": NOISE.model_copy(update={"digest": "another"})}, "noise table ovmm-v1"),
    ],
)
def test_a_run_refuses_to_resume_with_a_changed_preset_or_noise_table(
    changed: dict, what: str, fake_pool: FakePool, tmp_path: Path
) -> None:
    merge_runs.pack(tmp_path, [record(0, noise=NOISE).model_copy(update=changed)], {})
    with pytest.raises(InvalidInput, match=f"another {what}"):
        run(asked(tmp_path), quiet())
    assert not fake_pool.played


def test_a_run_refuses_to_resume_with_changed_settings_of_an_agent(
    fake_pool: FakePool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(asked(tmp_path, 1), quiet())
    fake_pool.played.clear()
    now = service_settings.default_settings_of("helios-paper")
    assert now["planner.tau_g"] == "0.5"
    assert service_settings.default_settings_of("helios") != now

    def changed(_: str) -> dict[str, str]:
        return now | {"planner.is_new": "1"}

    monkeypatch.setattr(service_settings, "default_settings_of", changed)
    run(asked(tmp_path, 2), quiet())
    assert len(fake_pool.played) == 2
    monkeypatch.setattr(
        service_settings, "default_settings_of", lambda _: now | {"planner.tau_g": "0.4"}
    )
    with pytest.raises(InvalidInput, match=r"played with planner\.tau_g = 0\.5; it is 0\.4 here"):
        run(asked(tmp_path, 3), quiet())
    assert len(fake_pool.played) == 2


def test_a_run_resumes_from_another_commit_and_the_report_names_both_commits(
    fake_pool: FakePool, tmp_path: Path
) -> None:
    merge_runs.pack(tmp_path, [record(0, noise=NOISE, commit="first")], {})
    run(asked(tmp_path, 2, ("helios-paper",)), quiet())
    assert fake_pool.played == [(1, "helios-paper")]
    assert "helios-paper 1 by first, 1 by c" in (tmp_path / "report.md").read_text()


# --- the folder -----------------------------------------------------------------------------------
def test_a_folder_accepts_one_run_at_a_time(fake_pool: FakePool, tmp_path: Path) -> None:
    with (
        run_folder.locked_folder(tmp_path),
        pytest.raises(Conflict, match="another run plays into"),
    ):
        run(asked(tmp_path), quiet())
    assert not fake_pool.played
    assert not (tmp_path / runs.RUN).exists()  # the other run's file is untouched
    run(asked(tmp_path), quiet())
    assert len(fake_pool.played) == 6


def test_a_killed_run_releases_its_folder(fake_pool: FakePool, tmp_path: Path) -> None:
    holds = (
        "import pathlib, sys, time; from helios_eval import run_folder\n"
        "with run_folder.locked_folder(pathlib.Path(sys.argv[1])): print('held', flush=True); "
        "time.sleep(600)"
    )
    command = [sys.executable, "-c", holds, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        with pytest.raises(Conflict):
            run(asked(tmp_path), quiet())
        other.send_signal(signal.SIGKILL)
    assert len(run(asked(tmp_path), quiet())) == 6


def test_a_file_as_output_folder_is_a_usage_error(fake_pool: FakePool, tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("mine")
    for out in (file, file / "below"):
        with pytest.raises(UsageError, match="a file is there"):
            run(asked(out), quiet())
    assert file.read_text() == "mine"
    assert not fake_pool.played


@pytest.mark.parametrize(("file", "played"), [(runs.RUN, 0), (results.RESULTS, 6)])
def test_a_full_disk_is_reported_in_one_sentence(
    file: str, played: int, fake_pool: FakePool, tmp_path: Path
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        stem, ending = file.split(".")
        refuse_writing(patch, f".{stem}.", f".new.{ending}")
        with pytest.raises(Unavailable, match=r"cannot write to .*No space left"):
            run(asked(tmp_path), quiet())
    assert len(fake_pool.played) == played
    assert not (tmp_path / file).exists()
    assert len(run(asked(tmp_path), quiet())) == 6
    assert len(fake_pool.played) == 6


def test_an_episode_that_could_not_be_played_is_played_by_the_next_run(
    fake_pool: FakePool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def outcomes(_: Run, missing: Sequence[EpisodeSpec], __: str) -> Generator[Outcome]:
        for spec in missing:
            yield spec, "its process was ended by signal 9, 2 times"

    with monkeypatch.context() as broken:
        broken.setattr(runs, "_outcomes", outcomes)
        (lost,) = run(asked(tmp_path, 1, ("trusting",)), quiet())
    assert (lost.cause, lost.was_played) == ("system error", False)
    (played,) = run(asked(tmp_path, 1, ("trusting",)), quiet())
    assert fake_pool.played == [(0, "trusting")]
    assert played.was_played
    assert records.read(tmp_path) == [played]


def test_a_report_that_fails_does_not_hide_why_the_run_ended(
    fake_pool: FakePool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(_: Path) -> None:
        raise KeyError("a column")

    monkeypatch.setattr(runs, "write_report", fails)
    fake_pool.end_before, fake_pool.end = 1, Unavailable("no OpenGL context")
    with pytest.raises(Unavailable, match="no OpenGL context"):
        run(asked(tmp_path), quiet())
    assert len(records.read(tmp_path)) == 1


def test_a_command_that_plays_nothing_keeps_the_commit_of_the_episodes(
    fake_pool: FakePool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runs, "commit", lambda: "abc1234")
    monkeypatch.setattr(runs, "machine", lambda: "the first machine")
    run(asked(tmp_path, 1), quiet())
    monkeypatch.setattr(runs, "commit", lambda: "def5678")
    monkeypatch.setattr(runs, "machine", lambda: "another machine")
    run(asked(tmp_path, 1), quiet())
    described = json.loads((tmp_path / "run.json").read_text())
    assert (described["commit"], described["machine"]) == ("abc1234", "the first machine")
    run(asked(tmp_path, 2), quiet())
    described = json.loads((tmp_path / "run.json").read_text())
    assert described["commit"] == "def5678"
    assert described["machines"] == ["the first machine", "another machine"]


# --- libraries and files --------------------------------------------------------------------------
def test_a_run_tells_that_earlier_episodes_were_played_with_other_libraries(
    fake_pool: FakePool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(asked(tmp_path, 1), quiet())
    here = played_with.versions_here()
    newer = here | {"numpy": "9.9", "helios-ovmm": "9.9"}
    monkeypatch.setattr(played_with, "versions_here", lambda: dict(newer))
    told = []
    for episodes in (1, 2):  # the first plays nothing
        console = Console(file=StringIO(), width=80)
        run(asked(tmp_path, episodes), console)
        assert isinstance(console.file, StringIO)
        told.append("Earlier episodes" in console.file.getvalue())
    assert f"were played with numpy {here['numpy']} (here 9.9);" in console.file.getvalue()
    assert told == [False, True]
    described = json.loads((tmp_path / runs.RUN).read_text())
    assert described["versions"] == newer
    assert described["all_versions"] == [here, newer]
    assert len(fake_pool.played) == 4


def test_the_version_of_an_installed_program_counts_as_its_code() -> None:
    run = {"versions": played_with.versions_here() | {"helios-ovmm": "0.0"}}
    assert played_with.other_versions(run, "abc1234") == ""
    assert played_with.other_versions(run, "unknown").startswith("helios-ovmm 0.0 (here ")


@pytest.mark.parametrize("setting", ["detector.scorer", "objectmap.error_model"])
def test_a_run_refuses_to_resume_if_a_file_that_a_setting_names_has_changed(
    setting: str, fake_pool: FakePool, tmp_path: Path
) -> None:
    """The record has the file's name alone."""
    table, out = tmp_path / "mine", tmp_path / "out"
    if setting == "detector.scorer":
        value, first = f"simulated:{table}", 'base = "itc-v1"\n'
        second = 'base = "itc-v1"\nname = "mine"\n'
    else:
        value = str(table)
        shipped = shipped_error_model()
        first, second = shipped, shipped + "\n"
    table.write_text(first)
    other = replace(asked(out, 1), settings={setting: value})
    run(other, quiet())
    run(replace(other, episodes=2), quiet())
    assert len(fake_pool.played) == 4
    table.write_text(second)
    run(asked(out, 1), quiet())  # episodes without the file
    with pytest.raises(InvalidInput, match=f"another file of {setting}="):
        run(replace(other, episodes=3), quiet())
    assert len(fake_pool.played) == 6


def shipped_error_model() -> str:
    """Text of the first error model that is shipped."""
    name = error_model.shipped_models()[0]
    folder = Path(error_model.__file__).parent / "error_models"
    return (folder / f"{name}.json").read_text()


AGENT = """
from helios_planner.plugins import exploring_by
agent = exploring_by(lambda places: places.distance_m)
"""


@pytest.mark.parametrize("is_package", [False, True])
def test_a_run_refuses_to_resume_if_the_code_of_an_agent_of_another_package_has_changed(
    is_package: bool, fake_pool: FakePool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No commit covers it, and the record has its name alone."""
    name = f"agent_of_a_run_{is_package}".lower()
    monkeypatch.syspath_prepend(tmp_path)
    changed = tmp_path / f"{name}.py"
    if is_package:
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text(AGENT)
        changed = tmp_path / name / "rules.py"
    changed.write_text(AGENT)
    own = replace(asked(tmp_path / "out", 1), agents=(f"{name}:agent", "helios-paper"))
    run(own, quiet())
    run(replace(own, episodes=2), quiet())
    assert len(fake_pool.played) == 4
    changed.write_text(AGENT + "# changed\n")
    run(replace(own, agents=("helios-paper",), episodes=3), quiet())  # it is as it was
    with pytest.raises(InvalidInput, match=f"another file of agent {name}:agent"):
        run(replace(own, episodes=3), quiet())
    assert len(fake_pool.played) == 5


def test_runs_with_other_contents_of_a_file_are_not_reported_together(
    fake_pool: FakePool, tmp_path: Path
) -> None:
    table, folders = tmp_path / "mine.toml", [tmp_path / "a", tmp_path / "b"]
    for folder, name in zip(folders, ("one", "two"), strict=True):
        table.write_text(f'base = "itc-v1"\nname = "{name}"\n')
        seed0 = len(fake_pool.played)
        settings = {"detector.scorer": f"simulated:{table}"}
        run(replace(asked(folder, 1), seed0=seed0, settings=settings), quiet())
    with pytest.raises(InvalidInput, match=r"file of detector\.scorer=.* report them apart"):
        merge_runs.episodes(folders)
