"""Commands against a running gateway."""

from __future__ import annotations

import io
import math
import threading
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest
from helios_client.cli import run
from helios_client.http.errors import WrongRequest
from helios_client.supervision import state_file
from helios_core import proto as pb
from helios_core.errors import InvalidInput, Unavailable
from helios_planner.instruction.parser import parse
from helios_planner.tasks.search_context import in_vocabulary

from tests.client_command import Helios
from tests.full_disk import fill, small_disk
from tests.gateway_process import Served
from tests.support import free_port, wait_until

INSTRUCTION = "move the mug from the coffee table to the kitchen counter"


def test_tasks_are_listed_newest_first_and_by_state(gateway: Served, helios: Helios) -> None:
    assert helios("tasks") == "no tasks yet\n"
    for _ in range(3):
        gateway.backend.submit(INSTRUCTION)
    gateway.backend.tasks["t1"].state = "succeeded"
    assert [t["id"] for t in helios.json("tasks")["tasks"]] == ["t3", "t2", "t1"]
    assert [t["id"] for t in helios.json("tasks", "--state", "succeeded")["tasks"]] == ["t1"]
    assert [t["id"] for t in helios.json("tasks", "--limit", "1")["tasks"]] == ["t3"]
    assert "t2" in helios("tasks")
    helios("tasks", "--state", "asleep", status=2)


def test_a_task_is_cancelled_by_id_and_an_ambiguous_or_unknown_id_is_refused(
    gateway: Served, helios: Helios
) -> None:
    gateway.backend.submit(INSTRUCTION)
    gateway.backend.submit(INSTRUCTION)
    assert "t1 is cancelled" in helios("cancel", "t1")
    helios("cancel", "t", status=2)
    assert "2 tasks begin" in helios.error
    helios("cancel", "none", status=2)
    assert "helios tasks" in helios.error
    helios("cancel", "t1", status=1)
    assert "has ended" in helios.error


def test_a_task_is_paused_and_resumed(gateway: Served, helios: Helios) -> None:
    gateway.backend.submit(INSTRUCTION)
    assert helios("pause", "t1") == "task t1 is queued\n"
    assert helios.json("resume", "t1")["on_hold"] is False
    gateway.backend.change_task("t1", "running", message="drives")
    assert helios("pause", "t1") == "task t1 is paused: drives\n"
    assert helios.json("resume", "t1")["state"] == "running"


def test_a_stop_latches_appears_in_the_status_and_can_be_cleared(
    gateway: Served, helios: Helios
) -> None:
    assert "helios clear-stop" in helios("stop", "--reason", "a child in the way")
    assert gateway.backend.stop_reason == "a child in the way"
    assert "the robot is stopped (a child in the way): it will not move" in helios("status")
    assert helios.json("status")["stop_reason"] == "a child in the way"
    assert (helios.json("status")["ready"], helios.json("status")["stopped"]) == (False, True)
    assert helios.json("clear-stop")["state"]["stopped"] is False
    assert helios.json("status")["stopped"] is False


def test_a_stop_that_the_robot_does_not_report_is_an_error(gateway: Served, helios: Helios) -> None:
    gateway.backend.state_late_s = math.inf
    assert helios("stop", status=1) == ""
    assert "did not confirm that the robot is stopped; if it moves, use its own" in helios.error
    gateway.backend.state_late_s = 0.0
    helios("stop")
    gateway.backend.state_late_s = math.inf
    assert helios("clear-stop", status=1) == ""
    assert "did not confirm that the stop is cleared" in helios.error


@pytest.mark.parametrize(
    "args",
    [
        ["task", INSTRUCTION, "--time-limit-s", "inf"],
        ["task", INSTRUCTION, "--robot", "any", "--time-limit-s", "inf"],
        ["explore", "--time-limit-s", "inf"],
        ["objects", "--min-score", "nan"],
    ],
)
def test_a_number_that_is_not_finite_is_a_usage_error(
    args: list[str], gateway: Served, helios: Helios, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("helios_client.sdk.Helios._do", lambda *_: pytest.fail("it was sent"))
    helios(*args, status=2)
    option, value = args[-2:]
    assert helios.error == f"helios: {option} is {value}; wanted a finite number\n"


def test_the_gateway_url_may_lack_its_scheme(
    helios: Helios, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HELIOS_URL", f"localhost:{helios.gateway.port}")
    assert run(["tasks"]) == 0
    assert helios._capsys.readouterr().out == "no tasks yet\n"


def test_names_here_lists_found_objects_and_example_tasks(gateway: Served, helios: Helios) -> None:
    lines = helios("names", "--here").splitlines()
    assert [line.split()[:-2] for line in lines[1:4]] == [
        ["coffee", "table"],
        ["mug"],
        ["kitchen", "counter"],
    ]
    assert '  helios task "Move the mug from the coffee table to the kitchen counter"' in lines
    assert helios.json("names", "--here")["seen"][1]["objects"] == 2
    gateway.backend.found.clear()
    gateway.backend.change_objects()
    reported = helios("names", "--here")
    assert reported.startswith("no object that a task looked for has been seen in this home yet")
    assert "\nExamples with names that the detector knows:\n" in reported


def test_the_camera_image_is_written_to_a_file(
    gateway: Served, helios: Helios, tmp_path: Path
) -> None:
    gateway.backend.publish_frame()
    file = tmp_path / "now.jpg"
    assert helios("camera", str(file)) == f"{file}\n"
    assert file.read_bytes().startswith(b"\xff\xd8")


def test_an_option_overrides_the_environment_variable(
    gateway: Served, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("HELIOS_URL", f"http://127.0.0.1:{free_port()}")
    for typed in (["--port", str(gateway.port)], ["--url", f"localhost:{gateway.port}"]):
        assert run(["tasks", *typed]) == 0
    assert run(["tasks", "--port", str(gateway.port), "--url", "localhost:1"]) == 2
    assert capsys.readouterr().err == (
        f"helios: --url localhost:1 names port 1, but --port is {gateway.port}; give one of them\n"
    )


def test_names_and_ids_ignore_case(gateway: Served, helios: Helios) -> None:
    gateway.backend.submit(INSTRUCTION)
    assert len(helios.json("tasks", "--state", "QUEUED")["tasks"]) == 1
    assert len(helios.json("objects", "--class", "Coffee Table")["objects"]) == 1
    assert "t1 is queued" in helios("pause", "T1")
    assert "t1 is queued" in helios("resume", "LAST")


def test_objects_are_sorted_by_score_and_filtered_by_class_and_score(helios: Helios) -> None:
    scores = [o["score"] for o in helios.json("objects")["objects"]]
    assert scores == sorted(scores, reverse=True)
    assert [o["class"] for o in helios.json("objects", "--class", "mug")["objects"]] == ["mug"] * 2
    assert all(o["score"] >= 0.7 for o in helios.json("objects", "--min-score", "0.7")["objects"])
    assert "coffee table" in helios("objects")
    for said in ("Mug", "MUGS", "Coffee_Table", "coffee  tables"):
        assert helios.json("objects", "--class", said)["objects"], said
    assert helios("objects", "--class", "Bowl") == "no Bowl has been found yet\n"
    helios("objects", "--class", "bowll", status=2)
    assert "did you mean bowl?" in helios.error
    helios("objects", "--class", "piano", status=2)
    assert "no class is called 'piano'" in helios.error
    assert "helios names" in helios.error


def test_the_map_is_exported_as_images_and_arrays(helios: Helios, tmp_path: Path) -> None:
    out = tmp_path / "map"
    files = [Path(path) for path in helios.json("map", "export", "--out", str(out))["files"]]
    names = {"occupancy", "value-pick", "value-place"}
    assert {path.name for path in files} == {f"{n}.{e}" for n in names for e in ("png", "npz")}
    assert (out / "occupancy.png").read_bytes().startswith(b"\x89PNG")
    with np.load(io.BytesIO((out / "value-pick.npz").read_bytes())) as arrays:
        assert arrays["value"].shape == (140, 180)
    assert helios("map", "export", "--out", str(out), "--only", "occupancy").count("\n") == 2
    assert "value-pick.png" in helios("map", "export", "--out", str(out), "--only", "PICK")
    helios("map", "export", "--only", "dream", status=2)
    assert "wanted one of occupancy, pick, place" in helios.error
    helios("map", "export", "--out", "/dev/null/x", status=1)
    assert "/dev/null/x cannot be created: Not a directory" in helios.error


def test_the_map_is_exported_for_ros(helios: Helios, tmp_path: Path) -> None:
    out = tmp_path / "ros"
    assert helios.json("map", "export", "--ros", "--out", str(out))["files"] == [
        str(out / "map.pgm"),
        str(out / "map.yaml"),
    ]
    assert (out / "map.yaml").read_bytes() == b"walls"
    helios("map", "export", "--ros", "--only", "pick", status=2)
    assert "only the occupancy" in helios.error


@pytest.mark.parametrize("command", [["map", "save"], ["camera"]])
def test_output_into_a_missing_folder_or_onto_a_folder_is_refused(
    command: list[str], helios: Helios, tmp_path: Path
) -> None:
    helios(*command, str(tmp_path / "homes" / "first"), status=2)
    assert (
        f"there is no folder {tmp_path / 'homes'}; make it first, or choose another" in helios.error
    )
    assert not (tmp_path / "homes").exists()
    helios(*command, str(tmp_path), status=2)
    assert f"{tmp_path} is a folder; name a file in it" in helios.error


def test_a_full_disk_leaves_existing_files_unchanged(
    gateway: Served, helios: Helios, tmp_path: Path
) -> None:
    big = bytes(600_000)
    gateway.backend.kept = {"map2d": big, "objects": big}
    with small_disk(tmp_path / "disk") as disk:
        good = disk / "home.zip"
        good.write_bytes(b"a good map")
        for folder in ("map", "seen"):
            helios("map", "export", "--out", str(disk / folder))
        before = {path: path.read_bytes() for path in disk.rglob("*") if path.is_file()}
        helios("map", "save", str(good), status=1)
        assert "No space left" in helios.error
        filler = fill(disk)
        helios("map", "export", "--out", str(disk / "map"), status=1)
        helios("seen", "mug", "--out", str(disk / "seen"), status=1)
        assert "No space left" in helios.error
        helios("map", "save", str(disk / "never.zip"), status=1)
        filler.unlink()
        assert {p: p.read_bytes() for p in disk.rglob("*") if p.is_file()} == before


def test_map_reset_clears_both_maps_or_the_named_one(gateway: Served, helios: Helios) -> None:
    assert helios("map", "reset", "--only", "objects").startswith("discarded: objects; ")
    assert gateway.backend.kept == {"map2d": b"walls", "objects": b""}
    assert helios.json("map", "reset", "--yes") == {"reset": ["objects", "occupancy"]}
    assert gateway.backend.kept == {"map2d": b"", "objects": b""}
    helios("map", "reset", "--only", "walls", status=2)
    gateway.backend.submit(INSTRUCTION)
    helios("map", "reset", status=1)
    assert "t1 is queued" in helios.error


@pytest.mark.parametrize(("answer", "status"), [("y", 0), ("n", 1), ("", 1)])
def test_map_reset_at_a_terminal_asks_for_confirmation(
    gateway: Served, helios: Helios, monkeypatch: pytest.MonkeyPatch, answer: str, status: int
) -> None:
    terminal = io.StringIO(f"{answer}\n")
    monkeypatch.setattr(terminal, "isatty", lambda: True)
    monkeypatch.setattr("sys.stdin", terminal)
    helios("map", "reset", "--only", "occupancy", status=status)
    assert "Discard the map of occupancy" in helios.error
    assert bool(gateway.backend.kept["map2d"]) == bool(status)


def test_both_maps_are_saved_to_one_file_and_loaded_from_it(
    gateway: Served, helios: Helios, tmp_path: Path
) -> None:
    file = tmp_path / "first.zip"
    assert helios("map", "save", str(file)) == f"{file}\n"
    gateway.backend.kept = {"map2d": b"other", "objects": b"other"}
    assert helios.json("map", "load", str(file))["objects"] == 4
    assert gateway.backend.kept == {"map2d": b"walls", "objects": b"things"}
    assert "40 m² of known area, 4 objects" in helios("map", "load", str(file))
    helios("map", "load", str(tmp_path / "none.zip"), status=2)
    assert "No such file" in helios.error
    assert "helios map save" in helios.error
    (tmp_path / "note.zip").write_text("not a map")
    helios("map", "load", str(tmp_path / "note.zip"), status=2)
    assert "helios map save" in helios.error


def test_seen_reports_objects_and_past_views_with_images(
    gateway: Served, helios: Helios, tmp_path: Path
) -> None:
    reported = helios("seen", "the mug", "--limit", "2", "--out", str(tmp_path))
    assert "0.82" in reported
    assert "view-2.jpg" in reported
    assert (tmp_path / "view-1.jpg").read_bytes().startswith(b"\xff\xd8")
    assert [o["id"] for o in helios.json("seen", "mug")["objects"]] == [1, 4]
    gateway.backend.recalls = Unavailable("no view has been kept")
    reported = helios("seen", "piano")
    assert "the map has no object of that name: piano" in reported
    assert "past views were not asked: no view has been kept" in reported.replace("\n", " ")


def test_a_task_accepts_a_priority_and_its_own_settings(gateway: Served, helios: Helios) -> None:
    def end_it() -> None:
        wait_until(lambda: "t1" in gateway.backend.tasks, 60, "the task was submitted")
        gateway.backend.change_task("t1", "succeeded")

    threading.Thread(target=end_it, daemon=True).start()
    reported = helios.json("task", INSTRUCTION, "--priority", "7", "--set", "alpha_d=0.02")
    assert (reported["priority"], reported["settings"]) == (7, {"alpha_d": "0.02"})
    assert "priority" in helios("tasks")
    helios("task", INSTRUCTION, "--set", "alpha_d", status=2)
    assert "NAME=VALUE" in helios.error
    helios("task", INSTRUCTION, "--priority", "101", status=2)


def test_names_lists_the_vocabulary(helios: Helios, monkeypatch: pytest.MonkeyPatch) -> None:
    known = ["bowl", "coffee table", "kitchen counter", "mug", "sofa"]
    assert helios("names").splitlines() == known
    reported = helios.json("names")
    assert (reported["open"], reported["names"]) == (False, known)
    monkeypatch.setenv("FORCE_COLOR", "1")  # as on a terminal
    monkeypatch.setenv("COLUMNS", "80")
    lines = helios("names").splitlines()
    assert len(lines) < len(known)
    assert all(name in " ".join(lines) for name in known)


@pytest.mark.parametrize("thing", ["unicorn", "mugg"])
def test_an_unknown_class_gives_an_error_that_points_to_helios_names(
    thing: str, helios: Helios, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = pb.VocabularyReply(names=["mug", "sofa"], detector="simulated")
    with pytest.raises(InvalidInput) as said:
        in_vocabulary(parse(f"find the {thing}"), known)

    def refuse(*_: object) -> NoReturn:
        raise WrongRequest(said.value.message)

    monkeypatch.setattr("helios_client.sdk.Helios.submit", refuse)
    helios("task", f"find the {thing}", status=2)
    assert helios.error.startswith(f"helios: {said.value.message}")
    assert helios.error.count("helios names") == 1


def test_a_task_for_a_stopped_robot_reports_at_once_that_it_waits_for_clear_stop(
    gateway: Served, helios: Helios, tmp_path: Path
) -> None:
    folder = tmp_path / "helios" / str(gateway.port)
    state_file.write([folder], {"ready": True, "services": []})  # as `helios up` writes it
    helios("stop")

    def end_it() -> None:
        wait_until(lambda: "t1" in gateway.backend.tasks, 60, "the task was submitted at once")
        gateway.backend.change_task("t1", "succeeded")

    threading.Thread(target=end_it, daemon=True).start()
    helios.json("task", INSTRUCTION)
    assert "the task waits for `helios clear-stop`" in helios.error
    assert "waiting until all services" not in helios.error


def test_an_interrupt_cancels_the_task_before_the_command_ends(
    gateway: Served, helios: Helios, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> NoReturn:
        raise KeyboardInterrupt

    monkeypatch.setattr("helios_client.commands.task_view._watch_lines", interrupted)
    reported = helios("task", INSTRUCTION, status=130)
    assert "\ncancelling the task\n" in reported
    assert gateway.backend.tasks["t1"].state == "cancelled"


def test_an_interrupt_while_the_stop_is_reported_cancels_the_task(
    gateway: Served, helios: Helios, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> NoReturn:
        raise KeyboardInterrupt

    monkeypatch.setattr("helios_client.commands.task_view.say_stopped", interrupted)
    helios("task", INSTRUCTION, status=130)
    assert gateway.backend.tasks["t1"].state == "cancelled"


def test_the_robot_option_selects_a_robot_and_refuses_an_unknown_one(helios: Helios) -> None:
    assert helios.json("tasks", "--robot", "robot") == {"tasks": []}
    helios("tasks", "--robot", "spot", status=2)
    assert "there are: robot" in helios.error


def test_status_of_a_named_robot_ignores_the_state_file_of_another_robot(
    helios: Helios, tmp_path: Path
) -> None:
    row = {"name": "only-here", "state": "ready", "reason": "", "restarts": 0, "pid": 7}
    here = {"ready": True, "services": [row], "robot": "here"}  # as `helios up` writes it
    state_file.write([tmp_path / "helios" / str(helios.gateway.port)], here)
    assert "only-here" in helios("status")
    reported = helios("status", "--robot", "robot")
    assert "only-here" not in reported
    assert "gateway" in reported


@pytest.mark.parametrize(
    "args", [["task", "dance"], ["status", "--robot", "foo"], ["tasks", "--robot", "foo"]]
)
def test_a_request_that_the_gateway_refuses_is_a_usage_error(
    args: list[str], helios: Helios
) -> None:
    helios(*args, status=2)
    assert helios.error.startswith("helios: ")
    assert helios.error.count("\n") == 1


def test_a_command_on_the_wrong_port_names_the_port_of_a_running_stack(
    gateway: Served,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    free = free_port()
    for args in (["task", INSTRUCTION], ["status"]):
        assert run([*args, "--port", str(free)]) == 1
        assert "or name its port with --port\n" in capsys.readouterr().err
    running = {"ready": True, "services": []}  # as `helios up` writes it
    state_file.write([tmp_path / "helios" / str(gateway.port)], running)
    (tmp_path / "helios" / "backup").mkdir()
    for args in (["task", INSTRUCTION], ["status"], ["objects"]):
        assert run([*args, "--port", str(free)]) == 1
        reported = capsys.readouterr().err
        assert reported.endswith(f"--port: one runs with --port {gateway.port}\n")
        assert reported.count("\n") == 1
    monkeypatch.setenv("HELIOS_URL", f"127.0.0.1:{free}")  # also this machine
    assert run(["tasks"]) == 1
    assert capsys.readouterr().err.endswith(f"one runs with --port {gateway.port}\n")
    monkeypatch.setenv("HELIOS_URL", f"http://127.0.0.2:{free}")  # stands for another machine
    assert run(["tasks"]) == 1
    assert "--port" not in capsys.readouterr().err


def test_an_empty_object_list_names_the_minimum_score_that_filtered_it(helios: Helios) -> None:
    assert helios("objects", "--min-score", "7") == (
        "no object with a score of at least 7 has been found yet\n"
    )


def test_the_camera_command_refuses_a_file_name_that_is_not_jpeg(
    helios: Helios, tmp_path: Path
) -> None:
    helios("camera", str(tmp_path / "now.png"), status=2)
    assert "the image is a JPEG" in helios.error
    assert not list(tmp_path.iterdir())


def test_every_error_message_is_one_sentence(helios: Helios) -> None:
    for args in (["cancel", "none"], ["tasks", "--robot", "x"], ["map", "export", "--only", "x"]):
        assert run([*args, "--port", str(helios.gateway.port)]) in (1, 2)
        helios.error = helios._capsys.readouterr().err
        assert helios.error.startswith("helios: ")
        assert helios.error.count("\n") == 1
