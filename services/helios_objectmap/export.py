"""Export of Gaussians: PLY for 3D Gaussian splatting tools, NPZ, and PNG layers.

The PLY has the properties of the 3DGS reference code in its order and units: log scales, logit
opacity, colour as the first spherical harmonic, quaternions w x y z. Coordinates are in the world
frame.
"""

from __future__ import annotations

import io

import cv2
import numpy as np
from helios_core.errors import InvalidInput
from numpy.typing import NDArray

from helios_objectmap.fusion.semantics import marginal
from helios_objectmap.gaussians import GaussianStore, InstanceGaussians
from helios_objectmap.rendering.renderer_interface import Projection

SH_C0 = 0.28209479177387814  # Y_00: colour = 0.5 + SH_C0 * f_dc
_PROPERTIES = (
    "x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity",
    "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3",
)  # fmt: skip
LAYERS = ("color", "depth", "probability", "uncertainty")
MOST_UNCERTAIN = 0.3  # standard deviation drawn brightest: that of the prior with two classes


def ply(gaussians: InstanceGaussians) -> bytes:
    """Binary little-endian PLY."""
    n = len(gaussians.means)
    table = np.zeros((n, len(_PROPERTIES)), "<f4")
    table[:, 0:3] = gaussians.means
    table[:, 6:9] = (gaussians.color / 255.0 - 0.5) / SH_C0
    opacity = np.clip(gaussians.opacity.astype(np.float64), 1e-4, 1 - 1e-4)
    table[:, 9] = np.log(opacity / (1 - opacity))
    table[:, 10:13] = np.log(gaussians.radius_m)[:, None]
    table[:, 13] = 1.0  # no rotation: spheres
    header = "\n".join(
        [
            "ply",
            "format binary_little_endian 1.0",
            f"element vertex {n}",
            *(f"property float {name}" for name in _PROPERTIES),
            "end_header",
            "",
        ]
    )
    return header.encode("ascii") + table.tobytes()


def npz(gaussians: InstanceGaussians) -> bytes:
    """NPZ of all arrays by name, with the Dirichlet parameters of each class."""
    arrays: dict[str, NDArray] = {
        "means_m": gaussians.means,
        "radius_m": gaussians.radius_m,
        "opacity": gaussians.opacity,
        "color": gaussians.color,
        "instance": gaussians.instance,
        "class_names": np.array(gaussians.class_names),
        "concentration": gaussians.concentration,
    }
    out = io.BytesIO()
    np.savez_compressed(out, allow_pickle=False, **arrays)
    return out.getvalue()


def layer_png(
    projection: Projection,
    store: GaussianStore,
    layer: str,
    class_name: str,
    prior: tuple[float, int],
) -> bytes:
    """PNG of one of `LAYERS`: RGB, or uint16 millimetres for depth.

    The last two layers need a class of the store. prior: concentration of each class, and number of
    classes with "other". Raises InvalidInput.
    """
    rows = projection.rows
    if layer == "color":
        return png(color(projection, store.color[rows]))
    if layer == "depth":
        return png(depth_mm(projection))
    if layer not in LAYERS or class_name not in store.class_names:
        raise InvalidInput(
            f"no picture of layer {layer!r} and class {class_name!r}; wanted one of "
            f"{', '.join(LAYERS)}, and of {', '.join(store.class_names) or 'no class'}"
        )
    column = store.class_names.index(class_name)
    evidence, total = store.class_evidence[rows, column], store.total_evidence[rows, column]
    mean, deviation = marginal(evidence, total, *prior)
    if layer == "probability":
        return png(belief(projection, np.asarray(mean), 1.0))
    return png(belief(projection, deviation, MOST_UNCERTAIN))


def color(projection: Projection, rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """RGB image [h, w, 3] on white. rgb: [k, 3] of `projection.rows`."""
    rendering = projection.render(rgb.astype(np.float32) / np.float32(255))
    image = rendering.features.transpose(1, 2, 0) + (1 - rendering.coverage)[..., None]
    return np.rint(image.clip(0, 1) * 255).astype(np.uint8)


def depth_mm(projection: Projection) -> NDArray[np.uint16]:
    """Depth image [h, w] in millimetres along the optical axis; 0 where nothing is modelled."""
    return np.rint(projection.render().depth_m.clip(0, 65.5) * 1000).astype(np.uint16)


def belief(projection: Projection, values: NDArray[np.floating], most: float) -> NDArray[np.uint8]:
    """RGB image [h, w, 3] from dark (0) to yellow (`most`), on white. values: [k]."""
    rendering = projection.render(values.astype(np.float32)[:, None])
    share = np.divide(
        rendering.features[0],
        rendering.coverage,
        out=np.zeros_like(rendering.coverage),
        where=rendering.coverage > 1e-3,
    )
    level = np.rint((share / most).clip(0, 1) * 255).astype(np.uint8)
    tint = cv2.applyColorMap(level, cv2.COLORMAP_VIRIDIS)[..., ::-1].astype(np.float32)
    cover = rendering.coverage[..., None]
    return np.rint(tint * cover + 255 * (1 - cover)).clip(0, 255).astype(np.uint8)


def png(image: NDArray[np.uint8] | NDArray[np.uint16]) -> bytes:
    """PNG of an image: [h, w, 3] RGB or [h, w] grey."""
    ok, data = cv2.imencode(".png", image[..., ::-1] if image.ndim == 3 else image)
    if not ok:
        raise RuntimeError("the image could not be written as PNG")
    return data.tobytes()
