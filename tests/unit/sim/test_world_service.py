"""Tests the world service behind a bus."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator

import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.errors import InvalidInput, Unavailable
from helios_core.geometry import Pinhole, camera_on_base, se2_to_se3
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.robot import Capture, Forward, Observe, Turn
from helios_core.topics import TRUTH_EPISODE, TRUTH_METRICS, TRUTH_SEGMENTATION
from helios_core.zenoh_bus import ZenohBus
from helios_sim.capture_messages import capture_from_proto, capture_to_proto
from helios_sim.driver import SimDriver
from helios_sim.episode_tracker import episode_of
from helios_sim.home import Home
from helios_sim.service import WorldService
from helios_sim.simulation_thread import WorldThread
from helios_sim.world import World

from tests.support import ENDS_WITHIN_S, free_port, wait_until


@pytest.fixture
def hub(sim_home: Home) -> Iterator[MemoryHub]:
    """A world served on a bus in this process."""
    hub = MemoryHub()
    thread = WorldThread(lambda: World(sim_home, episode_of(sim_home, 0)))
    service = WorldService(MemoryBus(hub), thread, Health())
    yield hub
    service.close()


def test_captures_of_the_driver_match_the_segmentation_of_the_world(hub: MemoryHub):
    bus = MemoryBus(hub)
    driver = SimDriver(bus)
    assert driver.describe().simulated
    shot = driver.capture()
    truth = bus.call(TRUTH_SEGMENTATION, pb.TruthSegmentationRequest(stamp_ns=shot.stamp_ns), 5.0)
    assert (truth.height, truth.width) == shot.depth_m.shape
    ids = np.frombuffer(truth.ids, "<u2").reshape(shot.depth_m.shape)
    named = {i.id: i for i in truth.instances}
    assert set(np.unique(ids)) - {0} <= named.keys()
    assert "floor" in {i.class_name for i in truth.instances}
    assert shot.depth_m.max() <= driver.describe().max_depth_m


def test_the_world_keeps_its_state_when_the_driver_is_replaced(hub: MemoryHub):
    first = SimDriver(MemoryBus(hub))
    done = first.act(Turn(0.4), "a")
    boot, pose = first.state().robot_boot_id, first.state().T_world_base
    first.close()
    second = SimDriver(MemoryBus(hub))
    assert second.state().robot_boot_id == boot
    assert np.array_equal(second.state().T_world_base, pose)
    assert second.act(Turn(0.4), "a") == done
    assert np.array_equal(second.state().T_world_base, pose)


def test_truth_methods_report_steps_and_the_task(hub: MemoryHub):
    bus = MemoryBus(hub)
    SimDriver(bus).act(Observe(), "a")
    assert bus.call(TRUTH_METRICS, pb.Empty(), 5.0).steps == 1
    episode = bus.call(TRUTH_EPISODE, pb.Empty(), 5.0)
    assert episode.object_class in episode.instruction
    assert episode.preset == "demo-v1"


def test_a_stop_from_another_thread_ends_driving(sim_home: Home):
    thread = WorldThread(lambda: World(sim_home))
    results = []

    def drive() -> None:
        results.extend(thread.act(Turn(math.pi / 6), f"t{k}") for k in range(200))

    driver = threading.Thread(target=drive)
    driver.start()
    wait_until(lambda: results, 60, "it drives")
    thread.stop("enough")
    driver.join(20)
    assert results[0].succeeded
    assert not results[-1].succeeded
    assert "enough" in results[-1].reason
    thread.close()
    with pytest.raises(Unavailable):
        thread.capture()


def test_a_driver_without_a_world_raises_unavailable():
    with pytest.raises(Unavailable):
        SimDriver(MemoryBus(MemoryHub())).describe()


def test_a_capture_of_the_wrong_size_is_refused(hub: MemoryHub):
    message = pb.WorldCapture(color=b"abc", depth_mm=b"ab")
    message.camera.CopyFrom(pb.Pinhole(fx=1, fy=1, cx=0, cy=0, width=2, height=2))
    with pytest.raises(InvalidInput, match="2x2"):
        capture_from_proto(message)


def test_the_driver_imports_neither_mujoco_nor_the_world():
    """The bridge's process loads neither MuJoCo nor the truth."""
    code = (
        "import sys, helios_sim.driver; "
        "print([m for m in sys.modules if m == 'mujoco' or m.startswith('helios_sim.')])"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "['helios_sim.capture_messages', 'helios_sim.driver']"


def test_the_world_process_serves_and_ends_on_sigterm():
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    router = subprocess.Popen([sys.executable, "-m", "helios_core.router", "--listen", endpoint])
    world = subprocess.Popen(
        [sys.executable, "-m", "helios_sim", "--router", endpoint, "--seed", "0"]
    )
    try:
        bus = _open(endpoint)
        driver = SimDriver(bus)
        wait_until(lambda: _serves(driver), 60, "the world serves")
        assert driver.act(Forward(0.2), "a").succeeded
        assert driver.capture().color.shape == (480, 640, 3)
        world.send_signal(signal.SIGTERM)
        assert world.wait(ENDS_WITHIN_S) == 0
        bus.close()
    finally:
        for process in (world, router):
            process.kill()
            process.wait()


def _open(endpoint: str) -> ZenohBus:
    made: list[ZenohBus] = []

    def connected() -> bool:
        try:
            made.append(ZenohBus(endpoint, "robot"))
        except Unavailable:
            return False
        return True

    wait_until(connected, 60, "the router answers")
    return made[0]


def _serves(driver: SimDriver) -> bool:
    try:
        driver.describe()
    except Unavailable:
        return False
    return True


def test_depth_beyond_the_range_of_the_message_stays_beyond_every_sensor() -> None:
    base = se2_to_se3(0.0, 0.0, 0.0)
    depth_m = np.array([[1.25, 66.0], [np.inf, 0.0]], np.float32)
    sent = Capture(
        stamp_ns=1,
        color=np.zeros((2, 2, 3), np.uint8),
        depth_m=depth_m,
        camera=Pinhole(2.0, 2.0, 0.5, 0.5, 2, 2),
        T_world_cam=camera_on_base(base, 1.0, 0.5),
        T_world_base=base,
    )
    got = capture_from_proto(capture_to_proto(sent)).depth_m
    np.testing.assert_allclose(got, [[1.25, 65.535], [65.535, 0.0]])
