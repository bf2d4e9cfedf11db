"""Tests saving and loading failure snapshots."""

from __future__ import annotations

import contextlib
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helios_core.errors import InvalidInput
from helios_eval.episodes import failure_snapshot
from helios_eval.episodes.failure_snapshot import FailureSnapshot, MarkedObject
from hypothesis import given, settings
from hypothesis import strategies as st

KEPT = FailureSnapshot(
    key="ovmm|helios-paper|noisy|demo-v1|7||{}", agent="helios-paper", semantics="noisy", seed=7,
    instruction="Move the mug",
    cause="object not found", message="nowhere",
    occupancy=np.array([[-1, 0, 100], [0, 0, 0]], np.int8), origin_m=(-1.5, 2.0), cell_m=0.025,
    trajectory_m=np.array([[0.0, 0.0], [0.5, 0.25]]), start_pose=(0.0, 0.0, 1.5),
    candidates=(MarkedObject("mug_1", (1.0, 2.0, 0.8), (0.1, 0.1, 0.1)),), goals=(),
    beliefs=(MarkedObject("mug", (1.1, 2.0, 0.8), (0.1, 0.1, 0.1), 0.61, 0.7),),
    camera_jpeg=b"\xff\xd8",
)  # fmt: skip


def test_a_loaded_failure_snapshot_equals_the_saved_one(tmp_path: Path) -> None:
    path = failure_snapshot.save(tmp_path, KEPT)
    assert path.parent == tmp_path / "failed"
    assert path.name.startswith("helios-paper-noisy-7-")
    assert failure_snapshot.all_of(tmp_path) == [path]
    back = failure_snapshot.load(path)
    np.testing.assert_array_equal(back.occupancy, KEPT.occupancy)
    np.testing.assert_array_equal(back.trajectory_m, KEPT.trajectory_m)
    same = {"occupancy": KEPT.occupancy, "trajectory_m": KEPT.trajectory_m}
    assert replace(back, **same) == KEPT


def test_failures_are_selected_by_the_exact_agent_name(tmp_path: Path) -> None:
    """Agent names may be prefixes of each other."""
    mine = failure_snapshot.save(tmp_path, KEPT)
    others = [
        failure_snapshot.save(tmp_path, replace(KEPT, key=name, agent=name))
        for name in ("helios", "helios-ground")
    ]
    assert failure_snapshot.all_of(tmp_path, "helios-paper") == [mine]
    assert failure_snapshot.all_of(tmp_path, "helios") == others[:1]
    assert failure_snapshot.all_of(tmp_path) == sorted([mine, *others])


def test_snapshots_of_one_episode_with_different_settings_are_kept_side_by_side(
    tmp_path: Path,
) -> None:
    other = replace(KEPT, key=KEPT.key.replace("{}", '{"planner.tau_g": 0.3}'), cause="stuck")
    paths = [failure_snapshot.save(tmp_path, kept) for kept in (KEPT, other)]
    assert [failure_snapshot.load(path).cause for path in paths] == ["object not found", "stuck"]
    assert failure_snapshot.all_of(tmp_path) == sorted(paths)


@given(st.permutations(range(16)))
def test_those_of_the_lowest_seeds_are_kept_in_whatever_order_they_came(seeds: list[int]) -> None:
    """So the pictures of a run do not depend on how many episodes play at once."""
    with tempfile.TemporaryDirectory() as folder:
        for seed in seeds:
            failure_snapshot.keep(Path(folder), replace(KEPT, key=f"{seed}", seed=seed))
        left = [failure_snapshot.load(p).seed for p in failure_snapshot.all_of(Path(folder))]
    assert sorted(left) == list(range(failure_snapshot.MOST_KEPT))


def test_a_snapshot_with_an_empty_trajectory_is_loaded(tmp_path: Path) -> None:
    path = failure_snapshot.save(tmp_path, replace(KEPT, trajectory_m=np.zeros((0, 2))))
    assert failure_snapshot.load(path).trajectory_m.shape == (0, 2)


def test_a_file_that_is_no_snapshot_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "x.npz"
    path.write_bytes(b"no zip")
    with pytest.raises(InvalidInput, match=r"x\.npz"):
        failure_snapshot.load(path)


@given(data=st.data())
@settings(max_examples=200, deadline=None)
def test_a_damaged_file_is_refused_or_loaded_intact(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """The damage is a truncation or one changed byte."""
    path = failure_snapshot.save(tmp_path_factory.mktemp("run"), KEPT)
    written = bytearray(path.read_bytes())
    at = data.draw(st.integers(0, len(written) - 1))
    if data.draw(st.booleans()):
        written[at] ^= data.draw(st.integers(1, 255))
    else:
        del written[at:]
    path.write_bytes(written)
    with contextlib.suppress(InvalidInput):
        assert failure_snapshot.load(path).key == KEPT.key
