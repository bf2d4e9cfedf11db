"""Tests that a fault in one process of the pool affects only its episode."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Generator
from contextlib import closing, suppress
from pathlib import Path

import eval_fake_worker
import pytest
from helios_core.errors import Unavailable
from helios_eval.episodes.episode_player import PlayedEpisode
from helios_eval.episodes.episode_spec import EpisodeSpec
from helios_eval.runs import process_pool
from helios_eval.runs.process_pool import Outcome, play_all

from tests.support import wait_until


def spec(agent: str, seed: int = 0) -> EpisodeSpec:
    return EpisodeSpec("ovmm", agent, "noisy", "demo-v1", seed, None)


def played(specs: list[EpisodeSpec], folder: Path, jobs: int = 2) -> Generator[Outcome]:
    return play_all(specs, jobs, str(folder), serve=eval_fake_worker.serve)


def ended(pid: int) -> bool:
    with suppress(ProcessLookupError):
        os.kill(pid, 0)
        return False
    return True


def test_every_episode_is_played_once(tmp_path: Path) -> None:
    specs = [spec("fine", seed) for seed in range(7)]
    outcomes = list(played(specs, tmp_path, jobs=3))
    assert sorted(s.seed for s, _ in outcomes) == list(range(7))
    assert all(
        isinstance(came, PlayedEpisode) and came.record.seed == s.seed for s, came in outcomes
    )
    assert len(set((tmp_path / "pids").read_text().split())) <= 3


def test_a_process_that_dies_loses_only_its_episode(tmp_path: Path) -> None:
    """The pool retries the episode once; a second death is reported as lost, with the reason."""
    specs = [spec("fine", 1), spec("dies", 2), spec("dies-once", 3), spec("fine", 4)]
    came = {s.seed: c for s, c in played(specs, tmp_path)}
    assert [seed for seed, c in came.items() if isinstance(c, str)] == [2]
    assert "signal 9" in str(came[2])
    assert set(came) == {1, 2, 3, 4}


def test_an_episode_that_raises_is_reported_and_the_others_are_played(tmp_path: Path) -> None:
    came = {s.seed: c for s, c in played([spec("raises", 1), spec("fine", 2)], tmp_path)}
    assert came[1] == "no such luck"
    assert not isinstance(came[2], str)


def test_a_run_ends_when_no_episode_can_be_played(tmp_path: Path) -> None:
    with pytest.raises(Unavailable, match="OpenGL"):
        list(played([spec("impossible", seed) for seed in range(3)], tmp_path))


def test_closing_the_pool_ends_running_processes(tmp_path: Path) -> None:
    with closing(played([spec("fine"), spec("hangs", 1), spec("hangs", 2)], tmp_path)) as outcomes:
        assert next(outcomes)[0].agent == "fine"
        pids = tmp_path / "pids"
        wait_until(lambda: len(pids.read_text().split()) >= 2, 60, "another episode runs")
    assert all(ended(int(pid)) for pid in pids.read_text().split())


FIRST_PROCESS = """
import multiprocessing, time
from pathlib import Path
from helios_eval.runs.process_pool import _interrupts_put_off

process = multiprocessing.get_context("spawn").Process(target=time.sleep, args=(60,), daemon=True)
with _interrupts_put_off():
    process.start()
    print(Path(f"/proc/{process.pid}/status").read_text())
process.kill()
"""


@pytest.mark.skipif(
    not Path("/proc/self/status").exists(), reason="reads a process's mask in /proc"
)
def test_interrupts_are_blocked_while_the_first_process_starts() -> None:
    """An interrupt then would print a fatal error of the interpreter to the terminal."""
    said = subprocess.run(
        [sys.executable, "-c", FIRST_PROCESS],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    ).stdout
    (mask,) = [line.split()[1] for line in said.splitlines() if line.startswith("SigBlk")]
    assert int(mask, 16) >> (signal.SIGINT - 1) & 1


def test_only_folders_that_no_live_run_holds_are_deleted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run in another container has a process number that does not exist here."""
    monkeypatch.setattr(process_pool, "_MEMORY", str(tmp_path))
    monkeypatch.setattr(process_pool.psutil, "pid_exists", lambda _: False)
    with process_pool._temporary_folder() as live:
        killed = tmp_path / "helios-eval-1234567-x"
        killed.mkdir()
        (killed / "lock").touch()
        before_locks = tmp_path / "helios-eval-1234568-x"
        before_locks.mkdir()
        process_pool._tidy_up()
        assert list(tmp_path.iterdir()) == [Path(live)]
    assert not list(tmp_path.iterdir())
