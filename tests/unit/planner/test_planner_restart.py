"""Interrupted missions resume from their checkpoint, and repeat nothing."""

from __future__ import annotations

import json

import pytest
from helios_core.robot import Action, ActionResult, Observe, Pick, Place, Turn
from helios_planner.decisions.decision import Decision, Do
from helios_planner.instruction.parser import parse
from helios_planner.settings import Settings
from helios_planner.task import Cause, TaskCancelled, TaskFailed
from helios_planner.tasks.mission import Mission
from helios_planner.tasks.run_control import LastAction
from planner_flat import MOVE, coffee_table, counter, flat, mug
from planner_world import FakeWorld


def mission(world: FakeWorld, agent: str = "helios-paper") -> Mission:
    return Mission(world, parse(MOVE), Settings(rounds=1), agent)


def cut_off(world: FakeWorld, after: int, agent: str = "helios-paper") -> dict:
    """Run until `after` actions are done; return the checkpoint as it is stored."""
    first = mission(world, agent)
    world.cancel_after = after
    with pytest.raises(TaskCancelled):
        first.run()
    world.cancel_after = None
    return json.loads(json.dumps(first.checkpoint()))


def last_action(
    action: Action | None = None, succeeded: bool | None = True, held: str = "", reason: str = ""
) -> LastAction:
    return LastAction(action, succeeded, reason, held)


def searched(world: FakeWorld) -> list[int]:
    return [d.chosen.id for d in world.decisions if d.do is Do.SEARCH_RECEPTACLE]


@pytest.mark.parametrize("agent", ["helios-paper", "trusting"])
def test_a_mission_goes_on_where_it_was_cut_off(agent: str) -> None:
    world = flat([coffee_table(), counter(), mug()])
    checkpoint = cut_off(world, 60, agent)
    assert checkpoint["looked_around"]
    again = mission(world, agent)
    again.restore(checkpoint, last_action(Turn(0.1)))
    steps = world.steps
    again.run()
    assert world.released is world.things[3]
    assert world.picks == 1
    assert world.contacts == 0
    turns = [a for a in world.log[steps : steps + 12] if isinstance(a, Turn)]
    assert len(turns) < 12, "it looked around again"


def two_bare_tables() -> FakeWorld:
    other = coffee_table(9)
    other.center_m[:] = (7.8, 1.0, 0.45)
    return flat([coffee_table(), other, counter()])


def test_a_searched_receptacle_is_not_searched_again() -> None:
    """Two tables have no mug; a mission cut off on the way to the second skips the first."""
    whole = two_bare_tables()
    steps: list[int] = []
    tell = whole.on_decision

    def tell_and_count(decision: Decision) -> None:
        if decision.do is Do.SEARCH_RECEPTACLE:
            steps.append(whole.steps)
        tell(decision)

    whole.on_decision = tell_and_count
    with pytest.raises(TaskFailed):
        mission(whole).run()
    first, second = searched(whole)[:2]
    assert first != second

    world = two_bare_tables()
    checkpoint = cut_off(world, steps[1] + 2)
    world.decisions.clear()
    again = mission(world)
    again.restore(checkpoint, last_action())
    with pytest.raises(TaskFailed) as failure:
        again.run()
    assert failure.value.cause is Cause.OBJECT_NOT_FOUND
    assert searched(world) == [second]


def test_a_restored_search_gives_the_same_checkpoint() -> None:
    world = flat([coffee_table(), counter(), mug()])
    checkpoint = cut_off(world, 60)
    again = mission(world)
    again.restore(checkpoint, last_action())
    search = again._begun(again.agent.seek_object(again.tools, "mug", "coffee table"))
    assert again.search is search
    assert json.loads(json.dumps(again.checkpoint())) == checkpoint


def test_a_pick_whose_answer_was_lost_is_not_tried_again() -> None:
    world = flat([coffee_table(), counter(), mug()])
    checkpoint = run_until(world, Pick)
    assert world.held() == "mug"
    again = mission(world)
    again.restore(checkpoint, last_action(world.log[-1], succeeded=None, held="mug"))
    again.run()
    assert sum(isinstance(a, Pick) for a in world.log) == 1
    assert world.released is world.things[3]


def test_a_place_whose_answer_was_lost_ends_the_task() -> None:
    world = flat([coffee_table(), counter(), mug()])
    checkpoint = run_until(world, Place)
    steps = world.steps
    again = mission(world)
    again.restore(checkpoint, last_action(world.log[-1]))
    assert again.run() == "put the mug on the counter; it was not seen there yet"
    assert again.seen_at_goal is False
    assert sum(isinstance(a, Place) for a in world.log) == 1
    assert world.steps - steps < 5


def test_a_death_in_the_look_after_placing_does_not_pick_the_object_up_again() -> None:
    world = flat([coffee_table(), counter(), mug()])
    first, act = mission(world), world.act
    kept: dict = {}

    def unseen_once_placed(action: Action) -> ActionResult:
        if isinstance(action, Observe) and world.released is not None:
            kept.update(json.loads(json.dumps(first.checkpoint())))
            raise TaskCancelled
        result = act(action)
        if isinstance(action, Place):
            world.things[3].views.clear()
        return result

    world.act = unseen_once_placed
    with pytest.raises(TaskCancelled):
        first.run()
    world.act = act
    again = mission(world)
    again.restore(kept, last_action(Observe()))
    assert again.run() == "put the mug on the counter; it was not seen there yet"
    assert (again.skills.falls, again.seen_at_goal) == (0, False)
    assert sum(isinstance(a, Pick) for a in world.log) == 1


@pytest.mark.parametrize("kind", [Pick, Place])
def test_a_death_while_a_lost_keyframe_is_taken_again_repeats_neither_pick_nor_place(
    kind: type,
) -> None:
    world = flat([coffee_table(), counter(), mug()])
    checkpoint = run_until(world, kind, once_done=True)
    again = mission(world)
    again.restore(checkpoint, last_action(Observe(), held=world.held()))
    assert again.picked_at_m is not None
    assert again.picked_at_m[:2] == pytest.approx([7.2, 5.35], abs=0.05)  # where the mug was
    again.run()
    assert [type(a) for a in world.log if isinstance(a, Pick | Place)] == [Pick, Place]
    assert world.released is world.things[3]
    assert again.skills.falls == 0


def test_an_object_that_is_still_held_after_a_place_is_placed_again() -> None:
    world = flat([coffee_table(), counter(), mug()])
    checkpoint = run_until(world, Place) | {"placed": True}
    again = mission(world)
    again.restore(checkpoint, last_action(Observe(), held="mug"))
    assert not again.placed


@pytest.mark.parametrize("kind", [Pick, Place])
def test_an_object_accepted_as_likeliest_is_still_reported_after_the_planner_died(
    kind: type,
) -> None:
    doubtful = mug()
    doubtful.rate = 0.4
    world = flat([coffee_table(), counter(), doubtful])
    checkpoint = run_until(world, kind)
    again = mission(world)
    again.restore(checkpoint, last_action(world.log[-1], held=world.held()))
    assert "no surer mug was found than this one (0." in again.run()


def test_an_object_that_fell_meanwhile_is_searched_again() -> None:
    world = flat([coffee_table(), counter(), mug()])
    checkpoint = run_until(world, Pick) | {"picked_at_m": [7.2, 5.35, 0.5]}
    again = mission(world)
    again.restore(checkpoint, last_action(Turn(0.1), held=""))
    assert (again.picked_at_m, again.skills.falls) == (None, 1)


def run_until(world: FakeWorld, kind: type, once_done: bool = False) -> dict:
    """Run until an action of a kind is done but not answered; return the checkpoint before it.
    once_done: that after its result was known."""
    first = mission(world)
    kept: list[dict] = []
    act = world.act

    def watched(action: Action) -> ActionResult:
        kept.append(json.loads(json.dumps(first.checkpoint())))
        result = act(action)
        if isinstance(action, kind):
            if once_done:
                kept.append(json.loads(json.dumps(first.checkpoint())))
            raise TaskCancelled
        return result

    world.act = watched
    with pytest.raises(TaskCancelled):
        first.run()
    world.act = act
    return kept[-1]
