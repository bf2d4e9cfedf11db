"""2D maps that are saved and loaded in every file format."""

from __future__ import annotations

import dataclasses
import io
import json
import zlib

import cv2
import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.errors import Conflict, InvalidInput, Unavailable
from helios_core.topics import RECALL
from map2d_kept import assert_same_state, load, saved, state_of, walked
from map2d_rig import Rig


def test_a_loaded_map_continues_exactly_like_the_saved_one() -> None:
    rig, other = walked(), Rig()
    other.say_epoch("boot")
    other.search("first")
    reply = load(other, saved(rig, "map"))
    assert reply.known_m2 > 5
    assert reply.occupied_m2 > 0.3
    assert reply.views == 12
    assert_same_state(state_of(rig), state_of(other))
    # Unpublished state, such as evidence, is restored too: later frames change both maps alike.
    rig.walk.blocks = rig.walk.blocks[:4]
    for frame in rig.walk.look_around(2.2, 1.4):
        for each in (rig, other):
            each.keyframe(frame)
    assert_same_state(state_of(rig), state_of(other))


def test_values_beyond_the_known_floor_are_restored_too() -> None:
    rig, other = Rig(), Rig()
    for each in (rig, other):
        each.say_epoch("boot")
        each.search("first")
    rig.keyframe(rig.walk.frame(2.0, 1.5, 0.0))
    rig.walk.blocks = []
    rig.observe(rig.walk.frame(12.0, 9.0, 0.0), "first", {"pick": 0.3, "place": 0.6})
    assert state_of(rig).published.grid.columns > 400
    load(other, saved(rig, "map"))
    assert_same_state(state_of(rig), state_of(other))


def test_a_map_of_another_world_is_loaded_if_its_frame_is_the_same() -> None:
    files = saved(walked(), "map")
    today = Rig()
    with pytest.raises(Conflict, match="start its bridge"):
        load(today, files)
    today.say_epoch("another boot")
    load(today, files)
    frame = today.walk.frame(1.0, 1.0, 0.0)
    today.keyframe(
        dataclasses.replace(frame, id=dataclasses.replace(frame.id, robot_boot_id="another boot"))
    )
    assert today.acks[-1].accepted
    after = state_of(today).published
    assert after.robot_pose == pytest.approx((1.0, 1.0, 0.0))
    assert (after.occupancy != -1).sum() * 0.025**2 > 5


def test_an_npz_export_restores_occupancy_heights_and_values() -> None:
    rig, other = walked(), Rig()
    other.say_epoch("boot")
    other.search("first")
    load(other, saved(rig, "npz"))
    a, b = state_of(rig).published, state_of(other).published
    for name in ("occupancy", "explored_for_search", "z_low_m", "z_high_m"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)
    np.testing.assert_array_equal(a.values["pick"], b.values["pick"])
    assert {f.id for f in a.frontiers} == {f.id for f in b.frontiers}


def test_a_map_round_trips_through_the_ros_map_server_format() -> None:
    rig, other = walked(), Rig()
    files = saved(rig, "ros")
    by_name = {f.name: f.data for f in files}
    assert set(by_name) == {"map.pgm", "map.yaml"}
    text = by_name["map.yaml"].decode()
    assert "image: map.pgm" in text
    assert "resolution: 0.025" in text
    picture = cv2.imdecode(np.frombuffer(by_name["map.pgm"], np.uint8), cv2.IMREAD_GRAYSCALE)
    before = state_of(rig).published
    assert picture is not None
    assert picture.shape == before.occupancy.shape
    np.testing.assert_array_equal(picture[::-1] == 0, before.occupancy == 100)  # top row: high y
    other.say_epoch("boot")
    load(other, files)
    after = state_of(other).published
    assert after.grid.centre_of(0, 0) == pytest.approx(before.grid.centre_of(0, 0))
    np.testing.assert_array_equal(before.occupancy, after.occupancy)


def test_obstacles_of_a_ros_map_fill_the_height_band_of_the_service() -> None:
    other = Rig("--band-lo-m", "0.2", "--band-hi-m", "1.1")
    other.say_epoch("boot")
    load(other, saved(walked(), "ros"))
    after = state_of(other).published
    there = after.occupancy == 100
    assert there.any()
    np.testing.assert_array_equal(after.z_low_m, np.where(there, np.float32(0.2), 0))
    np.testing.assert_array_equal(after.z_high_m, np.where(there, np.float32(1.1), 0))


def test_floor_of_a_ros_map_counts_as_explored_only_without_a_search() -> None:
    rig = Rig()
    rig.say_epoch("boot")
    load(rig, saved(walked(), "ros"))
    known = state_of(rig).published
    np.testing.assert_array_equal(known.explored_for_search, known.occupancy != -1)
    rig.search("first")
    assert not state_of(rig).published.explored_for_search.any()
    assert not state_of(rig).published.frontiers
    rig.keyframe(rig.walk.frame(2.0, 1.5, 0.0))
    assert state_of(rig).published.frontiers


def test_every_export_contains_frame_id_stamp_robot_pose_and_world() -> None:
    rig = walked()
    rig.keyframe(rig.walk.frame(2.25, 1.5, 0.5))
    published = state_of(rig).published
    (npz,) = saved(rig, "npz")
    with np.load(io.BytesIO(npz.data)) as arrays:
        of_npz = json.loads(str(arrays["meta"]))
    (png,) = saved(rig, "png")
    at = png.data.index(b"tEXthelios\0")
    length = int.from_bytes(png.data[at - 4 : at], "big")
    chunk = png.data[at : at + 4 + length]
    assert int.from_bytes(png.data[at + 4 + length :][:4], "big") == zlib.crc32(chunk)
    assert cv2.imdecode(np.frombuffer(png.data, np.uint8), cv2.IMREAD_COLOR) is not None
    yaml = next(f.data for f in saved(rig, "ros") if f.name.endswith(".yaml")).decode()
    of_ros = json.loads(yaml.splitlines()[0].removeprefix("# HELIOS: "))
    assert of_ros == json.loads(chunk[len(b"tEXthelios\0") :])
    assert of_ros == {name: of_npz[name] for name in of_ros}
    assert published.frame_id is not None
    assert of_ros["frame_id"] == ["boot", 0, published.frame_id.seq]
    assert of_ros["stamp_ns"] == published.stamp_ns > 0
    assert of_ros["robot_pose"] == pytest.approx([2.25, 1.5, 0.5])


def test_frontier_ids_and_frame_numbers_continue_after_a_load() -> None:
    rig, other = walked(), Rig()
    other.say_epoch("boot")
    load(other, saved(rig, "map"))
    one, two = state_of(rig), state_of(other)
    assert two.stack.frontiers.next_id == one.stack.frontiers.next_id > 1
    assert two.order.newest == one.order.newest


def test_a_negated_ros_map_is_read_with_inverted_values() -> None:
    rig, other = walked(), Rig()
    files = {f.name: f.data for f in saved(rig, "ros")}
    grey = cv2.imdecode(np.frombuffer(files["map.pgm"], np.uint8), cv2.IMREAD_GRAYSCALE)
    assert grey is not None
    _, png = cv2.imencode(".png", 255 - grey)
    about = files["map.yaml"].replace(b"negate: 0", b"negate: 1")
    other.say_epoch("boot")
    load(
        other,
        [pb.Map2DFile(name="m.yaml", data=about), pb.Map2DFile(name="m.png", data=png.tobytes())],
    )
    before = state_of(rig).published.occupancy
    np.testing.assert_array_equal(state_of(other).published.occupancy, before)


def test_a_ros_map_with_block_style_yaml_is_aligned_to_the_grid_within_half_a_cell() -> None:
    rig = Rig()
    rig.say_epoch("boot")
    grey = np.full((40, 60), 205, np.uint8)
    grey[10, 20] = 0
    ok, png = cv2.imencode(".png", grey)
    assert ok
    about = (
        b"image: floor.png\nresolution: 0.025\norigin:\n- -1.02\n- 2.004\n- 0.0\n"
        b"negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25\n"
    )
    load(
        rig,
        [
            pb.Map2DFile(name="floor.yaml", data=about),
            pb.Map2DFile(name="floor.png", data=png.tobytes()),
        ],
    )
    after = state_of(rig).published
    ((row, column),) = np.argwhere(after.occupancy == 100)
    x, y = after.grid.centre_of(int(row), int(column))
    assert x == pytest.approx(-1.02 + 20.5 * 0.025, abs=0.0126)
    assert y == pytest.approx(2.004 + 29.5 * 0.025, abs=0.0126)


@pytest.mark.parametrize(
    ("name", "data", "reason"),
    [
        ("a.map", b"helios map2d 1\n", "damaged or cut short"),
        ("a.map", b"something else", "no map file"),
        ("a.npz", b"something else", "no map snapshot"),
        ("a.txt", b"", "send one .map, one .npz, or a .yaml"),
    ],
)
def test_a_file_that_is_not_a_map_is_refused_and_changes_nothing(
    name: str, data: bytes, reason: str
) -> None:
    rig = walked()
    before = state_of(rig).published
    with pytest.raises(InvalidInput, match=reason):
        load(rig, [pb.Map2DFile(name=name, data=data)])
    assert state_of(rig).published is before


@pytest.mark.parametrize(
    ("about", "reason"),
    [
        (b"resolution: 0.05\norigin: [0, 0, 0]\noccupied_thresh: 0.6\nfree_thresh: 0.2", "0.05 m"),
        (b"resolution: 0.025\norigin: [0, 0, 1]\noccupied_thresh: 0.6\nfree_thresh: 0.2", "turned"),
        (
            b"resolution: x\norigin: [0, 0, 0]\noccupied_thresh: 0.6\nfree_thresh: 0.2",
            "no map_serv",
        ),
        (b"resolution: 0.025\norigin: [nan, 0, 0]\noccupied_thresh: 0.6\nfree_thresh: 0", "finite"),
        (
            b"resolution: 0.025\norigin: [0, 0, 0]\noccupied_thresh: 0.6\nfree_thresh: 0",
            "no picture",
        ),
    ],
)
def test_an_unsupported_or_invalid_ros_map_is_refused(about: bytes, reason: str) -> None:
    rig = Rig()
    rig.say_epoch("boot")
    files = [pb.Map2DFile(name="m.yaml", data=about), pb.Map2DFile(name="m.pgm", data=b"P5")]
    with pytest.raises(InvalidInput, match=reason):
        load(rig, files)


def test_saving_before_the_first_keyframe_or_in_an_unknown_format_is_refused() -> None:
    with pytest.raises(Unavailable, match="no keyframe"):
        saved(Rig(), "map")
    with pytest.raises(InvalidInput, match="map, npz, ros or png"):
        saved(walked(), "jpeg2000")


def test_a_saved_map_restores_its_views() -> None:
    rig, other = walked(), Rig()
    other.say_epoch("boot")
    load(other, saved(rig, "map"))
    for each in (rig, other):
        each.scorer.serve(each.bus)
    asked = pb.RecallRequest(prompt="a teapot", most_places=3)
    one, two = (each.bus.call(RECALL, asked, 5) for each in (rig, other))
    assert one.views == two.views == 12
    assert [(p.id, p.score, p.jpeg) for p in one.places] == [
        (p.id, p.score, p.jpeg) for p in two.places
    ]
