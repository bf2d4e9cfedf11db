"""An action that waits for its turn: a stop, a lost lease or its time limit still refuses it."""

from __future__ import annotations

import threading
from collections.abc import Callable

from helios_core import proto as pb
from helios_core.errors import Conflict, DeadlineExceeded, HeliosError
from helios_core.keyframe_acks import KeyframeAcks
from helios_core.topics import LEASE, STOP
from helios_core.types import FrameId

from tests.support import wait_until
from tests.unit.bridge.bridge_stage import Stage


def wait_for_its_turn(stage: Stage) -> None:
    """Wait until one action runs and a second one waits."""
    known = stage.bridge._actions._results
    wait_until(lambda: stage.robot.done and len(known) == 2, 60, "the second action waits")


def refusal_of_waiting_action(
    stage: Stage, meanwhile: Callable[[], object], left_s: float = 5
) -> Exception:
    """Run `meanwhile` while an action waits for its turn; return the error that refuses it."""
    stage.drive("before")
    stage.bridge._actions._results.clear()
    stage.robot.done.clear()
    stage.robot.hold.clear()
    errors: list[Exception] = []

    def second() -> None:
        try:
            stage.drive("second", left_s=left_s)
        except HeliosError as error:
            errors.append(error)

    first = threading.Thread(target=lambda: stage.drive("first"))
    first.start()
    wait_until(lambda: stage.robot.done, 60, "the first action runs")
    waiting = threading.Thread(target=second)
    waiting.start()
    wait_for_its_turn(stage)
    meanwhile()
    stage.robot.hold.set()
    first.join(5)
    waiting.join(5)
    assert len(stage.robot.done) == 1
    return errors[0]


def test_a_stop_refuses_an_action_that_waits_for_its_turn() -> None:
    stage = Stage()
    # The robot forgets the stop itself: the bridge must not rely on it.
    stage.robot.stop = lambda reason: None
    why = refusal_of_waiting_action(
        stage, lambda: stage.other.call(STOP, pb.StopRequest(reason="a child"), 1)
    )
    assert isinstance(why, Conflict)
    assert "a child" in str(why)
    assert stage.bridge.state().stopped  # whatever the robot reports


def test_a_taken_lease_refuses_an_action_that_waits_for_its_turn() -> None:
    stage = Stage()
    take = pb.LeaseRequest(holder="other", take=True)
    why = refusal_of_waiting_action(stage, lambda: stage.other.call(LEASE, take, 1))
    assert isinstance(why, Conflict)
    assert "ask for a new one" in str(why)


def test_an_action_waits_for_a_hanging_robot_no_longer_than_its_time_limit() -> None:
    stage = Stage()
    errors: list[Exception] = []

    def late() -> None:
        try:
            stage.drive("late", left_s=0.2)
        except HeliosError as error:
            errors.append(error)

    stage.drive("before")
    with stage.bridge._turn:  # as an action that never ends
        waiting = threading.Thread(target=late)
        waiting.start()
        waiting.join(5)
        assert not waiting.is_alive()
    assert isinstance(errors[0], DeadlineExceeded)


def test_only_the_answers_of_the_newest_frames_are_kept() -> None:
    acks = KeyframeAcks(remembered=2)
    for seq in range(4):
        for part in ("occupancy", "value"):
            acks.add(pb.Ack(service="map2d", part=part, id=pb.FrameId(robot_boot_id="b", seq=seq)))
    assert [len(acks.answers(FrameId("b", 0, seq))) for seq in range(4)] == [0, 0, 2, 2]
