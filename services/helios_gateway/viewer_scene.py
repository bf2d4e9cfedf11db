"""Object map as a scene file that viser's page plays.

viser (https://viser.studio) is a maintained viewer of Gaussians. Its own server requires no key, so
the gateway does not start it. The gateway serves viser's page and a scene file (`.viser`), both
behind its keys. viser's scene interface writes the file to a recorder instead of a connection.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from helios_core.errors import Unavailable
from helios_core.map_snapshot import FREE, OCCUPIED, MapView
from numpy.typing import NDArray

from helios_gateway.api_map_models import ObjectInstance
from helios_gateway.gaussian_arrays import ColorBy, Gaussians, colored

if TYPE_CHECKING:
    import viser

MEDIA_TYPE = "application/octet-stream"
# Script inserted before viser's own. It turns the text after # into query parameters, so that one
# fetched page serves all of them, and posts console logs (the camera, with `logCamera`) to the
# parent page.
HEAD = b"""<script>
if (location.hash) history.replaceState(null, "", `${location.pathname}?${location.hash.slice(1)}`);
if (parent !== self) {
  const log = console.log;
  console.log = (...said) => {
    parent.postMessage({ viser: String(said[0]) }, location.origin);
    log(...said);
  };
}
</script>
"""
FREE_RGB, OCCUPIED_RGB, UNKNOWN_RGB = (250, 251, 253), (120, 128, 142), (222, 226, 233)
DRAWN_LARGER = 3.0  # in a view of a whole home, a Gaussian of 1 cm is below one pixel
LEAST_CLASS_SCORE = 0.3  # lowest class score S of a labelled instance


def page() -> bytes:
    """viser's page with `HEAD`: one file that loads from no other host.

    Raises Unavailable if viser is not installed, or its page cannot be read or has no head.
    """
    found = find_spec("viser")
    if found is None or found.origin is None:
        raise Unavailable("the 3D view needs viser; pip install 'helios-ovmm[viewer]'")
    return _with_head(Path(found.origin).parent / "client" / "build" / "index.html")


@cache
def _with_head(path: Path) -> bytes:
    try:
        before, tag, after = path.read_bytes().partition(b"<head>")
    except OSError as error:  # such as an installation from source that was not built
        raise Unavailable(
            f"viser's page {path} cannot be read ({error.strerror}); "
            "pip install 'helios-ovmm[viewer]'"
        ) from error
    if not tag:
        raise Unavailable("this viser's page has no head; pip install 'helios-ovmm[viewer]'")
    return before + tag + HEAD + after


def scene_file(
    gaussians: Gaussians, objects: Iterable[ObjectInstance], ground: MapView | None, by: ColorBy
) -> bytes:
    """Scene file (.viser): coloured Gaussians, labels of the objects, and the map's ground below.

    Raises Unavailable if viser is not installed.
    """
    page()
    recorder = _Recorder()
    scene = recorder.scene
    scene.set_up_direction("+z")
    if ground is not None:
        _add_ground(scene, ground)
    if len(gaussians):
        variances = np.square(DRAWN_LARGER * gaussians.radii_m)[:, None, None]
        scene.add_gaussian_splats(
            "/gaussians",
            centers=gaussians.means_m,
            covariances=variances * np.eye(3, dtype=np.float32),
            rgbs=colored(gaussians, by) / np.float32(255),
            opacities=gaussians.opacities[:, None],
        )
    for found in objects:
        place = _top(found)
        if place is not None and (found.class_score or 0.0) >= LEAST_CLASS_SCORE:
            text = f"{found.class_name} {found.score or 0.0:.2f}"
            scene.add_label(f"/labels/{found.id}", text, position=place, font_screen_scale=0.8)
    return recorder.file()


def _add_ground(scene: viser.SceneApi, ground: MapView) -> None:
    rows, columns = ground.shape
    picture = ground_rgb(ground)
    width_m, height_m = columns * ground.cell_m, rows * ground.cell_m
    x_m, y_m = ground.origin_m
    scene.add_image(
        "/ground",
        picture,
        width_m,
        height_m,
        format="png",
        wxyz=(0.0, 1.0, 0.0, 0.0),  # viser's images face -z, rows along -y
        position=(x_m + width_m / 2, y_m + height_m / 2, -0.02),
    )


def ground_rgb(ground: MapView) -> NDArray[np.uint8]:
    """RGB [rows, columns, 3] of the occupancy grid, first row the largest y."""
    out = np.full((*ground.shape, 3), UNKNOWN_RGB, np.uint8)
    out[ground.occupancy == FREE] = FREE_RGB
    out[ground.occupancy == OCCUPIED] = OCCUPIED_RGB
    return np.ascontiguousarray(out[::-1])


def _top(found: ObjectInstance) -> tuple[float, float, float] | None:
    """Centre of the object's upper face; None if its position is unknown."""
    center, size = found.center_m, found.size_m
    values = [v for v in (*center, size[2]) if v is not None]
    if len(values) < 4:
        return None
    x, y, z, height = values
    return x, y, z + height / 2


class _Recorder:
    """Owner of viser's scene interface that records to a file instead of a connection."""

    client_id = ""

    def __init__(self) -> None:
        import viser
        from viser.infra import WebsockMessageHandler

        class Handler(WebsockMessageHandler):
            def get_message_buffer(self) -> Any:
                return self

            def push(self, _: object) -> None:
                """Do nothing: no client is connected, and the serializer has the message."""

        self._websock_connection = Handler()
        self._viser_server = self
        self._scene_lifecycle_lock = threading.RLock()
        self._serializer = self._websock_connection.get_message_serializer(
            lambda message: message.include_in_scene_serialization
        )
        # A recording needs neither executor nor event loop: both serve clicks.
        self.scene = viser.SceneApi(
            cast(viser.ClientHandle, self),
            cast(ThreadPoolExecutor, None),
            cast(asyncio.AbstractEventLoop, None),
        )

    def file(self) -> bytes:
        return self._serializer.serialize()
