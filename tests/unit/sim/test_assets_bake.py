"""Tests baking furniture: reading, mesh simplification, boxes, surfaces, the cache."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from helios_client.cli import run
from helios_core.errors import InvalidInput, Unavailable
from helios_sim.assets import asset_pack as packs
from helios_sim.assets import sweethome_library as libraries
from helios_sim.assets.asset_baking import Baked, bake
from helios_sim.assets.asset_pack import Model
from helios_sim.assets.collision_boxes import levelled, merged_boxes
from helios_sim.assets.flat_surfaces import largest_rectangle
from helios_sim.assets.mesh_simplification import refined, with_normals
from helios_sim.assets.obj_reader import Part, load_parts
from helios_sim.assets.surface_sampling import face_normals, sample
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tests.unit.sim.assets_library import CHAIR, CHOICES, write_library, write_package


@pytest.fixture(scope="module")
def baked(tmp_path_factory: pytest.TempPathFactory) -> Baked:
    folder = tmp_path_factory.mktemp("furniture")
    write_library(folder / "source")
    return bake(folder / "source", folder / "cache", CHOICES)


def model(baked: Baked, key: str) -> Model:
    return next(m for m in baked.pack.models if m.key == key)


def sphere(rings: int = 40) -> Part:
    a, b = np.meshgrid(np.linspace(0, np.pi, rings), np.linspace(0, 2 * np.pi, rings))
    points = np.stack([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)], axis=-1)
    at = np.arange(rings * rings).reshape(rings, rings)
    p, q, r, s = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    faces = np.concatenate([np.stack([p, s, r], -1), np.stack([p, r, q], -1)]).reshape(-1, 3)
    uv = np.stack([b / (2 * np.pi), a / np.pi], axis=-1).reshape(-1, 2)
    picture = np.full((4, 4, 3), 90, np.uint8)
    return Part(points.reshape(-1, 3), faces, (1.0, 1.0, 1.0), uv, picture)


# ---- the source


def test_a_package_and_its_folder_hold_the_same_models(tmp_path: Path) -> None:
    path = write_library(tmp_path / "there")
    package = write_package(path, tmp_path / "furniture.deb")
    with libraries.open_libraries(package) as a, libraries.open_libraries(path.parent) as b:
        assert [x.sha256 for x in a] == [x.sha256 for x in b]
        assert list(a[0].entries) == ["Tiny/table", "Tiny/chair", "Tiny/chest", "Tiny/mug"]
        assert a[0].entries["Tiny/chair"].licence == "CC-BY-3.0"


def test_an_invalid_source_is_refused_with_advice(tmp_path: Path) -> None:
    package = write_package(write_library(tmp_path / "a"), tmp_path / "furniture.deb")
    cut = tmp_path / "cut.deb"
    cut.write_bytes(package.read_bytes()[:-200])
    (tmp_path / "empty").mkdir()
    (tmp_path / "text.sh3f").write_text("nothing")
    for source in (cut, tmp_path / "empty", tmp_path / "text.sh3f", tmp_path / "nowhere"):
        with pytest.raises(InvalidInput, match=r"apt|dpkg-deb"):
            bake(source, tmp_path / "cache", CHOICES)


def test_a_library_under_an_unknown_licence_is_refused(tmp_path: Path) -> None:
    write_library(tmp_path / "a", licence="All rights reserved")
    with pytest.raises(InvalidInput, match="licence"):
        bake(tmp_path / "a", tmp_path / "cache", CHOICES)


def test_without_the_package_the_command_shows_how_to_install_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(libraries, "INSTALLED", tmp_path / "missing")
    assert run(["assets", "bake", "--cache", str(tmp_path)]) == 1
    assert "sudo apt install sweethome3d-furniture" in capsys.readouterr().err


# ---- the models


def test_a_chair_is_converted_to_our_axes_with_its_back_at_positive_y(tmp_path: Path) -> None:
    write_library(tmp_path)
    with libraries.open_libraries(tmp_path) as (library,):
        entry = library.entries["Tiny/chair"]
        parts = load_parts(library.folder(entry), entry)
    vertices = np.concatenate([p.vertices for p in parts])
    assert vertices.min(axis=0) == pytest.approx([-0.22, -0.23, 0.0])
    assert vertices.max(axis=0) == pytest.approx([0.22, 0.23, 0.9])
    assert vertices[vertices[:, 2] > 0.6][:, 1].min() > 0.19
    for part in parts:  # normals point outward from the middle of each box
        normals, _ = face_normals(part.vertices, part.faces)
        middle = part.vertices[part.faces].mean(axis=1)
        for start in range(0, len(part.faces), 12):
            box = slice(start, start + 12)
            away = middle[box] - middle[box].mean(axis=0)
            assert (np.einsum("kx,kx->k", normals[box], away) > 0).all()


def test_textures_are_small_and_glass_is_opaque_and_grey(baked: Baked) -> None:
    assert [p.shape for p in baked.pack.pictures.values()] == [(256, 192, 3)]
    (look,) = model(baked, "Tiny/mug").looks
    assert 0.7 < min(look.rgb) < max(look.rgb) < 0.95
    colors = {look.rgb for look in model(baked, "Tiny/chair").looks}
    assert colors == {(0.8, 0.1, 0.1), (1.0, 1.0, 1.0)}


def test_a_broken_model_is_refused_by_name(tmp_path: Path) -> None:
    path = write_library(tmp_path)
    with libraries.open_libraries(path) as (library,):
        entry = library.entries["Tiny/chair"]
        for text in ("f 1 2 3", "v 0 x 0", "v 0 0 0", CHAIR.replace("f 1/1", "f 999/1")):
            files = library.folder(entry)
            files["model.obj"].seek(0)
            files["model.obj"].truncate()
            files["model.obj"].write(text.encode())
            with pytest.raises(InvalidInput, match="Tiny/chair"):
                load_parts(files, entry)


def test_a_simplified_sphere_keeps_its_shape_normals_and_texture() -> None:
    (thin,) = refined([sphere()], 600)
    assert len(thin.faces) < 900
    part, normals = with_normals(thin)
    assert np.linalg.norm(part.vertices, axis=1) == pytest.approx(1.0, abs=0.06)
    outward = np.einsum("kx,kx->k", normals, part.vertices)
    assert np.percentile(outward, 2) > 0.9
    assert part.uv is not None
    # v is the polar angle over pi, whatever triangle a corner is in.
    polar = np.arccos(np.clip(part.vertices[:, 2], -1, 1)) / np.pi
    assert np.percentile(np.abs(part.uv[:, 1] - polar), 95) < 0.03


def test_the_edges_of_a_box_stay_sharp(baked: Baked) -> None:
    (look,) = model(baked, "Tiny/chest+Tiny/chest").looks
    assert np.abs(look.normals).max(axis=1) == pytest.approx(1.0, abs=0.01)


def test_modules_of_one_model_stand_in_a_row(baked: Baked) -> None:
    assert model(baked, "Tiny/chest+Tiny/chest").size_m == pytest.approx((1.0, 0.42, 0.55))


# ---- boxes and surfaces


def test_boxes_cover_the_surface_and_stay_within_its_bounds(baked: Baked) -> None:
    for baked_model in baked.pack.models:
        boxes = np.array(baked_model.boxes)
        half = np.array(baked_model.size_m) / 2
        low, high = boxes[:, :3] - boxes[:, 3:], boxes[:, :3] + boxes[:, 3:]
        assert (low.min(axis=0) >= [-half[0] - 4e-3, -half[1] - 4e-3, -4e-3]).all()
        assert (high.max(axis=0) <= [half[0] + 4e-3, half[1] + 4e-3, 2 * half[2] + 4e-3]).all()
        for look in baked_model.looks:
            found = sample(look.vertices.astype(float), look.faces.astype(np.int64), 0.03).points
            inside = (found[:, None] >= low - 3e-3) & (found[:, None] <= high + 3e-3)
            assert np.any(np.all(inside, axis=2), axis=1).all(), baked_model.key


def test_the_space_between_the_legs_of_a_table_is_empty(baked: Baked) -> None:
    boxes = np.array(model(baked, "Tiny/table").boxes)
    under = np.array([0.0, 0.0, 0.3])
    assert not (np.abs(under - boxes[:, :3]) <= boxes[:, 3:]).all(axis=1).any()


def test_a_closed_model_is_solid(baked: Baked) -> None:
    boxes = np.array(model(baked, "Tiny/chest").boxes)
    assert (np.abs([0.0, 0.0, 0.3] - boxes[:, :3]) <= boxes[:, 3:]).all(axis=1).any()


def test_the_surfaces_are_the_table_top_and_the_chair_seat(baked: Baked) -> None:
    ((x, y, half_x, half_y, height),) = model(baked, "Tiny/table").surfaces
    assert (x, y, height) == pytest.approx((0.0, 0.0, 0.74), abs=0.005)
    assert (half_x, half_y) == pytest.approx((0.6, 0.4), abs=0.03)
    ((_, y, _, half_y, height),) = model(baked, "Tiny/chair").surfaces
    assert height == pytest.approx(0.45, abs=0.005)
    assert y + half_y < 0.23 - 0.03 + 1e-3, "the seat ends before the back"
    assert model(baked, "Tiny/mug").surfaces == ()


@given(
    boxes=hnp.arrays(float, (3, 6), elements=st.floats(0.05, 1.0)),
    surface=hnp.arrays(float, (1, 5), elements=st.floats(0.1, 0.8)),
)
def test_levelling_removes_only_the_volume_above_a_surface(
    boxes: np.ndarray, surface: np.ndarray
) -> None:
    cut = levelled(boxes, surface)
    x, y, half_x, half_y, height = surface[0]
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 2.2, (400, 3))
    was = _within(points, boxes)
    over = (np.abs(points[:, :2] - [x, y]) < [half_x, half_y]).all(axis=1) & (points[:, 2] > height)
    now = _within(points, cut[:-1])
    assert not now[over].any()
    near = (np.abs(np.abs(points[:, None] - boxes[:, :3]) - boxes[:, 3:]) < 2e-3).any(axis=(1, 2))
    near |= (np.abs(np.abs(points[:, :2] - [x, y]) - [half_x, half_y]) < 2e-3).any(axis=1)
    near |= np.abs(points[:, 2] - height) < 2e-3
    assert (now == was)[~over & ~near].all()


def _within(points: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    gap = np.abs(points[:, None] - boxes[None, :, :3])
    return np.any(np.all(gap <= boxes[None, :, 3:], axis=2), axis=1)


@given(hnp.arrays(bool, st.tuples(st.integers(1, 6), st.integers(1, 6))))
def test_the_largest_rectangle_equals_a_brute_force_search(mask: np.ndarray) -> None:
    rows, columns = mask.shape
    best = max(
        (r1 - r0) * (c1 - c0)
        for r0 in range(rows)
        for r1 in range(r0, rows + 1)
        for c0 in range(columns)
        for c1 in range(c0, columns + 1)
        if mask[r0:r1, c0:c1].all()
    )
    area, (r0, c0, r1, c1) = largest_rectangle(mask)
    assert area == best == (r1 - r0) * (c1 - c0)
    assert mask[r0:r1, c0:c1].all()


def test_a_sphere_is_covered_by_at_most_the_given_number_of_boxes() -> None:
    ball = sphere()
    assert len(merged_boxes(ball.vertices, ball.faces, 0.05, 20)) <= 20


# ---- the cache


def test_a_model_that_cannot_be_baked_is_named(baked: Baked) -> None:
    assert baked.left_out == {"Tiny/lost": "Tiny/lost is not in the source"}


def test_baking_again_changes_nothing_until_the_source_changes(tmp_path: Path) -> None:
    write_library(tmp_path / "a")
    first = bake(tmp_path / "a", tmp_path / "cache", CHOICES)
    stamp = (first.folder / packs.ARRAYS).stat().st_mtime_ns
    again = bake(tmp_path / "a", tmp_path / "cache", CHOICES)
    assert (first.fresh, again.fresh) == (True, False)
    assert (first.folder / packs.ARRAYS).stat().st_mtime_ns == stamp
    write_library(tmp_path / "a", licence="creativecommons.org/choose/zero/")
    other = bake(tmp_path / "a", tmp_path / "cache", CHOICES)
    assert other.fresh
    assert other.pack.digest != first.pack.digest
    names = sorted(path.name for path in (tmp_path / "cache").iterdir())
    assert names == ["current", other.folder.name]


def test_two_bakes_of_one_source_are_equal(baked: Baked, tmp_path: Path) -> None:
    write_library(tmp_path / "a")
    other = bake(tmp_path / "a", tmp_path / "cache", CHOICES)
    assert other.pack.models == baked.pack.models
    for a, b in zip(other.pack.models, baked.pack.models, strict=True):
        for x, y in zip(a.looks, b.looks, strict=True):
            assert np.array_equal(x.vertices, y.vertices)
            assert np.array_equal(x.uv, y.uv)


def test_a_damaged_foreign_or_missing_pack_is_refused_with_advice(tmp_path: Path) -> None:
    with pytest.raises(Unavailable, match="helios assets bake"):
        packs.read(tmp_path / "cache")
    write_library(tmp_path / "a")
    folder = bake(tmp_path / "a", tmp_path / "cache", CHOICES).folder
    arrays, index = folder / packs.ARRAYS, folder / packs.INDEX
    good = arrays.read_bytes(), index.read_text()
    head = json.loads(good[1])
    lost = {k: v for k, v in head.items() if k != "models"}
    for bad_arrays, bad_index in (
        (good[0][:-100], good[1]),
        (b"", good[1]),
        (good[0], good[1][:-100]),
        (good[0], "[]"),
        (good[0], json.dumps(head | {"format": "helios-furniture-99"})),
        (good[0], json.dumps(lost)),
    ):
        arrays.write_bytes(bad_arrays)
        index.write_text(bad_index)
        with pytest.raises(InvalidInput, match="helios assets bake"):
            packs.read(tmp_path / "cache")
    mended = bake(tmp_path / "a", tmp_path / "cache", CHOICES)
    assert mended.fresh
    assert packs.read(tmp_path / "cache").models == mended.pack.models


def test_a_failed_bake_leaves_the_old_pack(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_library(tmp_path / "a")
    first = bake(tmp_path / "a", tmp_path / "cache", CHOICES)

    def fail(*_: object) -> Path:
        raise OSError("no space left")

    monkeypatch.setattr(packs, "_put", fail)
    with pytest.raises(OSError, match="no space"):
        bake(tmp_path / "a", tmp_path / "cache", CHOICES[:2])
    assert packs.read(tmp_path / "cache").digest == first.pack.digest
    assert len(list((tmp_path / "cache").iterdir())) == 2


def test_the_show_command_and_the_attributions_name_author_and_licence(
    baked: Baked, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (baked.folder / packs.ATTRIBUTIONS).read_text()
    assert "| Tiny/table | Table | A. Carpenter | CC-BY-3.0 |" in text
    assert "https://creativecommons.org/licenses/by/3.0/" in text
    assert run(["assets", "show", "--json", "--cache", str(baked.folder.parent)]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert {row["licence"] for row in shown["models"]} == {"CC-BY-3.0"}
    table = next(row for row in shown["models"] if row["key"] == "Tiny/table")
    assert table["classes"] == ["dining table", "coffee table"]
    assert run(["assets", "show", "--cache", str(baked.folder / "nothing")]) == 1
    assert "helios assets bake" in capsys.readouterr().err
