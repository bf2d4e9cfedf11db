"""`/seen` and `/objects/{id}/views`: objects and past views that match a text or an object."""

from __future__ import annotations

import base64
import math
from typing import Annotated

from fastapi import APIRouter, Query
from helios_core import proto as pb
from helios_core.codec.frames import frame_id_from_proto
from helios_core.errors import HeliosError
from helios_core.name_rules import mentions_class
from helios_core.topics import RECALL

from helios_gateway import api_map_models, message_conversion
from helios_gateway.api_keys import Scope
from helios_gateway.dependencies import AddressedRobot, Maps, secured
from helios_gateway.error_responses import problems
from helios_gateway.robot_registry import RobotEndpoint
from helios_gateway.routes.objects import ObjectId

RECALL_S = 12.0  # includes the loading of the text model
MOST_VIEWS = 50  # requested from map2d, before the filter by place
NEAR_M = 0.4  # margin beyond an object's half diagonal
router = APIRouter(tags=["maps and camera"], dependencies=secured(Scope.READ))


@router.get("/seen", summary="Find where something was seen", responses=problems())
def seen(
    robot: AddressedRobot,
    maps: Maps,
    prompt: Annotated[
        str,
        Query(
            min_length=1,
            max_length=500,
            description="search text in natural language",
            examples=["a red mug"],
        ),
    ],
    limit: Annotated[int, Query(ge=1, le=50, description="maximum number of views")] = 5,
) -> api_map_models.SeenAnswer:
    """Find where something was seen: objects and past views that match a text.

    `objects` are the instances of the object map whose class the text names, `stored` those of a
    stored map in which the robot has not found its place. The scorer's
    image-text model ranks the past views, also for names that no search has used. A scorer
    without such a model (for instance the simulator's) gives the views in which the detector
    found the name while a search looked for it; then `views_note` says so.
    """
    recalled = _recalled(robot, pb.RecallRequest(prompt=prompt, most_places=limit))
    mapped = maps.objects()
    return api_map_models.SeenAnswer(
        prompt=prompt,
        objects=[
            found
            for found in sorted(mapped.objects, key=lambda o: -(o.score or 0.0))
            if mentions_class(prompt, found.class_name)
        ],
        stored=[one for one in mapped.stored if mentions_class(prompt, one.class_name)],
        views=[_view(place) for place in recalled.places],
        views_asked=recalled.views,
        views_note=recalled.note,
    )


@router.get("/objects/{id}/views", summary="List past views of an object", responses=problems(404))
def object_views(
    robot: AddressedRobot,
    maps: Maps,
    id: ObjectId,
    limit: Annotated[int, Query(ge=1, le=50, description="maximum number of views")] = 5,
) -> api_map_models.ViewList:
    """List past views of an object, from different sides, best first.

    A view matches if it shows the object's class near its place. `/v1/seen` describes the past
    views and their scores.
    """
    found = maps.object(id)
    asked = pb.RecallRequest(prompt=found.class_name, most_places=MOST_VIEWS)
    recalled = _recalled(robot, asked)
    near = [place for place in recalled.places if _shows(found, place)]
    return api_map_models.ViewList(
        views=[_view(place) for place in near[:limit]], views_note=recalled.note
    )


def _shows(found: api_map_models.ObjectInstance, place: pb.SeenPlace) -> bool:
    """True if the place is near the object's centre: within half its diagonal plus `NEAR_M`."""
    x, y, *_ = found.center_m
    width, depth, *_ = found.size_m
    if None in (x, y, width, depth):
        return False
    reach_m = NEAR_M + math.hypot(width or 0.0, depth or 0.0) / 2
    return math.hypot(place.x_m - (x or 0.0), place.y_m - (y or 0.0)) <= reach_m


def _recalled(robot: RobotEndpoint, request: pb.RecallRequest) -> pb.RecallReply:
    """Past views from map2d; if it does not answer, none, with the error as the note."""
    try:
        return robot.bus.call(RECALL, request, RECALL_S)
    except HeliosError as error:
        return pb.RecallReply(note=f"past views were not asked: {error.message}")


def _view(place: pb.SeenPlace) -> api_map_models.SeenView:
    camera = place.camera
    return api_map_models.SeenView(
        score=message_conversion.finite(place.score),
        class_name=place.class_name,
        center_m=[message_conversion.metres(place.x_m), message_conversion.metres(place.y_m)],
        camera=message_conversion.pose(camera.x_m, camera.y_m, camera.yaw_rad),
        stamp_s=place.stamp_ns / 1e9,
        frame_id=str(frame_id_from_proto(place.id)),
        jpeg_base64=base64.b64encode(place.jpeg).decode(),
    )
