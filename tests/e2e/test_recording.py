"""Tests that the replay of a recorded task builds the same maps to the last bit."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helios_bridge.service import BridgeService
from helios_bridge.settings import Settings as BridgeSettings
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec import action_to_proto
from helios_core.health import Health
from helios_core.map_snapshot import decode_snapshot
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.recording_format import OBJECTS as OBJECTS_SEEN
from helios_core.recording_format import OCCUPANCY
from helios_core.robot import Observe
from helios_core.topics import ACT, GAUSSIANS, LEASE, OBJECTS, ROBOT_STATE, SNAPSHOT
from helios_eval.episodes.episode_judgement import episode_for
from helios_eval.episodes.episode_player import make_world
from helios_eval.episodes.episode_spec import EpisodeSpec
from helios_eval.episodes.in_process_stack import InProcessStack
from helios_map2d.service import Map2DService
from helios_map2d.settings import Settings as Map2DSettings
from helios_objectmap.service import ObjectMapService
from helios_objectmap.settings import ObjectMapSettings
from helios_recorder.service import RecorderService
from helios_recorder.settings import Settings
from helios_replay import ReplayDriver
from helios_replay.format_detection import open_source
from helios_replay.recorded_detector import RecordedDetector
from helios_sim.home import PRESETS, generate_home
from helios_sim.simulation_thread import WorldThread

from tests.helios_up import Up, helios_up
from tests.support import ENDS_WITHIN_S, LOOPBACK, wait_until
from tests.unit.recorder.recorder_maps import cells_of, last_of

pytestmark = pytest.mark.long

SEED = 1
MOST_STEPS = 400
CALL_S = 60.0
RERUN = os.environ.get("HELIOS_TEST_RERUN") or shutil.which(
    "rerun", path=f"{Path(sys.executable).parent}:{os.environ['PATH']}"
)


@dataclass(frozen=True)
class Maps:
    """The maps by which two runs are compared."""

    snapshot: pb.MapSnapshot
    gaussians: pb.GaussiansReply
    objects: pb.ObjectsReply

    @classmethod
    def of(cls, bus: Bus) -> Maps:
        snapshot = bus.call(SNAPSHOT, pb.SnapshotRequest(layers=True), CALL_S)
        snapshot.map_id = ""  # differs for each map
        return cls(
            snapshot,
            bus.call(GAUSSIANS, pb.GaussiansRequest(), CALL_S),
            bus.call(OBJECTS, pb.ObjectsRequest(), CALL_S),
        )


@dataclass(frozen=True)
class RecordedTask:
    """A recorded task with the maps at its end."""

    folder: Path
    maps: Maps
    task: pb.Task
    metrics: dict[str, float]


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> RecordedTask:
    """A complete pick-and-place task, recorded in one process."""
    folder = tmp_path_factory.mktemp("recorded")
    spec = EpisodeSpec("ovmm", "helios", "ground-truth", "demo-v1", SEED, None)
    home = generate_home(SEED, PRESETS[spec.preset])
    world, health = WorldThread(lambda: make_world(spec, home)), Health()
    chosen = Settings(out=folder, min_free_mb=0)
    with (
        closing(world),
        InProcessStack(world, "helios", None, SEED, {}) as stack,
        closing(RecorderService(stack.bus(), chosen, health)),
    ):
        task = stack.run(episode_for("ovmm", home, SEED).instruction, MOST_STEPS, 250)
        maps = Maps.of(stack.bus())
    return RecordedTask(folder, maps, task, health.metrics())


def play(folder: Path, rate: float = 0.0, limit: int = 0) -> Maps:
    """Replay a recording through new services in lockstep; the maps at the end."""
    hub = MemoryHub()
    with ExitStack() as opened:

        def new_bus() -> Bus:
            return opened.enter_context(closing(MemoryBus(hub)))

        bus, bridge_bus = new_bus(), new_bus()
        opened.enter_context(closing(Map2DService(new_bus(), Map2DSettings.load([]), Health())))
        objects = ObjectMapService(new_bus(), ObjectMapSettings.load([]), Health())
        opened.enter_context(closing(objects)).warm_up()
        opened.enter_context(closing(RecordedDetector(new_bus(), folder, Health())))
        driver = ReplayDriver(folder, bus=bridge_bus, contexts=True, rate=rate, limit=limit)
        chosen = BridgeSettings(stream_hz=0, lockstep=True, lease_s=1e5, autoplay=False)
        states: list[pb.RobotState] = []
        bus.subscribe(ROBOT_STATE, states.append)
        with closing(BridgeService(bridge_bus, driver, chosen, Health(), first_number=0)) as bridge:
            bridge.start()
            token = bus.call(LEASE, pb.LeaseRequest(holder="test", take=True), CALL_S).token
            while not states[-1].finished:
                request = pb.ActionRequest(
                    action_id=str(len(states)),
                    lease_token=token,
                    time_remaining_s=CALL_S,
                    action=action_to_proto(Observe()),
                )
                bus.call(ACT, request, CALL_S)
        return Maps.of(bus)


def test_the_recorded_task_succeeds_and_the_recording_is_complete(done: RecordedTask) -> None:
    assert (done.task.state, done.task.phase) == ("succeeded", "place")
    assert done.metrics["dropped_frames"] == done.metrics["dropped_messages"] == 0
    assert done.metrics["missed_frames"] == 0
    assert done.maps.gaussians.count > 1000


def test_a_replay_gives_the_same_maps_and_objects_to_the_last_bit(done: RecordedTask) -> None:
    assert play(done.folder) == done.maps


def test_a_paced_replay_gives_the_same_maps_as_a_fast_one(done: RecordedTask) -> None:
    """A rate only makes the replay wait."""
    source = open_source(done.folder)
    first_s = source.shots[20].time_s - source.shots[0].time_s
    assert play(done.folder, rate=first_s / 1.5, limit=20) == play(done.folder, limit=20)


def test_the_replay_command_gives_the_same_maps_and_objects(
    done: RecordedTask, tmp_path: Path
) -> None:
    """Here the services are processes that communicate over the router."""
    reported = helios("replay", str(done.folder), "--out", str(tmp_path))
    assert reported.returncode == 0, reported.stderr
    found = {o["id"]: o for o in json.loads((tmp_path / "objects.json").read_text())}
    assert set(found) == {o.id for o in done.maps.objects.objects}
    for o in done.maps.objects.objects:
        same = found[o.id]
        assert same["center_m"] == [o.center_m.x, o.center_m.y, o.center_m.z]
        assert (same["score"], same["uncertainty"]) == (o.score, o.uncertainty)
        assert (same["views"], same["gaussians"]) == (o.views, o.gaussians)
        assert same["probabilities"] == dict(o.probabilities)
    with np.load(tmp_path / "occupancy.npz") as arrays:
        live = decode_snapshot(done.maps.snapshot)
        np.testing.assert_array_equal(arrays["occupancy"], live.occupancy)
        np.testing.assert_array_equal(arrays["explored"], live.explored)


def test_a_free_running_replay_ends_and_writes_its_results(
    done: RecordedTask, tmp_path: Path
) -> None:
    """Equal results are not promised: the replay waits for nothing and writes every file."""
    reported = helios(
        "replay", str(done.folder), "--free-running", "--rate", "4", "--out", str(tmp_path)
    )
    assert reported.returncode == 0, reported.stderr
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["frames"] > 0
    assert json.loads((tmp_path / "objects.json").read_text())


@pytest.mark.skipif(RERUN is None, reason="the command `rerun` (pip install rerun-sdk) is not here")
def test_rerun_converts_the_recording(done: RecordedTask, tmp_path: Path) -> None:
    assert RERUN is not None
    (path,) = done.folder.glob("*.mcap")
    out = tmp_path / "recording.rrd"
    reported = subprocess.run(
        [RERUN, "mcap", "convert", str(path), "-o", str(out)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert reported.returncode == 0, reported.stderr
    assert out.stat().st_size > path.stat().st_size / 2
    for entity in ("/camera/keyframe/color", "/camera/keyframe/depth", "/tf", "/planner/task"):
        assert entity in reported.stderr


# --- as processes ---------------------------------------------------------------------------------
class RecordedUp(Up):
    """`helios up --record` with the simulated robot."""

    def services(self) -> dict[str, dict[str, Any]]:
        try:
            reported = json.loads((self.state / "supervisor.json").read_text())
        except (OSError, ValueError):
            return {}
        return {s["name"]: s for s in reported["services"]} if reported["ready"] else {}

    @property
    def recordings(self) -> list[Path]:
        return sorted((self.state / "recordings").glob("*.mcap"))


def helios(*args: str, timeout_s: float = 200) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "helios_client", *args],
        capture_output=True,
        text=True,
        timeout=timeout_s,
        check=False,
    )


def keyframes_of(path: Path) -> int:
    """The number of complete keyframes in a file that may still be written."""
    from helios_core.errors import InvalidInput

    try:
        return len(open_source(path).shots)
    except InvalidInput:
        return 0


@pytest.fixture(scope="module")
def up(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RecordedUp]:
    flags = ("--record", "--seed", str(SEED))
    with helios_up(tmp_path_factory.mktemp("up"), *flags, kind=RecordedUp) as up:
        wait_until(up.services, 120, "all services are ready")
        yield up


def test_the_file_of_a_killed_recorder_is_replayed(up: RecordedUp, tmp_path: Path) -> None:
    """Two replays give the same result. Meanwhile the recorder restarts with a new file."""
    before = up.services()["recorder"]
    assert before["state"] == "ready"
    assert "recording to" in before["reason"]
    tasks = f"http://127.0.0.1:{up.port}/v1/tasks"
    task = LOOPBACK.post(tasks, json={"instruction": "Find the sofa"}, timeout=20)
    assert task.status_code == 202, task.text
    wait_until(lambda: keyframes_of(up.recordings[0]) >= 4, 60, "some keyframes are on the disk")
    os.kill(before["pid"], signal.SIGKILL)

    def is_back() -> bool:
        now = up.services().get("recorder", {})
        return now.get("state") == "ready" and now["pid"] != before["pid"]

    wait_until(is_back, 60, "the recorder is back")
    wait_until(lambda: len(up.recordings) == 2, 60, "it writes a new file")
    LOOPBACK.post(f"{tasks}/{task.json()['id']}/cancel")  # a running task would slow the replays
    found: list[tuple[str, np.ndarray]] = []
    for name, rate in (("fast", "0"), ("paced", "1000")):
        out = tmp_path / name
        done = helios("replay", str(up.recordings[0]), "--out", str(out), "--rate", rate)
        assert done.returncode == 0, done.stderr
        assert "cut off" in done.stdout
        summary = json.loads((out / "summary.json").read_text())
        assert summary["keyframes"] == summary["frames"] >= 4
        with np.load(out / "occupancy.npz") as arrays:
            found.append(((out / "objects.json").read_text(), arrays["occupancy"]))
    assert found[0][0] == found[1][0]
    np.testing.assert_array_equal(found[0][1], found[1][1])


def test_a_recorder_may_be_started_outside_helios_up(up: RecordedUp, tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "helios_client", "record", "--out", str(tmp_path),
         "--port", str(up.port), "--state", str(up.state)],
    )  # fmt: skip
    try:
        wait_until(lambda: list(tmp_path.glob("*.mcap")), 60, "it records")
        wait_until(
            lambda: next(tmp_path.glob("*.mcap")).stat().st_size > 20_000, 60, "there is something"
        )
    finally:
        process.terminate()
        assert process.wait(ENDS_WITHIN_S) == 0


def test_the_recording_holds_the_same_map_and_objects_as_the_gateway(
    up: RecordedUp, tmp_path: Path
) -> None:
    """The robot stands still, so that both have the same version."""
    tasks = f"http://127.0.0.1:{up.port}/v1/tasks"
    task = LOOPBACK.post(tasks, json={"instruction": "Find the bed"}, timeout=20).json()

    def objects() -> dict[int, Any]:
        answer = LOOPBACK.get(f"http://127.0.0.1:{up.port}/v1/objects", timeout=60).json()
        return {o["id"]: o for o in answer["objects"]}

    wait_until(objects, 120, "something is believed")
    LOOPBACK.post(f"{tasks}/{task['id']}/cancel", timeout=60)

    def stands() -> bool:
        now = LOOPBACK.get(f"{tasks}/{task['id']}", timeout=60).json()["state"]
        return now in ("cancelled", "succeeded", "failed")

    wait_until(stands, 60, "the robot stands")
    out = tmp_path / "recorded"
    argv = ("record", "--out", str(out), "--port", str(up.port), "--state", str(up.state))
    process = subprocess.Popen([sys.executable, "-m", "helios_client", *argv])
    try:
        wait_until(lambda: last_of(out).keys() >= {OCCUPANCY, OBJECTS_SEEN}, 60, "it has the map")
    finally:
        process.terminate()
        assert process.wait(ENDS_WITHIN_S) == 0
    last = last_of(out)
    exported = tmp_path / "exported"
    done = helios("map", "export", "--out", str(exported), "--port", str(up.port))
    assert done.returncode == 0, done.stderr
    grid = last[OCCUPANCY]
    with np.load(exported / "occupancy.npz") as live:
        np.testing.assert_array_equal(cells_of(grid)["occupancy"], live["occupancy"])
        corner = grid.pose.position
        np.testing.assert_allclose([corner.x, corner.y], live["origin_m"])
        assert grid.cell_size.x == grid.cell_size.y == float(live["cell_m"])
    drawn = {int(e.id.split()[1]): e for e in last[OBJECTS_SEEN].entities}
    assert drawn.keys() == objects().keys()
    for id, o in objects().items():
        box = drawn[id].cubes[0].pose.position
        x_m, y_m, z_m = o["center_m"]
        assert box.z == pytest.approx(z_m, abs=1e-4)
        assert np.hypot(box.x - x_m, box.y - y_m) < 0.1  # the drawn box is turned as the object is
        name, _, score = drawn[id].texts[0].text.rpartition(" ")
        assert (name, float(score)) == (o["class"], pytest.approx(o["score"], abs=0.006))


def test_recording_without_a_running_stack_fails_with_one_sentence(tmp_path: Path) -> None:
    done = helios("record", "--out", str(tmp_path), "--state", str(tmp_path))
    assert done.returncode == 1
    assert "--router" in done.stderr
    assert done.stderr.count("\n") == 1
