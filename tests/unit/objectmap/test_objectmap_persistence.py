"""The object map as a file, as PLY, as a rendered view, and after a kill."""

from __future__ import annotations

import contextlib
import io
import json
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.codec import context_to_proto, observation_to_proto, state_to_proto
from helios_core.codec.frames import pinhole_to_proto, transform_to_proto
from helios_core.errors import InvalidInput
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import (
    CONTEXT,
    EXPORT_OBJECTS,
    GAUSSIANS,
    LOAD_OBJECTS,
    OBJECT_DETAIL,
    OBJECTS,
    OBSERVATION,
    RENDER_OBJECTS,
    ROBOT_STATE,
    SAVE_OBJECTS,
    STORED_OBJECTS,
)
from helios_core.types import RobotState
from helios_objectmap import persistence
from helios_objectmap.export import SH_C0
from helios_objectmap.gaussians import GaussianStore
from helios_objectmap.object_map import ObjectMap
from helios_objectmap.service import FILE_NAME, ObjectMapService
from hypothesis import given, settings
from hypothesis import strategies as st
from objectmap_scene import CAMERA, ROOM, SETTINGS, Box, looking_at, mug_at, observe
from objectmap_scene import CONTEXT as SOUGHT

MUG_CENTER = (1.2, 0.0, 0.8)
SCENE = (*ROOM, mug_at(1.2, 0.0))


class Rig:
    """A service that autosaves its map in a folder, or nowhere."""

    def __init__(self, folder: Path | None = None, evidence: str = "views") -> None:
        hub = MemoryHub()
        self.bus, self.health = MemoryBus(hub), Health()
        kept = SETTINGS.model_copy(
            update={"state_dir": folder, "save_every_s": 3600.0, "evidence": evidence}
        )
        self.service = ObjectMapService(MemoryBus(hub), kept, self.health)

    def look_around(self) -> Rig:
        self.bus.publish(CONTEXT, context_to_proto(SOUGHT))
        for seq, (x, y) in enumerate([(0.0, 0.0), (0.1, 0.3), (0.2, -0.3)]):
            o = observe(SCENE, looking_at(x, y, MUG_CENTER), seq=seq)
            self.bus.publish(OBSERVATION, observation_to_proto(o))
        return self

    def objects(self) -> list[pb.ObjectInstance]:
        return list(self.bus.call(OBJECTS, pb.ObjectsRequest(), 5.0).objects)

    def mug(self) -> pb.ObjectInstance:
        return max((o for o in self.objects() if o.class_name == "mug"), key=lambda o: o.score)

    def saved(self) -> bytes:
        return self.bus.call(SAVE_OBJECTS, pb.Empty(), 5.0).data

    def render(self, layer: str, class_name: str = "mug"):
        request = pb.RenderRequest(
            T_world_cam=transform_to_proto(looking_at(0.0, 0.0, MUG_CENTER)),
            camera=pinhole_to_proto(CAMERA),
            layer=layer,
            class_name=class_name,
        )
        png = self.bus.call(RENDER_OBJECTS, request, 5.0).png
        return cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return Rig().look_around()


def test_a_loaded_map_equals_the_saved_one_and_continues(rig):
    other, known = Rig(), rig.objects()
    loaded = other.bus.call(LOAD_OBJECTS, pb.ObjectMapFile(data=rig.saved()), 5.0)
    assert loaded.objects == len(known)
    other.bus.publish(CONTEXT, context_to_proto(SOUGHT))
    assert other.objects() == rig.objects()
    everything = pb.GaussiansRequest()
    assert other.bus.call(GAUSSIANS, everything, 5.0) == rig.bus.call(GAUSSIANS, everything, 5.0)
    before = other.mug()
    o = observe(SCENE, looking_at(0.2, -0.3, MUG_CENTER), seq=9)
    other.bus.publish(OBSERVATION, observation_to_proto(o))
    assert other.mug().score == pytest.approx(before.score)  # that view counted before
    o = observe(SCENE, looking_at(0.4, 0.4, MUG_CENTER), seq=10)
    other.bus.publish(OBSERVATION, observation_to_proto(o))
    assert other.mug().id == before.id
    assert other.mug().score > before.score


@pytest.mark.parametrize("same_frame", [False, True])
def test_a_map_loaded_before_the_robot_tells_its_world_is_used_there_only_if_asked(rig, same_frame):
    other = Rig()
    other.bus.publish(CONTEXT, context_to_proto(SOUGHT))
    file = pb.ObjectMapFile(data=rig.saved(), same_frame=same_frame)
    other.bus.call(LOAD_OBJECTS, file, 5.0)
    state = RobotState(np.eye(4), robot_boot_id="a boot that the file does not name")
    other.bus.publish(ROBOT_STATE, state_to_proto(state))
    assert other.objects() == (rig.objects() if same_frame else [])
    waiting = other.bus.call(STORED_OBJECTS, pb.Empty(), 5.0).objects
    assert len(waiting) == (0 if same_frame else len(rig.objects()))


def told(rig: Rig, boot: str) -> None:
    """The robot tells its world."""
    rig.bus.publish(ROBOT_STATE, state_to_proto(RobotState(np.eye(4), robot_boot_id=boot)))


def waiting(rig: Rig) -> int:
    """Number of objects that wait for their place."""
    return len(rig.bus.call(STORED_OBJECTS, pb.Empty(), 5.0).objects)


def test_a_map_that_is_loaded_twice_before_the_robot_tells_another_world_waits_once(rig):
    other = Rig()
    for _ in range(2):
        assert not other.bus.call(LOAD_OBJECTS, pb.ObjectMapFile(data=rig.saved()), 5.0).stored
    told(other, "wednesday")
    assert (len(other.objects()), waiting(other)) == (0, len(rig.objects()))


def test_a_map_that_waits_is_used_once_the_robot_tells_its_world(rig):
    world = persistence.world_of(rig.saved())
    assert world is not None
    other = Rig()
    told(other, "wednesday")
    assert other.bus.call(LOAD_OBJECTS, pb.ObjectMapFile(data=rig.saved()), 5.0).stored
    told(other, world.robot_boot_id)
    assert (len(other.objects()), waiting(other)) == (len(rig.objects()), 0)


def test_a_map_that_counts_anywhere_replaces_one_that_waits_for_its_world(rig):
    other = Rig()
    other.bus.call(LOAD_OBJECTS, pb.ObjectMapFile(data=rig.saved()), 5.0)
    file = pb.ObjectMapFile(data=rig.saved(), same_frame=True)
    assert not other.bus.call(LOAD_OBJECTS, file, 5.0).stored
    told(other, "wednesday")
    assert (len(other.objects()), waiting(other)) == (len(rig.objects()), 0)


def test_a_frame_of_another_world_also_puts_a_loaded_map_aside(rig):
    other = Rig()
    other.bus.publish(CONTEXT, context_to_proto(SOUGHT))
    other.bus.call(LOAD_OBJECTS, pb.ObjectMapFile(data=rig.saved()), 5.0)
    seen = observe(SCENE, looking_at(0.4, 0.4, MUG_CENTER), seq=1)
    id = replace(seen.frame.id, robot_boot_id="wednesday")
    seen = replace(seen, frame=replace(seen.frame, id=id))
    other.bus.publish(OBSERVATION, observation_to_proto(seen))
    assert waiting(other) == len(rig.objects())


@settings(max_examples=20, deadline=None)
@given(share=st.floats(0, 0.999))
def test_a_truncated_file_is_refused_and_changes_nothing(rig, share):
    data, before = rig.saved(), rig.objects()
    with pytest.raises(InvalidInput, match="helios map save"):
        rig.bus.call(LOAD_OBJECTS, pb.ObjectMapFile(data=data[: int(share * len(data))]), 5.0)
    assert rig.objects() == before


@settings(max_examples=20, deadline=None)
@given(share=st.floats(0, 0.999))
def test_a_damaged_file_never_changes_the_map(rig, share):
    data, before = bytearray(rig.saved()), rig.objects()
    data[int(share * len(data))] ^= 0xFF
    # A few bytes of a ZIP have no effect, such as times; all bytes of an array do.
    with contextlib.suppress(InvalidInput):
        rig.bus.call(LOAD_OBJECTS, pb.ObjectMapFile(data=bytes(data)), 5.0)
    assert rig.objects() == before


@pytest.mark.parametrize("bit", [1, 2, 8, 0x20, 0x40])
def test_a_flipped_bit_in_the_zip_directory_raises_nothing_but_invalid_input(rig, bit):
    """The directory says how the entries are compressed, encrypted and named."""
    data = rig.saved()
    viewpoints = ObjectMap(SETTINGS).empty_viewpoints()
    for at in range(data.rindex(b"PK\x01\x02") - 300, len(data)):
        damaged = bytearray(data)
        damaged[at] ^= bit
        with contextlib.suppress(InvalidInput):
            persistence.read(bytes(damaged), viewpoints)


@pytest.mark.parametrize(
    ("array", "value", "said"),
    [
        ("store.through_from", 10_000, "seen through"),
        ("store.radius_m", np.nan, "not finite"),
        ("viewpoints.positions", np.inf, "not finite"),
        ("store.means", 3e4, "from the origin"),
        ("store.radius_m", -0.01, "a radius is not above 0"),
        ("store.opacity", 1.5, "opacity not from 0 to 1"),
        ("store.positive", -1.0, "evidence is below 0"),
        ("store.instance", -5, "an instance is below 0"),
        ("store.instance", 2**31 - 2, "instances and Gaussians disagree"),
    ],
)
def test_a_complete_file_with_invalid_values_is_refused(rig, array, value, said):
    with np.load(io.BytesIO(rig.saved())) as file:
        arrays = {name: file[name] for name in file.files}
    arrays[array][0] = value
    with pytest.raises(InvalidInput, match=said):
        persistence.read(persistence.to_bytes(arrays), ObjectMap(SETTINGS).empty_viewpoints())


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"updates": 2**63}, "9223372036854775808 updates"),
        ({"updates": -1}, "-1 updates"),
        ({"newest_seq": 2**64}, "no whole object map"),
        ({"newest_seq": -1}, "no whole object map"),
        ({"epoch": ["boot", 2**32], "newest_seq": None}, "no whole object map"),
    ],
)
def test_a_file_with_numbers_that_no_message_holds_is_refused(rig, changes, said):
    with np.load(io.BytesIO(rig.saved())) as file:
        arrays = {name: file[name] for name in file.files}
    header = json.loads(arrays["header"].tobytes()) | changes
    arrays["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
    with pytest.raises(InvalidInput, match=said):
        persistence.read(persistence.to_bytes(arrays), ObjectMap(SETTINGS).empty_viewpoints())


@pytest.mark.parametrize(
    ("moment", "said"),
    [
        ([2**63, 1.0, 0.5, 0.5], "a time of more than 9000000000 s"),
        ([-(2**63), 1.0, 0.5, 0.5], "a time of more than 9000000000 s"),
        ([0, float("nan"), 0.5, 0.5], "not finite"),
    ],
)
def test_a_history_that_no_message_holds_is_refused(rig, moment, said):
    with np.load(io.BytesIO(rig.saved())) as file:
        arrays = {name: file[name] for name in file.files}
    header = json.loads(arrays["header"].tobytes())
    next(iter(header["records"].values()))[3].append(moment)
    arrays["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
    with pytest.raises(InvalidInput, match=said):
        persistence.read(persistence.to_bytes(arrays), ObjectMap(SETTINGS).empty_viewpoints())


@pytest.mark.parametrize("label", [-2_000_000_000, 2**31 - 2])
def test_labels_are_checked_before_they_index_an_array(rig, label, monkeypatch):
    """The first of these labels ended the process, the second allocated 16 GB."""
    with np.load(io.BytesIO(rig.saved())) as file:
        arrays = {name: file[name] for name in file.files}
    header = json.loads(arrays["header"].tobytes())
    header["records"][label] = next(iter(header["records"].values()))
    header["next_label"] = label + 1
    arrays["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
    arrays["store.instance"][0] = label
    monkeypatch.setattr(GaussianStore, "fill", lambda *_: pytest.fail("the labels were used"))
    with pytest.raises(InvalidInput, match="the next instance is"):
        persistence.read(persistence.to_bytes(arrays), ObjectMap(SETTINGS).empty_viewpoints())


def test_an_oversized_file_is_refused_before_unpacking(rig):
    data, before = rig.saved(), rig.objects()
    at = data.rindex(b"PK\x01\x02") + 24  # the unpacked size of the last entry of the ZIP
    bomb = data[:at] + (3 * 2**30).to_bytes(4, "little") + data[at + 4 :]
    with pytest.raises(InvalidInput, match=r"unpacks to 3221\d+, wanted at most 2147483648"):
        rig.bus.call(LOAD_OBJECTS, pb.ObjectMapFile(data=bomb), 5.0)
    assert rig.objects() == before


def test_a_foreign_file_is_refused():
    foreign = io.BytesIO()
    np.savez(foreign, means=np.zeros((3, 3)))
    for data in (b"", b"not a map", foreign.getvalue()):
        with pytest.raises(InvalidInput, match="helios map save"):
            Rig().bus.call(LOAD_OBJECTS, pb.ObjectMapFile(data=data), 5.0)


def test_an_independent_reader_gets_positions_colours_and_sizes_from_the_ply(rig):
    trimesh = pytest.importorskip("trimesh")
    reply = rig.bus.call(EXPORT_OBJECTS, pb.ExportRequest(format="ply"), 5.0)
    held = rig.bus.call(GAUSSIANS, pb.GaussiansRequest(), 5.0)
    cloud = trimesh.load(io.BytesIO(reply.data), file_type="ply")
    means = np.frombuffer(held.means_m, "<f4").reshape(-1, 3)
    assert reply.gaussians == held.count == len(cloud.vertices)
    assert np.allclose(cloud.vertices, means)
    vertex = cloud.metadata["_ply_raw"]["vertex"]["data"]
    assert np.allclose(np.exp(vertex["scale_1"]).ravel(), np.frombuffer(held.scales_m, "<f4"))
    opacity = 1 / (1 + np.exp(-vertex["opacity"].ravel()))
    assert np.allclose(opacity, np.frombuffer(held.opacities, "<f4"), atol=1e-4)
    red = np.frombuffer(held.colors, np.uint8).reshape(-1, 3)[:, 0] / 255
    assert np.allclose(0.5 + SH_C0 * vertex["f_dc_0"].ravel(), red, atol=1e-5)
    assert set(vertex["rot_0"].ravel()) == {1.0}


def test_an_npz_of_one_object_contains_only_its_gaussians(rig):
    mug = rig.mug()
    request = pb.ExportRequest(format="npz", object_id=mug.id)
    with np.load(io.BytesIO(rig.bus.call(EXPORT_OBJECTS, request, 5.0).data)) as file:
        assert len(file["means_m"]) == mug.gaussians
        assert set(file["instance"]) == {mug.id}
        assert file["class_names"].tolist() == ["other", "mug", "table"]


def test_an_unknown_format_object_layer_or_class_is_refused_with_a_reason(rig):
    for request in (pb.ExportRequest(format="obj"), pb.ExportRequest(format="ply", object_id=999)):
        with pytest.raises(InvalidInput):
            rig.bus.call(EXPORT_OBJECTS, request, 5.0)
    with pytest.raises(InvalidInput, match="no object 999"):
        rig.bus.call(OBJECT_DETAIL, pb.ObjectRequest(object_id=999), 5.0)
    with pytest.raises(InvalidInput, match="uncertainty"):
        rig.render("heat")
    with pytest.raises(InvalidInput, match="mug"):
        rig.render("probability", "cat")


def test_rendered_views_show_the_mug_at_its_place_and_depth(rig):
    depth_mm = rig.render("depth")
    assert depth_mm.dtype == np.uint16
    middle = depth_mm[CAMERA.height // 2, CAMERA.width // 2] / 1000
    truth = np.linalg.norm(np.array([0.0, 0.0, 1.3]) - MUG_CENTER)
    assert middle == pytest.approx(truth, abs=0.08)
    shown = rig.render("color")
    assert shown.shape == (CAMERA.height, CAMERA.width, 3)
    assert np.abs(shown[CAMERA.height // 2, CAMERA.width // 2].astype(int) - 128).max() < 6
    assert (shown[0] == 255).all()  # the wall is not modelled
    sure, unsure = rig.render("probability"), rig.render("uncertainty")
    assert sure[60, 80, 1] > 120  # viridis: more green is more likely
    assert unsure[60, 80, 1] < sure[60, 80, 1]


def test_object_details_contain_history_box_and_points(rig):
    mug = rig.mug()
    detail = rig.bus.call(OBJECT_DETAIL, pb.ObjectRequest(object_id=mug.id), 5.0)
    assert detail.object == mug
    assert [m.stamp_ns for m in detail.history] == [0, 1, 2]
    assert detail.history[-1].score == pytest.approx(mug.score)
    points = np.array(detail.points_m).reshape(-1, 3)
    assert len(points) > 30
    assert np.abs(points - MUG_CENTER).max() < 0.07
    size = detail.box_size_m
    assert size.x <= size.y
    assert size.y == pytest.approx(0.09, abs=0.04)
    assert abs(detail.box_yaw_rad) <= np.pi / 2


@pytest.mark.parametrize("evidence", ["views", "sides"])
def test_the_map_is_restored_after_a_restart_and_health_reports_that(tmp_path, evidence):
    first = Rig(tmp_path, evidence).look_around()
    known = first.objects()
    first.service.close()
    again = Rig(tmp_path, evidence)
    again.service.warm_up()
    assert "frames up to number 2" in again.health.state[1]
    assert again.bus.call(OBJECTS, pb.ObjectsRequest(), 5.0).id.seq == 2
    again.bus.publish(CONTEXT, context_to_proto(SOUGHT))
    assert again.objects() == known
    o = observe(SCENE, looking_at(0.4, 0.4, MUG_CENTER), seq=9)
    for one in (first, again):
        one.bus.publish(OBSERVATION, observation_to_proto(o))
    assert again.objects() == first.objects()  # frames of the same epoch go into the same map
    again.service.close()


def test_an_instance_after_a_crash_gets_no_id_that_the_map_file_lacks(tmp_path):
    def see(rig: Rig, boxes: Sequence[Box], seq: int) -> None:
        o = observe(boxes, looking_at(0.0, 0.0, MUG_CENTER), seq=seq)
        rig.bus.publish(OBSERVATION, observation_to_proto(o))

    first = Rig(tmp_path)
    first.bus.publish(CONTEXT, context_to_proto(SOUGHT))
    see(first, ROOM, 0)
    kept = first.service._kept
    assert kept is not None
    assert kept.write()
    see(first, SCENE, 1)
    lost = first.mug().id  # the process ends before it writes again
    again = Rig(tmp_path)
    again.bus.publish(CONTEXT, context_to_proto(SOUGHT))
    assert {o.class_name for o in again.objects()} == {"table"}
    see(again, (*ROOM, mug_at(1.2, 0.3)), 2)
    assert again.mug().id > lost


def test_an_autosaved_map_of_an_ended_world_is_replaced_at_once(tmp_path):
    first = Rig(tmp_path).look_around()
    first.service.close()
    again = Rig(tmp_path)
    again.bus.publish(CONTEXT, context_to_proto(SOUGHT))
    assert again.objects()
    boot = observe(SCENE, looking_at(0, 0, MUG_CENTER)).frame.id.robot_boot_id
    for id, left in ((boot, True), ("another", False)):
        state = RobotState(np.eye(4), robot_boot_id=id)
        again.bus.publish(ROBOT_STATE, state_to_proto(state))
        assert bool(again.objects()) == left


def test_a_truncated_autosaved_map_is_moved_aside_and_reported(tmp_path, rig):
    (tmp_path / FILE_NAME).write_bytes(rig.saved()[:-100])
    again = Rig(tmp_path)
    again.service.warm_up()
    assert "put aside" in again.health.state[1]
    assert not again.objects()
    (aside,) = tmp_path.iterdir()
    assert aside.name.startswith(f"{FILE_NAME}.refused")
    again.look_around().service.close()
    assert (tmp_path / FILE_NAME).is_file()


KILLED = """
import sys, time, pathlib
from test_objectmap_persistence import Rig
from helios_objectmap.service import FILE_NAME
folder = pathlib.Path(sys.argv[1])
rig = Rig(folder).look_around()
rig.service._kept.write()
print(rig.mug().id, flush=True)
while True:
    rig.look_around()
    rig.service._kept.write()
"""


def test_a_killed_service_leaves_a_complete_map_file(tmp_path, rig):
    process = subprocess.Popen(
        [sys.executable, "-c", KILLED, str(tmp_path)],
        cwd=Path(__file__).parent,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"NUMBA_NUM_THREADS": "1"},
    )
    assert process.stdout is not None
    mug = int(process.stdout.readline())
    process.send_signal(signal.SIGKILL)
    process.wait()
    again = Rig(tmp_path)
    again.bus.publish(CONTEXT, context_to_proto(SOUGHT))
    assert again.mug().id == mug
    assert again.objects()


def test_the_world_of_a_file_is_read_without_the_rest(rig, monkeypatch):
    data = rig.saved()
    world = persistence.read(data, ObjectMap(SETTINGS).empty_viewpoints()).world
    assert world is not None
    monkeypatch.setattr(persistence, "unpacked", None)  # raises TypeError if called
    assert persistence.world_of(data) == world
    assert persistence.world_of(data[:-30]) is None
    monkeypatch.setattr(persistence, "HEADER_BYTES", 10)
    assert persistence.world_of(data) is None
