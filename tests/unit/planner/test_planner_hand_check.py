"""A picked object is looked at in the hand, and put back if it is the wrong one."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from helios_core.robot import ActionResult, Pick, Place, Show, Tilt
from helios_planner.decisions.decision import DecisionRule, Do
from helios_planner.decisions.held_object import HeldObject
from helios_planner.hand_check import NEARER_M
from helios_planner.instruction.parser import parse
from helios_planner.settings import Settings
from helios_planner.task import Cause, Phase, TaskFailed
from helios_planner.tasks.mission import Mission
from helios_planner.tasks.run_control import LastAction
from planner_eye import ROBOT
from planner_flat import MOVE, coffee_table, counter, flat, mug
from planner_things import Box, Thing
from planner_world import FakeWorld

WRONG = HeldObject(0.01, 6, (("glass", 5 / 6), ("mug", 1 / 6)))
DOUBTFUL = HeldObject(0.4, 6, (("mug", 4 / 6), ("glass", 5 / 6)))
RIGHT = HeldObject(0.99, 6, (("mug", 5 / 6), ("glass", 1 / 6)))
SHOWING = replace(ROBOT, show_base_m=(0.5, 0.0, 1.1))


def looks(thing: Thing, held: HeldObject) -> Thing:
    thing.in_hand = held
    return thing


def world_of(*mugs: Thing) -> FakeWorld:
    world = flat([coffee_table(), counter(), *mugs])
    world.description = SHOWING
    return world


def mission(world: FakeWorld, **settings: float) -> Mission:
    return Mission(world, parse(MOVE), Settings.model_validate({"hand_sides": 6} | settings))


def picked(world: FakeWorld) -> list[int]:
    """Ids of the things that were picked, in order."""
    return world.retired


def in_hand(world: FakeWorld) -> list[Do]:
    return [d.do for d in world.decisions if d.rule == DecisionRule.IN_HAND]


def test_a_wrong_object_goes_back_to_its_place_and_the_right_one_is_brought() -> None:
    wrong, right = looks(mug(3), WRONG), looks(mug(4, 6.7, 5.6), RIGHT)
    world = world_of(wrong, right)
    place_m = wrong.center_m.copy()
    assert "put the mug on the counter" in mission(world).run()
    assert world.released is right
    assert picked(world) == [3, 4]
    assert wrong.center_m == pytest.approx(place_m, abs=0.02)
    assert in_hand(world) == [Do.SEARCH_ON, Do.ACT]


def test_a_wrong_object_that_was_put_back_is_not_picked_again() -> None:
    world = world_of(looks(mug(3), WRONG))
    with pytest.raises(TaskFailed) as failure:
        mission(world).run()
    assert failure.value.cause is Cause.OBJECT_NOT_FOUND
    assert picked(world) == [3]
    assert world.held() == ""


@pytest.mark.parametrize("forgotten", [False, True])
def test_a_doubtful_object_is_brought_after_all_if_nothing_better_is_found(forgotten: bool) -> None:
    world = world_of(looks(mug(3), DOUBTFUL))
    placing = world._place

    def place(point):
        done = placing(point)
        if forgotten:  # the object map does not find it again
            world.things[3].rate = 0.0
        return done

    world._place = place
    assert "put the mug on the counter" in mission(world).run()
    assert picked(world) == [3, 3]
    assert in_hand(world) == [Do.SEARCH_ON]  # it is not looked at again
    assert any("hand 0.40" in d.why for d in world.decisions)


def test_a_doubtful_object_waits_until_all_else_was_tried() -> None:
    world = world_of(looks(mug(3), DOUBTFUL), looks(mug(4, 6.7, 5.6), RIGHT))
    mission(world).run()
    assert picked(world) == [3, 4]
    assert world.released is world.things[4]


def test_a_restart_remembers_a_doubtful_object() -> None:
    world = world_of(looks(mug(3), DOUBTFUL))
    again = restarted(world, before=Place)
    again.run()
    assert picked(world) == [3, 3]
    assert in_hand(world) == [Do.SEARCH_ON]


def test_the_right_object_is_shown_from_all_sides_and_kept() -> None:
    world = world_of(looks(mug(3), RIGHT))
    mission(world).run()
    angles = [action.angle_rad for action in world.log if isinstance(action, Show)]
    assert angles == pytest.approx([k * 1.0472 for k in range(6)], abs=1e-3)
    assert world.phases.count(Phase.FIND_OBJECT) == 1  # the look belongs to the pick
    (kept,) = [d for d in world.decisions if d.rule == DecisionRule.IN_HAND]
    assert (
        kept.why == "keep the mug: 6 sides in the hand show mug on 83% and glass on 17%; "
        "probability 0.99"
    )


@pytest.mark.parametrize("settings", [{"hand_sides": 0}, {"max_picks": 1}])
def test_without_the_setting_or_another_pick_nothing_is_shown(settings: dict[str, float]) -> None:
    world = world_of(looks(mug(3), WRONG))
    mission(world, **settings).run()
    assert not any(isinstance(action, Show) for action in world.log)


def test_a_robot_that_cannot_show_what_it_holds_brings_it() -> None:
    world = world_of(looks(mug(3), WRONG))
    world.description = ROBOT
    mission(world).run()
    assert not any(isinstance(action, Show) for action in world.log)


def test_a_failed_show_ends_the_check_for_the_task() -> None:
    world = world_of(looks(mug(3), WRONG))
    done = world._do
    world._do = lambda action: replace(done(action), succeeded=not isinstance(action, Show))
    mission(world).run()
    assert sum(isinstance(action, Show) for action in world.log) == 1


def refuse_places(world: FakeWorld, times: int) -> list[np.ndarray]:
    """Let the first attempts to place fail; returns where they were made."""
    placing, refused = world._place, []

    def place(point: np.ndarray) -> ActionResult:
        if len(refused) < times:
            refused.append(point)
            return replace(placing(point * 0 - 100.0), reason="something is in the way")
        return placing(point)

    world._place = place
    return refused


def test_an_object_that_cannot_be_put_back_at_its_place_is_put_beside_it() -> None:
    world = world_of(looks(mug(3), WRONG), looks(mug(4, 6.7, 5.6), RIGHT))
    refused = refuse_places(world, 2)
    mission(world).run()
    assert in_hand(world) == [Do.SEARCH_ON, Do.ACT]
    assert world.released is world.things[4]
    x, y, _ = refused[0]
    placed = (a.point_world_m for a in world.log if isinstance(a, Place))
    away_m = next(d for at in placed if (d := math.dist(at[:2], (x, y))) > 1e-6)
    assert away_m <= 0.13


def test_an_object_that_cannot_be_put_back_is_brought() -> None:
    world = world_of(looks(mug(3), WRONG))
    refuse_places(world, 2 * (1 + len(NEARER_M)))
    assert "put the mug on the counter" in mission(world).run()
    assert in_hand(world) == [Do.SEARCH_ON, Do.ACT]
    (kept,) = [d.why for d in world.decisions if d.rule == DecisionRule.IN_HAND and d.do is Do.ACT]
    assert "which cannot be put back where it was" in kept


def restarted(
    world: FakeWorld, before: type[Place] | type[Show] | type[Tilt], **settings: float
) -> Mission:
    """Mission after a death of the planner before its first action of that kind with the object in
    the gripper."""
    first = mission(world, **settings)
    stored: dict = {}

    class Died(Exception):
        pass

    acting = world.act

    def act(action):
        if isinstance(action, before) and world.held() and not stored:
            stored.update(first.checkpoint())
            stored["action"] = action
            raise Died
        return acting(action)

    world.act = act
    with pytest.raises(Died):
        first.run()
    assert world.held() == "mug"
    again = mission(world, **settings)
    last = stored.pop("action") if before is Tilt else Show(0.0)
    again.restore(stored, LastAction(last, True, "", "mug"))
    return again


def test_a_restart_between_pick_and_return_puts_the_wrong_object_back() -> None:
    world = world_of(looks(mug(3), WRONG), looks(mug(4, 6.7, 5.6), RIGHT))
    again = restarted(world, before=Place)
    again.run()
    assert world.released is world.things[4]
    assert again.skills.falls == 0


def test_a_restart_after_the_return_forgets_it() -> None:
    """Else a later restart would put the right object back."""
    world = world_of(looks(mug(3), WRONG), looks(mug(4, 6.7, 5.6), RIGHT))
    again = restarted(world, before=Place)
    assert again.hand.returning_m is not None
    x, y, z = again.hand.returning_m.tolist()
    world.act(Place((x, y, z + 0.01)))
    again.run()
    assert world.released is world.things[4]
    assert (again.hand.put_back, again.hand.returning_m) == (1, None)


@pytest.mark.parametrize("before", [Show, Tilt])
def test_a_restart_between_the_pick_and_the_look_keeps_a_named_object(
    before: type[Show] | type[Tilt],
) -> None:
    world = world_of(looks(mug(3), RIGHT))
    again = restarted(world, before=before)
    assert again.picked_at_m is not None
    again.run()
    assert world.released is world.things[3]
    assert sum(isinstance(action, Pick) for action in world.log) == 1


# --- things without the sought name ---------------------------------------------------------------
def unseen_mug(held: HeldObject, id: int = 3, x: float = 7.2) -> Thing:
    """A mug that the detector never reports."""
    return looks(mug(id, x, rate=0.0), held)


def bumps(world: FakeWorld, *mugs: Thing) -> FakeWorld:
    """The same world; the height map shows the mugs, which lie on the table."""
    table = world.truth_top.copy()
    for one in mugs:
        x, y = one.center_m[:2].tolist()
        world.add_box(Box(x - 0.05, y - 0.05, x + 0.05, y + 0.05, 0.55))
    world.truth_top[:] = table
    return world


def unnamed(world: FakeWorld) -> list[str]:
    return [d.why for d in world.decisions if d.rule == DecisionRule.UNNAMED]


def test_in_vain_the_robot_picks_what_lies_on_the_start_receptacle() -> None:
    thing = unseen_mug(RIGHT)
    world = bumps(world_of(thing), thing)
    mission(world, unnamed_picks=4).run()
    assert world.released is thing
    (why,) = unnamed(world)
    assert "no mug was found, and it is the only thing there of the right size" in why


def test_unnamed_things_are_tried_before_the_object_counts_as_absent() -> None:
    thing = unseen_mug(RIGHT)
    world = bumps(world_of(thing), thing)
    world.named_at = 0.1  # so it is no likely one
    mission(world, unnamed_picks=4, absent_from=0.01).run()
    assert world.released is thing
    nothing = world_of()
    with pytest.raises(TaskFailed, match="probably not here"):
        mission(nothing, unnamed_picks=4, absent_from=0.01).run()


def test_a_thing_that_looks_wrong_is_put_back_and_the_next_one_tried() -> None:
    wrong, right = unseen_mug(WRONG, 3, 6.7), unseen_mug(RIGHT, 4, 7.2)
    world = bumps(world_of(wrong, right), wrong, right)
    mission(world, unnamed_picks=4).run()
    assert world.released is right
    assert len(unnamed(world)) <= 2


@pytest.mark.parametrize("settings", [{"unnamed_picks": 0}, {"hand_sides": 0, "unnamed_picks": 4}])
def test_without_a_look_in_the_hand_nothing_unnamed_is_picked(settings: dict[str, float]) -> None:
    thing = unseen_mug(RIGHT)
    world = bumps(world_of(thing), thing)
    with pytest.raises(TaskFailed) as failure:
        mission(world, **settings).run()
    assert failure.value.cause is Cause.OBJECT_NOT_FOUND
    assert unnamed(world) == []


def test_on_a_sure_receptacle_it_is_tried_before_the_rest_of_the_home_is_searched() -> None:
    def decisions_before(named_at: float) -> int:
        thing = unseen_mug(RIGHT)
        world = bumps(world_of(thing), thing)
        world.named_at = named_at
        mission(world, unnamed_picks=4).run()
        return [d.rule for d in world.decisions].index(DecisionRule.UNNAMED)

    unlikely = 0.1  # it has another name
    assert decisions_before(0.5) < decisions_before(unlikely)


def test_a_doubtful_unnamed_thing_is_brought_after_all() -> None:
    thing = unseen_mug(HeldObject(0.7, 6, (("mug", 4 / 6), ("glass", 5 / 6))))
    world = bumps(world_of(thing), thing)
    mission(world, unnamed_picks=4).run()
    assert world.released is thing
    assert in_hand(world) == [Do.SEARCH_ON]


def test_a_doubtful_thing_that_cannot_be_picked_again_is_left() -> None:
    thing = unseen_mug(DOUBTFUL)
    world = bumps(world_of(thing), thing)
    placing = world._place

    def place(point):
        done = placing(point)
        thing.center_m = np.array([1.0, 1.0, 0.05])  # it rolls away
        return done

    world._place = place
    with pytest.raises(TaskFailed) as failure:
        mission(world, unnamed_picks=4).run()
    assert failure.value.cause in (Cause.OBJECT_NOT_FOUND, Cause.PICK_FAILED)


def test_a_named_thing_that_was_put_back_is_no_unnamed_one() -> None:
    """Else it would be picked for a second look."""
    doubtful, right = looks(mug(3, 6.7), DOUBTFUL), unseen_mug(RIGHT, 4, 7.2)
    world = bumps(world_of(doubtful, right), doubtful, right)
    mission(world, unnamed_picks=4).run()
    assert world.released is right
    assert sum(isinstance(action, Pick) for action in world.log) == 2


def test_a_thing_beside_one_that_was_put_back_is_looked_at_too() -> None:
    nameless, wrong = unseen_mug(HeldObject(1.0, 0, ()), 3, 6.7), unseen_mug(WRONG, 4, 6.83)
    world = bumps(world_of(nameless, wrong), nameless, wrong)
    mission(world, unnamed_picks=4).run()
    assert world.released is nameless  # at last
    assert len(in_hand(world)) == 2


def test_an_unnamed_thing_that_cannot_be_shown_goes_back() -> None:
    things = [unseen_mug(WRONG, 3, 6.7), unseen_mug(WRONG, 4, 7.2)]
    world = bumps(world_of(*things), *things)
    done = world._do
    world._do = lambda action: replace(done(action), succeeded=not isinstance(action, Show))
    with pytest.raises(TaskFailed):
        mission(world, unnamed_picks=4).run()
    assert world.held() == ""
    assert len(unnamed(world)) == 1
    assert any("cannot show what it holds" in d.why for d in world.decisions)


def test_an_unnamed_thing_is_looked_at_after_the_last_pick_too() -> None:
    thing = unseen_mug(WRONG)
    world = bumps(world_of(thing), thing)
    with pytest.raises(TaskFailed):
        mission(world, unnamed_picks=4, max_picks=1).run()
    assert world.held() == ""


def test_a_named_thing_beside_an_unnamed_one_does_not_take_its_place() -> None:
    named, right = looks(mug(3, 6.9), WRONG), unseen_mug(RIGHT, 4, 7.1)
    world = bumps(world_of(named, right), named, right)
    mission(world, unnamed_picks=4).run()
    assert world.released is right


@pytest.mark.parametrize("before", [Show, Tilt])
@pytest.mark.parametrize(("held", "is_brought"), [(WRONG, False), (RIGHT, True)])
def test_a_restart_in_the_look_at_an_unnamed_thing_repeats_it(
    held: HeldObject, is_brought: bool, before: type[Show] | type[Tilt]
) -> None:
    thing = unseen_mug(held)
    world = bumps(world_of(thing), thing)
    again = restarted(world, before=before, unnamed_picks=4)
    if is_brought:
        again.run()
        assert world.released is thing
    else:
        with pytest.raises(TaskFailed):
            again.run()
    assert sum(isinstance(action, Pick) for action in world.log) == 2
    assert world.held() == ""


def test_a_spot_that_two_instances_of_the_table_have_is_one_thing() -> None:
    thing = unseen_mug(RIGHT)
    twin = replace(coffee_table(), id=coffee_table().id + 50)
    world = flat([coffee_table(), twin, counter(), thing])
    world.description = SHOWING
    mission(bumps(world, thing), unnamed_picks=4).run()
    assert all("the only thing there" in why for why in unnamed(world))


def test_an_unnamed_thing_without_a_name_in_the_hand_waits_until_all_else_was_tried() -> None:
    nameless, right = unseen_mug(HeldObject(1.0, 0, ()), 3, 6.7), unseen_mug(RIGHT, 4, 7.2)
    world = bumps(world_of(nameless, right), nameless, right)
    mission(world, unnamed_picks=4).run()
    assert world.released is right


def test_each_thing_is_tried_once_and_no_more_than_asked_for() -> None:
    things = [unseen_mug(WRONG, 3, 6.7), unseen_mug(WRONG, 4, 7.0), unseen_mug(WRONG, 5, 7.3)]
    world = bumps(world_of(*things), *things)
    with pytest.raises(TaskFailed):
        mission(world, unnamed_picks=2).run()
    assert len(unnamed(world)) == 2
