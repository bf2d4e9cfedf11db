"""Files that are no home, or mean harm: one sentence with a way out, and nothing else."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from contextlib import suppress
from pathlib import Path

import cv2
import pytest
from helios_core.errors import InvalidInput
from helios_sim.assets.image_header import pixels_of
from helios_sim.plans import PlanSource, drawn_home, home_of_plan
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.unit.sim.plan_files import LEFT, TWO_ROOMS, door, drawn, piece, room, write_plan


def _refused(path: Path) -> str:
    with pytest.raises(InvalidInput) as refusal:
        drawn_home(PlanSource.of(path))
    message = refusal.value.message
    assert "\n" not in message
    assert len(message) < 400
    return message


def _zip(path: Path, **entries: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in entries.items():
            archive.writestr(name.replace("_xml", ".xml"), content)
    return path


def test_a_file_of_a_version_before_xml_says_how_to_convert_it(tmp_path: Path) -> None:
    assert "save it" in _refused(_zip(tmp_path / "a.sh3d", Home=b"\xac\xed\x00\x05"))


def test_a_zip_file_of_something_else_is_refused(tmp_path: Path) -> None:
    assert "without Home.xml" in _refused(_zip(tmp_path / "a.sh3d", readme=b"hello"))


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="does not exist"):
        PlanSource.of(tmp_path / "none.sh3d")
    with pytest.raises(InvalidInput, match="is a folder"):
        PlanSource.of(tmp_path)


@given(cut=st.integers(0, 2000), seed=st.integers(0, 255))
@settings(max_examples=30, deadline=None)
def test_a_truncated_or_overwritten_file_never_gets_past_a_refusal(
    tmp_path_factory: pytest.TempPathFactory, cut: int, seed: int
) -> None:
    path = tmp_path_factory.mktemp("cut") / "a.sh3d"
    write_plan(path, (TWO_ROOMS, room("Kitchen", LEFT)))
    data = bytearray(path.read_bytes())
    at = cut % len(data)
    path.write_bytes(bytes(data[:at]) if seed % 2 else bytes(data[:at]) + bytes([seed]) * 40)
    with suppress(InvalidInput):
        drawn_home(PlanSource.of(path))


@pytest.mark.parametrize(
    "prolog",
    [
        '<!DOCTYPE home [<!ENTITY a "x"><!ENTITY b "&a;&a;&a;&a;">]>',
        '<!DOCTYPE home SYSTEM "file:///etc/passwd">',
        '<!DOCTYPE home [<!ENTITY x SYSTEM "file:///etc/passwd">]>',
    ],
)
def test_document_types_and_entities_are_refused(tmp_path: Path, prolog: str) -> None:
    xml = f"<?xml version='1.0'?>{prolog}<home name='n'></home>".encode()
    assert "document type or entities" in _refused(_zip(tmp_path / "a.sh3d", Home_xml=xml))


def test_invalid_xml_and_deep_xml_are_refused(tmp_path: Path) -> None:
    assert "no valid XML" in _refused(_zip(tmp_path / "a.sh3d", Home_xml=b"<home><wall></home>"))
    deep = b"<home>" + b"<g>" * 100 + b"</g>" * 100 + b"</home>"
    assert "levels" in _refused(_zip(tmp_path / "b.sh3d", Home_xml=deep))
    assert "describes no home" in _refused(_zip(tmp_path / "c.sh3d", Home_xml=b"<html/>"))


def test_a_zip_bomb_is_refused_before_it_grows(tmp_path: Path) -> None:
    bomb = b"<home>" + b" " * (31 << 20) + b"</home>"
    assert "fold" in _refused(_zip(tmp_path / "a.sh3d", Home_xml=bomb))


def test_an_entry_that_lies_about_its_size_is_read_only_to_the_limit(tmp_path: Path) -> None:
    path = _zip(tmp_path / "a.sh3d", Home_xml=b"<home/>" + b" " * (40 << 20))
    data = path.read_bytes()
    declared = struct.pack("<L", (40 << 20) + 7)
    path.write_bytes(data.replace(declared, struct.pack("<L", 7)))
    _refused(path)


def test_names_that_leave_the_folder_write_nothing(tmp_path: Path) -> None:
    folder = tmp_path / "inner"
    folder.mkdir()
    evil = {"../evil.obj": b"v 0 0 0", "/tmp/evil.obj": b"v 0 0 0"}
    home = drawn(folder / "a.sh3d", piece("Table", 200, 250, model="../evil.obj"), entries=evil)
    assert home.furnishing.pieces[0].source == "our shape"
    assert [p.name for p in tmp_path.iterdir()] == ["inner"]
    assert [p.name for p in folder.iterdir()] == ["a.sh3d"]


@pytest.mark.parametrize("bad", ["nan", "inf", "-inf", "1e300", "", "abc", "-5"])
def test_a_piece_with_an_invalid_number_is_left_out_alone(tmp_path: Path, bad: str) -> None:
    home = drawn(
        tmp_path / "a.sh3d",
        piece("Broken table", 200, 250, width=bad),
        piece("Table", 200, 350),
        f"<wall xStart='{bad}' yStart='0' xEnd='10' yEnd='nan' thickness='5'/>",
    )
    assert [p.piece.name for p in home.furnishing.pieces] == ["Table"]
    assert any("Broken table" in sentence for sentence in home.plan.left_out)


def test_a_texture_without_content_and_short_coordinates_leave_the_model_usable(
    tmp_path: Path,
) -> None:
    model = (
        b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 1\nvt 0\nvt 0 1 0\nusemtl m\n"
        b"f 1/1 2/1 3/2\nf 1/1 3/1 4/1\nf 1/1 2/1 4/1\nf 2/1 3/1 4/1\n"
    )
    files = {"1/a.obj": model, "1/a.mtl": b"newmtl m\nmap_Kd t.png\n", "1/t.png": b""}
    home = drawn(tmp_path / "a.sh3d", piece("Table", 200, 250, model="1/a.obj"), entries=files)
    assert home.furnishing.pieces[0].source == "own model"


def test_gigantic_furniture_and_walls_are_left_out(tmp_path: Path) -> None:
    home = drawn(
        tmp_path / "a.sh3d",
        piece("Table", 200, 250, (100_000, 80, 75)),
        door(400, 250),
        "<wall xStart='0' yStart='0' xEnd='10' yEnd='0' thickness='90000'/>",
    )
    assert not home.furnishing.pieces
    assert [s for s in home.plan.left_out if "larger than 30 m" in s or "thicker than 30 m" in s]
    assert len(home.plan.left_out) == 2


def test_a_plan_on_whose_furniture_nothing_fits_has_no_things(tmp_path: Path) -> None:
    parts = (TWO_ROOMS, room("Kitchen", LEFT), piece("Side table", 200, 250, (12, 12, 60)))
    path = write_plan(tmp_path / "a.sh3d", parts)
    assert home_of_plan(PlanSource.of(path), 0).objects == ()


def test_zero_sized_furniture_is_left_out(tmp_path: Path) -> None:
    home = drawn(tmp_path / "a.sh3d", piece("Flat table", 200, 250, (100, 0, 75)))
    assert not home.furnishing.pieces
    assert "0" in home.plan.left_out[0]


def test_a_plan_in_another_unit_is_refused(tmp_path: Path) -> None:
    far = "<wall xStart='0' yStart='0' xEnd='90000' yEnd='0' thickness='10'/>"
    path = write_plan(tmp_path / "a.sh3d", (TWO_ROOMS, far, room("Kitchen", LEFT)))
    assert "900 m wide" in _refused(path)


def test_a_plan_without_a_closed_room_says_what_to_draw(tmp_path: Path) -> None:
    stairs = piece("Stairs", 0, 0, (90, 300, 250), staircaseCutOutShape="M0,0")
    assert "neither walls nor rooms" in _refused(write_plan(tmp_path / "a.sh3d", (stairs,)))
    wall = "<wall xStart='0' yStart='0' xEnd='500' yEnd='0' thickness='10'/>"
    assert "no closed room" in _refused(write_plan(tmp_path / "b.sh3d", (wall, stairs)))


def test_a_room_full_of_furniture_has_no_floor_for_the_robot(tmp_path: Path) -> None:
    parts = (TWO_ROOMS, room("Kitchen", LEFT), piece("Box", 400, 250, (790, 490, 200)))
    assert "no free floor" in _refused(write_plan(tmp_path / "a.sh3d", parts))


def _png(width: int, height: int) -> bytes:
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    crc = struct.pack(">I", zlib.crc32(b"IHDR" + head))
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + b"IHDR" + head + crc


@pytest.mark.parametrize("name", ["big.png", "big", "big.webp"])
def test_a_gigantic_texture_is_not_decoded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("it was decoded"))
    model = (
        b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 1\nvt 0 0\nusemtl m\n"
        b"f 1/1 2/1 3/1\nf 1/1 3/1 4/1\nf 1/1 2/1 4/1\nf 2/1 3/1 4/1\n"
    )
    files = {
        "1/a.obj": model,
        "1/a.mtl": f"newmtl m\nKd 1 0 0\nmap_Kd {name}\n".encode(),
        f"1/{name}": _png(60_000, 60_000),
    }
    home = drawn(
        tmp_path / "a.sh3d",
        piece("Table", 200, 250, model="1/a.obj"),
        door(400, 250),
        entries=files,
    )
    placed = home.furnishing.pieces[0]
    assert placed.source == "own model"
    assert all(visual.material.picture is None for visual in placed.shape.visuals)


@pytest.mark.parametrize(
    "model",
    [
        b"",
        b"\x00" * 100,
        b"v nan 0 0\nv 0 1 0\nv 1 0 0\nf 1 2 3\n",
        b"v 0 0 0\nf 1 2 99999\n",
        b"v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n",
        b"v 0 0 0\nv 0 1\nv 1 0 0\nf 1 2 3\n",
        b"v 0 0\nv 0 1\nv 1 0\nf 1 2 3\n",
    ],
)
def test_a_model_that_does_not_load_gives_way_to_our_shape(tmp_path: Path, model: bytes) -> None:
    home = drawn(
        tmp_path / "a.sh3d", piece("Table", 200, 250, model="1/a.obj"), entries={"1/a.obj": model}
    )
    assert home.furnishing.pieces[0].source == "our shape"
    assert "Table" in home.model_failures
    assert home.home.spec().compile() is not None


def test_image_headers() -> None:
    assert pixels_of(_png(7, 5)) == (7, 5)
    assert pixels_of(b"GIF89a" + struct.pack("<HH", 3, 2)) == (3, 2)
    jpeg = io.BytesIO(b"\xff\xd8\xff\xe0\x00\x04ab\xff\xc0\x00\x11\x08\x00\x09\x00\x0b" + b"\0" * 9)
    assert pixels_of(jpeg.getvalue()) == (11, 9)
    assert pixels_of(b"no image") is None


@given(st.binary(max_size=200))
def test_image_headers_of_any_bytes(data: bytes) -> None:
    for start in (b"", b"\xff\xd8", b"\x89PNG\r\n\x1a\n", b"BM", b"GIF89a"):
        pixels_of(start + data)
