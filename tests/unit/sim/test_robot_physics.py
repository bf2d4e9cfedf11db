"""Tests that steps of the robot alone equal steps of the whole model, and touch nothing."""

from __future__ import annotations

import math
from collections.abc import Callable

import mujoco
import numpy as np
import pytest
from helios_core.robot import Action, Forward, Observe, Tilt, Turn
from helios_sim.robot_physics import RobotPhysics
from helios_sim.world import World

# The robot leaves its start, turns, drives until furniture or a wall blocks it, and turns there.
ACTIONS: tuple[Action, ...] = (
    Turn(math.radians(30)), Forward(0.25), Tilt(0.2), Turn(math.radians(-75)), Forward(0.6),
    *[Forward(0.8)] * 4, Turn(math.radians(40)), Observe(), Forward(-0.2), Turn(math.radians(90)),
    Forward(0.8),
)  # fmt: skip


def driven(world: World) -> list[tuple[bytes, bytes, float, object]]:
    out = []
    for k, action in enumerate(ACTIONS):
        result = world.act(action, f"action-{k}")
        data = world._data
        out.append((data.qpos.tobytes(), data.qvel.tobytes(), float(data.time), result))
    return out


@pytest.mark.parametrize("holds", [False, True])
def test_a_robot_moves_alone_as_it_does_in_the_whole_model(
    holds: bool, make_world: Callable[[], World], monkeypatch: pytest.MonkeyPatch
) -> None:
    fast, slow = make_world(), make_world()
    if holds:
        for world in (fast, slow):
            gripper = world._executor._gripper
            gripper.grasp(next(iter(world._executor._manipulation._things)))
            mujoco.mj_forward(world._model, world._data)
    whole: list[bool] = []
    step = RobotPhysics.step

    def counted(self: RobotPhysics, **given: bool) -> bool:
        whole.append(step(self, **given))
        return whole[-1]

    with monkeypatch.context() as patched:
        patched.setattr(RobotPhysics, "step", counted)
        moved = driven(fast)
    assert 0.5 < 1 - np.mean(whole) < 1  # most steps were of the robot alone
    monkeypatch.setattr(RobotPhysics, "_is_free", lambda self: False)
    assert moved == driven(slow)
    assert fast.progress == slow.progress
    assert fast.progress.collisions > 0  # some steps touched the scene


def test_nothing_touches_a_robot_that_moves_alone(world: World) -> None:
    model, data, robot = world._model, world._data, world._robot
    physics = world._executor._physics
    low, high = np.array(world.home.bounds[:2]), np.array(world.home.bounds[2:])
    rng = np.random.default_rng(1)
    found = {True: 0, False: 0}
    for _ in range(400):
        x, y = rng.uniform(low, high)
        data.qpos[list(robot.qpos)] = x, y, rng.uniform(-3, 3)
        mujoco.mj_forward(model, data)
        physics.begin()
        physics._others_move = lambda: False  # type: ignore[method-assign]
        free = physics._is_free()
        touches = any(
            (int(c.geom1) in robot.geoms) != (int(c.geom2) in robot.geoms)
            for c in (data.contact[k] for k in range(data.ncon))
        )
        assert not (free and touches)
        found[free] += 1
    assert min(found.values()) > 40
