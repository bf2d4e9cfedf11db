"""Tests video frames: layout, map panel, frames between keyframes, observer and file."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from eval_constructed_scene import CELL_M, constructed_map, constructed_scene, thing
from helios_core import proto as pb
from helios_core.codec import object_to_proto, state_to_proto
from helios_core.errors import InvalidInput, Unavailable
from helios_core.geometry import se2_to_se3
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import CONTEXT, DECISION, OBJECTS, PLAN, ROBOT_STATE, SNAPSHOT, TASK
from helios_core.types import RobotState
from helios_eval.video.bus_observer import MOST_GLIDES, Watcher, glides
from helios_eval.video.drawing import GREEN, PAPER, RED
from helios_eval.video.frame_content import Scene
from helios_eval.video.frame_layout import (
    BOTTOM,
    CAMERA_W,
    CAMERA_X,
    HEAD,
    HEIGHT,
    MAP_W,
    MAP_X,
    WHY_W,
    WHY_X,
    WIDTH,
    frame_picture,
)
from helios_eval.video.map_panel import map_picture, window_of
from helios_eval.video.mp4_writer import VideoFile

from tests.full_disk import small_disk

HOSTILE = "‮\x00\n<b>" + "W" * 2000 + "\u0301" * 30 + "漢字🤖"


def hostile_scene() -> Scene:
    decision = pb.Decision(index=2**31, rule=HOSTILE, why=HOSTILE, settings={HOSTILE: math.inf})
    for k in range(60):
        terms = {HOSTILE: math.nan, "total": 1e300 * (-1) ** k, "value": -12345.678}
        decision.candidates.append(pb.Candidate(kind=HOSTILE, name=HOSTILE, terms=terms))
    decision.candidates[59].chosen = True
    decision.candidates[59].position_m.CopyFrom(pb.Vector3(x=math.nan, y=math.inf))
    task = pb.Task(
        instruction=HOSTILE,
        message=HOSTILE,
        seeking=HOSTILE,
        state="failed",
        cause=HOSTILE,
        phase=HOSTILE,
        kind="move",
        max_steps=2**32 - 1,
    )
    return constructed_scene(
        task=task,
        title=HOSTILE,
        held=HOSTILE,
        verdict=HOSTILE,
        roles={HOSTILE: "object"},
        decisions=(decision, decision),
        step=10**12,
        story=((10**12, HOSTILE),) * 9,
        objects=tuple(thing(HOSTILE, k % 5, k // 5, 0.3, 0.5 + k / 100) for k in range(30)),
        robot=(math.nan, math.inf, 0.0),
        path_m=np.array([[math.nan, 1e300], [math.inf, 0.0]]),
    )


SCENES = {"empty": Scene, "usual": constructed_scene, "hostile": hostile_scene}


@pytest.mark.parametrize("name", SCENES)
def test_every_scene_gives_a_frame_and_no_drawing_leaves_its_panel(name):
    picture = frame_picture(SCENES[name]())
    assert picture.shape == (HEIGHT, WIDTH, 3)
    assert picture.dtype == np.uint8
    body = picture[HEAD + 2 :]
    for left, right in (
        (0, CAMERA_X),
        (CAMERA_X + CAMERA_W + 1, MAP_X),
        (MAP_X + MAP_W + 1, WHY_X),
        (WHY_X + WHY_W + 1, WIDTH),
    ):
        assert (body[:, left:right] == PAPER).all(), f"something is drawn between {left}-{right}"
    assert (picture[BOTTOM + 1 :] == PAPER).all()


@pytest.mark.parametrize("shape", [(640, 480), (480, 640), (10, 400), (400, 10), (1, 1)])
def test_camera_images_of_any_shape_fit(shape):
    scene = constructed_scene(color=np.full((*shape, 3), 90, np.uint8), detections=())
    picture = frame_picture(scene)
    assert (picture[HEAD + 2 :, CAMERA_X + CAMERA_W + 1 : MAP_X] == PAPER).all()


def test_the_outcome_has_its_colour():
    def has(color: tuple[int, int, int], scene: Scene) -> bool:
        return bool((frame_picture(scene)[:HEAD] == color).all(axis=2).any())

    won = pb.Task(state="succeeded", kind="move", phase="place")
    lost = pb.Task(state="failed", cause="stuck", kind="move", phase="pick")
    assert has(GREEN, constructed_scene(task=won))
    assert has(RED, constructed_scene(task=lost))
    assert not has(RED, constructed_scene(task=won, verdict="the truth: success", right=True))
    assert has(RED, constructed_scene(task=won, verdict="the truth: place missed"))


def test_the_map_window_contains_all_known_cells():
    view = constructed_map()
    for width, height in ((460, 380), (200, 140), (140, 400)):
        window = window_of(view, width, height)
        rows, columns = np.nonzero(view.occupancy >= 0)
        known = np.stack([columns, rows], -1) * CELL_M + view.origin_m
        uv = window.at(known)
        assert uv.min() >= 0
        assert (uv <= (width, height)).all()


def test_the_map_is_drawn_with_x_to_the_right_and_y_up():
    """A point at larger y is drawn higher."""
    view = constructed_map()
    window = window_of(view, 460, 380)
    (u0, v0), (u1, v1) = window.at(np.array([[0.0, 0.0], [1.0, 2.0]]))
    assert (u1 - u0) == pytest.approx(window.px_per_m)
    assert (v0 - v1) == pytest.approx(2 * window.px_per_m)
    plain = constructed_scene(objects=(), path_m=np.zeros((0, 2)), decisions=(), robot=None)
    picture = map_picture(plain, 460, 380)
    (wall,) = window.at(np.array([[-1.42, 3.0]])).round().astype(int)
    (floor,) = window.at(np.array([[0.5, 1.0]])).round().astype(int)
    assert picture[wall[1], wall[0]].max() < 120
    assert picture[floor[1], floor[0]].min() > 240


def test_an_empty_map_is_drawn():
    view = constructed_map()
    unknown = np.full(view.shape, -1, np.int8)
    blank = replace(view, occupancy=unknown, explored=np.zeros(view.shape, bool), frontiers=())
    assert map_picture(constructed_scene(map=blank), 200, 100).shape == (100, 200, 3)
    none = replace(
        blank,
        occupancy=unknown[:0, :0],
        explored=np.zeros((0, 0), bool),
        top_m=np.zeros((0, 0), np.float32),
        values={},
    )
    assert map_picture(constructed_scene(map=none), 200, 100).shape == (100, 200, 3)


# --- between frames ------------------------------------------------------------------------------
def test_a_long_move_gets_intermediate_frames():
    before = constructed_scene(robot=(0.0, 0.0, 0.0), step=4)
    after = constructed_scene(robot=(1.0, 0.0, 0.0), step=5)
    between = glides(before, after)
    assert [round(s.robot[0], 3) for s in between if s.robot] == [0.333, 0.667]
    assert {s.step for s in between} == {4}
    assert glides(before, constructed_scene(robot=(0.2, 0.0, 0.0))) == []
    assert len(glides(before, constructed_scene(robot=(99.0, 0.0, 0.0)))) == MOST_GLIDES - 1
    assert glides(None, after) == []
    assert glides(Scene(), after) == []


def test_intermediate_frames_turn_through_the_smaller_angle():
    before = constructed_scene(robot=(0.0, 0.0, math.pi - 0.5))
    (mid,) = glides(before, constructed_scene(robot=(0.0, 0.0, -math.pi + 0.5)))
    assert mid.robot is not None
    assert math.cos(mid.robot[2]) == pytest.approx(-1.0, abs=1e-6)


# --- the bus -------------------------------------------------------------------------------------
def test_the_watcher_reports_one_scene_per_keyframe():
    hub = MemoryHub()
    services, bus = MemoryBus(hub), MemoryBus(hub)
    seen: list[Scene] = []
    services.serve(
        OBJECTS,
        lambda _: pb.ObjectsReply(objects=[object_to_proto(thing("mug", 1.0, 2.0, 0.1, 0.4))]),
    )
    services.serve(SNAPSHOT, lambda _: pb.MapSnapshot())
    watcher = Watcher(bus, "helios-paper · home 1", seen.append)
    services.publish(
        CONTEXT,
        pb.SearchContext(
            id="c", classes=[pb.SearchClass(name="mug", role="object", threshold=0.3)]
        ),
    )
    for message in ("looking around", "looking around", "going to pick the mug"):
        services.publish(TASK, pb.Task(id="t", message=message, steps=3))
    services.publish(DECISION, pb.Decision(rule="global search"))
    services.publish(PLAN, pb.Plan(path_m=[0.0, 0.0, 1.0, 2.0]))
    state = RobotState(se2_to_se3(1.0, 2.0, 0.5), held="mug", last_seq=1)
    for seq in (1, 1, 2):
        services.publish(
            ROBOT_STATE, state_to_proto(RobotState(state.T_world_base, held="mug", last_seq=seq))
        )
    assert len(seen) == 2
    scene = seen[-1]
    assert scene.robot == pytest.approx((1.0, 2.0, 0.5))
    assert (scene.held, scene.map, scene.title) == ("mug", None, "helios-paper · home 1")
    assert scene.roles == {"mug": "object"}
    assert scene.path_m.tolist() == [[0.0, 0.0], [1.0, 2.0]]
    assert [o.class_name for o in scene.objects] == ["mug"]
    assert scene.story == ((3, "looking around"), (3, "going to pick the mug"))
    assert [d.rule for d in scene.decisions] == ["global search"]
    watcher.close()
    services.publish(ROBOT_STATE, state_to_proto(RobotState(state.T_world_base, last_seq=9)))
    assert len(seen) == 2


# --- the file ------------------------------------------------------------------------------------
def frames_of(path) -> list[np.ndarray]:
    reader = cv2.VideoCapture(str(path))
    frames = []
    while (got := reader.read())[0]:
        frames.append(got[1][..., ::-1])
    reader.release()
    return frames


def test_a_written_video_can_be_read(tmp_path):
    path = tmp_path / "deep" / "tiny.mp4"
    shades = (30, 120, 220)
    with VideoFile(path, 64, 48, 8) as video:
        for shade in shades:
            video.write(np.full((48, 64, 3), (shade, 60, 60), np.uint8), times=2)
        assert video.frames == 6
    assert b"vp09" in path.read_bytes()  # browsers play VP9 but not MPEG-4 part 2
    frames = frames_of(path)
    assert len(frames) == 6
    assert frames[0].shape == (48, 64, 3)
    for shade, frame in zip(np.repeat(shades, 2), frames, strict=True):
        assert abs(float(frame[..., 0].mean()) - shade) < 12  # red stays red
        assert abs(float(frame[..., 2].mean()) - 60) < 12


def test_an_error_leaves_a_readable_video(tmp_path):
    path = tmp_path / "short.mp4"

    def breaks() -> None:
        with VideoFile(path, 64, 48, 8) as video:
            video.write(np.zeros((48, 64, 3), np.uint8), 3)
            raise RuntimeError("the episode broke")

    with pytest.raises(RuntimeError):
        breaks()
    assert len(frames_of(path)) == 3


def test_a_video_without_a_frame_leaves_the_existing_one_unchanged(tmp_path):
    path = tmp_path / "film.mp4"
    path.write_bytes(b"an earlier film")
    with pytest.raises(RuntimeError), VideoFile(path, 64, 48, 8):
        raise RuntimeError("the episode broke")
    assert path.read_bytes() == b"an earlier film"
    assert [p.name for p in tmp_path.iterdir()] == ["film.mp4"]


def test_a_full_disk_leaves_the_existing_video_unchanged(tmp_path):
    noise = np.random.default_rng(0).integers(0, 255, (480, 640, 3), np.uint8)

    def write(path):
        with VideoFile(path, 640, 480, 8) as video:
            for shift in range(20):
                video.write(np.roll(noise, 31 * shift, axis=1))

    with small_disk(tmp_path / "disk", kilobytes=600) as disk:
        (disk / "film.mp4").write_bytes(b"an earlier film")
        with pytest.raises(Unavailable, match=r"film\.mp4 cannot be written"):
            write(disk / "film.mp4")
        assert (disk / "film.mp4").read_bytes() == b"an earlier film"
        assert [path.name for path in disk.iterdir()] == ["film.mp4"]


def test_wrong_files_and_frames_are_refused(tmp_path):
    with pytest.raises(InvalidInput, match=r"\.mp4"):
        VideoFile(tmp_path / "film.avi", 64, 48, 8)
    (tmp_path / "file").write_text("")
    with pytest.raises(Unavailable, match="cannot be written"):
        VideoFile(tmp_path / "file" / "film.mp4", 64, 48, 8)
    with (
        VideoFile(tmp_path / "a.mp4", 64, 48, 8) as video,
        pytest.raises(InvalidInput, match="64 x 48"),
    ):
        video.write(np.zeros((48, 63, 3), np.uint8))
