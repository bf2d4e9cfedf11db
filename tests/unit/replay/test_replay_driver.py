"""The replay driver: a data set in the role of a robot."""

from __future__ import annotations

import json
import math
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
from helios_core.errors import InvalidInput
from helios_core.geometry import (
    R_BODY_CAM,
    base_below_camera,
    camera_on_base,
    is_rigid,
    se2_to_se3,
    yaw_of,
)
from helios_core.robot import EndOfRecording, Forward, Observe, Pick, Place, Tilt, Turn
from helios_replay import ReplayDriver
from helios_replay.driver import REMEMBERED
from helios_replay.rgbd_folder import read_dataset, read_image
from hypothesis import given
from hypothesis import strategies as st

WIDTH, HEIGHT = 64, 48
META = {
    "width": WIDTH,
    "height": HEIGHT,
    "fx": 52.5,
    "fy": 52.5,
    "cx": 32.0,
    "cy": 24.0,
    "depth_scale_m": 0.001,
}
HEADER = "frame,t_s,r00,r01,r02,tx,r10,r11,r12,ty,r20,r21,r22,tz"
metres = st.floats(-20, 20)
angles = st.floats(-3.1, 3.1)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Three frames, numbered 0, 4 and 8, whose camera drives along x."""
    (tmp_path / "frames").mkdir()
    (tmp_path / "meta.json").write_text(json.dumps(META))
    lines = [HEADER]
    for k, number in enumerate((0, 4, 8)):
        T = camera_on_base(se2_to_se3(0.5 * k, 0.0, 0.0), height_m=1.3, tilt_rad=0.4)
        lines.append(",".join([str(number), str(k / 10), *(f"{v:.7f}" for v in T[:3].ravel())]))
        color = np.full((HEIGHT, WIDTH, 3), (250, 10, 10), np.uint8)  # blue, in OpenCV's order
        depth = np.full((HEIGHT, WIDTH), 1000 + k, np.uint16)
        depth[0, 0] = 0
        cv2.imwrite(str(tmp_path / f"frames/{number:06d}.jpg"), color)
        cv2.imwrite(str(tmp_path / f"frames/{number:06d}.png"), depth)
    (tmp_path / "poses.csv").write_text("\n".join(lines) + "\n")
    return tmp_path


def test_each_capture_gives_the_next_frame_then_the_recording_ends(folder: Path) -> None:
    driver = ReplayDriver(folder)
    captures = [driver.capture() for _ in range(3)]
    assert [c.stamp_ns for c in captures] == [0, 100_000_000, 200_000_000]
    assert [float(c.T_world_base[0, 3]) for c in captures] == pytest.approx([0, 0.5, 1.0])
    assert driver.state().finished
    for _ in range(2):
        with pytest.raises(EndOfRecording):
            driver.capture()


def test_rows_are_played_in_order_of_time(folder: Path) -> None:
    path = folder / "poses.csv"
    header, first, second, third = path.read_text().splitlines()
    path.write_text("\n".join([header, third, first, second]))
    driver = ReplayDriver(folder)
    assert [driver.capture().stamp_ns for _ in range(3)] == [0, 100_000_000, 200_000_000]


def test_a_limit_ends_the_recording_earlier(folder: Path) -> None:
    driver = ReplayDriver(folder, limit=1)
    driver.capture()
    with pytest.raises(EndOfRecording):
        driver.capture()


def test_colour_is_rgb_and_depth_is_in_metres(folder: Path) -> None:
    capture = ReplayDriver(folder).capture()
    assert capture.color.shape == (HEIGHT, WIDTH, 3)
    assert capture.color[5, 5, 2] > 200 > 50 > capture.color[5, 5, 0]
    assert capture.depth_m.dtype == np.float32
    assert capture.depth_m[5, 5] == pytest.approx(1.0)
    assert capture.depth_m[0, 0] == 0


def test_a_recording_refuses_motion_and_manipulation_with_a_reason(folder: Path) -> None:
    driver = ReplayDriver(folder)
    robot = driver.describe()
    assert (robot.can_move, robot.can_pick, robot.can_place) == (False, False, False)
    assert robot.camera_height_m == pytest.approx(1.3)
    actions = (Forward(1), Turn(1), Tilt(1), Pick((0, 0, 0), "cup"), Place((0, 0, 0)))
    for k, action in enumerate(actions):
        result = driver.act(action, f"a{k}")
        assert not result.succeeded
        assert "recording" in result.reason


def test_the_same_action_is_done_once(folder: Path) -> None:
    driver = ReplayDriver(folder)
    assert driver.act(Observe(), "a") == driver.act(Observe(), "a")
    assert driver.act(Observe(), "b").steps == 2


def test_only_the_last_results_are_remembered(folder: Path) -> None:
    driver = ReplayDriver(folder)
    for k in range(REMEMBERED + 1):
        driver.act(Observe(), str(k))
    assert driver.act(Observe(), "1").steps == 2
    assert driver.act(Observe(), "0").steps == REMEMBERED + 2


def test_a_stop_latches_until_cleared(folder: Path) -> None:
    driver = ReplayDriver(folder)
    driver.stop("because")
    assert driver.state().stopped
    assert not driver.act(Observe(), "a").succeeded
    driver.clear_stop()
    assert driver.act(Observe(), "b").succeeded


@given(metres, metres, angles, st.floats(0.1, 2), st.floats(-1.4, 1.4))
def test_the_base_is_below_the_camera_and_has_the_heading_of_the_camera(
    x_m: float, y_m: float, yaw_rad: float, height_m: float, tilt_rad: float
) -> None:
    T_world_base = se2_to_se3(x_m, y_m, yaw_rad)
    found = base_below_camera(camera_on_base(T_world_base, height_m, tilt_rad))
    np.testing.assert_allclose(found, T_world_base, atol=1e-6)


@given(angles)
def test_a_camera_that_looks_straight_down_still_has_a_heading(yaw_rad: float) -> None:
    T_world_cam = camera_on_base(se2_to_se3(1, 2, yaw_rad), 1.5, math.pi / 2)
    found = base_below_camera(T_world_cam)
    assert is_rigid(found)
    assert math.cos(yaw_of(found) - yaw_rad) == pytest.approx(1)


def test_a_camera_that_looks_along_x_gives_yaw_0() -> None:
    T_world_cam = np.eye(4)
    T_world_cam[:3, :3] = R_BODY_CAM
    assert yaw_of(base_below_camera(T_world_cam)) == 0


@pytest.mark.parametrize(
    "name", ["meta.json", "poses.csv", "frames/000004.jpg", "frames/000008.png"]
)
def test_a_missing_file_is_named(folder: Path, name: str) -> None:
    (folder / name).unlink()
    with pytest.raises(InvalidInput, match=name.replace(".", r"\.")):
        ReplayDriver(folder)


def test_a_folder_without_a_data_set_is_reported_with_the_formats(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for path in (tmp_path, tmp_path / "none", tmp_path / "file"):
        with pytest.raises(InvalidInput, match=rf"no data set at {path}; .*\.mcap.*groundtruth"):
            read_dataset(path)


@pytest.mark.parametrize("data", [b"", b"no image", None])
@pytest.mark.parametrize("suffix", ["jpg", "png"])
def test_a_corrupt_image_is_named_and_the_next_one_still_plays(
    folder: Path, suffix: str, data: bytes | None
) -> None:
    path = folder / f"frames/000004.{suffix}"
    path.write_bytes(path.read_bytes()[:30] if data is None else data)
    driver = ReplayDriver(folder)
    driver.capture()
    with pytest.raises(InvalidInput, match=rf"000004\.{suffix}"):
        driver.capture()
    assert driver.capture().stamp_ns == 200_000_000


def test_an_image_that_claims_a_huge_size_is_refused(folder: Path) -> None:
    path = folder / "frames/000000.png"
    data = bytearray(path.read_bytes())
    data[16:24] = struct.pack(">II", 30_000, 30_000)
    path.write_bytes(data)
    with pytest.raises(InvalidInput, match="megapixels"):
        ReplayDriver(folder).capture()


def test_an_image_of_another_size_or_bit_depth_is_refused(folder: Path) -> None:
    path = folder / "frames/000000.png"
    cv2.imwrite(str(path), np.ones((HEIGHT, WIDTH + 1), np.uint16))
    with pytest.raises(InvalidInput, match="65x48 uint16"):
        ReplayDriver(folder).capture()
    cv2.imwrite(str(path), np.ones((HEIGHT, WIDTH), np.uint8))
    with pytest.raises(InvalidInput, match="16 bit"):
        ReplayDriver(folder).capture()


@pytest.mark.parametrize(
    "text", ["", "[]", "{", '{"width": 64}', "[" * 200_000, '{"width": 1' + "0" * 400 + "}"]
)
def test_an_invalid_meta_file_is_refused_by_name(folder: Path, text: str) -> None:
    (folder / "meta.json").write_text(text)
    with pytest.raises(InvalidInput, match=r"meta\.json"):
        read_dataset(folder)


@pytest.mark.parametrize("value", [0, -1, "525", None, True, float("nan"), 1e300])
def test_an_invalid_number_in_the_meta_file_is_refused_by_name(folder: Path, value: object) -> None:
    (folder / "meta.json").write_text(json.dumps(META | {"fx": value}))
    with pytest.raises(InvalidInput, match="fx"):
        read_dataset(folder)


@pytest.mark.parametrize(
    "rows",
    [
        "",
        "0,0,1,0,0,0,0,1,0,0,0,0",
        "x,0,1,0,0,0,0,1,0,0,0,0,1,1",
        "0,0,1,0,0,nan,0,1,0,0,0,0,1,1",
        "0,0,2,0,0,0,0,1,0,0,0,0,1,1",
        "0,0,1,0,0,0,0,1,0,0,0,0,-1,1",
        "0,1e300,1,0,0,0,0,1,0,0,0,0,1,1",
        "0,-1e12,1,0,0,0,0,1,0,0,0,0,1,1",
        "0,nan,1,0,0,0,0,1,0,0,0,0,1,1",
        "-1,0,1,0,0,0,0,1,0,0,0,0,1,1",
        "9" * 300 + ",0,1,0,0,0,0,1,0,0,0,0,1,1",
    ],
)
def test_invalid_poses_are_refused_with_the_file_name(folder: Path, rows: str) -> None:
    (folder / "poses.csv").write_text(f"{HEADER}\n{rows}\n")
    with pytest.raises(InvalidInput, match=r"poses\.csv"):
        read_dataset(folder)


@given(st.binary())
def test_random_bytes_as_an_image_raise_invalid_input(
    tmp_path_factory: pytest.TempPathFactory, data: bytes
) -> None:
    folder = tmp_path_factory.getbasetemp() / "fuzz"
    (folder / "frames").mkdir(parents=True, exist_ok=True)
    (folder / "meta.json").write_text(json.dumps(META))
    (folder / "poses.csv").write_text(f"{HEADER}\n0,0,1,0,0,0,0,1,0,0,0,0,1,1\n")
    for suffix in ("jpg", "png"):
        (folder / f"frames/000000.{suffix}").write_bytes(data)
    with pytest.raises(InvalidInput):
        read_image(read_dataset(folder), 0)
