"""The choice of a robot for each waiting task."""

from __future__ import annotations

from helios_gateway.fleet.assignment import (
    Assignment,
    IdleRobot,
    KnownThing,
    WaitingTask,
    assignments,
)
from hypothesis import given
from hypothesis import strategies as st

ROBOTS = ("robot-1", "robot-2", "robot-3", "robot-4")
THINGS = ("", "mug", "can", "book")

known = st.builds(KnownThing, score=st.floats(0.2, 1), distance_m=st.floats(0, 20))
idle_robots = st.lists(
    st.builds(
        IdleRobot,
        name=st.sampled_from(ROBOTS),
        known=st.dictionaries(st.sampled_from(THINGS[1:]), known),
    ),
    unique_by=lambda robot: robot.name,
)
waiting_tasks = st.lists(
    st.builds(
        WaitingTask,
        id=st.text("abcdef", min_size=3, max_size=6),
        priority=st.integers(-100, 100),
        created_s=st.floats(0, 100),
        thing=st.sampled_from(THINGS),
        wanted=st.sampled_from(("any", *ROBOTS)),
        refused=st.frozensets(st.sampled_from(ROBOTS)),
    ),
    unique_by=lambda task: task.id,
)


def may_do(robot: str, task: WaitingTask) -> bool:
    return task.wanted in ("any", robot) and robot not in task.refused


def rank(task: WaitingTask) -> tuple:
    return -task.priority, task.created_s, task.id


@given(waiting_tasks, idle_robots)
def test_no_task_goes_twice_and_no_robot_gets_two(
    waiting: list[WaitingTask], idle: list[IdleRobot]
) -> None:
    made = assignments(waiting, idle)
    assert len({a.task_id for a in made}) == len({a.robot for a in made}) == len(made)
    tasks = {task.id: task for task in waiting}
    for one in made:
        assert one.robot in {robot.name for robot in idle}
        assert may_do(one.robot, tasks[one.task_id])
        assert one.robot in one.why


@given(waiting_tasks, idle_robots)
def test_no_task_waits_while_a_robot_could_do_it(
    waiting: list[WaitingTask], idle: list[IdleRobot]
) -> None:
    made = assignments(waiting, idle)
    left = [t for t in waiting if t.id not in {a.task_id for a in made}]
    unused = {robot.name for robot in idle} - {a.robot for a in made}
    assert not any(may_do(robot, task) for task in left for robot in unused)


@given(waiting_tasks, idle_robots)
def test_an_earlier_task_never_loses_its_robot_to_a_later_one(
    waiting: list[WaitingTask], idle: list[IdleRobot]
) -> None:
    """Earlier: of higher priority, else older."""
    by_task = {a.task_id: a.robot for a in assignments(waiting, idle)}
    for task in waiting:
        if task.id in by_task:
            continue
        for other in waiting:
            if other.id in by_task and may_do(by_task[other.id], task):
                assert rank(other) < rank(task)


@given(waiting_tasks, idle_robots)
def test_the_first_task_gets_the_nearest_robot_that_knows_its_thing(
    waiting: list[WaitingTask], idle: list[IdleRobot]
) -> None:
    made = {a.task_id: a.robot for a in assignments(waiting, idle)}
    able = [t for t in sorted(waiting, key=rank) if any(may_do(r.name, t) for r in idle)]
    if not able:
        assert made == {}
        return
    first = able[0]
    distances = {
        r.name: r.known[first.thing].distance_m
        for r in idle
        if may_do(r.name, first) and first.thing in r.known
    }
    if distances:
        assert distances[made[first.id]] == min(distances.values())


def test_the_reason_tells_thing_distance_and_rivals() -> None:
    near = IdleRobot("robot-2", {"mug": KnownThing(0.71, 1.84)})
    far = IdleRobot("robot-1", {"mug": KnownThing(0.9, 6.0)})
    blank = IdleRobot("robot-3")
    mug = WaitingTask("t", 0, 0.0, "mug")
    assert assignments([mug], [far, near, blank]) == [
        Assignment(
            "t",
            "robot-2",
            "robot-2's map had the mug 1.8 m away (score 0.71): the nearest of 2 idle robots with "
            "one in its map",
        )
    ]
    assert assignments([mug], [blank])[0].why == (
        "robot-3 was idle; no idle robot's map had the mug"
    )
    named = WaitingTask("t", 0, 0.0, "mug", wanted="robot-3")
    assert assignments([named], [near, blank])[0].why == "the task names robot-3"
