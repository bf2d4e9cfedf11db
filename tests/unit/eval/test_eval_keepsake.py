"""What is kept of a failed episode comes back as it was."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helios_core.errors import InvalidInput
from helios_eval.episodes import keepsake
from helios_eval.episodes.keepsake import Keepsake, Marked

KEPT = Keepsake(
    agent="helios", semantics="noisy", seed=7, preset="demo-v1", instruction="Move the mug",
    cause="object not found", message="nowhere",
    occupancy=np.array([[-1, 0, 100], [0, 0, 0]], np.int8), origin_m=(-1.5, 2.0), cell_m=0.025,
    trajectory_m=np.array([[0.0, 0.0], [0.5, 0.25]]), start_pose=(0.0, 0.0, 1.5),
    candidates=(Marked("mug_1", (1.0, 2.0, 0.8), (0.1, 0.1, 0.1)),), goals=(),
    beliefs=(Marked("mug", (1.1, 2.0, 0.8), (0.1, 0.1, 0.1), 0.61, 0.7),), camera_jpeg=b"\xff\xd8",
)  # fmt: skip


def test_a_keepsake_comes_back_as_it_was(tmp_path: Path) -> None:
    path = keepsake.save(tmp_path, KEPT)
    assert path == tmp_path / "failed" / "helios-noisy-7.npz"
    assert keepsake.all_of(tmp_path) == [path]
    back = keepsake.load(path)
    np.testing.assert_array_equal(back.occupancy, KEPT.occupancy)
    np.testing.assert_array_equal(back.trajectory_m, KEPT.trajectory_m)
    same = {"occupancy": KEPT.occupancy, "trajectory_m": KEPT.trajectory_m}
    assert replace(back, **same) == KEPT


def test_an_agent_that_never_moved_has_an_empty_trajectory(tmp_path: Path) -> None:
    path = keepsake.save(tmp_path, replace(KEPT, trajectory_m=np.zeros((0, 2))))
    assert keepsake.load(path).trajectory_m.shape == (0, 2)


def test_a_file_that_is_none_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "x.npz"
    path.write_bytes(b"no zip")
    with pytest.raises(InvalidInput, match=r"x\.npz"):
        keepsake.load(path)
