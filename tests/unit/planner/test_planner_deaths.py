"""A task over its planner's death: it goes on, does nothing twice, or says why it does not."""

from __future__ import annotations

import threading

import pytest
from helios_core import proto as pb
from helios_core.topics import CANCEL, DECISIONS, PAUSE
from planner_bus import ended, submit, task
from planner_flat import GO, flat_with_mug
from planner_house import House
from planner_world import FakeWorld

from tests.support import wait_until


def kinds(world: FakeWorld) -> list[str]:
    return [type(a).__name__ for a in world.log]


@pytest.mark.parametrize("answered", [True, False], ids=["done", "never sent"])
def test_a_planner_that_dies_in_a_pick_goes_on_and_picks_once(house: House, answered: bool) -> None:
    peers = house.peers(flat_with_mug())
    mortal, bus = house.mortal(lambda r: r.action.HasField("pick"), answered)
    id = submit(bus).id
    wait_until(mortal.dead.is_set, 120, "it dies")
    before = bus.call(DECISIONS, pb.TaskRequest(id=id), 5).decisions
    steps = peers.world.steps
    mortal.close()
    bus = house.planner()
    done = ended(bus, id)
    assert (done.state, done.cause) == ("succeeded", ""), done.message
    assert (kinds(peers.world).count("Pick"), kinds(peers.world).count("Place")) == (1, 1)
    assert done.picks == 1
    assert peers.world.released is peers.world.things[3]
    assert done.steps >= steps
    told = bus.call(DECISIONS, pb.TaskRequest(id=id), 5).decisions
    assert [d.index for d in told] == list(range(len(told)))
    assert told[: len(before)] == before
    assert peers.contexts == [id], "a new search context would forget what was searched"


def test_a_paused_task_stays_paused_over_the_planners_death(house: House) -> None:
    peers = house.peers(flat_with_mug())
    mortal, bus = house.mortal(lambda _: True)
    id = submit(bus, GO).id
    wait_until(mortal.dead.is_set, 60, "its worker is dead")
    bus.call(PAUSE, pb.TaskRequest(id=id), 5)  # it was still there to hear this
    mortal.close()
    bus = house.planner()
    wait_until(lambda: "resume" in task(bus, id).message, 60, "it waits")
    assert task(bus, id).state == "paused"
    assert peers.world.steps == 1
    bus.call(CANCEL, pb.TaskRequest(id=id), 5)
    assert ended(bus, id).state == "cancelled"


def test_a_cancelled_task_does_not_go_on_after_the_planners_death(house: House) -> None:
    peers = house.peers(flat_with_mug())
    mortal, bus = house.mortal(lambda _: True)
    id = submit(bus, GO).id
    wait_until(mortal.dead.is_set, 60, "its worker is dead")
    bus.call(CANCEL, pb.TaskRequest(id=id), 5)  # it was still there to hear this
    mortal.close()
    assert task(house.planner(), id).state == "cancelled"
    assert peers.world.steps == 1


def test_a_planner_that_was_away_for_too_long_leaves_the_task(house: House) -> None:
    peers = house.peers(flat_with_mug())
    mortal, bus = house.mortal(lambda r: r.action.HasField("turn"))
    id = submit(bus).id
    wait_until(mortal.dead.is_set, 60, "it dies")
    mortal.close()
    steps = peers.world.steps
    bus = house.planner(resume_within_s=0)
    done = task(bus, id)
    assert (done.state, done.cause) == ("failed", "system error")
    assert "away for too long" in done.message
    assert peers.world.steps == steps


def test_a_planner_that_is_stopped_leaves_no_task_that_starts_by_itself(house: House) -> None:
    peers = house.peers(flat_with_mug())
    bus = house.planner()
    peers.gate = threading.Event()
    id = submit(bus, GO).id
    wait_until(peers.acting.is_set, 60, "it acts")
    stopping = threading.Thread(target=house.planners[0].close)
    stopping.start()
    peers.gate.set()
    stopping.join(10)
    steps = peers.world.steps
    bus = house.planner()
    done = task(bus, id)
    assert (done.state, done.cause) == ("failed", "system error")
    assert "was stopped" in done.message
    assert peers.world.steps == steps


def test_a_robot_that_restarted_meanwhile_does_not_go_on(house: House) -> None:
    peers = house.peers(flat_with_mug())
    mortal, bus = house.mortal(lambda r: r.action.HasField("tilt"))
    id = submit(bus).id
    wait_until(mortal.dead.is_set, 60, "it dies")
    mortal.close()
    peers.boot = "another"
    done = ended(house.planner(), id)
    assert (done.state, done.cause) == ("failed", "system error")
    assert "restarted" in done.message
