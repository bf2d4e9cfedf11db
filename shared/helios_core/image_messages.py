"""Messages whose raw images are kept apart, so that nobody copies pixels to read or send them.

Protobuf copies every byte field at least once when it packs and once when it parses a message. An
`ImageMessage` holds the message without the bytes of its raw images (its head), and each image as a
view of memory. `ImageMessage.parts` gives the bytes of the whole message, exactly as any protobuf
library writes and reads them; `split` finds the images in such bytes and leaves them in place.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Generic, TypeVar

from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.descriptor import Descriptor
from google.protobuf.message import DecodeError, Message

from helios_core import proto as pb

M = TypeVar("M", bound=Message)
T = TypeVar("T")

Buffer = bytes | memoryview
_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5  # wire types of protobuf
_IMAGE = RawImage.DESCRIPTOR.full_name
_DATA = RawImage.DESCRIPTOR.fields_by_name["data"].number


class ImageMessage(Generic[M]):
    """Message with its raw images apart. The other fields read as those of the message itself.

    The images may lie in memory that other processes share. Nobody writes to it while a reference
    to the image exists, but the sender has only a few such places: keep what `kept` returns.
    """

    __slots__ = ("head", "images")

    def __init__(self, head: M, images: Mapping[str, memoryview]) -> None:
        """head: the message, `data` of its raw images empty.
        images: path of a raw image ("raw_color", "frame.raw_depth") -> its bytes."""
        self.head = head
        self.images = images

    def __getattr__(self, name: str) -> Any:
        """Field of the head. A field that contains images is an ImageMessage, too."""
        value = getattr(self.head, name)
        prefix = f"{name}."
        if not any(path.startswith(prefix) for path in self.images):
            return value
        inner = {p.removeprefix(prefix): i for p, i in self.images.items() if p.startswith(prefix)}
        return ImageMessage(value, inner)

    def parts(self) -> list[Buffer]:
        """Bytes of the whole message in pieces, the images as they are."""
        layout = _layout(self.head.DESCRIPTOR)
        return _joined(memoryview(self.head.SerializeToString()), layout, "", self.images)

    def SerializeToString(self) -> bytes:
        """Bytes of the whole message, as protobuf's method of this name."""
        return b"".join(self.parts())

    def whole(self) -> M:
        """Message with its images as protobuf fields. Copies them."""
        return type(self.head).FromString(self.SerializeToString())


FrameMessage = pb.Frame | ImageMessage[pb.Frame]
ObservationMessage = pb.Observation | ImageMessage[pb.Observation]


def split(type: type[M], data: Buffer) -> ImageMessage[M]:
    """Message in `data`, whose images stay there. Raises DecodeError for other bytes."""
    images: dict[str, memoryview] = {}
    head = _stripped(memoryview(data), _layout(type.DESCRIPTOR), "", images)
    return ImageMessage(type.FromString(head), images)


def apart(message: M | ImageMessage[M]) -> ImageMessage[M]:
    """The message with its images apart."""
    if isinstance(message, ImageMessage):
        return message
    return split(type(message), message.SerializeToString())


def kept(message: T) -> T:
    """The message with images of its own, for a handler that keeps it."""
    if not isinstance(message, ImageMessage):
        return message
    images = {path: memoryview(bytes(image)) for path, image in message.images.items()}
    return ImageMessage(message.head, images)  # pyright: ignore[reportReturnType]


def image_data(message: Message | ImageMessage, field: str) -> Buffer:
    """Bytes of the raw image in a field of the message."""
    apart = message.images.get(field) if isinstance(message, ImageMessage) else None
    return getattr(message, field).data if apart is None else apart


@dataclass(frozen=True)
class _Place:
    """Field of a message type that contains images. inner: its own such fields; None: the bytes of
    an image."""

    name: str
    inner: dict[int, _Place] | None


@cache
def _layout(type: Descriptor) -> dict[int, _Place]:
    """Fields of a message type that contain raw images, by their numbers."""
    if type.full_name == _IMAGE:
        return {_DATA: _Place("", None)}
    found = {}
    for field in type.fields:
        if field.message_type is not None and field.has_presence:  # a message, not a list
            inner = _layout(field.message_type)
            if inner:
                found[field.number] = _Place(field.name, inner)
    return found


def _stripped(
    data: memoryview, layout: dict[int, _Place], path: str, images: dict[str, memoryview]
) -> bytes:
    """Bytes of the message without its images, which are added to `images`."""
    if not layout:
        return data.tobytes()
    out: list[Buffer] = []
    copied = 0
    for number, begin, content, end in _fields(data):
        place = layout.get(number)
        if place is None:
            continue
        out.append(data[copied:begin])
        copied = end
        if place.inner is None:
            images[path] = data[content:end].toreadonly()
            continue
        inner = f"{path}.{place.name}" if path else place.name
        head = _stripped(data[content:end], place.inner, inner, images)
        out += [_tag(number), _varint(len(head)), head]
    out.append(data[copied:])
    return b"".join(out)


def _joined(
    head: memoryview, layout: dict[int, _Place], path: str, images: Mapping[str, memoryview]
) -> list[Buffer]:
    """Bytes of the message with its images; the inverse of `_stripped`."""
    out: list[Buffer] = []
    copied = 0
    for number, begin, content, end in _fields(head) if layout else ():
        place = layout.get(number)
        if place is None or place.inner is None:
            continue
        out.append(head[copied:begin])
        copied = end
        inner = f"{path}.{place.name}" if path else place.name
        pieces = _joined(head[content:end], place.inner, inner, images)
        out += [_tag(number), _varint(sum(map(len, pieces))), *pieces]
    out.append(head[copied:])
    if _DATA in layout and layout[_DATA].inner is None and path in images:
        out += [_tag(_DATA), _varint(len(images[path])), images[path]]
    return out


def _fields(data: memoryview) -> Iterator[tuple[int, int, int, int]]:
    """(number, begin, begin of the content, end) of each field. Raises DecodeError.

    For a field of another wire type than bytes, the number is 0.
    """
    at = 0
    while at < len(data):
        begin = at
        tag, at = _read_varint(data, at)
        wire_type, size = tag & 7, 0
        if tag < 8:
            raise DecodeError("a field has the number 0")
        if wire_type == _VARINT:
            _, at = _read_varint(data, at)
        elif wire_type == _BYTES:
            size, at = _read_varint(data, at)
        elif wire_type in (_FIXED64, _FIXED32):
            size = 8 if wire_type == _FIXED64 else 4
        else:
            raise DecodeError(f"a field has wire type {wire_type}, which no message of ours has")
        if at + size > len(data):
            raise DecodeError(f"a field of {size} bytes ends after its message")
        yield tag >> 3 if wire_type == _BYTES else 0, begin, at, at + size
        at += size


def _read_varint(data: memoryview, at: int) -> tuple[int, int]:
    """(value, index after it)."""
    value = shift = 0
    while at < len(data) and shift < 64:
        byte = data[at]
        value |= (byte & 0x7F) << shift
        at += 1
        if byte < 0x80:
            return value, at
        shift += 7
    raise DecodeError("a number has no end")


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def _tag(number: int) -> bytes:
    return _varint(number << 3 | _BYTES)
