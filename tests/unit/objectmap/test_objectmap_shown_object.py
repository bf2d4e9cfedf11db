"""What the robot shows to its camera counts for the held object, and leaves the map as it is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import pytest
from helios_core import proto as pb
from helios_core.codec import observation_to_proto, vector_to_proto
from helios_core.errors import InvalidInput
from helios_core.topics import HELD_OBJECT, NAMES_AT, OBSERVATION
from helios_core.types import Detection, Observation, Shown
from helios_objectmap.fusion.label_image import read
from helios_objectmap.instances.image_text import ImageTextScores
from helios_objectmap.instances.name_sightings import BROAD_PRIOR
from helios_objectmap.shown_object import ShownNames, ShownObject
from objectmap_scene import CONTEXT, ROOM, SETTINGS, looking_at, mug_at, observe
from test_objectmap_service import Rig

HAND_M = (0.5, 0.0, 1.0)
EYE = looking_at(0.0, 0.0, HAND_M)
IN_HAND = ("mug", (0.46, -0.04, 0.96), (0.54, 0.04, 1.04))


def seen(turn_deg: float, names: Sequence[str], seq: int = 1) -> Observation:
    """The shown object, called by these names."""
    view = observe([*ROOM, IN_HAND], EYE, seq=seq)
    mask = next(d for d in view.detections if d.class_name == "mug").mask
    box = next(d for d in view.detections if d.class_name == "mug").box_xyxy
    shown = Shown(HAND_M, math.radians(turn_deg))
    named = tuple(Detection(name, 0.6, box, mask) for name in names)
    own = tuple(d for d in named if d.class_name == "mug")
    others = tuple(d for d in named if d.class_name != "mug")
    frame = replace(view.frame, shown=shown, held="mug")
    return replace(view, frame=frame, detections=own, others=others)


def judged(*sides: Sequence[str]):
    shown = ShownObject()
    for k, names in enumerate(sides):
        shown.note(seen(k * 360 / len(sides), names))
    return shown.names("mug", BROAD_PRIOR)


def test_a_name_that_most_sides_give_is_believed() -> None:
    right = judged(["mug"], ["mug", "glass"], ["mug"], ["glass"])
    assert right.probability > 0.95
    assert right.sides == 4
    assert right.names == (("mug", 0.75), ("glass", 0.5))
    assert judged(["glass"], ["mug", "glass"], ["glass"], ["glass"]).probability < 0.05


def test_without_any_detection_nothing_is_held_against_it() -> None:
    nothing = judged([], [], [])
    assert (nothing.probability, nothing.sides, nothing.names) == (1.0, 0, ())


def test_furniture_behind_the_hand_and_furniture_names_do_not_count() -> None:
    shown = ShownObject()
    view = seen(0, ["cabinet"])
    behind = observe([*ROOM, mug_at(1.2, 0.0)], EYE)
    there = tuple(replace(d, class_name="glass") for d in behind.detections)
    assert there
    shown.note(replace(view, detections=(), others=(*view.others, *there)))
    assert shown.names("mug", BROAD_PRIOR).sides == 0


def test_views_of_one_side_count_as_one_side() -> None:
    shown = ShownObject()
    for turn_deg in (0, 2, -2, 180):
        shown.note(seen(turn_deg, ["mug"]))
    assert shown.names("mug", BROAD_PRIOR).sides == 2


def test_the_next_object_in_the_hand_begins_anew() -> None:
    shown = ShownObject()
    shown.note(seen(0, ["glass"]))
    shown.note(observe(ROOM, EYE))
    assert shown.names("mug", BROAD_PRIOR).names == (("glass", 1.0),)  # of the last one shown
    shown.note(seen(0, ["mug"]))
    assert shown.names("mug", BROAD_PRIOR).names == (("mug", 1.0),)


def test_the_service_answers_and_its_map_stays_as_it_is() -> None:
    rig = Rig()
    rig.ask_for()
    rig.see(seq=1)
    before = rig.objects()
    rig.bus.publish(OBSERVATION, observation_to_proto(seen(0, ["mug", "glass"], seq=2)))
    assert rig.acks[-1].accepted
    assert rig.acks[-1].id.seq == 2
    after = rig.objects()
    assert [(o.id, o.score, o.gaussians) for o in after] == [
        (o.id, o.score, o.gaussians) for o in before
    ]
    reply = rig.bus.call(HELD_OBJECT, pb.HeldObjectRequest(class_name="mug"), 30.0)
    assert reply.sides == 1
    assert {n.name: n.share for n in reply.names} == {"mug": 1.0, "glass": 1.0}
    assert reply.probability == pytest.approx(1 / (1 + BROAD_PRIOR.rival))  # both as often


def test_image_text_scores_of_the_shown_object_count_against_those_of_all_views() -> None:
    rated = ImageTextScores()
    for k, score in enumerate([0.2, 0.3] * 20):
        rated.note(read(observe(ROOM, EYE, seq=k), CONTEXT, 1, 0.25, 8.0), {"mug": score})

    def judged_at(score: float) -> ShownNames:
        shown = ShownObject()
        shown.note(replace(seen(0, ["mug", "glass"]), class_scores={"mug": score}))
        return shown.names("mug", BROAD_PRIOR, rated)

    high, low = judged_at(0.45), judged_at(0.2)
    assert high.image_text_nats is not None
    assert low.image_text_nats is not None
    assert high.image_text_nats > 0 > low.image_text_nats
    assert high.probability > 1 / (1 + BROAD_PRIOR.rival) > low.probability


def test_without_a_detection_image_text_scores_decide() -> None:
    nothing = ShownNames(1.0, 0, ())
    assert nothing.with_image_text(None).probability == 1.0
    assert nothing.with_image_text(0.0).probability == 0.5
    assert nothing.with_image_text(3.0).probability > 0.9


def test_the_service_says_what_a_box_was_called() -> None:
    rig = Rig(SETTINGS.model_copy(update={"look_alikes": "compared"}))
    rig.ask_for()
    rig.see(seq=1)
    (mug,) = [o for o in rig.objects() if o.class_name == "mug"]
    empty = pb.Vector3(x=50.0, y=50.0, z=50.0)
    request = pb.NamesAtRequest(
        class_name="mug",
        center_m=[vector_to_proto(mug.center_m), empty],
        size_m=[vector_to_proto(mug.size_m)] * 2,
    )
    called, unknown = rig.bus.call(NAMES_AT, request, 30.0).probability
    assert called == pytest.approx(1.0)
    assert unknown == 0.5
    request.class_name = "glass"
    assert rig.bus.call(NAMES_AT, request, 30.0).probability[0] < called


@pytest.mark.parametrize(
    "request_",
    [
        pb.NamesAtRequest(class_name="mug", center_m=[pb.Vector3()]),
        pb.NamesAtRequest(
            class_name="mug", center_m=[pb.Vector3(x=math.nan)], size_m=[pb.Vector3()]
        ),
        pb.NamesAtRequest(class_name="mug", center_m=[pb.Vector3()], size_m=[pb.Vector3(x=-1)]),
        pb.NamesAtRequest(class_name="mug", center_m=[pb.Vector3()], size_m=[pb.Vector3(x=1e6)]),
        pb.NamesAtRequest(class_name="mug", center_m=[pb.Vector3(x=1e300)], size_m=[pb.Vector3()]),
    ],
)
def test_boxes_that_make_no_sense_are_refused(request_: pb.NamesAtRequest) -> None:
    with pytest.raises(InvalidInput, match=r"box|centre"):
        Rig().bus.call(NAMES_AT, request_, 30.0)
