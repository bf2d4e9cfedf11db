"""Tasks for an agent that the services were not started for: the refusal names the remedy."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from helios_core import proto as pb
from helios_core.errors import Conflict, DeadlineExceeded
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.robot import Action, ActionResult
from helios_core.topics import LIST_TASKS, settings_method
from helios_planner.service import PlannerService
from planner_bus import Start, ended, hasty, submit
from planner_flat import flat_with_mug
from planner_peers import Peers

OWN = "helios_examples.left_first:agent"


def serve_object_map_settings(peers: Peers, reported: str) -> None:
    """Serve this JSON as the settings of the object map."""
    peers.bus.serve(settings_method("objectmap"), lambda _: pb.SettingsReply(json=reported))


def settings_for(agent: str) -> str:
    return json.dumps({"agent": {"value": agent}})


@pytest.mark.parametrize("started", ["helios", "helios-paper"])
def test_the_refusal_names_the_command_and_the_agent_that_can_run_the_task(
    started: str, start: Start
) -> None:
    other = "helios-paper" if started == "helios" else "helios"
    _, bus, peers = start(agent=started)
    serve_object_map_settings(peers, settings_for(started))
    with pytest.raises(Conflict) as refusal:
        submit(bus, agent=other)
    assert refusal.value.message == (
        f"agent '{other}' needs other settings: the planner was started for '{started}' and the "
        f"object map was started for '{started}'; start the services with helios up --agent "
        f"{other}, or submit the task for agent '{started}'"
    )
    assert not bus.call(LIST_TASKS, pb.Empty(), 5).tasks
    assert submit(bus, agent=started).agent == started


def test_an_object_map_that_was_started_for_another_agent_than_the_planner_is_named(
    start: Start,
) -> None:
    _, bus, peers = start(agent="helios")
    serve_object_map_settings(peers, settings_for("helios-paper"))
    with pytest.raises(
        Conflict, match=r"the object map was started for .*'helios-paper'"
    ) as refusal:
        submit(bus)
    assert "or submit" not in refusal.value.message  # no agent can run the task
    assert "the planner was" not in refusal.value.message


@pytest.mark.parametrize("agent", ["trusting", "vlfm", "helios-5050"])
def test_an_agent_with_the_same_settings_is_accepted(agent: str, start: Start) -> None:
    _, bus, peers = start(agent="helios-paper", agents_of_tasks="any")
    serve_object_map_settings(peers, settings_for(agent))
    assert submit(bus, agent=agent).agent == agent


@pytest.mark.parametrize("started", ["helios", "helios-paper"])
def test_an_agent_of_another_package_requires_the_default_settings(
    started: str, start: Start
) -> None:
    _, bus, _ = start(agent=started, agents_of_tasks="any")
    with pytest.raises(Conflict, match=f"helios up --agent {OWN}"):
        submit(bus, agent=OWN)


def test_a_queued_task_fails_if_the_planner_is_restarted_for_another_agent(
    tmp_path: Path,
) -> None:
    """The planner had no robot yet, so the task was still queued when the planner died."""
    hub = MemoryHub()
    died = PlannerService(MemoryBus(hub), hasty(tmp_path, agent="helios"), Health())
    id = submit(MemoryBus(hub)).id
    hub = MemoryHub()
    again = PlannerService(MemoryBus(hub), hasty(tmp_path, agent="helios-paper"), Health())
    Peers(hub, flat_with_mug())
    try:
        reported = ended(MemoryBus(hub), id)
        assert (reported.state, reported.cause, reported.steps) == ("failed", "system error", 0)
        assert "helios up --agent helios" in reported.message
        assert submit(MemoryBus(hub)).agent == "helios-paper"
    finally:
        again.close()
        died.close()


def test_a_task_waits_for_a_slow_object_map_and_fails_if_that_runs_for_another_agent(
    start: Start,
) -> None:
    _, bus, peers = start(agent="helios")
    asked = 0

    def slow_at_first(_: pb.Empty) -> pb.SettingsReply:
        nonlocal asked
        asked += 1
        if asked < 5:
            raise DeadlineExceeded("objectmap/settings gave no answer in 1 s")
        return pb.SettingsReply(json=settings_for("helios-paper"))

    peers.bus.serve(settings_method("objectmap"), slow_at_first)
    done = ended(bus, submit(bus).id)
    assert (done.state, done.cause, done.steps) == ("failed", "system error", 0)
    assert "the object map was started for 'helios-paper'" in done.message


def test_a_task_fails_if_the_object_map_comes_back_for_another_agent(start: Start) -> None:
    world = flat_with_mug()
    act = world.act
    _, bus, peers = start(world, agent="helios")

    def back_meanwhile(action: Action) -> ActionResult:
        serve_object_map_settings(peers, settings_for("helios-paper"))
        return act(action)

    world.act = back_meanwhile
    done = ended(bus, submit(bus).id)
    assert (done.state, done.steps) == ("failed", 1)  # it only looked
    assert "the object map was started for 'helios-paper'" in done.message


def test_a_motion_needs_no_answer_of_the_object_map(start: Start) -> None:
    _, bus, peers = start(agent="helios")

    def slow(_: pb.Empty) -> pb.SettingsReply:
        raise DeadlineExceeded("objectmap/settings gave no answer in 1 s")

    peers.bus.serve(settings_method("objectmap"), slow)
    assert ended(bus, submit(bus, "come back").id).state == "succeeded"


@pytest.mark.parametrize("reported", ["", "no JSON", "[]", "{}", '{"agent": 3}', '{"agent": {}}'])
def test_an_object_map_that_does_not_report_its_agent_causes_no_refusal(
    reported: str, start: Start
) -> None:
    """It is of an older release, or away; the planner's own settings still count."""
    _, bus, peers = start(agent="helios")
    serve_object_map_settings(peers, reported)
    assert submit(bus).agent == "helios"
