"""The 3D view: its colour modes, a scene that viser reads, and no access without a key."""

from __future__ import annotations

import io
from pathlib import Path
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
import zstandard
from fastapi.testclient import TestClient
from helios_client.commands.api_keys import add_key
from helios_core import proto as pb
from helios_core.errors import DeadlineExceeded, HeliosError, Internal, Unavailable
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import SNAPSHOT
from helios_gateway import viewer_scene
from helios_gateway.bus_listener import RobotMonitor
from helios_gateway.class_colors import class_rgb
from helios_gateway.gaussian_arrays import OTHER_RGB, Gaussians, colored
from helios_gateway.robot_registry import RobotEndpoint, RobotRegistry
from helios_gateway.settings import Settings
from helios_gateway.web_app import create_app
from hypothesis import given
from hypothesis import strategies as st

from tests.gateway_backend import Backend
from tests.gateway_home import gaussians as reply_of


def arrays_of(concentration: list[list[float]]) -> Gaussians:
    n = len(concentration)
    return Gaussians(
        np.zeros((n, 3), np.float32),
        np.full(n, 0.02, np.float32),
        np.full((n, 3), 9, np.uint8),
        np.ones(n, np.float32),
        np.array(concentration, np.float32),
        ("other", "mug", "sofa"),
    )


def messages(scene: bytes) -> list[dict]:
    """The messages of a .viser file: length, then zstd of length, msgpack, arrays."""
    inner = zstandard.ZstdDecompressor().stream_reader(io.BytesIO(scene[8:])).read()
    end = 8 + int.from_bytes(inner[:8], "little")
    return [message for _, message in msgspec.msgpack.decode(inner[8:end])["messages"]]


def test_each_class_has_its_colour_and_the_other_class_is_grey() -> None:
    rgb = colored(arrays_of([[1, 5, 1], [1, 1, 5], [5, 1, 1]]), "class")
    assert [tuple(row) for row in rgb.tolist()] == [class_rgb("mug"), class_rgb("sofa"), OTHER_RGB]


@given(st.floats(0.1, 50), st.floats(0.1, 50))
def test_a_higher_class_probability_is_nearer_to_yellow(less: float, more: float) -> None:
    less, more = sorted((less, more))
    low, high = colored(arrays_of([[1, 1 + less, 1], [1, 1 + more, 1]]), "probability").astype(int)
    assert high[1] >= low[1], "viridis' green rises all the way"


def test_more_evidence_at_the_same_probability_is_less_uncertain() -> None:
    seldom, often = colored(arrays_of([[1, 3, 1], [100, 300, 100]]), "uncertainty").astype(int)
    assert seldom[1] > often[1]


def test_arrays_of_inconsistent_size_raise_an_internal_error() -> None:
    reply = reply_of(Backend(MemoryHub()).found)
    reply.count += 1
    with pytest.raises(Internal, match="do not fit"):
        Gaussians.of(reply)


def test_a_scene_contains_gaussians_ground_and_labels(client: TestClient, backend: Backend) -> None:
    seen = {}
    for by in ("color", "class", "probability", "uncertainty"):
        answer = client.get("/v1/objects.viser", params={"color": by})
        assert answer.headers["x-gaussians"] == str(40 * (7 + 12 + 5 + 2))
        reported = messages(answer.content)
        named = {m["name"]: m for m in reported if "name" in m}
        assert named["/labels/2"]["type"] == "SetSceneNodeVisibilityMessage"
        assert "coffee table 0.82" in str(reported)
        assert {"/gaussians", "/ground"} <= set(named)
        seen[by] = answer.content
    assert len(set(seen.values())) == 4
    assert client.get("/v1/objects.viser?color=taste").status_code == 400


@pytest.mark.parametrize("error", [DeadlineExceeded, Internal, Unavailable])
def test_a_scene_without_an_answer_of_the_2d_map_has_no_ground(
    client: TestClient, backend: Backend, error: type[HeliosError]
) -> None:
    def fail(_: pb.SnapshotRequest) -> pb.MapSnapshot:
        raise error("it hangs")

    backend.bus.serve(SNAPSHOT, fail)
    answer = client.get("/v1/objects.viser")
    assert answer.status_code == 200
    named = {m.get("name") for m in messages(answer.content)}
    assert "/gaussians" in named
    assert "/ground" not in named


def test_a_scene_is_built_once_per_version_and_unchanged_gets_status_304(
    client: TestClient, backend: Backend, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = []
    real = viewer_scene.scene_file
    monkeypatch.setattr(viewer_scene, "scene_file", lambda *a: made.append(1) or real(*a))
    first = client.get("/v1/objects.viser?color=class")
    again = client.get("/v1/objects.viser?color=class")
    assert (len(made), first.content) == (1, again.content)
    tag = {"if-none-match": first.headers["etag"]}
    assert client.get("/v1/objects.viser?color=class", headers=tag).status_code == 304
    backend.change_objects()
    client.get("/v1/objects.viser?color=class")
    assert len(made) == 2


def test_the_page_connects_only_to_this_gateway(client: TestClient) -> None:
    page = client.get("/v1/view3d")
    assert page.headers["content-type"].startswith("text/html")
    policy = page.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "http" not in policy
    assert page.text.index("parent.postMessage") < page.text.index("</title>"), "before viser's"


def test_the_3d_view_needs_a_key(
    hub: MemoryHub, backend: Backend, live: RobotMonitor, tmp_path: Path
) -> None:
    file = tmp_path / "keys.toml"
    key = add_key(file, "tablet", "read")
    fleet = RobotRegistry({"robot": RobotEndpoint(MemoryBus(hub), live)})
    app = create_app(fleet, Settings.load(["--keys", str(file)]))
    client = TestClient(app, "http://localhost")
    for path in ("/v1/view3d", "/v1/objects.viser"):
        assert client.get(path).status_code == 401
        assert client.get(path, headers={"authorization": f"Bearer {key}"}).status_code == 200


def test_a_missing_viser_package_is_reported_with_the_extra_to_install(
    client: TestClient, backend: Backend, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(viewer_scene, "find_spec", lambda _: None)
    for path in ("/v1/view3d", "/v1/objects.viser"):
        answer = client.get(path)
        assert answer.status_code == 503
        assert "helios-ovmm[viewer]" in answer.json()["detail"]


def test_a_viser_package_without_its_page_is_reported_with_the_extra_to_install(
    client: TestClient, backend: Backend, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    from_source = SimpleNamespace(origin=str(tmp_path / "__init__.py"))
    monkeypatch.setattr(viewer_scene, "find_spec", lambda _: from_source)
    for path in ("/v1/view3d", "/v1/objects.viser"):
        answer = client.get(path)
        assert answer.status_code == 503
        assert "helios-ovmm[viewer]" in answer.json()["detail"]
