"""Details, rendered views and exports of objects."""

from __future__ import annotations

import io
import math

import numpy as np
import pytest
from fastapi.testclient import TestClient
from helios_core.geometry import is_rigid, project
from helios_gateway.object_viewpoint import camera, look_at
from hypothesis import given
from hypothesis import strategies as st

from tests.gateway_backend import Backend

metres = st.floats(0.02, 3.0)


@given(
    center=st.tuples(*[st.floats(-20, 20)] * 3),
    size=st.tuples(metres, metres, metres),
    azimuth_rad=st.floats(-7, 7),
)
def test_the_rendered_view_contains_the_whole_box_upright(
    center: tuple[float, ...], size: tuple[float, ...], azimuth_rad: float
) -> None:
    T_world_cam = look_at(np.array(center), np.array(size), azimuth_rad)
    assert is_rigid(T_world_cam)
    assert T_world_cam[2, 1] < 0  # the camera's y axis points down
    lens = camera(320)
    corners = np.array(center) + np.array(size) / 2 * [
        [i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)
    ]
    pixels, depth_m = project(corners, lens, T_world_cam)
    assert (depth_m > 0).all()
    assert (pixels > 0).all()
    assert (pixels < 319).all()


def test_an_object_is_reported_with_its_history(backend: Backend, client: TestClient) -> None:
    detail = client.get("/v1/objects/1/detail").json()
    assert detail["object"]["class"] == "mug"
    assert [m["views"] for m in detail["history"]] == [1, 2, 3, 4, 5]
    assert detail["history"][-1]["score"] == detail["object"]["score"]


def test_the_points_file_contains_points_and_the_bounding_box(
    backend: Backend, client: TestClient
) -> None:
    answer = client.get("/v1/objects/1/points.npz")
    with np.load(io.BytesIO(answer.content)) as arrays:
        assert np.allclose(arrays["points_m"], [[1.0, 2.0, 0.5], [1.1, 2.0, 0.5]])
        box = client.get("/v1/objects/1/detail").json()
        assert arrays["box_center_m"].tolist() == pytest.approx(box["box_center_m"])
        assert arrays["box_size_m"].shape == (3,)


def test_an_object_is_rendered_from_the_robot_side_or_a_requested_azimuth(
    backend: Backend, client: TestClient
) -> None:
    def camera_at(query: str = "") -> np.ndarray:
        answer = client.get(f"/v1/objects/1/view.png{query}")
        assert answer.headers["content-type"] == "image/png"
        assert backend.rendered is not None
        assert backend.rendered.class_name == "mug"
        return np.array(backend.rendered.T_world_cam.rows).reshape(4, 4)[:2, 3]

    mug = np.array([1.55, 1.45])
    to_robot = np.array(backend.pose[:2]) - mug
    offset = camera_at() - mug
    assert math.atan2(*offset[::-1]) == pytest.approx(math.atan2(*to_robot[::-1]))
    offset = camera_at(f"?azimuth_rad={math.pi / 2}&layer=uncertainty&size_px=64") - mug
    assert offset[0] == pytest.approx(0, abs=1e-9)
    assert backend.rendered is not None
    assert (backend.rendered.layer, backend.rendered.camera.width) == ("uncertainty", 64)


@pytest.mark.parametrize("layer", ["color", "depth", "probability", "uncertainty"])
def test_the_map_is_rendered_from_any_pose(
    backend: Backend, client: TestClient, layer: str
) -> None:
    where = f"x_m=1.5&y_m=-2&z_m=1.2&yaw_rad={math.pi / 2}&down_rad=0.3&fov_rad={math.pi / 2}"
    answer = client.get(f"/v1/map/view.png?{where}&width_px=64&layer={layer}&class=mug")
    assert (answer.status_code, answer.headers["content-type"]) == (200, "image/png")
    asked = backend.rendered
    assert asked is not None
    assert (asked.layer, asked.class_name) == (layer, "mug")
    T_world_cam = np.array(asked.T_world_cam.rows).reshape(4, 4)
    assert T_world_cam[:3, 3] == pytest.approx([1.5, -2.0, 1.2])
    assert T_world_cam[:3, 2] == pytest.approx([0.0, math.cos(0.3), -math.sin(0.3)], abs=1e-9)
    assert asked.camera.fx == pytest.approx(32.0)
    assert client.get("/v1/map/view.png?x_m=nan&y_m=0").status_code in (400, 422)


@pytest.mark.parametrize("query", ["width_px=16&height_px=1280&fov_rad=2.5", "width_px=4000"])
def test_a_camera_that_cannot_exist_is_a_wrong_request(
    backend: Backend, client: TestClient, query: str
) -> None:
    answer = client.get(f"/v1/map/view.png?x_m=0&y_m=0&{query}")
    assert answer.status_code == 400
    assert "width_px" in answer.json()["detail"]
    assert backend.rendered is None


def test_gaussians_are_exported_and_an_unknown_object_gets_status_404(
    backend: Backend, client: TestClient
) -> None:
    for path in (
        "/v1/objects.ply",
        "/v1/objects.npz",
        "/v1/objects/1/gaussians.ply",
        "/v1/objects/1/gaussians.npz",
    ):
        answer = client.get(path)
        assert (answer.status_code, answer.headers["x-gaussians"]) == (200, "7")
        again = client.get(path, headers={"if-none-match": answer.headers["etag"]})
        assert again.status_code == 304
    for path in ("detail", "view.png", "gaussians.ply", "gaussians.npz", "points.npz"):
        assert client.get(f"/v1/objects/77/{path}").status_code == 404
