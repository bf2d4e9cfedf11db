"""Saving and loading both maps as one file."""

from __future__ import annotations

import contextlib
import io
import json
import tracemalloc
import zipfile
from pathlib import Path
from typing import NoReturn

import pytest
from fastapi.testclient import TestClient
from helios_client.commands.api_keys import add_key
from helios_core import proto as pb
from helios_core.errors import DeadlineExceeded, InvalidInput, Unavailable
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import LOAD_MAP2D, LOAD_OBJECTS, Method
from helios_gateway.bus_listener import RobotMonitor
from helios_gateway.map_archive import MapFile, packed, unpacked
from helios_gateway.robot_registry import RobotEndpoint, RobotRegistry
from helios_gateway.settings import Settings
from helios_gateway.web_app import create_app
from hypothesis import given
from hypothesis import strategies as st

from tests.gateway_backend import Backend

ZIP = {"content-type": "application/zip"}


def rezipped(**changes: bytes | None) -> bytes:
    """A map file with changed entries; an entry of None is left out."""
    entries = {"helios-map.json": b'{"format": 1}', "map2d.map": b"a", "objects.npz": b"b"}
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in (entries | {k.replace("__", "."): v for k, v in changes.items()}).items():
            if data is not None:
                archive.writestr(f"home/{name}", data)
    return stream.getvalue()


@given(st.binary(max_size=200), st.binary(max_size=200))
def test_a_packed_map_file_is_unpacked_unchanged(map2d: bytes, objects: bytes) -> None:
    maps = MapFile(map2d, objects)
    assert unpacked(packed(maps, "robot"), 10_000) == maps
    assert packed(maps, "robot") == packed(maps, "robot")


@given(st.binary(max_size=300), st.integers(0, 200))
def test_an_invalid_map_file_raises_at_most_a_typed_error(junk: bytes, at: int) -> None:
    good = packed(MapFile(b"walls", b"things"), "robot")
    for data in (junk, good[:at], good[:at] + junk + good[at:]):
        with contextlib.suppress(InvalidInput):
            unpacked(data, 10_000)


def test_a_rezipped_folder_is_a_valid_map_file() -> None:
    assert unpacked(rezipped(), 10_000) == MapFile(b"a", b"b")


def with_damaged_member(method: int) -> bytes:
    """A ZIP with valid directory whose first member is damaged."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as archive:
        archive.writestr("helios-map.json", b'{"format": 1, "robot": "sim"}' * 20)
    data = bytearray(stream.getvalue())
    data[50:70] = bytes(20)
    return bytes(data)


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (rezipped(objects__npz=None), "wanted map2d.map and objects.npz"),
        (rezipped(map2d__map=None), "wanted map2d.map and objects.npz"),
        (rezipped(**{"helios-map.json": b'{"format": 2}'}), "reads format 1"),
        (rezipped(**{"helios-map.json": None}), "helios map save"),
        (rezipped(map2d__map=bytes(20_000)), "larger than 10000 bytes"),
        (with_damaged_member(zipfile.ZIP_DEFLATED), "helios map save"),
        (with_damaged_member(zipfile.ZIP_LZMA), "ZIP method 14; wanted stored or deflated"),
    ],
)
def test_an_unusable_map_file_is_refused_with_the_reason(data: bytes, says: str) -> None:
    with pytest.raises(InvalidInput, match=says):
        unpacked(data, 10_000)


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_a_map_file_whose_sizes_are_forged_is_refused_before_unpacking(method: int) -> None:
    size, stream = 50_000_000, io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as archive:
        archive.writestr("helios-map.json", '{"format": 1}')
        archive.writestr("map2d.map", bytes(size))
        archive.writestr("objects.npz", b"x")
    data = stream.getvalue().replace(size.to_bytes(4, "little"), (10).to_bytes(4, "little"))
    tracemalloc.start()
    try:
        with pytest.raises(InvalidInput, match=f"ZIP method {method}; .*zip the files anew"):
            unpacked(data, 1000)
        assert tracemalloc.get_traced_memory()[1] < 5_000_000
    finally:
        tracemalloc.stop()


def test_a_saved_map_can_be_loaded_again(client: TestClient, backend: Backend) -> None:
    saved = client.get("/v1/map.zip")
    assert saved.headers["content-type"] == "application/zip"
    with zipfile.ZipFile(io.BytesIO(saved.content)) as archive:
        assert set(archive.namelist()) == {"helios-map.json", "map2d.map", "objects.npz"}
        assert json.loads(archive.read("helios-map.json"))["robot"] == "robot"
    backend.kept = {"map2d": b"other walls", "objects": b"other things"}
    loaded = client.put("/v1/map.zip", content=saved.content, headers=ZIP)
    assert loaded.json() == {
        "known_m2": 40.0,
        "occupied_m2": 8.0,
        "views": 3,
        "objects": 4,
        "gaussians": 5120,
        "stored": False,
    }
    assert backend.kept == {"map2d": b"walls", "objects": b"things"}


def test_the_map_for_ros_is_two_files_of_one_version(client: TestClient, backend: Backend) -> None:
    backend.kept["map2d"] = b"as map2d says it"
    answer = client.get("/v1/map/ros.zip")
    assert answer.status_code == 200
    with zipfile.ZipFile(io.BytesIO(answer.content)) as files:
        reported = {name: files.read(name) for name in files.namelist()}
    assert reported == dict.fromkeys(("map.pgm", "map.yaml"), b"as map2d says it")


def test_both_maps_are_loaded_or_neither(client: TestClient, backend: Backend) -> None:
    saved = client.get("/v1/map.zip").content
    backend.kept = {"map2d": b"present walls", "objects": b"present things"}
    backend.refuses_maps = InvalidInput("the file is of cells of 0.1 m")
    answer = client.put("/v1/map.zip", content=saved, headers=ZIP)
    assert (answer.status_code, answer.json()["detail"]) == (400, "the file is of cells of 0.1 m")
    assert backend.kept == {"map2d": b"present walls", "objects": b"present things"}


def test_no_map_is_loaded_while_a_task_is_open(client: TestClient, backend: Backend) -> None:
    saved = client.get("/v1/map.zip").content
    backend.submit("move the mug to the kitchen counter")
    for state in ("queued", "running", "paused"):
        backend.change_task("t1", state)
        answer = client.put("/v1/map.zip", content=saved, headers=ZIP)
        assert answer.status_code == 409
        assert f"t1 is {state}" in answer.json()["detail"]
    backend.change_task("t1", "succeeded")
    assert client.put("/v1/map.zip", content=saved, headers=ZIP).status_code == 200


@pytest.mark.parametrize("refused", [False, True])
def test_the_planner_is_reserved_only_while_maps_are_loaded(
    client: TestClient, hub: MemoryHub, backend: Backend, refused: bool
) -> None:
    saved = client.get("/v1/map.zip").content
    reserved: list[str] = []

    def load(request: pb.ObjectMapFile) -> pb.ObjectMapLoaded:
        reserved.append(backend.reserved)
        backend.submit("move the mug to the kitchen counter")  # stays queued: no task starts now
        return pb.ObjectMapLoaded()

    def load_map2d(_: pb.LoadMap2DRequest) -> pb.LoadMap2DReply:
        reserved.append(backend.reserved)
        if refused:
            raise InvalidInput("the file is of cells of 0.1 m")
        return pb.LoadMap2DReply()

    MemoryBus(hub).serve(LOAD_OBJECTS, load)
    MemoryBus(hub).serve(LOAD_MAP2D, load_map2d)
    answer = client.put("/v1/map.zip", content=saved, headers=ZIP)
    assert answer.status_code == (400 if refused else 200), answer.text
    assert set(reserved) == {"the maps are being loaded"}
    assert backend.reserved == ""


@pytest.mark.parametrize("method", [LOAD_OBJECTS, LOAD_MAP2D])
def test_a_load_without_an_answer_reports_an_unknown_outcome(
    client: TestClient, hub: MemoryHub, backend: Backend, method: Method
) -> None:
    saved = client.get("/v1/map.zip").content

    def late(_: object) -> NoReturn:
        raise DeadlineExceeded("no answer came in 60 s")

    MemoryBus(hub).serve(method, late)
    answer = client.put("/v1/map.zip", content=saved, headers=ZIP)
    assert (answer.status_code, "is not known" in answer.json()["detail"]) == (504, True)


def test_the_reason_of_a_refused_load_is_reported_even_if_the_rollback_fails(
    client: TestClient, hub: MemoryHub, backend: Backend
) -> None:
    saved = client.get("/v1/map.zip").content
    backend.refuses_maps = InvalidInput("the file is of cells of 0.1 m")
    loads: list[bytes] = []

    def load_once(request: pb.ObjectMapFile) -> pb.ObjectMapLoaded:
        loads.append(request.data)
        if len(loads) > 1:
            raise Unavailable("the object map is away")
        return pb.ObjectMapLoaded()

    MemoryBus(hub).serve(LOAD_OBJECTS, load_once)
    answer = client.put("/v1/map.zip", content=saved, headers=ZIP)
    assert answer.status_code == 400
    detail = answer.json()["detail"]
    assert detail.startswith("the file is of cells of 0.1 m; ")
    assert "the object map is away" in detail


def test_a_body_that_is_not_a_map_file_gets_status_400(
    client: TestClient, backend: Backend
) -> None:
    answer = client.put("/v1/map.zip", content=b"walls", headers=ZIP)
    assert answer.status_code == 400
    assert "helios map save" in answer.json()["detail"]


def test_a_map_upload_has_its_own_size_limit_and_needs_the_admin_scope(
    hub: MemoryHub, backend: Backend, live: RobotMonitor, tmp_path: Path
) -> None:
    file = tmp_path / "keys.toml"
    keys = {scope: add_key(file, scope, scope) for scope in ("read", "task", "robot", "admin")}
    flags = ["--keys", str(file), "--body-limit-bytes", "10", "--map-limit-bytes", "2000"]
    app = create_app(
        RobotRegistry({"robot": RobotEndpoint(MemoryBus(hub), live)}), Settings.load(flags)
    )
    client = TestClient(app, "http://localhost")

    def sent(scope: str, data: bytes) -> int:
        headers = ZIP | {"authorization": f"Bearer {keys[scope]}"}
        assert client.get("/v1/map.zip", headers=headers).status_code == 200
        return client.put("/v1/map.zip", content=data, headers=headers).status_code

    data = packed(MapFile(b"walls", b"things"), "robot")
    assert [sent(scope, data) for scope in keys] == [403, 403, 403, 200]
    assert sent("admin", bytes(2001)) == 413
