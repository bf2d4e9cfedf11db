"""Conversion of the object map's Gaussians to a point cloud. No I/O."""

from __future__ import annotations

import numpy as np
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from numpy.typing import NDArray

from helios_core import proto as pb
from helios_core.errors import InvalidInput
from helios_core.recording_format import GAUSSIANS
from helios_core.viewing.entry import Entry
from helios_core.viewing.foxglove_scene import WORLD, pose, stamp
from helios_core.viewing.map_entries import RGBA, name_fields

SPLAT = np.dtype(
    [
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),  # mean (m)
        *RGBA,  # observed colour; alpha is the opacity
        ("radius", "<f4"),  # one standard deviation (m)
        ("probability", "<f4"),  # of the most likely class, 0 to 1
        ("object", "<u4"),  # id of its object; 0: of none
    ]
)


def gaussian_entry(reply: pb.GaussiansReply, stamp_ns: int) -> Entry:
    """Point for each Gaussian with the fields of `SPLAT`, in the frame `world`.

    Raises InvalidInput if the array lengths of the reply do not match.
    """
    points = splats(reply)
    out = PointCloud(
        timestamp=stamp(stamp_ns),
        frame_id=WORLD,
        pose=pose((0.0, 0.0, 0.0)),
        point_stride=SPLAT.itemsize,
        data=points.tobytes(),
    )
    name_fields(out, SPLAT)
    return Entry(GAUSSIANS, out)


def splats(reply: pb.GaussiansReply) -> NDArray[np.void]:
    """Finite Gaussians of a reply, [n] of `SPLAT`. Raises InvalidInput, as `gaussian_entry`."""
    n = reply.count
    out = np.zeros(n, SPLAT)
    try:
        means_m = np.frombuffer(reply.means_m, "<f4").reshape(n, 3)
        out["x"], out["y"], out["z"] = means_m.T
        out["red"], out["green"], out["blue"] = np.frombuffer(reply.colors, "u1").reshape(n, 3).T
        out["radius"] = np.frombuffer(reply.scales_m, "<f4").reshape(n)
        opacities = np.frombuffer(reply.opacities, "<f4").reshape(n)
        out["object"] = np.frombuffer(reply.instances, "<u4").reshape(n)
        classes = len(reply.class_names)
        evidence = np.frombuffer(reply.concentration, "<f4").reshape(n, classes)
    except ValueError as error:
        raise InvalidInput(f"the object map sent Gaussians that do not fit: {error}") from error
    out["alpha"] = np.rint(255 * np.clip(np.nan_to_num(opacities), 0, 1))
    if n and classes:
        total = np.maximum(evidence.sum(axis=1), np.finfo(np.float32).tiny)
        out["probability"] = np.clip(np.nan_to_num(evidence.max(axis=1) / total), 0, 1)
    return out[np.isfinite(means_m).all(axis=1) & np.isfinite(out["radius"])]
