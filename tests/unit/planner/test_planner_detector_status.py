"""A degraded detector: a task that waits for it or fails reports the detector's reason."""

from __future__ import annotations

import threading

from helios_core import proto as pb
from helios_core.topics import TASK, status_topic
from planner_bus import Start, ended, submit
from planner_flat import coffee_table, counter, flat
from planner_peers import Peers

WHY = "the detector blobs gave what cannot be used, in detect(): a value of type list"


def publish_status(peers: Peers, state: str, reason: str = "") -> None:
    status = pb.ServiceStatus(service="detector", state=state, reason=reason)
    peers.bus.publish(status_topic("detector"), status)


def test_a_task_that_waits_for_the_detector_reports_the_detectors_reason(start: Start) -> None:
    _, bus, peers = start()
    peers.silent |= {"value", "objects"}
    publish_status(peers, "degraded", WHY)
    reported: list[str] = []
    bus.subscribe(TASK, lambda task: reported.append(task.message))
    done = ended(bus, submit(bus).id)
    assert (done.state, done.cause) == ("failed", "system error")
    assert f"waits for the detector: {WHY}" in reported
    assert not any("take up the search" in message for message in reported[:-1])
    assert done.message == f"the detector did not take up the search: {WHY}"


def test_a_silent_map_is_named_even_while_the_detector_is_degraded(start: Start) -> None:
    _, bus, peers = start()
    peers.silent.add("occupancy")
    publish_status(peers, "degraded", WHY)
    assert ended(bus, submit(bus).id).message.startswith("map2d did not take up the search")


def test_a_detector_that_fails_in_mid_task_is_named_with_its_reason(start: Start) -> None:
    _, bus, peers = start()
    act = peers.world.act

    def soon_silent(action):
        if peers.world.steps == 5:
            publish_status(peers, "degraded", WHY)
            peers.silent |= {"value", "objects"}
        return act(action)

    peers.world.act = soon_silent
    reported: list[str] = []
    bus.subscribe(TASK, lambda task: reported.append(task.message))
    done = ended(bus, submit(bus).id)
    assert f"waits for the detector: {WHY}" in reported
    assert "the detector did not answer keyframe" in done.message
    assert done.message.endswith(WHY)


def test_a_failed_search_reports_that_the_detector_was_degraded_meanwhile(start: Start) -> None:
    _, bus, peers = start(flat([coffee_table(), counter()]))
    publish_status(peers, "degraded", "of another search")
    act = peers.world.act

    def flaps(action):
        if peers.world.steps == 5:
            publish_status(peers, "degraded", WHY)
        if peers.world.steps == 8:
            publish_status(peers, "ready")
        return act(action)

    peers.world.act = flaps
    done = ended(bus, submit(bus, "find the mug").id)
    assert done.cause == "object not found"
    assert done.message.endswith(f"; meanwhile the detector was degraded: {WHY}")
    again = ended(bus, submit(bus, "find the mug", max_steps=9).id)
    assert again.cause == "step budget"
    assert again.message == "the task's 9 steps are used up"


def test_a_detector_that_is_degraded_from_the_first_keyframe_on_is_reported_at_the_end(
    start: Start,
) -> None:
    """The detector reports this while the search begins, and nothing after that."""
    _, bus, peers = start(flat([coffee_table(), counter()]))
    act = peers.world.act

    def slips(action):
        if peers.world.steps == 0:
            publish_status(peers, "degraded", WHY)
        return act(action)

    peers.world.act = slips
    done = ended(bus, submit(bus, "find the mug", max_steps=9).id)
    assert done.message == (
        f"the task's 9 steps are used up; meanwhile the detector was degraded: {WHY}"
    )


def test_a_task_that_runs_out_of_time_reports_that_the_detector_was_degraded(start: Start) -> None:
    _, bus, peers = start(flat([coffee_table(), counter()]))
    act = peers.world.act

    def slow(action):
        publish_status(peers, "degraded", WHY)
        if peers.world.steps == 3:
            threading.Event().wait(2.1)  # until the task's time is over
        return act(action)

    peers.world.act = slow
    done = ended(bus, submit(bus, "find the mug", time_limit_s=2.0).id)
    assert done.message == (
        f"the task's 2 s are used up; meanwhile the detector was degraded: {WHY}"
    )
