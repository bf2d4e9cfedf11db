"""Folders in the format of TUM's RGB-D data sets."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from helios_core.errors import InvalidInput
from helios_core.geometry import R_BODY_CAM, quaternion_from_rotation
from helios_replay import ReplayDriver
from helios_replay.format_detection import open_source

SIZE = (48, 64)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Three images at 0.0, 0.1 and 0.2 s; depth 5 ms later; poses each 10 ms, along x."""
    for kind in ("rgb", "depth"):
        (tmp_path / kind).mkdir()
    rgb, depth = ["# color images"], ["# depth maps"]
    for k in range(3):
        cv2.imwrite(str(tmp_path / f"rgb/{k}.png"), np.full((*SIZE, 3), (250, 10, k), np.uint8))
        cv2.imwrite(str(tmp_path / f"depth/{k}.png"), np.full(SIZE, 5000 * (k + 1), np.uint16))
        rgb.append(f"{1000 + k / 10:.4f} rgb/{k}.png")
        depth.append(f"{1000 + k / 10 + 0.005:.4f} depth/{k}.png")
    (tmp_path / "rgb.txt").write_text("\n".join(rgb))
    (tmp_path / "depth.txt").write_text("\n".join(depth))
    q = " ".join(f"{v:.6f}" for v in quaternion_from_rotation(R_BODY_CAM))
    lines = [f"{1000 + k / 100:.4f} {k / 100:.4f} 0 1.2 {q}" for k in range(22)]
    (tmp_path / "groundtruth.txt").write_text("# t x y z qx qy qz qw\n" + "\n".join(lines))
    (tmp_path / "calibration.txt").write_text("60 60 32 24\n")
    return tmp_path


def test_a_tum_folder_gives_images_poses_and_metres(folder: Path) -> None:
    driver = ReplayDriver(folder)
    captures = [driver.capture() for _ in range(3)]
    assert [float(c.depth_m[0, 0]) for c in captures] == pytest.approx([1.0, 2.0, 3.0])
    assert [c.T_world_cam[0, 3] for c in captures] == pytest.approx([0.0, 0.1, 0.2])
    assert [c.stamp_ns for c in captures] == [1000_000_000_000 + k * 100_000_000 for k in range(3)]
    assert captures[0].color[0, 0, 2] == 250
    assert captures[0].T_world_cam[:3, :3] == pytest.approx(R_BODY_CAM, abs=1e-5)
    assert driver.describe().camera_height_m == pytest.approx(1.2)


def test_an_associations_file_is_used_if_present(folder: Path) -> None:
    (folder / "associations.txt").write_text("1000.1 rgb/1.png 1000.1 depth/2.png\n")
    source = open_source(folder)
    assert len(source.shots) == 1
    assert float(source.read(0).depth_m[0, 0]) == pytest.approx(3.0)


def test_images_without_a_pose_are_left_out_and_counted(folder: Path) -> None:
    path = folder / "groundtruth.txt"
    assert open_source(folder).left_out == ""
    path.write_text("\n".join(path.read_text().splitlines()[:8]))
    source = open_source(folder)
    assert len(source.shots) == 1
    assert source.left_out == "2 of 3 images left out: no depth or no pose within 0.02 s"


def test_associations_are_played_in_order_of_time(folder: Path) -> None:
    rows = [f"{1000 + k / 10} rgb/{k}.png {1000 + k / 10} depth/{k}.png" for k in (2, 0, 1)]
    (folder / "associations.txt").write_text("\n".join(rows))
    source = open_source(folder)
    assert [shot.time_s for shot in source.shots] == pytest.approx([0.0, 0.1, 0.2])
    assert [float(source.read(k).depth_m[0, 0]) for k in range(3)] == pytest.approx([1, 2, 3])


def test_the_file_lists_may_be_missing(folder: Path) -> None:
    for kind in ("rgb", "depth"):
        (folder / f"{kind}.txt").unlink()
        for k in range(3):
            (folder / kind / f"{k}.png").rename(folder / kind / f"{1000 + k / 10:.3f}.png")
    assert len(open_source(folder).shots) == 3


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("groundtruth.txt", "", "no pose"),
        ("groundtruth.txt", "1 2 3", "8 columns"),
        ("groundtruth.txt", "1000 0 0 1 9 9 9 9", "no pose"),
        ("groundtruth.txt", "1000 0 nan 1 0 0 0 1", "a number is wanted"),
        ("rgb.txt", "x rgb/0.png", "a number is wanted"),
        ("calibration.txt", "0 0 0 0", "positive"),
        ("depth.txt", "5 depth/0.png", "no image with a depth image"),
    ],
)
def test_invalid_file_contents_are_refused_in_one_sentence(
    folder: Path, name: str, text: str, words: str
) -> None:
    (folder / name).write_text(text)
    with pytest.raises(InvalidInput, match=words) as error:
        open_source(folder)
    assert "\n" not in error.value.message


def test_a_time_beyond_the_range_of_stamps_is_refused(folder: Path) -> None:
    (folder / "associations.txt").write_text("1e12 rgb/1.png 1e12 depth/1.png\n")
    (folder / "groundtruth.txt").write_text("1e12 0 0 1 0 0 0 1\n")
    with pytest.raises(InvalidInput, match="the time 1e"):
        open_source(folder)


def test_a_non_standard_image_size_needs_a_calibration(folder: Path) -> None:
    (folder / "calibration.txt").unlink()
    with pytest.raises(InvalidInput, match=r"calibration\.txt"):
        open_source(folder)
