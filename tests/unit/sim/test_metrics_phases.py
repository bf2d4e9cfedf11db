"""Tests the phases of a move task on constructed cases."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from helios_sim.navigable_area import NavigableArea
from helios_sim.ovmm_metrics import (
    Progress,
    ReleaseResult,
    Step,
    Targets,
    advance,
    placed,
    viewpoints_of,
)
from hypothesis import given
from hypothesis import strategies as st

GROUND = NavigableArea(np.ones((200, 200), bool), (0.0, 0.0), 0.05)
TARGETS = Targets(
    objects={"mug_0": np.array([[1.0, 1.0]]), "mug_1": np.array([[5.0, 5.0]])},
    goals={"sofa_0": np.array([[3.0, 1.0]])},
    ground=GROUND,
)
AT_MUG = Step((1.05, 1.05), {"mug_0": 2e-3})
AT_SOFA = Step((3.0, 1.0), {"sofa_0": 0.3})
ON_SOFA = ReleaseResult("mug_0", True, {"sofa_0": 0.45}, 0.5)


def run(*steps: Step) -> Progress:
    progress = Progress()
    for step in steps:
        progress = advance(progress, step, TARGETS)
    return progress


def holding(step: Step, name: str = "mug_0") -> Step:
    return replace(step, held=name)


def test_a_task_with_all_phases_in_order_succeeds():
    done = run(AT_MUG, holding(AT_MUG), holding(AT_SOFA), replace(AT_SOFA, released=ON_SOFA))
    assert (done.find_object, done.pick, done.find_receptacle, done.place) == (True,) * 4
    assert done.success
    assert done.partial_success == 1.0
    assert done.steps == 4


def test_steps_and_path_until_the_object_is_found_stay_as_they_were():
    far = Step((9.0, 9.0), moved_m=2.0)
    done = run(far, replace(AT_MUG, moved_m=1.5), far, replace(AT_MUG, moved_m=1.0))
    assert (done.find_object_steps, done.find_object_path_m) == (2, 3.5)
    assert (done.steps, done.path_m) == (4, 6.5)
    assert run(far).find_object_steps == 0


def test_find_object_stays_set_after_the_robot_leaves():
    assert run(AT_MUG, Step((9.0, 9.0))).find_object


def test_an_object_counts_as_found_only_within_10_cm_of_a_viewpoint():
    assert not run(replace(AT_MUG, base_xy_m=(1.2, 1.0))).find_object
    assert run(replace(AT_MUG, base_xy_m=(1.099, 1.0))).find_object
    assert not run(replace(AT_MUG, base_xy_m=(1.101, 1.0))).find_object


def test_a_viewpoint_behind_a_wall_does_not_count_as_near():
    """The viewpoint is 7 cm away in a straight line, which is near without the wall."""
    free = GROUND.free.copy()
    free[:, 21] = False  # from 1.05 to 1.10 m
    here = replace(TARGETS, objects={"mug_0": np.array([[1.04, 1.0]])})
    walled = replace(here, ground=replace(GROUND, free=free))
    beyond = Step((1.11, 1.0), {"mug_0": 2e-3})
    this_side = replace(beyond, base_xy_m=(1.04, 1.08))
    assert advance(Progress(), beyond, here).find_object
    assert not advance(Progress(), beyond, walled).find_object
    assert advance(Progress(), this_side, walled).find_object


def test_an_object_that_covers_one_thousandth_of_the_image_is_found():
    assert run(replace(AT_MUG, coverage={"mug_0": 1e-3})).find_object


def test_an_object_with_too_few_pixels_is_not_found():
    assert not run(replace(AT_MUG, coverage={"mug_0": 0.9e-3})).find_object


def test_an_object_seen_from_the_viewpoint_of_another_is_not_found():
    assert not run(replace(AT_MUG, coverage={"mug_1": 0.2})).find_object


def test_holding_another_object_is_no_pick():
    assert not run(AT_MUG, holding(AT_MUG, "vase_0")).pick


def test_a_pick_without_find_object_does_not_count():
    assert not run(holding(Step((9.0, 9.0)))).pick


def test_one_step_may_complete_several_phases():
    """The robot grasps the object in the step that first sees it, beside the goal receptacle."""
    both = Step((3.0, 1.0), {"mug_2": 2e-3, "sofa_0": 0.3}, held="mug_2")
    here = replace(TARGETS, objects={"mug_2": np.array([[3.0, 1.05]])})
    done = advance(Progress(), both, here)
    assert (done.find_object, done.pick, done.find_receptacle) == (True, True, True)


def test_the_receptacle_counts_only_after_the_pick():
    assert not run(AT_MUG, AT_SOFA).find_receptacle
    assert run(AT_MUG, holding(AT_MUG), holding(AT_SOFA)).find_receptacle


def test_place_needs_find_receptacle_but_success_does_not():
    from_afar = Step((3.0, 1.9), {"sofa_0": 0.3}, released=ON_SOFA)
    done = run(AT_MUG, holding(AT_MUG), from_afar)
    assert (done.pick, done.find_receptacle, done.place) == (True, False, False)
    assert done.success
    assert done.partial_success == 0.75


def test_find_receptacle_after_the_release_completes_place():
    from_afar = Step((3.0, 1.9), {"sofa_0": 0.3}, released=ON_SOFA)
    assert run(AT_MUG, holding(AT_MUG), from_afar, AT_SOFA).place


def test_picking_the_placed_object_again_revokes_success():
    done = run(AT_MUG, holding(AT_MUG), replace(AT_SOFA, released=ON_SOFA), holding(AT_SOFA))
    assert done.place
    assert not done.success


def test_a_collision_prevents_success_but_not_place():
    bump = Step((2.0, 1.0), collided_with=frozenset({"walls"}), held="mug_0")
    done = run(AT_MUG, holding(AT_MUG), bump, bump, replace(AT_SOFA, released=ON_SOFA))
    assert done.place
    assert not done.success
    assert done.collisions == 2
    assert done.collided_with == ("walls",)
    assert done.partial_success == 0.75


def test_many_contacts_in_a_step_are_one_collision():
    both = Step((2.0, 1.0), collided_with=frozenset({"walls", "bed_0"}))
    assert run(both).collisions == 1
    assert set(run(both).collided_with) == {"walls", "bed_0"}


def test_an_object_is_placed_if_it_rests_on_the_goal():
    assert placed(ON_SOFA, TARGETS)
    assert not placed(None, TARGETS)
    assert not placed(replace(ON_SOFA, at_rest=False), TARGETS)
    assert not placed(replace(ON_SOFA, on={"floor_0": 0.2}), TARGETS)
    assert placed(replace(ON_SOFA, on={"floor_0": 0.0, "sofa_0": 0.05}), TARGETS)
    assert not placed(replace(ON_SOFA, on={"sofa_0": 0.049}), TARGETS)
    assert not placed(replace(ON_SOFA, name="vase_0"), TARGETS)


def test_a_place_without_a_pick_does_not_count():
    assert not run(replace(AT_SOFA, released=ON_SOFA)).place


def test_steps_and_path_length_add_up():
    done = run(*[Step((2.0, 2.0), moved_m=0.25)] * 4)
    assert (done.steps, done.path_m) == (4, 1.0)


@given(st.lists(st.sampled_from([AT_MUG, holding(AT_MUG), holding(AT_SOFA), Step((2.0, 2.0))])))
def test_phases_never_go_back_and_each_needs_the_previous_one(steps: list[Step]):
    progress = Progress()
    for step in steps:
        new = advance(progress, step, TARGETS)
        before = (progress.find_object, progress.pick, progress.find_receptacle, progress.place)
        after = (new.find_object, new.pick, new.find_receptacle, new.place)
        assert all(a or not b for a, b in zip(after, before, strict=True))
        assert list(after[:3]) == sorted(after[:3], reverse=True)
        progress = new


def test_viewpoints_lie_on_the_grid_within_a_metre_of_the_box():
    points = viewpoints_of((2.0, 2.0), (2.6, 2.3), GROUND)
    steps = (points - [1.0, 1.0]) / 0.15
    assert np.allclose(steps, np.rint(steps))
    beyond = np.maximum(np.maximum([2.0, 2.0] - points, points - [2.6, 2.3]), 0)
    assert np.hypot(*beyond.T).max() <= 1.0
    # A corner of the square is farther than a metre from the box; the middle of a side is not.
    assert not (np.hypot(*(points - [1.0, 1.0]).T) < 0.01).any()
    assert (np.hypot(*(points - [2.2, 1.0]).T) < 0.01).any()


def test_viewpoints_lie_where_the_robot_fits():
    free = np.zeros((100, 100), bool)
    free[:, :50] = True
    points = viewpoints_of((2.4, 2.0), (2.6, 2.3), NavigableArea(free, (0.0, 0.0), 0.05))
    assert len(points) > 0
    assert points[:, 0].max() < 2.5


def test_no_position_is_near_an_empty_set_of_viewpoints():
    assert not GROUND.within((1.0, 1.0), np.zeros((0, 2)), 0.1)
