"""A recording holds the robot's maps and plans: grids, objects, frontiers, path, candidates."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from helios_core import proto as pb
from helios_core.errors import Unavailable
from helios_core.map_snapshot import FREE, OCCUPIED, UNKNOWN, decode_snapshot
from helios_core.recording_format import MAPS
from helios_core.topics import CONTEXT, DECISION, PLAN, RETIRED
from helios_core.viewing.map_entries import map_entries, object_entry
from helios_core.viewing.plan_entries import candidate_entry, plan_entries
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as np_st

from tests.support import wait_until
from tests.unit.recorder.recorder_bus import Recorded, context
from tests.unit.recorder.recorder_maps import FakeMaps, cell_at, cells_of, snapshot_of
from tests.unit.recorder.test_recorder_file import messages, only_file

FAST = 0.01  # seconds between requests
CELL = st.sampled_from([UNKNOWN, FREE, OCCUPIED])


def small_map(marked: tuple[int, int] = (1, 3)) -> np.ndarray:
    """Free, except for one obstacle and an unknown row at the highest y."""
    out = np.zeros((4, 6), np.int8)
    out[marked], out[-1] = OCCUPIED, UNKNOWN
    return out


def with_objects(maps: FakeMaps) -> None:
    o = maps.objects.objects.add(id=3, class_name="cup", score=0.82, class_score=0.9)
    o.center_m.x, o.center_m.y, o.center_m.z = 0.2, 0.6, 0.8
    o.size_m.x, o.size_m.y, o.size_m.z = 0.1, 0.1, 0.12


def last_of_recording(recorded: Recorded, channel: str) -> object:
    """The newest entry of a channel that the recording has taken."""
    return recorded.service.recording._last.get(channel)


def news(recorded: Recorded) -> set[str]:
    """The maps that are to be polled."""
    watch = recorded.service._messages._maps
    assert watch is not None
    with watch._changed:
        return set(watch._times._news)


def poll_objects(recorded: Recorded, maps: FakeMaps) -> None:
    """Have the object map polled once."""
    so_far = maps.asked_objects
    recorded.bus.publish(RETIRED, pb.Retired())
    wait_until(lambda: maps.asked_objects > so_far, 60, "the objects are asked")


def asked(recorded: Recorded, maps: FakeMaps, more_than: int = 0) -> None:
    wait_until(lambda: maps.asked > more_than and maps.at_once == 0, 60, "the map is asked")


# --- what is recorded -------------------------------------------------------------------------
def test_the_map_is_recorded_at_its_place_in_the_world(tmp_path: Path) -> None:
    """A higher row has a higher y, a higher column a higher x."""
    recorded = Recorded(tmp_path, map_period_s=FAST)
    value = np.zeros((4, 6), np.float32)
    value[0, 5] = 0.5
    maps = FakeMaps(recorded.bus, snapshot_of(small_map(), values={"pick": value}))
    with_objects(maps)
    maps.announce()
    asked(recorded, maps)
    wait_until(
        lambda: recorded.service.recording._last.get("/map/objects"), 60, "it reaches the file"
    )
    recorded.close()
    said = messages(only_file(tmp_path))
    grid = said["/map/occupancy"][-1]
    assert (grid.frame_id, grid.column_count, len(cells_of(grid))) == ("world", 6, 4)
    assert cell_at(grid, -1.0 + 3.5 * 0.05, 0.5 + 1.5 * 0.05)["occupancy"] == OCCUPIED
    assert cell_at(grid, -1.0 + 1.5 * 0.05, 0.5 + 3.5 * 0.05)["alpha"] == 0  # unknown: transparent
    np.testing.assert_array_equal(cells_of(grid)["occupancy"], small_map())
    cloud = said["/map/obstacles"][-1]
    [point] = np.frombuffer(cloud.data, "<f4").reshape(-1, cloud.point_stride // 4)
    assert point[:3] == pytest.approx((-1.0 + 3.5 * 0.05, 0.5 + 1.5 * 0.05, 0.9), abs=1e-6)
    heat = said["/map/value/pick"][-1]
    assert cell_at(heat, -1.0 + 5.5 * 0.05, 0.5 + 0.5 * 0.05)["value"] == pytest.approx(0.5)
    assert (cells_of(heat)["alpha"] > 0).sum() == 1
    (cup,) = said["/map/objects"][-1].entities
    assert cup.texts[0].text == "cup 0.82"
    assert cup.cubes[0].size.z == pytest.approx(0.12)
    about = {pair.key: pair.value for pair in cup.metadata}
    assert (about["class"], about["score"], about["object"]) == ("cup", "0.82", "3")
    (frontier,) = said["/map/frontiers"][-1].entities
    assert (frontier.spheres[0].pose.position.x, frontier.texts[0].text) == (0.4, "pick 0.31")
    (driven,) = said["/map/trajectory"][-1].entities
    assert [[(p.x, p.y) for p in line.points] for line in driven.lines] == [
        [(0.0, 0.0), (0.5, 0.0)],
        [(2.0, 2.0), (2.0, 3.0)],
    ]
    # A viewer that starts anywhere needs only the newest message.
    assert all(len(s.deletions) == 1 and s.deletions[0].type == 1 for s in said["/map/objects"])


@given(
    np_st.arrays(np.int8, np_st.array_shapes(min_dims=2, max_dims=2, max_side=9), elements=CELL),
    st.floats(0.01, 1.0),
    st.tuples(st.floats(-50, 50), st.floats(-50, 50)),
)
def test_each_cell_of_any_map_is_recorded_at_its_place_in_the_world(
    occupancy: np.ndarray, cell_m: float, origin_m: tuple[float, float]
) -> None:
    values = {"pick": (occupancy == 0).astype(np.float32) / 2}
    view = decode_snapshot(snapshot_of(occupancy, origin_m, cell_m, values=values))
    said = {e.channel: e.message for e in map_entries(view, frozenset({"old"}), 5)}
    grid, heat = said["/map/occupancy"], said["/map/value/pick"]
    for row, column in np.ndindex(occupancy.shape):
        x_m, y_m = origin_m[0] + (column + 0.5) * cell_m, origin_m[1] + (row + 0.5) * cell_m
        assert cell_at(grid, x_m, y_m)["occupancy"] == occupancy[row, column]
        assert cell_at(heat, x_m, y_m)["value"] == values["pick"][row, column]
    assert cells_of(said["/map/value/old"])["alpha"].max() == 0


@given(st.lists(st.floats(width=32), max_size=9), st.floats(width=16))
def test_non_finite_numbers_of_a_map_or_plan_do_not_prevent_the_recording(
    numbers: list[float], other: float
) -> None:
    """They are left out of the drawing."""
    plan = pb.Plan(path_m=numbers, goal=pb.Pose2(x_m=other, yaw_rad=other), purpose="go")
    path, drawn = [e.message for e in plan_entries(plan, 1)]
    assert isinstance(path, PosesInFrame)
    for pose in path.poses:
        assert np.isfinite([pose.position.x, pose.position.y]).all()
    candidates = [pb.Candidate(name="a", position_m=pb.Vector3(x=x, z=other)) for x in numbers]
    scenes = [drawn, candidate_entry(pb.Decision(candidates=candidates), 1).message]
    objects = [pb.ObjectInstance(id=1, center_m=pb.Vector3(x=x)) for x in numbers]
    scenes.append(object_entry(pb.ObjectsReply(objects=objects), 1).message)
    snapshot = snapshot_of(small_map(), values={"pick": np.full((4, 6), other, np.float32)})
    snapshot.frontiers[0].x_m = other
    snapshot.trajectory_m[:] = numbers[: len(numbers) // 2 * 2]
    del snapshot.trajectory_starts[:]
    said = [e.message for e in map_entries(decode_snapshot(snapshot), frozenset(), 1)]
    for drawing in (m for m in (*scenes, *said) if isinstance(m, SceneUpdate)):
        for thing in drawing.entities:
            for part in (*thing.spheres, *thing.cubes, *thing.texts, *thing.arrows):
                p, q = part.pose.position, part.pose.orientation
                assert np.isfinite([p.x, p.y, p.z, q.z, q.w]).all()


def test_the_path_and_the_candidates_are_recorded_without_map_requests(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path, map_period_s=0)
    maps = FakeMaps(recorded.bus, snapshot_of(small_map()))
    maps.announce()
    recorded.bus.publish(
        PLAN,
        pb.Plan(task_id="t", path_m=[0, 0, 1, 0, 1, 2], purpose="look", goal=pb.Pose2(yaw_rad=0)),
    )
    decision = pb.Decision(task_id="t", why="it is near", rule="global_search (eq. 10)")
    best = decision.candidates.add(kind="frontier", name="frontier 7", chosen=True)
    best.position_m.x, best.terms["total"] = 0.4, 0.31
    decision.candidates.add(kind="receptacle", name="table").position_m.x = 2.0
    recorded.bus.publish(DECISION, decision)
    recorded.bus.publish(PLAN, pb.Plan(task_id="t"))
    recorded.close()
    said = messages(only_file(tmp_path))
    driven, over = said["/map/path"]
    yaws = [2 * np.arctan2(p.orientation.z, p.orientation.w) for p in driven.poses]
    assert yaws == pytest.approx([0, np.pi / 2, 0])  # along the path; at its end as requested
    assert (list(over.poses), list(said["/map/plan"][1].entities)) == ([], [])
    assert [t.text for e in said["/map/plan"][0].entities for t in e.texts] == ["look"]
    chosen, other = said["/map/candidates"][0].entities
    assert (chosen.texts[0].text, other.texts[0].text) == ("frontier 7 0.31", "table")
    assert chosen.spheres[0].size.x > other.spheres[0].size.x
    assert {pair.key: pair.value for pair in chosen.metadata}["total"] == "0.31"
    assert maps.asked == 0  # a period of 0 means off
    assert "/map/occupancy" not in said


def test_each_file_of_a_rotation_begins_with_the_map(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path, map_period_s=FAST, rotate_mb=0.05, flush_s=0.001)
    recorded.robot()
    maps = FakeMaps(recorded.bus, snapshot_of(small_map()))
    maps.announce()
    recorded.bus.publish(PLAN, pb.Plan(task_id="t", path_m=[0, 0, 1, 0]))
    wait_until(
        lambda: recorded.service.recording._last.get("/map/occupancy"), 60, "the map is recorded"
    )
    seq = 0
    while len(list(tmp_path.glob("*.mcap"))) < 3:
        recorded.look(seq)
        seq += 1
        wait_until(lambda: recorded.service.recording.inbox.bytes == 0, 60, "it is written")
    recorded.close()
    for path in sorted(tmp_path.glob("*.mcap"))[1:]:
        said = messages(path)
        assert {"/map/occupancy", "/map/frontiers", "/map/path", "/map/plan"} <= said.keys()


# --- how the maps are requested ---------------------------------------------------------------
def test_the_maps_are_requested_at_most_once_per_period_and_one_at_a_time(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path, map_period_s=0.2)
    maps = FakeMaps(recorded.bus, snapshot_of(small_map()))
    for _ in range(500):
        maps.change(snapshot_of(small_map()))
    newest = maps.snapshot.version

    def arrived() -> bool:
        watch = recorded.service._messages._maps
        return watch is not None and watch._map_version == newest

    wait_until(arrived, 60, "the newest version is recorded")
    assert maps.asked < 50  # of 500 changes
    assert maps.most_at_once == 1
    recorded.close()


def test_an_unchanged_map_is_not_requested_again(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path, map_period_s=FAST)
    maps = FakeMaps(recorded.bus, snapshot_of(small_map()))
    maps.announce()
    asked(recorded, maps)
    wait_until(lambda: "map2d" not in news(recorded), 60, "it waits for news")
    poll_objects(recorded, maps)  # after it no earlier poll goes on
    before = maps.asked
    for _ in range(5):
        poll_objects(recorded, maps)
    assert maps.asked == before
    recorded.bus.publish(CONTEXT, context())  # resets the explored area of the last search
    asked(recorded, maps, before)
    recorded.close()


def test_a_map_that_does_not_reply_does_not_slow_the_polls_of_the_other(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path, map_period_s=FAST)
    maps = FakeMaps(recorded.bus, snapshot_of(small_map()))

    def refuse() -> None:
        raise Unavailable("the map does not reply")

    maps.before = refuse
    maps.before_objects = lambda: recorded.bus.publish(RETIRED, pb.Retired())  # always news
    maps.announce()
    wait_until(lambda: maps.asked_objects > 100, 60, "the objects are asked")
    assert recorded.health.metrics()["missed_maps"] >= 1
    assert maps.asked < maps.asked_objects / 4  # its pauses double
    recorded.close()


def test_a_map_of_another_process_with_the_same_version_is_recorded(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path, map_period_s=FAST)
    maps = FakeMaps(recorded.bus, snapshot_of(small_map()))
    maps.snapshot.map_id = "first"
    maps.announce()
    wait_until(lambda: last_of_recording(recorded, "/map/trajectory"), 60, "it is recorded")
    drawn = last_of_recording(recorded, "/map/trajectory")
    other = snapshot_of(small_map((0, 0)))
    other.map_id = "second"
    maps.snapshot = other
    maps.announce()
    wait_until(
        lambda: last_of_recording(recorded, "/map/trajectory") is not drawn,
        60,
        "the other map is recorded",
    )
    recorded.close()
    grid = messages(only_file(tmp_path))["/map/occupancy"][-1]
    np.testing.assert_array_equal(cells_of(grid)["occupancy"], small_map((0, 0)))


def test_a_reset_empties_the_recorded_map_and_its_layers_once(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path, map_period_s=FAST)
    value = np.full((4, 6), 0.5, np.float32)
    maps = FakeMaps(recorded.bus, snapshot_of(small_map(), values={"pick": value}))
    maps.announce()
    wait_until(lambda: last_of_recording(recorded, "/map/trajectory"), 60, "it is recorded")
    drawn = last_of_recording(recorded, "/map/trajectory")
    maps.reset()
    wait_until(
        lambda: last_of_recording(recorded, "/map/trajectory") is not drawn,
        60,
        "the empty map is recorded",
    )
    for _ in range(2):  # further replies without a map
        before = maps.asked
        maps.announce()
        asked(recorded, maps, before)
    recorded.close()
    said = messages(only_file(tmp_path))
    for channel in ("/map/occupancy", "/map/value/pick"):
        full, empty = said[channel]
        assert len(cells_of(full)) == 4
        assert cells_of(empty).shape == (1, 1)
        assert cells_of(empty)["alpha"] == 0
    assert cells_of(said["/map/occupancy"][-1])["occupancy"] == UNKNOWN
    assert not said["/map/obstacles"][-1].data
    assert not said["/map/frontiers"][-1].entities
    assert not [line for e in said["/map/trajectory"][-1].entities for line in e.lines]


def test_missing_and_broken_maps_are_counted_and_the_recorder_stays_ready(
    tmp_path: Path,
) -> None:
    recorded = Recorded(tmp_path, map_period_s=FAST)
    recorded.bus.publish(CONTEXT, context())  # and no map answers
    wait_until(lambda: recorded.health.metrics()["missed_maps"] >= 2, 60, "it is counted")
    assert recorded.health.state[0] == "ready"
    broken = snapshot_of(small_map())
    broken.occupancy = b"no zlib"
    maps = FakeMaps(recorded.bus, broken)
    maps.announce()
    wait_until(lambda: recorded.health.metrics().get("unrecordable_messages"), 60, "it is told")
    maps.change(snapshot_of(small_map()))
    watch = recorded.service._messages._maps
    assert watch is not None
    wait_until(lambda: watch._map_version == maps.snapshot.version, 60, "the next one is kept")
    recorded.close()
    assert recorded_channels(tmp_path) >= {"/map/occupancy"}


def test_a_map_that_hangs_does_not_delay_the_recording(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path, map_period_s=FAST)
    maps = FakeMaps(recorded.bus, snapshot_of(small_map()))
    goes_on, hangs = threading.Event(), threading.Event()

    def hang() -> None:
        hangs.set()
        goes_on.wait(20)

    maps.before = hang
    maps.announce()
    wait_until(hangs.is_set, 60, "the map hangs")
    recorded.tour(3)
    wait_until(lambda: recorded.health.metrics().get("messages", 0) >= 11, 60, "all is recorded")
    recorded.close()
    goes_on.set()
    assert recorded_channels(tmp_path) >= {"/bridge/keyframe"}
    assert recorded.health.metrics()["dropped_messages"] == 0


def recorded_channels(folder: Path) -> set[str]:
    return set(messages(only_file(folder)))


def test_all_map_and_plan_channels_have_one_prefix() -> None:
    view = decode_snapshot(snapshot_of(small_map(), values={"pick": np.zeros((4, 6), np.float32)}))
    entries = [*map_entries(view, frozenset(), 1), *plan_entries(pb.Plan(), 1)]
    entries += [object_entry(pb.ObjectsReply(), 1), candidate_entry(pb.Decision(), 1)]
    assert all(e.channel.startswith(MAPS) for e in entries)
