"""Messages of the object map: objects, one in detail, the held one, acknowledgements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from helios_core import proto as pb
from helios_core.codec import object_to_proto, vector_from_proto, vector_to_proto
from helios_core.codec.frames import pinhole_from_proto
from helios_core.errors import InvalidInput
from helios_core.geometry import Pinhole
from helios_core.image_messages import ObservationMessage
from helios_core.keyframe_acks import MapPart
from helios_core.printable_text import counted
from helios_core.types import AlignedBox, FrameId, ObjectInstance, Observation
from numpy.typing import NDArray

from helios_objectmap.camera import kept_pixels
from helios_objectmap.instances.registry import Moment
from helios_objectmap.instances.summary import Grasp
from helios_objectmap.shown_object import ShownNames

MOST_BOXES = 1000
MOST_PIXELS = 1920 * 1200
MOST_SIDE_PX = 16_384
MOST_SIDE_M, MOST_AWAY_M = 3.0, 10_000.0


def object_message(thing: ObjectInstance, relocalised: bool) -> pb.ObjectInstance:
    """Message of an object. relocalised: True if it comes from a stored map."""
    out = object_to_proto(thing)
    out.relocalised = relocalised
    return out


def content_in_words(objects: int, gaussians: int, newest: FrameId | None) -> str:
    """Content of a map, for people. newest: newest frame in it."""
    frames = "" if newest is None else f", frames up to number {newest.seq}"
    return f"{counted(objects, 'object')}, {counted(gaussians, 'Gaussian')}{frames}"


def held_message(seen: ShownNames) -> pb.HeldObjectReply:
    """Message of the names of the shown object."""
    names = [pb.NameShare(name=name, share=share) for name, share in seen.names]
    return pb.HeldObjectReply(
        probability=seen.probability,
        sides=seen.sides,
        names=names,
        image_text_nats=seen.image_text_nats,
    )


def camera_of(camera: pb.Pinhole, stride_px: int = 1) -> Pinhole:
    """Camera of a request. stride_px: pixel step of the picture, in both directions.

    Raises InvalidInput for implausible intrinsics, or if the picture has over MOST_PIXELS pixels or
    over MOST_SIDE_PX in a row or column.
    """
    out = pinhole_from_proto(camera)
    sides = kept_pixels(out.width, stride_px), kept_pixels(out.height, stride_px)
    if max(sides) > MOST_SIDE_PX:
        raise InvalidInput(
            f"{out.width}x{out.height} pixels asked for; at most {MOST_SIDE_PX * stride_px} to a "
            "side"
        )
    if sides[0] * sides[1] > MOST_PIXELS:
        raise InvalidInput(
            f"{out.width}x{out.height} pixels asked for; at most {MOST_PIXELS * stride_px**2} in "
            "one picture"
        )
    return out


def boxes_of(request: pb.NamesAtRequest) -> list[AlignedBox]:
    """Centre [3] and size [3] of each box; world, m. Raises InvalidInput."""
    if len(request.center_m) != len(request.size_m) or len(request.size_m) > MOST_BOXES:
        raise InvalidInput(
            f"{len(request.center_m)} centres and {len(request.size_m)} sizes of boxes came; "
            f"wanted as many of both, {MOST_BOXES} at most"
        )
    pairs = zip(request.center_m, request.size_m, strict=True)
    boxes = [(vector_from_proto(center), vector_from_proto(size)) for center, size in pairs]
    for box in boxes:
        center_m, size_m = box
        if (
            not (np.abs(center_m) < MOST_AWAY_M).all()
            or not ((size_m >= 0) & (size_m <= MOST_SIDE_M)).all()
        ):
            raise InvalidInput(
                f"a box has the centre {center_m} m and the size {size_m} m; wanted sides of 0 to "
                f"{MOST_SIDE_M:g} m, and a centre within {MOST_AWAY_M:g} m of the origin"
            )
    return boxes


def point_of(request: pb.RetireRequest) -> NDArray[np.float64]:
    """Point [3] at which a thing was picked; world, m. Raises InvalidInput."""
    point_m = vector_from_proto(request.point_m)
    if not (np.abs(point_m) < MOST_AWAY_M).all():
        raise InvalidInput(
            f"point_m is {point_m.tolist()}; wanted a point within {MOST_AWAY_M:g} m of the "
            "origin, in metres"
        )
    return point_m


def nothing_retired(request: pb.RetireRequest) -> str:
    """Why no object was retired."""
    reasons = []
    if request.object_id:
        reasons.append(f"there is no object {request.object_id}")
    if request.radius_m > 0:
        reasons.append(f"no object lies within {request.radius_m:g} m of the point")
    return ", and ".join(reasons)


def detail_message(
    thing: ObjectInstance, history: Sequence[Moment], grasp: Grasp
) -> pb.ObjectDetail:
    """Message of one object with the history of its score, its grasp points and its grasp box."""
    return pb.ObjectDetail(
        object=object_to_proto(thing),
        history=[
            pb.Moment(stamp_ns=m.stamp_ns, views=m.views, score=m.score, class_score=m.class_score)
            for m in history
        ],
        points_m=grasp.points_m.ravel().tolist(),
        box_center_m=vector_to_proto(grasp.center_m),
        box_size_m=vector_to_proto(grasp.size_m),
        box_yaw_rad=grasp.yaw_rad,
    )


def ack_message(
    message: ObservationMessage, version: int, *, reason: str = "", update_ms: float = 0.0
) -> pb.Ack:
    """Acknowledgement of an observation. reason: why it is refused; empty: it is accepted."""
    return pb.Ack(
        service="objectmap",
        part=MapPart.OBJECTS,
        id=message.frame.id,
        accepted=not reason,
        reason=reason,
        version=version,
        update_ms=update_ms,
        context_id=message.context_id,
    )


def with_own_color(observation: Observation) -> Observation:
    """The observation with a colour image of its own: the received one may lie in shared memory."""
    frame = observation.frame
    return replace(observation, frame=replace(frame, color=frame.color.copy()))
