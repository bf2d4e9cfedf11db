"""Tests `helios up --robot push`: frames arrive by curl and over a WebSocket, as documented."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import httpx
import numpy as np
import pytest
from helios_core.geometry import camera_on_base, se2_to_se3
from helios_examples.room import look
from helios_examples.room_robot import CAMERA
from websockets.sync.client import connect

from tests.e2e.own_robot_up import OwnUp, own_robot_up
from tests.support import LOOPBACK, wait_until


@pytest.fixture(scope="module")
def up(tmp_path_factory: pytest.TempPathFactory) -> Iterator[OwnUp]:
    needed = ("bridge", "detector", "map2d", "objectmap")
    with own_robot_up(tmp_path_factory.mktemp("push"), "push", needed, "paint") as up:
        yield up


def write_frame(folder: Path, x_m: float = 0.0, yaw_rad: float = 0.0, **more: Any) -> None:
    """Write meta.json, color.png and depth.png of the example room."""
    T_world_cam = camera_on_base(se2_to_se3(x_m, 0.0, yaw_rad), 1.2, 0.4)
    color, depth_m = look(CAMERA, T_world_cam)
    cv2.imwrite(str(folder / "color.png"), color[..., ::-1])
    cv2.imwrite(str(folder / "depth.png"), np.rint(depth_m * 1000).astype(np.uint16))
    meta = {"K": CAMERA.matrix.ravel().tolist(), "T_world_cam": T_world_cam.tolist(), **more}
    (folder / "meta.json").write_text(json.dumps(meta))


def post(up: OwnUp, folder: Path) -> httpx.Response:
    files = {name: (folder / f"{name}.png").read_bytes() for name in ("color", "depth")}
    data = {"meta": (folder / "meta.json").read_text()}
    return LOOPBACK.post(f"{up.address}/v1/frames", data=data, files=files, timeout=60)


def test_the_curl_command_of_the_docs_works(up: OwnUp, tmp_path: Path) -> None:
    if shutil.which("curl") is None:
        pytest.skip("there is no curl")
    page = (Path(__file__).parents[2] / "docs/how-to/push-frames.md").read_text()
    (line,) = (line for line in page.splitlines() if line.startswith("curl ") and "color=@" in line)
    write_frame(tmp_path)
    line = line.replace("http://127.0.0.1:8080", up.address)
    done = subprocess.run(
        ["bash", "-c", line],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
        env=os.environ,
    )
    answer = json.loads(done.stdout)
    assert answer["integrated"], answer
    assert [m["map"] for m in answer["maps"]] == ["map2d/occupancy"]


def test_pushed_frames_build_a_map(up: OwnUp, tmp_path: Path) -> None:
    for k in range(4):
        write_frame(tmp_path, yaw_rad=k * np.pi / 2)
        answer = post(up, tmp_path)
        assert answer.status_code == 200, answer.text
        assert answer.json()["integrated"]
    wait_until(
        lambda: LOOPBACK.get(f"{up.address}/v1/map/occupancy.png", timeout=60).status_code == 200,
        60,
        "there is a picture of the map",
    )
    assert LOOPBACK.get(f"{up.address}/v1/camera.jpg", timeout=60).status_code == 200


def test_requested_classes_become_objects(up: OwnUp, tmp_path: Path) -> None:
    def integrated() -> bool:  # the first frames may reach a map before the search context does
        write_frame(tmp_path, x_m=0.1, classes=["box"], wait_s=10)
        answer = post(up, tmp_path).json()
        return answer["integrated"] and len(answer["maps"]) == 3

    wait_until(integrated, 60, "all three maps have taken a frame")
    objects = LOOPBACK.get(f"{up.address}/v1/objects", timeout=60).json()["objects"]
    near_m = [np.linalg.norm(np.subtract(o["center_m"], (1.6, 0.0, 0.55))) for o in objects]
    assert min(near_m) < 0.25, objects


def test_each_frame_over_a_websocket_gets_an_answer(up: OwnUp, tmp_path: Path) -> None:
    with connect(f"ws://127.0.0.1:{up.port}/v1/frames/ws") as socket:
        numbers = []
        for k in range(5):
            write_frame(tmp_path, x_m=0.1 * k, wait_s=10, robot_boot_id="walk")
            socket.send((tmp_path / "meta.json").read_text())
            socket.send((tmp_path / "color.png").read_bytes())
            socket.send((tmp_path / "depth.png").read_bytes())
            answer = json.loads(socket.recv(timeout=30))
            boot, _, number = answer["id"].split("/")
            assert boot == "walk"
            assert any(m["accepted"] for m in answer["maps"]), answer
            numbers.append(int(number))
    assert numbers == sorted(set(numbers))


def test_an_image_of_many_megabytes_is_accepted(up: OwnUp, tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (1080, 1920, 3), np.uint8)
    depth = np.full((1080, 1920), 2000, np.uint16)
    cv2.imwrite(str(tmp_path / "color.png"), noise)
    cv2.imwrite(str(tmp_path / "depth.png"), depth)
    assert (tmp_path / "color.png").stat().st_size > 5_000_000
    T_world_cam = camera_on_base(se2_to_se3(0.0, 0.0, 0.0), 1.2, 0.4)
    K = [1400.0, 0, 959.5, 0, 1400.0, 539.5, 0, 0, 1]
    meta = {"K": K, "T_world_cam": T_world_cam.tolist(), "wait_s": 30, "robot_boot_id": "large"}
    (tmp_path / "meta.json").write_text(json.dumps(meta))
    answer = post(up, tmp_path)
    assert answer.status_code == 200, answer.text
    taken = [m["map"] for m in answer.json()["maps"] if m["accepted"]]
    assert "map2d/occupancy" in taken, answer.text


def test_invalid_input_is_refused_and_ends_no_service(up: OwnUp, tmp_path: Path) -> None:
    before = {name: s["pid"] for name, s in up.services().items()}
    write_frame(tmp_path, wait_s=0)
    meta = json.loads((tmp_path / "meta.json").read_text())
    spoiled: list[dict[str, Any]] = [
        {"meta": "{}"},
        {"meta": json.dumps(meta | {"K": [1e300, 0, 0, 0, 1e300, 0, 0, 0, 1]})},
        {"meta": json.dumps(meta | {"K": [0] * 9})},
        {"meta": json.dumps(meta | {"T_world_cam": np.diag([1, 1, 1, 0]).tolist()})},
        {"meta": (tmp_path / "meta.json").read_text().replace("1.2", "NaN")},
        {"color": b""},
        {"color": b"\x89PNG\r\n\x1a\n" + bytes(8) + b"\xff" * 64},
        {"depth": (tmp_path / "color.png").read_bytes()},
        {"depth": (tmp_path / "depth.png").read_bytes()[:50]},
        {"color": os.urandom(2_000_000)},
    ]
    good: dict[str, Any] = {
        "meta": json.dumps(meta),
        "color": (tmp_path / "color.png").read_bytes(),
        "depth": (tmp_path / "depth.png").read_bytes(),
    }
    for wrong in spoiled:
        parts = good | wrong
        answer = LOOPBACK.post(
            f"{up.address}/v1/frames",
            data={"meta": parts["meta"]},
            files={"color": parts["color"], "depth": parts["depth"]},
            timeout=30,
        )
        assert answer.status_code == 400, (wrong.keys(), answer.text)
        assert answer.headers["content-type"] == "application/problem+json"
    refused = LOOPBACK.post(f"{up.address}/v1/frames", content=b"x" * 17_000_000, timeout=30)
    assert refused.status_code == 413
    assert post(up, tmp_path).status_code == 200
    assert {name: s["pid"] for name, s in up.services().items()} == before
