"""Values round-trip through their messages; inconsistent messages are refused with a reason."""

from __future__ import annotations

import contextlib
import math
import struct
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.codec import (
    action_from_proto,
    action_to_proto,
    context_from_proto,
    context_to_proto,
    description_from_proto,
    description_to_proto,
    frame_from_proto,
    frame_to_proto,
    object_from_proto,
    observation_from_proto,
    observation_to_proto,
)
from helios_core.codec.frames import depth_to_mm
from helios_core.codec.images import encoded_size
from helios_core.errors import HeliosError, InvalidInput
from helios_core.geometry import Pinhole, camera_on_base, se2_to_se3
from helios_core.recording_format import join_frame, split_frame
from helios_core.robot import Action, Forward, Observe, Pick, Place, Show, Tilt, Turn
from helios_core.types import (
    Detection,
    Frame,
    FrameId,
    Observation,
    RobotDescription,
    Role,
    SearchClass,
    SearchContext,
    Shown,
)
from helios_replay.ros_images import color_of
from helios_spot.posed_images import decode_color
from hypothesis import given, settings
from hypothesis import strategies as st

CAMERA = Pinhole(30.0, 31.0, 16.0, 12.0, 32, 24)


def make_frame() -> Frame:
    rng = np.random.default_rng(0)
    base = se2_to_se3(1.0, -2.0, 0.7)
    return Frame(
        id=FrameId("boot", 2, 41),
        stamp_ns=1_234_567_891_234,
        keyframe=True,
        color=rng.integers(0, 255, (24, 32, 3), np.uint8),
        depth_m=(rng.integers(0, 5000, (24, 32)) / 1000).astype(np.float32),
        camera=CAMERA,
        T_world_cam=camera_on_base(base, 1.3, 0.4),
        T_world_base=base,
    )


def assert_same_frame(a: Frame, b: Frame) -> None:
    assert (a.id, a.stamp_ns, a.keyframe, a.camera) == (b.id, b.stamp_ns, b.keyframe, b.camera)
    assert (a.held, a.shown) == (b.held, b.shown)
    np.testing.assert_array_equal(a.color, b.color)
    np.testing.assert_allclose(a.depth_m, b.depth_m, atol=1e-6)
    np.testing.assert_allclose(a.T_world_cam, b.T_world_cam, atol=1e-9)
    np.testing.assert_allclose(a.T_world_base, b.T_world_base, atol=1e-9)


@pytest.mark.parametrize("held", [None, "", "mug"])
def test_a_frame_round_trips_through_its_message(held: str | None) -> None:
    frame = replace(make_frame(), held=held)
    data = frame_to_proto(frame).SerializeToString()
    assert_same_frame(frame, frame_from_proto(pb.Frame.FromString(data)))


def test_a_frame_with_a_shown_object_round_trips_through_its_message() -> None:
    frame = replace(make_frame(), held="mug", shown=Shown((0.5, -0.25, 1.1), 0.75))
    assert_same_frame(frame, frame_from_proto(frame_to_proto(frame)))
    assert frame_from_proto(frame_to_proto(make_frame())).shown is None


def test_a_compressed_frame_round_trips_within_the_error_of_jpeg() -> None:
    frame, message = make_frame(), frame_to_proto(make_frame())
    gray = np.full((24, 32, 3), 128, np.uint8)
    message.compressed_color.data = cv2.imencode(".jpg", gray)[1].tobytes()
    depth_mm = np.rint(frame.depth_m * 1000).astype(np.uint16)
    message.compressed_depth.data = cv2.imencode(".png", depth_mm)[1].tobytes()
    got = frame_from_proto(message)
    assert np.abs(got.color.astype(int) - 128).max() <= 3
    np.testing.assert_allclose(got.depth_m, frame.depth_m, atol=1e-6)


def turned_by_exif(jpeg: bytes) -> bytes:
    """The same JPEG with an APP1 segment that says it stands on its head (orientation 3)."""
    entry = struct.pack("<HHIHH", 0x0112, 3, 1, 3, 0)
    exif = b"Exif\0\0II*\0" + struct.pack("<IH", 8, 1) + entry + bytes(4)
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", 2 + len(exif)) + exif + jpeg[2:]


def test_the_exif_orientation_of_a_jpeg_turns_no_image_of_a_frame() -> None:
    """Depth and K belong to the pixels as they are stored."""
    color = np.zeros((24, 32, 3), np.uint8)
    color[:, :16] = 255  # white on the left
    jpeg = turned_by_exif(cv2.imencode(".jpg", color)[1].tobytes())
    data = np.frombuffer(jpeg, np.uint8)
    opencv = cv2.imdecode(data, cv2.IMREAD_COLOR)
    assert opencv is not None
    assert opencv[:, 16:].min() > 200  # it would turn it
    message = frame_to_proto(make_frame())
    split = split_frame(message, 90)
    message.compressed_color.data = jpeg
    split.color.data = jpeg
    ros = SimpleNamespace(data=jpeg, format="jpeg")
    spot = SimpleNamespace(data=jpeg, format=1, FORMAT_RAW=2, rows=24, cols=32)
    joined = frame_from_proto(join_frame(split.head, split.color, split.depth))
    for decoded in (
        frame_from_proto(message).color,
        joined.color,
        color_of(ros, True, "the image"),
        decode_color(spot),
    ):
        assert decoded[:, :16].min() > 200
        assert decoded[:, 16:].max() < 50


def test_bad_depth_values_count_as_invalid() -> None:
    message = frame_to_proto(make_frame())
    depth = np.full((24, 32), 2.0, np.float32)
    depth[0, :3] = [np.nan, -1.0, np.inf]
    message.raw_depth.encoding, message.raw_depth.step = "32FC1", 32 * 4
    message.raw_depth.data = depth.tobytes()
    got = frame_from_proto(message).depth_m
    assert (got[0, :3] == 0).all()
    assert (got[1:] == 2.0).all()


def _cut_color(m: pb.Frame) -> None:
    m.raw_color.data = m.raw_color.data[:-5]


def _corrupt_jpeg(m: pb.Frame) -> None:
    m.compressed_color.data = b"\xff\xd8 this is no picture"


def _smaller_depth(m: pb.Frame) -> None:
    m.raw_depth.height = 20
    m.raw_depth.data = m.raw_depth.data[: 20 * 64]


def _encoding(m: pb.Frame) -> None:
    m.raw_color.encoding = "yuv422"


def _no_color(m: pb.Frame) -> None:
    m.ClearField("raw_color")


def _bomb(m: pb.Frame) -> None:
    png = bytearray(cv2.imencode(".png", np.zeros((4, 4), np.uint16))[1].tobytes())
    png[16:24] = (20000).to_bytes(4, "big") * 2
    m.compressed_depth.data = bytes(png)


def _calibration(m: pb.Frame) -> None:
    m.calibration.K[0] = -1.0


def _pose(m: pb.Frame) -> None:
    m.T_world_cam.pose.position.x = float("nan")


def _quaternion(m: pb.Frame) -> None:
    m.T_world_base.pose.orientation.w = 17.0


def _huge_quaternion(m: pb.Frame) -> None:
    m.T_world_base.pose.orientation.w = 1e300


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (_cut_color, "bytes; 2299 came"),
        (_corrupt_jpeg, "no JPEG or PNG"),
        (_smaller_depth, "sizes disagree"),
        (_encoding, "yuv422"),
        (_no_color, "no colour image"),
        (_bomb, "20000x20000"),
        (_calibration, "focal lengths"),
        (_pose, "T_world_cam"),
        (_quaternion, "unit quaternion"),
        (_huge_quaternion, "unit quaternion"),
    ],
)
def test_an_inconsistent_frame_is_refused(spoil: Callable[[pb.Frame], None], said: str) -> None:
    message = frame_to_proto(make_frame())
    spoil(message)
    with pytest.raises(InvalidInput, match=said):
        frame_from_proto(message)


@settings(max_examples=300, deadline=None)
@given(st.data())
def test_a_mutated_frame_raises_nothing_but_a_typed_error(data: st.DataObject) -> None:
    raw = bytearray(frame_to_proto(make_frame()).SerializeToString())
    for _ in range(data.draw(st.integers(1, 6))):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    try:
        message = pb.Frame.FromString(bytes(raw))
    except Exception:
        return  # protobuf refuses it: the bus logs and drops it
    with contextlib.suppress(HeliosError):
        frame_from_proto(message)


def test_an_observation_round_trips_through_its_message() -> None:
    frame = make_frame()
    mask = np.zeros((24, 32), bool)
    mask[5:9, 7:20] = True
    mask[6, 9] = False
    seen = Observation(
        frame, "c1", (Detection("mug", 0.5, (7, 5, 20, 9), mask),), {"pick": 0.25}, "test", "s"
    )
    got = observation_from_proto(observation_to_proto(seen))
    assert_same_frame(got.frame, frame)
    assert got.context_id == "c1"
    assert got.layer_scores == {"pick": 0.25}
    assert got.detections[0].class_name == "mug"
    np.testing.assert_array_equal(got.detections[0].mask, mask)


def test_a_mask_outside_the_image_is_refused() -> None:
    message = observation_to_proto(Observation(make_frame(), "c", (), {}, "t"))
    message.detections.add(class_name="mug", score=1).mask.x = 30
    message.detections[0].mask.width = message.detections[0].mask.height = 8
    with pytest.raises(InvalidInput, match=r"does not fit.*; send the part"):
        observation_from_proto(message)


def test_a_mask_that_does_not_fill_its_bytes_is_refused_with_the_right_number() -> None:
    message = observation_to_proto(Observation(make_frame(), "c", (), {}, "t"))
    mask = message.detections.add(class_name="mug", score=1).mask
    mask.width = mask.height = 8
    mask.bits = bytes(5)
    with pytest.raises(InvalidInput, match="with 5 bytes, 8 wanted; send one bit a pixel"):
        observation_from_proto(message)


def test_a_search_context_round_trips_through_its_message() -> None:
    context = SearchContext(
        "id",
        (SearchClass("mug", Role.OBJECT, 0.25, ("cup",)),),
        {"pick": "a mug ahead"},
        ("glass", "vase"),
        {"mug": "a mug ahead"},
    )
    assert context_from_proto(context_to_proto(context)) == context


def test_a_search_context_with_too_many_other_names_is_refused() -> None:
    context = SearchContext("id", (), also=tuple(f"name {k}" for k in range(2000)))
    with pytest.raises(InvalidInput, match="2000 other names; ask for at most 1024"):
        context_from_proto(context_to_proto(context))


def test_an_outline_with_an_incomplete_point_is_refused() -> None:
    with pytest.raises(InvalidInput, match="outline of object 7 has 3 numbers"):
        object_from_proto(pb.ObjectInstance(id=7, outline_m=[1.0, 2.0, 3.0]))


def test_an_unknown_role_is_refused_by_name() -> None:
    message = pb.SearchContext(classes=[pb.SearchClass(name="mug", role="boss", threshold=0.2)])
    with pytest.raises(InvalidInput, match="boss"):
        context_from_proto(message)


@pytest.mark.parametrize(
    "message",
    [
        pb.SearchContext(prompts={f"layer {i}": "a mug" for i in range(2000)}),
        pb.SearchContext(class_prompts={f"class {i}": "a mug" for i in range(2000)}),
        pb.SearchContext(class_prompts={"mug": "a mug " * 1000}),
        pb.SearchContext(classes=[pb.SearchClass(name=f"{i}", role="object") for i in range(2000)]),
        pb.SearchContext(classes=[pb.SearchClass(name="x" * 100_000, role="object")]),
    ],
)
def test_an_oversized_search_context_is_refused(message: pb.SearchContext) -> None:
    with pytest.raises(InvalidInput, match="at most"):
        context_from_proto(message)


def _calibrated(K: list[float]) -> Callable[[pb.Frame], None]:
    def spoil(frame: pb.Frame) -> None:
        frame.calibration.K[:] = K

    return spoil


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (_calibrated([1e-6, 0, 16, 0, 1e-6, 12, 0, 0, 1]), "no camera"),
        (_calibrated([1e300, 0, 16, 0, 1e300, 12, 0, 0, 1]), "no camera"),
        (_calibrated([30, 0, 1e9, 0, 30, 1e9, 0, 0, 1]), "no camera"),
        (lambda f: setattr(f.T_world_cam.pose.position, "x", 1e18), "within 20000 m"),
        (lambda f: setattr(f.T_world_base.pose.position, "y", -1e300), "within 20000 m"),
        (lambda f: setattr(f.stamp, "seconds", 2**62), "stamp"),
        (lambda f: setattr(f.shown, "turn_rad", math.nan), "finite numbers"),
        (lambda f: setattr(f.shown.point_m, "z", math.inf), "finite numbers"),
        (lambda f: setattr(f.stamp, "seconds", -(2**62)), "stamp"),
    ],
)
def test_a_frame_with_implausible_numbers_is_refused(
    spoil: Callable[[pb.Frame], None], said: str
) -> None:
    message = frame_to_proto(make_frame())
    spoil(message)
    with pytest.raises(InvalidInput, match=said):
        frame_from_proto(message)


@pytest.mark.parametrize(
    "action",
    [
        Forward(0.5),
        Forward(-0.2),
        Turn(-0.3),
        Tilt(0.2),
        Pick((1, 2, 3), "mug"),
        Place((1, 2, 0.5)),
        Observe(),
        Show(1.5),
    ],
)
def test_an_action_round_trips_through_its_message(action: Action) -> None:
    assert action_from_proto(action_to_proto(action)) == action


def test_an_empty_action_is_refused() -> None:
    with pytest.raises(InvalidInput, match="send forward"):
        action_from_proto(pb.Action())


def test_a_description_round_trips_through_its_message() -> None:
    robot = RobotDescription(
        "r", 0.3, 1.4, CAMERA, 1.31, 0.8, 10.0, max_back_m=0.25, tilt_range_rad=(-0.5, 1.0)
    )
    assert description_from_proto(description_to_proto(robot)) == robot
    showing = replace(robot, show_base_m=(0.5, 0.0, 1.1))
    assert description_from_proto(description_to_proto(showing)) == showing
    lost = replace(robot, show_base_m=(0.5, math.nan, 1.1))
    with pytest.raises(InvalidInput, match="show_base_m"):
        description_from_proto(description_to_proto(lost))


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
@pytest.mark.parametrize("size", [(3, 5), (480, 640)])
def test_the_image_size_is_read_from_the_file_header(suffix: str, size: tuple[int, int]) -> None:
    data = cv2.imencode(suffix, np.zeros(size, np.uint8))[1].tobytes()
    assert encoded_size(data) == (size[1], size[0])


def test_depth_in_millimetres_is_exact_for_such_sensors_and_never_wraps_around() -> None:
    every = np.arange(65536, dtype=np.float32)
    np.testing.assert_array_equal(depth_to_mm(every * np.float32(0.001)), every)
    for depth_m, wanted in (
        (65.5351, 65535), (66.0, 65535), (np.inf, 65535), (1.0005001, 1001), (-0.001, 0),
        (-np.inf, 0), (np.nan, 0),
    ):  # fmt: skip
        assert depth_to_mm(np.full((1, 1), depth_m, np.float32)) == wanted


@given(st.floats(0.0, 65.5, width=32))
def test_depth_that_fits_is_rounded_to_the_nearest_millimetre(depth_m: float) -> None:
    depth = np.full((1, 1), depth_m, np.float32)
    assert depth_to_mm(depth) == np.rint(depth * np.float32(1000.0)).astype("<u2")
