"""The state folder and the map file of every release open in this version.

`tests/earlier_releases/state-VERSION.tar.xz` holds what `helios up --robot sim --seed 3` of that
release left. `python -m scripts.sample_state` makes the file of a new release.
"""

from __future__ import annotations

import io
import json
import tarfile
from pathlib import Path

import numpy as np
import pytest
from helios_core.errors import InvalidInput
from helios_gateway.map_archive import unpacked
from helios_map2d.epoch_map import EpochMap
from helios_map2d.files.map_file import decode_map
from helios_map2d.layers.parameters import MapRules
from helios_objectmap import persistence
from helios_objectmap.viewpoint_weights import Viewpoints
from helios_planner.tasks.store import Store

ROOT = Path(__file__).resolve().parents[2]
SAMPLES = sorted((ROOT / "tests/earlier_releases").glob("state-*.tar.xz"))


@pytest.fixture(params=SAMPLES, ids=lambda p: p.name.removesuffix(".tar.xz"))
def sample(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    with tarfile.open(request.param) as archive:
        archive.extractall(tmp_path, filter="data")
    return tmp_path


def map_of(data: bytes) -> EpochMap:
    return decode_map(data, MapRules(), 0.2, 0)[0]


def test_both_published_versions_have_a_sample() -> None:
    assert [p.name for p in SAMPLES[:2]] == ["state-0.1.0.tar.xz", "state-0.2.0.tar.xz"]


def test_tasks_and_decisions_of_an_earlier_release_are_listed(sample: Path) -> None:
    (folder,) = (sample / "state/planner").iterdir()
    store = Store(folder)
    try:
        tasks = {t.instruction: t.state for t in store.tasks()}
        assert tasks.pop("explore for five seconds") == "succeeded"
        assert len(tasks) == 1
        assert store.said == ""
        assert any(d.why for t in store.tasks() for d in store.decisions(t.id))
    finally:
        store.close()


def test_the_2d_map_of_an_earlier_release_is_used(sample: Path) -> None:
    ground = map_of((sample / "state/map2d/map2d.map").read_bytes()).published
    free_m2 = np.count_nonzero(ground.occupancy == 0) * MapRules().cell_m ** 2
    assert free_m2 > 10


def test_the_object_map_of_an_earlier_release_is_used(sample: Path) -> None:
    loaded = persistence.read((sample / "state/objectmap/objects.npz").read_bytes(), Viewpoints())
    assert loaded.content.registry.records
    assert len(loaded.content.store.means) > 100


def test_a_map_file_of_an_earlier_release_is_used(sample: Path) -> None:
    maps = unpacked((sample / "saved.map").read_bytes(), 100_000_000)
    map_of(maps.map2d)
    persistence.read(maps.objects, Viewpoints())


def test_an_object_map_of_a_later_release_is_refused_with_the_way_out(sample: Path) -> None:
    arrays = dict(np.load(sample / "state/objectmap/objects.npz"))
    header = json.loads(arrays["header"].tobytes()) | {"version": persistence.VERSION + 1}
    arrays["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
    later = io.BytesIO()
    np.savez(later, allow_pickle=False, **arrays)
    with pytest.raises(InvalidInput, match="use the HELIOS that wrote it, or start with an empty"):
        persistence.read(later.getvalue(), Viewpoints())


def test_a_2d_map_of_a_later_release_is_refused_with_the_way_out() -> None:
    with pytest.raises(InvalidInput, match="use the HELIOS that wrote it, or start with an empty"):
        map_of(b"a map of a later version")
