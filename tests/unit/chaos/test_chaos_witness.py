"""When the robot can be driven again after a fault."""

from __future__ import annotations

import math
import threading
import time

from helios_chaos.witness import ControlChain
from helios_core import proto as pb
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import GET_STATE, LIST_TASKS, WORLD_STATE

WITHIN_S = 20.0


def serve(hub: MemoryHub, planner_from_s: float | None) -> None:
    """World and bridge answer at once, the planner from a time on or never."""
    MemoryBus(hub).serve(WORLD_STATE, lambda _: pb.RobotState())
    MemoryBus(hub).serve(GET_STATE, lambda _: pb.RobotState())
    if planner_from_s is not None:
        planner = MemoryBus(hub)
        wait_s = planner_from_s - time.monotonic()
        threading.Timer(wait_s, lambda: planner.serve(LIST_TASKS, lambda _: pb.TaskList())).start()


def test_the_chain_is_whole_once_the_last_of_planner_bridge_and_world_answers() -> None:
    hub = MemoryHub()
    lost_s = time.monotonic()
    serve(hub, lost_s + 0.4)
    chain = ControlChain(lambda _: MemoryBus(hub))
    whole_s = chain.whole_after(lost_s, WITHIN_S)()
    chain.close()
    assert lost_s + 0.4 <= whole_s < math.inf


def test_a_chain_without_a_planner_never_becomes_whole() -> None:
    hub = MemoryHub()
    serve(hub, None)
    chain = ControlChain(lambda _: MemoryBus(hub))
    assert chain.whole_after(time.monotonic(), 0.3)() == math.inf
    chain.close()
