"""The trace of the true drive, its pace, and drives that end for a silent bridge."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from helios_core.robot import Forward, Turn
from helios_sim.drive_trace import DriveTrace
from helios_sim.home import Home
from helios_sim.world import World

from tests.support import wait_until


def test_a_drive_waits_until_the_time_of_its_physics() -> None:
    clock_ns, slept = [0], list[float]()

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        clock_ns[0] += round(seconds * 1e9)

    trace = DriveTrace(0.5, lambda: clock_ns[0], sleep)
    trace.begin(10.0, 0.0, 0.0)
    for n in range(1, 5):
        clock_ns[0] += 1_000_000  # the physics takes 1 ms
        trace.step(10.0 + 0.1 * n, 0.1 * n, 0.0)
    assert clock_ns[0] == pytest.approx(0.8e9)
    assert len(slept) == 4
    np.testing.assert_allclose(trace.since(500_000_000)[:, 1], [0.3, 0.4])


def test_the_trace_ends_where_the_robot_is(world: World) -> None:
    assert world.act(Turn(0.5), "a").succeeded
    moved_m = world.act(Forward(0.3), "b").moved_m
    track = world.trace.since(0)
    x, y = world.trajectory_m[-1]
    np.testing.assert_allclose(track[-1, 1:], (x, y), atol=1e-6)
    assert np.hypot(*np.diff(track[:, 1:], axis=0).T).sum() == pytest.approx(moved_m, abs=0.02)
    assert world.trace.begun == world.trace.actions == 2


def test_a_halt_ends_one_drive_and_latches_nothing(sim_home: Home) -> None:
    world = World(sim_home, pace=0.2)  # a turn by 0.5 rad takes more than two seconds
    world.halt("of an action before")
    assert world.act(Turn(0.1), "a").succeeded

    def halt() -> None:
        before = len(world.trace.since(0))
        wait_until(lambda: len(world.trace.since(0)) > before + 20, 60, "it turns")
        world.halt("its sender is silent")

    halting = threading.Thread(target=halt)
    halting.start()
    done = world.act(Turn(0.5), "b")
    halting.join()
    assert "its sender is silent" in done.reason
    assert not world.state().stopped
    assert world.act(Turn(0.1), "c").succeeded
    world.close()
