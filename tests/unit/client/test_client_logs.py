"""`helios logs` prints the log files of the services."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from helios_client.cli import run
from helios_client.commands.logs import new_lines, newest_lines
from helios_client.supervision import state_file

from tests.support import wait_until

PORT = "8091"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The log folder of the stack on this port."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    logs = tmp_path / "helios" / PORT / "logs"
    logs.mkdir(parents=True)
    (logs / "planner.log").write_text("".join(f"line {k}\n" for k in range(100)))
    (logs / "planner.log.1").write_text("older\n")
    (logs / "map2d.log").write_bytes(b"one\ntwo \x1b[31m \xff\nhalf")
    return logs


def logs(*args: str, capsys: pytest.CaptureFixture[str], status: int = 0) -> list[str]:
    assert run(["logs", *args, "--port", PORT]) == status
    said = capsys.readouterr()
    return (said.err if status else said.out).splitlines()


def test_the_newest_lines_are_printed(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert logs("planner", capsys=capsys) == [f"line {k}" for k in range(50, 100)]
    assert logs("Planner", "-n", "2", capsys=capsys) == ["line 98", "line 99"]
    assert logs("planner", "-n", "0", capsys=capsys) == []
    assert logs("planner", "-n", "500", capsys=capsys)[:2] == ["older", "line 0"]


def test_control_characters_do_not_reach_the_terminal(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert logs("map2d", capsys=capsys) == ["one", "two \ufffd[31m \ufffd", "half"]


def test_logs_without_a_service_lists_the_services_that_have_logs(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    reported = logs(capsys=capsys)
    assert [line.split() for line in reported] == [
        [name, str(folder / f"{name}.log")] for name in ("map2d", "planner")
    ]
    [reported] = logs("plannner", capsys=capsys, status=2)
    assert reported.endswith(
        "there is no log of a service 'plannner'; logs exist for map2d, planner; "
        "did you mean planner?"
    )


def test_logs_come_from_the_robot_that_the_environment_variable_names(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("HELIOS_URL", f"localhost:{PORT}")
    assert run(["logs", "planner", "-n", "1"]) == 0
    assert capsys.readouterr().out == "line 99\n"
    assert run(["logs", "plannner"]) == 2
    assert "did you mean planner?" in capsys.readouterr().err
    monkeypatch.setenv("HELIOS_URL", "http://192.0.2.7:8080")  # reserved for examples
    assert run(["logs", "planner"]) == 2
    assert "run `helios logs` on 192.0.2.7" in capsys.readouterr().err
    assert logs("planner", "-n", "1", capsys=capsys) == ["line 99"]  # the option wins


def test_a_missing_log_folder_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    [reported] = logs("planner", capsys=capsys, status=1)
    assert "there are no logs in" in reported
    assert "--state" in reported


def test_logs_are_found_in_another_state_folder(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    elsewhere = tmp_path / "elsewhere"
    (elsewhere / "logs").mkdir(parents=True)
    (elsewhere / "logs" / "bridge.log").write_text("here\n")
    assert logs("bridge", "--state", str(elsewhere), capsys=capsys) == ["here"]
    state_file.write([folder.parent], {"state_dir": str(elsewhere)})  # of a running `helios up`
    assert logs("bridge", capsys=capsys) == ["here"]


def test_following_continues_in_a_log_that_was_emptied(folder: Path) -> None:
    file = folder / "planner.log"
    _, opened = newest_lines(file, 1)
    lines = new_lines(file, opened)
    with file.open("a") as log:
        log.write("one\n")
        log.flush()
        assert next(lines) == "one"
        os.truncate(file, 0)
        log.write("two\n")
        log.flush()
        assert next(lines) == "two"


def test_following_continues_across_log_rotation(folder: Path) -> None:
    file = folder / "planner.log"
    newest, opened = newest_lines(file, 1)
    assert newest == ["line 99"]
    reported: list[str] = []

    def follow(lines: Iterator[str]) -> None:
        for line in lines:
            reported.append(line)
            if line == "end":
                return

    reader = threading.Thread(target=follow, args=(new_lines(file, opened),), daemon=True)
    reader.start()
    with file.open("a") as log:
        log.write("one\ntw")
        log.flush()
        wait_until(lambda: reported == ["one"], 60, "the first line was told")
        log.write("o\n")
        log.flush()
        file.replace(folder / "planner.log.1")
        log.write("three\n")
    file.write_text("four\nend\n")
    reader.join(30)
    assert reported == ["one", "two", "three", "four", "end"]
