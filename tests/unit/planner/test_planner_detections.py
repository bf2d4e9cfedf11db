"""Detections lifted to world coordinates, and the belief of an agent that trusts them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helios_core.codec import observation_to_proto
from helios_core.geometry import Pinhole, camera_on_base, project, se2_to_se3
from helios_core.keyframe_acks import KeyframeAcks
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import OBSERVATION
from helios_core.types import Detection, Frame, FrameId, Observation
from helios_planner.robot.detections import MessageBuffer, Sighting, sighting_of, sightings_of
from helios_planner.search.candidate_beliefs import TrustingBelief
from helios_planner.settings import Settings
from hypothesis import given
from hypothesis import strategies as st
from planner_flat import coffee_table, flat
from planner_world import FakeWorld

CAMERA = Pinhole(fx=554.0, fy=554.0, cx=320.0, cy=240.0, width=640, height=480)


def observation_of(point_m: np.ndarray, T_world_cam: np.ndarray, half_px: int = 8) -> Observation:
    """Make an observation of a patch around a world point that faces the camera."""
    uv, z = project(point_m[None], CAMERA, T_world_cam)
    u, v = (round(float(c)) for c in uv[0])
    mask = np.zeros((480, 640), bool)
    box = (u - half_px, v - half_px, u + half_px + 1, v + half_px + 1)
    mask[box[1] : box[3], box[0] : box[2]] = True
    depth_m = np.full(mask.shape, 6.0, np.float32)  # the wall behind
    depth_m[mask] = z[0]
    frame = Frame(FrameId("b", 0, 1), 1, True, np.zeros((480, 640, 3), np.uint8), depth_m, CAMERA,
                  T_world_cam, np.eye(4))  # fmt: skip
    return Observation(frame, "c", (Detection("mug", 0.7, box, mask),), {}, "test")


@given(
    st.floats(-3, 3),
    st.floats(-3, 3),
    st.floats(-3.1, 3.1),
    st.floats(0, 0.8),
    st.floats(0.5, 4.0),
    st.floats(-0.4, 0.4),
    st.floats(-0.3, 0.3),
)
def test_a_lifted_mask_lies_at_the_position_of_the_object(
    x: float, y: float, yaw: float, tilt: float, away: float, left: float, down: float
) -> None:
    T = camera_on_base(se2_to_se3(x, y, yaw), 1.31, tilt)
    point = T[:3, :3] @ np.array([left * away, down * away, away]) + T[:3, 3]
    (found,) = sightings_of(observation_of(point, T))
    assert np.linalg.norm(found.center_m - point) < 0.01 + 0.002 * away
    assert (found.class_name, found.confidence) == ("mug", 0.7)


def test_a_mask_rim_on_the_wall_behind_does_not_move_the_object() -> None:
    T = camera_on_base(se2_to_se3(0, 0, 0), 1.31, 0.3)
    point = T[:3, :3] @ np.array([0.0, 0.0, 1.5]) + T[:3, 3]
    observation = observation_of(point, T)
    rim = observation.detections[0].mask.copy()
    x0, y0, x1, y1 = observation.detections[0].box_xyxy
    rim[y0 + 1 : y1 - 1, x0 + 1 : x1 - 1] = False
    assert rim.any()
    observation.frame.depth_m[rim] = 6.0
    (found,) = sightings_of(observation)
    assert np.linalg.norm(found.center_m - point) < 0.02


@pytest.mark.parametrize("share", [0.1, 1.0])
def test_saturated_depth_neither_stretches_nor_makes_a_sighting(share: float) -> None:
    observation = observation_of(np.array([2.0, 0.0, 1.0]), camera_on_base(np.eye(4), 1.31, 0.0))
    rows, columns = np.nonzero(observation.detections[0].mask)
    n = int(share * len(rows))
    observation.frame.depth_m[rows[:n], columns[:n]] = 65.535
    found = sightings_of(observation, max_depth_m=5.0)
    assert len(found) == (share < 1)
    assert all(s.size_m.max() < 0.1 for s in found)


def test_the_client_uses_no_depth_beyond_what_the_robot_measures() -> None:
    hub, acks = MemoryHub(), KeyframeAcks()
    inbox = MessageBuffer(MemoryBus(hub), acks, "c", max_depth_m=1.0)
    T = camera_on_base(np.eye(4), 1.31, 0.0)
    for seq, away_m in enumerate((3.0, 0.9)):
        seen = observation_of(np.array([away_m, 0.0, 1.31]), T)
        seen = replace(seen, frame=replace(seen.frame, id=FrameId("b", 0, seq)))
        MemoryBus(hub).publish(OBSERVATION, observation_to_proto(seen))
    (found,) = inbox.sightings()
    assert found.center_m[0] == pytest.approx(0.9, abs=0.02)


def test_an_observation_that_is_sent_twice_gives_its_sightings_once() -> None:
    hub = MemoryHub()
    inbox = MessageBuffer(MemoryBus(hub), KeyframeAcks(), "c", max_depth_m=5.0)
    seen = observation_of(np.array([0.9, 0.0, 1.31]), camera_on_base(np.eye(4), 1.31, 0.0))
    for _ in range(2):
        MemoryBus(hub).publish(OBSERVATION, observation_to_proto(seen))
    assert len(inbox.sightings()) == 1


def test_a_detection_without_depth_is_no_sighting() -> None:
    observation = observation_of(np.array([2.0, 0.0, 1.0]), camera_on_base(np.eye(4), 1.31, 0.0))
    observation.frame.depth_m[:] = 0
    assert sightings_of(observation) == []


def test_a_surface_has_its_outline_and_its_height() -> None:
    xy = np.stack(np.meshgrid(np.linspace(1, 2, 60), np.linspace(3, 3.5, 60)), -1).reshape(-1, 2)
    points = np.column_stack([xy, np.full(len(xy), 0.74)])
    table = sighting_of("table", 0.5, points, np.array([1.5, 0.0, 0.74]), at_side=False)
    assert table.top_m == pytest.approx(0.74)
    assert table.size_m == pytest.approx([1.0, 0.5, 0.0], abs=0.05)
    assert table.outline_m.min(axis=0) == pytest.approx([1, 3], abs=0.03)
    assert table.outline_m.max(axis=0) == pytest.approx([2, 3.5], abs=0.03)
    assert table.nearest_m == pytest.approx(3.0, abs=0.02)


# --- trusting them -------------------------------------------------------------------------------
def sighting_at(x: float, y: float, name: str = "mug") -> Sighting:
    points = np.array([x, y, 0.5]) + 0.02 * np.eye(3)
    return sighting_of(name, 0.4, points, np.zeros(3), at_side=False)


def belief_from(*sightings: Sighting) -> tuple[TrustingBelief, FakeWorld]:
    world = flat([coffee_table()])
    world.sightings = lambda: list(sightings)
    return TrustingBelief(world, Settings()), world


def test_every_detected_object_has_score_one() -> None:
    belief, _ = belief_from(sighting_at(1, 1), sighting_at(3, 3), sighting_at(5, 5, "table"))
    assert [o.score for o in belief.known("mug")] == [1.0, 1.0]
    assert len(belief.known("table")) == 1


def test_a_later_detection_of_the_same_object_updates_its_position() -> None:
    belief, _ = belief_from(sighting_at(1, 1), sighting_at(1.2, 1))
    (thing,) = belief.known("mug")
    assert thing.center_m[0] == pytest.approx(1.2, abs=0.02)
    assert thing.views == 2


def test_from_near_the_newest_detection_counts_or_else_the_first() -> None:
    belief, world = belief_from(sighting_at(1, 1))
    (thing,) = belief.known("mug")
    assert belief.from_near(thing, "mug", 0.3) is thing
    world.sightings = lambda: [sighting_at(1, 1), sighting_at(1.1, 1)]
    newest = belief.from_near(thing, "mug", 0.3)
    assert newest is not None
    assert newest.center_m[0] == pytest.approx(1.1, abs=0.02)


def test_a_picked_object_is_no_longer_in_the_belief() -> None:
    belief, _ = belief_from(sighting_at(1, 1), sighting_at(3, 3))
    first, second = belief.known("mug")
    belief.taken(first)
    assert belief.known("mug") == [second]
