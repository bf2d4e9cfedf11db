"""Tests that a closed world leaves no memory, files or threads in its process."""

from __future__ import annotations

import gc
import os
import queue
import subprocess
import sys
import threading
import weakref
from pathlib import Path

import pytest
from helios_core.errors import Unavailable
from helios_core.robot import Observe
from helios_core.types import RobotState
from helios_sim.home import Home
from helios_sim.simulation_thread import WorldThread
from helios_sim.world import World

from tests.support import ENDS_WITHIN_S


def test_without_an_opengl_library_a_sentence_says_what_to_install() -> None:
    command = [sys.executable, "-m", "helios_client", "eval", "ovmm", "--help"]
    variables = os.environ | {"MUJOCO_GL": "nonsense"}
    ended = subprocess.run(
        command, env=variables, capture_output=True, text=True, timeout=120, check=False
    )
    assert ended.returncode == 1
    (said,) = ended.stderr.splitlines()
    assert said.startswith("helios: no OpenGL context (")
    assert "; install " in said


def test_a_closed_world_is_freed_at_once(sim_home: Home):
    """Without the cycle collector: a world takes tens of megabytes."""
    gc.collect()
    gc.disable()
    try:
        world = World(sim_home)
        world.act(Observe(), "a")
        world.segmentation(world.capture().stamp_ns)
        world.close()
        known = weakref.ref(world), weakref.ref(world._executor), weakref.ref(world._sensors)
        del world
        assert [ref() for ref in known] == [None] * 3
    finally:
        gc.enable()


def test_a_closed_world_still_gives_progress_and_objects_but_no_images(sim_home: Home):
    world = World(sim_home)
    world.act(Observe(), "a")
    world.close()
    world.close()
    assert world.progress.steps == 1
    assert len(world.object_states()) > 0
    with pytest.raises(Unavailable):
        world.capture()


def test_a_call_that_races_with_close_is_answered(sim_home: Home):
    """The world closes after the call was admitted and before it is in the queue."""
    thread = WorldThread(lambda: World(sim_home))
    calls, closer = thread._calls, threading.Thread(target=thread.close)
    ended = threading.Event()

    class Slow(queue.SimpleQueue):
        def put(self, item, block=True, timeout=None):
            if item is None:
                calls.put(None)
                ended.set()
            else:
                closer.start()
                ended.wait(0.5)  # times out if close waits for the call
                calls.put(item)

    thread._calls = Slow()
    reported: queue.SimpleQueue[BaseException | RobotState] = queue.SimpleQueue()

    def ask() -> None:
        try:
            reported.put(thread.state())
        except Unavailable as error:
            reported.put(error)

    threading.Thread(target=ask, daemon=True).start()
    reported.get(timeout=ENDS_WITHIN_S)
    closer.join(ENDS_WITHIN_S)
    assert not closer.is_alive()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="counts files by /proc")
def test_many_worlds_keep_no_files_and_no_threads(sim_home: Home):
    def opened() -> tuple[int, int]:
        gc.collect()
        return len(list(Path("/proc/self/fd").iterdir())), len(
            list(Path("/proc/self/task").iterdir())
        )

    def once() -> None:
        thread = WorldThread(lambda: World(sim_home))
        thread.capture()
        thread.close()

    once()  # libraries start their own threads
    before = opened()
    for _ in range(2):
        once()
    after = opened()
    assert after[0] <= before[0]
    assert after[1] <= before[1] + 1  # the last world's thread may still be ending
