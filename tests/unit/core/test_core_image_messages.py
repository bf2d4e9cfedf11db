"""Tests of messages with their images apart: the bytes are those of any protobuf program."""

from __future__ import annotations

import pytest
from google.protobuf.message import DecodeError
from helios_core import proto as pb
from helios_core.image_messages import ImageMessage, apart, image_data, kept, split
from hypothesis import given
from hypothesis import strategies as st

IMAGES = st.binary(max_size=300)


@st.composite
def frames(draw: st.DrawFn) -> pb.Frame:
    """Frames with any mixture of raw, compressed and missing images."""
    out = pb.Frame(origin_id=draw(st.text(max_size=9)), keyframe=draw(st.booleans()))
    out.id.seq = draw(st.integers(0, 2**40))
    out.T_world_cam.pose.position.x = draw(st.floats(allow_nan=False))
    for what in ("color", "depth"):
        kind = draw(st.sampled_from(["raw", "compressed", "none"]))
        if kind != "none":
            image = getattr(out, f"{kind}_{what}")
            image.data = draw(IMAGES)
            image.frame_id = draw(st.sampled_from(["", "camera"]))
            image.SetInParent()
    return out


@given(frames())
def test_a_frame_survives_the_separation_of_its_images(frame: pb.Frame) -> None:
    found = split(pb.Frame, frame.SerializeToString())
    assert found.whole() == frame
    assert pb.Frame.FromString(b"".join(found.parts())) == frame
    for path, image in found.images.items():
        assert getattr(found.head, path).data == b""
        assert image.readonly
    for path in ("raw_color", "raw_depth"):
        assert bytes(image_data(found, path)) == getattr(frame, path).data


@given(frames(), st.lists(IMAGES, max_size=3), st.booleans())
def test_an_observation_keeps_its_frame_in_place(
    frame: pb.Frame, masks: list[bytes], has_frame: bool
) -> None:
    message = pb.Observation(context_id="c", frame=frame if has_frame else None)
    for mask in masks:
        message.detections.add(class_name="mug").mask.bits = mask
    found = split(pb.Observation, message.SerializeToString())
    assert found.whole() == message
    inner = apart(found.frame)
    assert inner.whole() == message.frame
    assert found.context_id == "c"


@given(st.binary(max_size=60) | frames().map(lambda f: f.SerializeToString()[:-1]))
def test_bytes_that_protobuf_refuses_are_refused(data: bytes) -> None:
    try:
        found = split(pb.Frame, data)
    except DecodeError:
        return
    assert found.whole() == pb.Frame.FromString(data)


def test_zeros_are_refused_at_once() -> None:
    with pytest.raises(DecodeError, match="number 0"):
        split(pb.Frame, bytes(1000))


def test_an_image_in_two_pieces_merges_as_protobuf_says() -> None:
    first, second = pb.Frame(), pb.Frame()
    first.raw_color.width, first.raw_color.data = 3, b"abc"
    second.raw_color.height, second.raw_color.data = 1, b"xyz"
    data = first.SerializeToString() + second.SerializeToString()
    assert split(pb.Frame, data).whole() == pb.Frame.FromString(data)


def test_a_kept_message_does_not_change_with_the_memory_it_came_in() -> None:
    memory = bytearray(pb.Frame(raw_color={"data": b"abc"}).SerializeToString())
    found = split(pb.Frame, memoryview(memory))
    mine = kept(found)
    memory[-3:] = b"xyz"
    assert bytes(found.images["raw_color"]) == b"xyz"
    assert bytes(mine.images["raw_color"]) == b"abc"
    assert isinstance(mine, ImageMessage)
