"""Tests the command `helios eval`: its output files, resuming after a kill, and how it ends."""

from __future__ import annotations

import importlib.util
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from helios_eval.episodes import episode_record
from helios_eval.episodes.episode_record import EpisodeRecord

from tests.support import wait_until

AGENTS = ("helios", "ground-truth-walker")
TIMES = {"wall_s", "step_ms", "cpu_s", "stage_ms"}


def arguments(out: Path, *more: str) -> list[str]:
    return [
        sys.executable, "-m", "helios_client", "eval", "ovmm", "--agents", ",".join(AGENTS),
        "--picks", "1,unlimited", "--preset", "demo-v1", "--episodes", "2", "--max-steps", "8",
        "--out", str(out), *more,
    ]  # fmt: skip


def start(out: Path, *more: str) -> subprocess.Popen[str]:
    """Start the command in its own process group, as a shell would."""
    return subprocess.Popen(
        arguments(out, *more),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def facts(records: list[EpisodeRecord]) -> dict[str, dict]:
    return {r.key: r.model_dump(exclude=TIMES) for r in records}


def members(group: int) -> list[int]:
    """Live processes of a group."""
    out = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            if int(fields[2]) == group and fields[0] != "Z":
                out.append(int(entry.name))
    return out


@pytest.fixture(scope="module")
def complete_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an undisturbed run."""
    out = tmp_path_factory.mktemp("whole")
    done = subprocess.run(
        arguments(out, "--jobs", "2"), capture_output=True, text=True, timeout=250, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "4/4" in done.stdout
    return out


def test_a_run_writes_results_settings_reports_and_failure_snapshots(complete_run: Path) -> None:
    assert len(episode_record.read(complete_run)) == 4
    rows = json.loads((complete_run / "results.json").read_text())
    assert {(r["agent"], r["picks"]) for r in rows} == {
        (agent, picks) for agent in AGENTS for picks in (1, "unlimited")
    }
    names = {"FindObj", "Pick", "FindRec", "Place", "SR", "partial", "collisions", "steps",
             "seconds_per_step"}  # fmt: skip
    for row in rows:
        assert (row["benchmark"], row["semantics"], row["preset"]) == ("ovmm", "noisy", "demo-v1")
        assert set(row["metrics"]) == names
        assert all(set(m) == {"mean", "sem", "n"} for m in row["metrics"].values())
        assert row["metrics"]["SR"]["n"] == 2
    assert all(r["metrics"]["steps"]["mean"] <= 8 for r in rows)  # also for the walker
    run = json.loads((complete_run / "run.json").read_text())
    assert {"commit", "machine", "versions", "preset_hash", "noise_hash", "command"} <= set(run)
    assert "demo-v1" in (complete_run / "report.md").read_text()
    assert (complete_run / "report.html").stat().st_size > 0
    assert len(list((complete_run / "failed").glob("helios-noisy-*.npz"))) == 2


@pytest.mark.long
def test_a_killed_run_resumes_and_plays_only_the_missing_episodes(
    complete_run: Path, tmp_path: Path
) -> None:
    """The whole process group is killed during the run; the second run plays the rest."""
    first = start(tmp_path, "--jobs", "1")
    episodes = tmp_path / episode_record.EPISODES
    try:
        wait_until(
            lambda: first.poll() is not None or (episodes.exists() and episodes.read_text()),
            200,
            "an episode is written",
        )
    finally:
        os.killpg(first.pid, signal.SIGKILL)
        first.communicate()
    wait_until(lambda: not members(first.pid), 60, "all processes are gone")
    there = len(episode_record.read(tmp_path))
    assert 1 <= there < 4
    with episodes.open("a") as file:
        file.write('{"benchmark":"ovmm","agent":"hel')  # as if killed while writing
    again = subprocess.run(
        arguments(tmp_path), capture_output=True, text=True, timeout=250, check=False
    )
    assert again.returncode == 0, again.stderr
    assert f"{there} of 4 episodes are there already" in again.stdout
    assert facts(episode_record.read(tmp_path)) == facts(episode_record.read(complete_run))


def test_a_complete_run_plays_no_episode_again(complete_run: Path) -> None:
    before = (complete_run / episode_record.EPISODES).read_bytes()
    done = subprocess.run(
        arguments(complete_run), capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    assert (complete_run / episode_record.EPISODES).read_bytes() == before


def test_an_interrupt_ends_all_processes_within_seconds(tmp_path: Path) -> None:
    run = start(tmp_path, "--jobs", "2", "--seed0", "3")
    try:
        wait_until(lambda: len(members(run.pid)) >= 3, 60, "two processes play")
        os.killpg(run.pid, signal.SIGINT)
        _, error = run.communicate(timeout=10)
        assert run.returncode == 130
        assert error.startswith("helios: interrupted")
        assert error.count("\n") == 1
        wait_until(lambda: not members(run.pid), 60, "all processes are gone")
    finally:
        if members(run.pid):
            os.killpg(run.pid, signal.SIGKILL)


def test_a_terminated_run_writes_the_report_of_its_finished_episodes(tmp_path: Path) -> None:
    run = start(tmp_path, "--jobs", "1")
    episodes = tmp_path / episode_record.EPISODES
    try:
        wait_until(
            lambda: run.poll() is not None or (episodes.exists() and episodes.read_text()),
            200,
            "an episode is written",
        )
        os.kill(run.pid, signal.SIGTERM)
        _, error = run.communicate(timeout=100)
        assert run.returncode == 128 + signal.SIGTERM
        assert error.startswith("helios: interrupted")
        wait_until(lambda: not members(run.pid), 60, "all processes are gone")
    finally:
        if members(run.pid):
            os.killpg(run.pid, signal.SIGKILL)
    there = episode_record.read(tmp_path)
    rows = json.loads((tmp_path / "results.json").read_text())
    assert sum(r["metrics"]["SR"]["n"] for r in rows if r["picks"] == 1) == len(there) < 4
    assert "Not complete" in (tmp_path / "report.md").read_text()
    assert "Not complete" in (tmp_path / "report.html").read_text()


@pytest.mark.skipif(
    importlib.util.find_spec("ray") is None, reason="Ray is missing: pip install 'helios-ovmm[ray]'"
)
def test_a_ray_cluster_gives_the_same_results(complete_run: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        arguments(tmp_path, "--ray", "local"),
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert facts(episode_record.read(tmp_path)) == facts(episode_record.read(complete_run))
