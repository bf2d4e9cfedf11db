"""Map, objects, camera image and robot over HTTP."""

from __future__ import annotations

import io
import math
import threading
import time

import cv2
import numpy as np
from fastapi.testclient import TestClient
from helios_core import proto as pb
from helios_core.errors import DeadlineExceeded
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import CONTEXT, FRAME, KEYFRAME, PREVIEW, SNAPSHOT
from helios_gateway.box_drawing import Box, draw_boxes
from helios_gateway.class_colors import class_rgb
from helios_gateway.request_coalescing import RequestCoalescer

from tests.gateway_backend import Backend
from tests.gateway_home import snapshot


def image(data: bytes) -> np.ndarray:
    out = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert out is not None
    return out


def test_map_arrays_have_their_origin_cell_size_and_frontiers(
    backend: Backend, client: TestClient
) -> None:
    response = client.get("/v1/map/occupancy.npz")
    with np.load(io.BytesIO(response.content)) as file:
        assert file["occupancy"].dtype == np.int8
        assert set(np.unique(file["occupancy"])) == {-1, 0, 100}
        assert file["occupancy"].shape == file["explored"].shape == (140, 180)
        assert file["cell_m"] == 0.05
        assert file["origin_m"].tolist() == [0.0, 0.0]
        reported = client.get("/v1/map/frontiers").json()["frontiers"]
        assert reported
        assert file["frontier_id"].tolist() == [f["id"] for f in reported]
        assert file["frontier_center_m"].tolist() == [f["center_m"] for f in reported]
        assert file["frontier_reachable"].tolist() == [f["reachable"] for f in reported]
    with np.load(io.BytesIO(client.get("/v1/map/value/pick.npz").content)) as file:
        assert file["value"].dtype == np.float32
        row, column = np.unravel_index(file["value"].argmax(), file["value"].shape)
        assert abs((column + 0.5) * 0.05 - 1.7) < 0.05
        assert abs((row + 0.5) * 0.05 - 1.5) < 0.05


def test_the_cells_image_is_north_up_and_encodes_state_explored_and_value(
    backend: Backend, client: TestClient
) -> None:
    cells = image(client.get("/v1/map/cells.png?layer=pick").content)
    assert cells.shape == (140, 180, 3)
    value, explored, state = cells[139 - 30, 40]  # y 1.525 m, x 2.025 m: the coffee table
    assert (state, explored) == (255, 255)
    assert value > 200
    assert cells[0, 179].tolist() == [0, 0, 0]  # a room that was never seen
    assert (
        client.get("/v1/map/cells.png").content
        != client.get("/v1/map/cells.png?layer=pick").content
    )


def test_each_map_version_is_requested_only_once_from_map2d(
    backend: Backend, client: TestClient
) -> None:
    for _ in range(5):
        for path in ("", "/frontiers", "/cells.png", "/occupancy.npz", "/occupancy.png"):
            assert client.get(f"/v1/map{path}").status_code == 200
    assert backend.calls.count("snapshot") == 1
    assert backend.calls.count("picture") == 1
    backend.change_map()
    client.get("/v1/map/occupancy.png")
    reported = client.get("/v1/map").json()
    assert (reported["version"], reported["map_id"]) == (42, "m1")
    assert (backend.calls.count("snapshot"), backend.calls.count("picture")) == (2, 2)


def test_a_lower_version_of_a_restarted_map2d_is_accepted(
    backend: Backend, client: TestClient
) -> None:
    assert client.get("/v1/map").json()["version"] == 41
    backend.map_version = 3
    backend.bus.publish(CONTEXT, pb.SearchContext(id="c2"))
    assert client.get("/v1/map").json()["version"] == 3


def test_a_map_of_another_process_with_the_same_version_is_served(
    hub: MemoryHub, backend: Backend, client: TestClient
) -> None:
    before = client.get("/v1/map").json(), client.get("/v1/map/cells.png").content
    other = snapshot(backend.map_version, (0.0, 0.0, 0.0))
    other.map_id = "m2"
    other.occupancy = other.explored  # another ground

    def answer(request: pb.SnapshotRequest) -> pb.MapSnapshot:
        if request.if_newer == other.version:
            return pb.MapSnapshot(version=other.version, map_id=other.map_id, unchanged=True)
        return other

    MemoryBus(hub).serve(SNAPSHOT, answer)
    backend.bus.publish(CONTEXT, pb.SearchContext(id="c2"))
    after = client.get("/v1/map").json()
    assert (before[0]["map_id"], after["map_id"]) == ("m1", "m2")
    assert before[0]["version"] == after["version"]
    assert client.get("/v1/map/cells.png").content != before[1]


def test_map_images_have_an_entity_tag_and_are_not_sent_twice(
    backend: Backend, client: TestClient
) -> None:
    first = client.get("/v1/map/occupancy.png?size_px=128")
    assert first.headers["content-type"] == "image/png"
    assert image(first.content).shape[:2] == (128, 128)
    again = client.get(
        "/v1/map/occupancy.png?size_px=128", headers={"if-none-match": first.headers["etag"]}
    )
    assert (again.status_code, again.content) == (304, b"")


def test_a_corrupt_map_gets_status_500_with_the_reason(
    hub: MemoryHub, backend: Backend, client: TestClient
) -> None:
    bad = pb.MapSnapshot(version=1, cell_m=0.05, width=10, height=10, occupancy=b"no zlib")
    MemoryBus(hub).serve(SNAPSHOT, lambda _: bad)
    response = client.get("/v1/map")
    assert response.status_code == 500
    assert "occupancy of the map is corrupt" in response.json()["detail"]


def test_frontiers_have_values_and_positions(backend: Backend, client: TestClient) -> None:
    frontiers = client.get("/v1/map/frontiers").json()["frontiers"]
    assert frontiers[0] == {
        "id": 12,
        "center_m": [6.4, 2.0],
        "size_m": 1.3,
        "reachable": True,
        "values": {"pick": 0.21, "place": 0.33},
    }


def test_objects_have_the_documented_fields_and_no_nan(
    backend: Backend, client: TestClient
) -> None:
    backend.found[1].score = math.nan
    backend.found[1].center_m.x = math.inf
    response = client.get("/v1/objects")
    mug, table = response.json()["objects"][:2]
    assert set(mug) >= {"id", "class", "center_m", "size_m", "score", "class_score",
                        "uncertainty", "views", "gaussians", "probabilities"}  # fmt: skip
    assert (mug["class"], mug["score"], mug["views"]) == ("mug", 0.71, 7)
    assert (table["score"], table["center_m"][0]) == (None, None)


def test_detections_are_drawn_on_the_newest_image_but_not_on_the_raw_image(
    backend: Backend, client: TestClient
) -> None:
    frame = backend.publish_frame()
    plain = client.get("/v1/camera.jpg").content
    backend.publish_observation(frame)
    boxed = client.get("/v1/camera.jpg")
    assert boxed.headers["content-type"] == "image/jpeg"
    assert image(boxed.content).shape == (480, 640, 3)
    assert boxed.content != plain
    assert client.get("/v1/camera.jpg?raw=1").content == plain
    edge = image(boxed.content)[200, 200].astype(int)
    assert np.abs(edge - class_rgb("mug")[::-1]).max() < 60


def test_boxes_stay_on_newer_images_from_the_same_pose(
    backend: Backend, client: TestClient
) -> None:
    backend.publish_observation(backend.publish_frame())
    backend.publish_frame()
    frame = backend.publish_frame()
    response = client.get("/v1/camera.jpg")
    assert response.headers["x-frame-id"] == f"0/{frame.id.seq}"
    assert response.content != client.get("/v1/camera.jpg?raw=1").content


def test_a_preview_is_shown_with_its_boxes(backend: Backend, client: TestClient) -> None:
    _, jpeg = cv2.imencode(".jpg", np.full((240, 320, 3), 90, np.uint8))
    preview = pb.Preview(id=pb.FrameId(robot_boot_id="boot", seq=5), jpeg=jpeg.tobytes())
    mask = pb.Mask(x=4_000_000_000, y=10, width=4_000_000_000, height=50)
    preview.detections.append(pb.Detection(class_name="mug", score=math.nan, mask=mask))
    backend.bus.publish(PREVIEW, preview)
    assert image(client.get("/v1/camera.jpg").content).shape == (240, 320, 3)


def test_a_corrupt_image_gets_status_500_and_the_next_valid_image_is_shown(
    backend: Backend, client: TestClient
) -> None:
    frame = pb.Frame(id=pb.FrameId(robot_boot_id="boot", seq=0))
    frame.compressed_color.format = "jpeg"
    frame.compressed_color.data = b"\xff\xd8 this is no picture"
    for topic in (FRAME, KEYFRAME):
        backend.bus.publish(topic, frame)
    assert client.get("/v1/camera.jpg").status_code == 500
    backend.publish_frame()
    assert client.get("/v1/camera.jpg").status_code == 200


def test_the_robot_is_reported_with_its_pose_and_stop_now_latches(
    backend: Backend, client: TestClient
) -> None:
    robot = client.get("/v1/robot").json()
    assert robot["connected"] is True
    assert robot["description"]["name"] == "stretch"
    assert {k: round(v, 6) for k, v in robot["state"]["pose"].items()} == {
        "x_m": 3.1,
        "y_m": 2.2,
        "yaw_rad": 2.5,
    }
    assert client.post("/v1/robot/stop").json()["state"]["stopped"] is True
    assert client.post("/v1/robot/stop", json={"reason": "test"}).status_code == 200
    assert client.post("/v1/robot/stop", json={"reason": 5}).status_code == 200
    assert client.post("/v1/robot/clear-stop").json()["state"]["stopped"] is False


def test_boxes_outside_the_image_are_clipped() -> None:
    picture = np.zeros((60, 80, 3), np.uint8)
    boxes = (Box("ä long näme", 0.5, 70, 50, 500, 500), Box("x", 0.5, 900, 900, 1, 1))
    assert draw_boxes(picture, boxes).shape == (60, 80, 3)


def test_concurrent_requests_share_one_answer() -> None:
    made: list[int] = []
    results: RequestCoalescer[int] = RequestCoalescer(max_age_s=60)
    together = threading.Barrier(8)

    def make() -> int:
        made.append(1)
        return len(made)

    def ask() -> None:
        together.wait()
        results.get("key", "state", make)

    threads = [threading.Thread(target=ask) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(made) == 1
    assert results.get("key", "another state", make) == 2


def test_a_failure_is_shared_by_waiting_requests_and_the_next_request_retries() -> None:
    asked = threading.Semaphore(0)
    tried: list[int] = []
    failures: list[str] = []

    def clock() -> float:  # read once per request, and once more to compute
        asked.release()
        return time.monotonic()

    results: RequestCoalescer[int] = RequestCoalescer(max_age_s=60, clock=clock)

    def fail() -> int:
        tried.append(1)
        for _ in range(8 + 1):
            assert asked.acquire(timeout=20)
        raise DeadlineExceeded("map2d gave no answer in 5 s")

    def ask() -> None:
        try:
            results.get("key", "state", fail)
        except DeadlineExceeded as error:
            failures.append(error.message)

    threads = [threading.Thread(target=ask) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failures == 8 * ["map2d gave no answer in 5 s"]
    assert len(tried) == 1
    assert results.get("key", "state", lambda: 5) == 5
