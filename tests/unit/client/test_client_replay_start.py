"""Start of a replay: late services are named with reasons; skipped frames are counted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import cast

import pytest
from helios_client.interrupt_signals import Interrupts
from helios_client.replay import run as module
from helios_client.replay.frame_answers import FrameAcks
from helios_client.replay.input_checks import CheckedInput
from helios_client.replay.progress import ReplayMonitor, waits_for
from helios_client.replay.results import unreadable_frames
from helios_client.replay.run import ReplayJob
from helios_client.supervision.service_table import ServiceRow, ServiceTable
from helios_client.supervision.supervisor import ProcessInfo, ProcessState, Supervisor
from helios_client.usage_errors import UsageError
from helios_core import proto as pb
from helios_core.errors import DeadlineExceeded, InvalidInput, Unavailable
from helios_core.keyframe_acks import MapPart
from rich.console import Console

NAMES = ("router", "bridge", "detector", "map2d")


class Processes:
    """A supervisor whose processes are all running."""

    def check(self) -> tuple:
        return ()

    def table(self) -> tuple[ProcessInfo, ...]:
        return tuple(ProcessInfo(name, 7, 0, ProcessState.RUNNING, "") for name in NAMES)


def status(service: str, state: str, reason: str = "", **metrics: float) -> pb.ServiceStatus:
    return pb.ServiceStatus(service=service, state=state, reason=reason, pid=7, metrics=metrics)


def table_of(*statuses: pb.ServiceStatus) -> ServiceTable:
    service_table = ServiceTable()
    for one in statuses:
        service_table.on_status(one)
    return service_table


def play(
    job: ReplayJob,
    service_table: ServiceTable,
    acks: FrameAcks,
    *searches: str,
    interrupts: Interrupts | None = None,
) -> None:
    """Play a replay; each of `searches` is the class name of one search."""
    quiet = Console(quiet=True)
    known = CheckedInput(4, 0.0, tuple(frozenset({name}) for name in searches or ("cup",)), {})
    watch = ReplayMonitor(job, known, service_table, quiet)
    module._play(watch, cast(Supervisor, Processes()), acks, interrupts or Interrupts(), quiet)


def job(tmp_path: Path, **values: float) -> ReplayJob:
    return replace(ReplayJob(tmp_path, None, "recorded", tmp_path), **values)


def test_a_file_in_place_of_the_log_folder_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "logs").touch()
    monkeypatch.setattr(module, "examine", lambda *_: CheckedInput(4, 0.0, (), {}))
    with pytest.raises(InvalidInput, match=r"--out .*/logs: File exists"):
        module.replay(job(tmp_path), Interrupts(), Console(quiet=True))


def test_services_that_do_not_start_in_time_are_named_with_their_reasons_and_logs(
    tmp_path: Path,
) -> None:
    loading = status("detector", "starting", "loading the model")
    service_table = table_of(status("bridge", "ready"), loading)
    with pytest.raises(DeadlineExceeded) as late:
        play(job(tmp_path, start_s=0.1), service_table, FrameAcks())
    said = late.value.message
    assert "not ready within 0.1 s" in said
    assert f"detector is starting (loading the model; log {tmp_path / 'logs/detector.log'})" in said
    assert f"map2d is starting (no report yet; log {tmp_path / 'logs/map2d.log'})" in said
    assert "bridge" not in said


def test_an_unanswered_first_frame_ends_the_replay_with_the_services_reasons(
    tmp_path: Path,
) -> None:
    ready = [status(name, "ready") for name in NAMES[2:]]
    service_table = table_of(
        *ready, status("bridge", "ready", "keyframe a/0/1 waits for map2d/occupancy")
    )
    with pytest.raises(DeadlineExceeded, match=r"after 0 of 4.*waits for map2d/occupancy"):
        play(job(tmp_path, start_s=60, patience_s=0.1), service_table, FrameAcks())


def test_a_replay_ends_when_its_frames_are_answered_and_the_robot_is_finished(
    tmp_path: Path,
) -> None:
    acks = FrameAcks()
    for part in MapPart:
        acks.note_ack(pb.Ack(part=part, id=pb.FrameId(seq=1), accepted=True))
    acks.note_state(pb.RobotState(finished=True))
    play(job(tmp_path, start_s=0.1), table_of(), acks)


def test_a_loading_model_is_waited_for_but_a_missing_model_ends_the_replay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("helios_client.replay.progress.TROUBLE_S", 0.0)
    loading = status("detector", "waiting", "loading onnx:a")
    with pytest.raises(DeadlineExceeded, match="loading onnx:a"):
        play(job(tmp_path, start_s=0.3), table_of(loading), FrameAcks())
    missing = status("detector", "waiting", "a is not there")
    with pytest.raises(Unavailable, match="detector: a is not there"):
        play(job(tmp_path, start_s=60), table_of(missing), FrameAcks())


def test_a_detector_that_knows_no_class_ends_the_replay_with_a_usage_error(
    tmp_path: Path,
) -> None:
    refused = {"contexts_unknown": 1, "classes_refused": 1}
    service_table = table_of(status("detector", "degraded", "'cup' is not painted", **refused))
    with pytest.raises(UsageError, match=r"recorded knows none.*'cup' is not painted"):
        play(job(tmp_path, start_s=60), service_table, FrameAcks(), "cup", "cup")


def test_an_unknown_class_is_reported_once_and_the_replay_continues(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    figures = {"contexts_sought": 1, "classes_refused": 1}
    service_table = table_of(status("detector", "degraded", "'cup' is not painted", **figures))
    classes = ReplayMonitor(
        job(tmp_path),
        CheckedInput(4, 0.0, (frozenset({"cup", "box"}),), {}),
        service_table,
        Console(),
    ).classes
    for over in (False, False, True):
        classes.check(service_table, over, Console(width=200))
    assert capsys.readouterr().out.count("'cup' is not painted") == 1


def test_an_unknown_first_search_is_an_error_only_when_the_replay_is_over(tmp_path: Path) -> None:
    refused = {"contexts_unknown": 1, "classes_refused": 1}
    service_table = table_of(
        *(status(name, "ready") for name in NAMES[1:]),
        status("detector", "degraded", "'cup' is not painted", **refused),
    )
    acks = FrameAcks()
    acks.note_state(pb.RobotState(finished=True))
    play(job(tmp_path, start_s=60), service_table, acks, "cup", "box")
    watch = ReplayMonitor(
        job(tmp_path),
        CheckedInput(4, 0.0, (frozenset({"cup"}), frozenset({"box"})), {}),
        service_table,
        Console(quiet=True),
    )
    with pytest.raises(UsageError):
        watch.classes.check(service_table, over=True, console=Console(quiet=True))


def test_an_interrupt_before_the_first_frame_raises_and_a_later_one_ends_the_replay(
    tmp_path: Path,
) -> None:
    acks, interrupts = FrameAcks(), Interrupts()
    interrupts.note()
    with pytest.raises(KeyboardInterrupt):
        play(job(tmp_path), table_of(), acks, interrupts=interrupts)
    acks.note_ack(pb.Ack(part="occupancy", id=pb.FrameId(seq=1), accepted=True))
    play(job(tmp_path), table_of(), acks, interrupts=interrupts)


def test_the_progress_line_names_what_each_service_waits_for() -> None:
    rows = [
        ServiceRow("router", "ready", "", 0, 1),
        ServiceRow("bridge", "ready", "keyframe a/0/1 waits for map2d/value", 0, 2),
        ServiceRow("detector", "ready", "waits for a search context", 0, 3),
    ]
    assert waits_for(rows) == (
        "bridge: keyframe a/0/1 waits for map2d/value; detector: waits for a search context"
    )


def test_skipped_frames_are_reported_and_a_replay_without_readable_frames_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def say(unreadable: int) -> None:
        module._say_unreadable(unreadable, 4, job(tmp_path), Console(width=300))

    say(0)
    assert capsys.readouterr().out == ""
    say(3)
    assert "3 of 4 frames could not be read and were skipped" in capsys.readouterr().out
    with pytest.raises(InvalidInput, match="none of the 4 frames"):
        say(4)
    assert unreadable_frames(table_of(status("bridge", "ready", unreadable_frames=3))) == 3
    assert unreadable_frames(ServiceTable()) == 0
